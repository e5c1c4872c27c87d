"""Places: the site on the Earth, and the camera as the target sees it. Rig and scene files share them."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from rigctl.files.config import Allowed, NotNegative, Section, Uncertain, with_std_apart

NotBelow0 = Annotated[float, Field(ge=0)]


def _zenith(number: Uncertain) -> Uncertain:
    if not 0.0 <= number.value < 90.0:
        raise ValueError(f"is {number.value:g}, must lie in [0, 90)")
    return number


@dataclass(frozen=True, kw_only=True)
class Place:
    """A place on the Earth, or how far one may be from it; north and east are positive."""

    latitude_deg: float
    longitude_deg: float
    elevation_m: float


class SiteSection(Section):
    """A place on the Earth; north and east are positive.

    Each number may be given as ``{value = 43.1, std = 0.05}``; a prediction then allows for the sun that this moves.
    """

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    """Latitude, north positive. Example: `43.08`."""
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]
    """Longitude, east positive. Example: `-77.67`."""
    elevation_m: Annotated[float, Field(ge=-500, le=9000)] = 0.0
    """Height above the sea. Example: `160.0`."""
    latitude_std_deg: NotBelow0 = 0.0
    """Standard uncertainty of the latitude. Example: `0.01`."""
    longitude_std_deg: NotBelow0 = 0.0
    """Standard uncertainty of the longitude. Example: `0.01`."""
    elevation_std_m: NotBelow0 = 0.0
    """Standard uncertainty of the height. Example: `10.0`."""

    @model_validator(mode="before")
    @classmethod
    def _stds_apart(cls, given: object) -> object:
        return with_std_apart(given, "latitude_deg", "longitude_deg", "elevation_m")

    @property
    def place(self) -> Place:
        """The place alone."""
        return Place(latitude_deg=self.latitude_deg, longitude_deg=self.longitude_deg, elevation_m=self.elevation_m)

    @property
    def std(self) -> Place:
        """The standard uncertainties of the place."""
        return Place(
            latitude_deg=self.latitude_std_deg, longitude_deg=self.longitude_std_deg, elevation_m=self.elevation_std_m
        )

    @property
    def is_uncertain(self) -> bool:
        """True if any of its numbers has a standard uncertainty."""
        return self.std != Place(latitude_deg=0.0, longitude_deg=0.0, elevation_m=0.0)


class GeometrySection(Section):
    """Place of the camera as seen from the target, and how it is held.

    Its azimuth is given either clockwise from north, or as phi: azimuth of the sun minus that of the camera, 180 where
    the camera looks toward the sun's side. Roll is counter-clockwise as the camera sees the scene.
    """

    camera_zenith_deg: Annotated[Uncertain, AfterValidator(_zenith), Allowed("from 0, below 90")]
    """Angle of the camera from the target's zenith, below 90. Example: `45.0`."""
    camera_azimuth_deg: Uncertain | None = None
    """Azimuth of the camera as seen from the target, clockwise from north. Example: `180.0`."""
    phi_deg: Uncertain | None = None
    """Azimuth of the sun minus that of the camera, 180 toward the sun; in place of the azimuth. Example: `180.0`."""
    camera_roll_deg: Uncertain = Uncertain(value=0.0)
    """Roll of the camera, counter-clockwise as it sees the scene. Example: `0.0`."""
    camera_height_m: NotNegative = Uncertain(value=0.0)
    """Height of the camera over the ground. Example: `30.0`."""

    @model_validator(mode="after")
    def _one_azimuth(self) -> "GeometrySection":
        if (self.camera_azimuth_deg is None) == (self.phi_deg is None):
            raise ValueError("needs exactly one of camera_azimuth_deg and phi_deg")
        return self
