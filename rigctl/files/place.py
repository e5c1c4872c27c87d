"""Places in rig and scene files: the site on the Earth, the camera as seen from the target, and their errors."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from rigctl.files.toml import NotNegative, Section, Uncertain, Within, with_std_apart

NotBelow0 = Annotated[float, Field(ge=0)]

FloatArray = NDArray[np.float64]

# Largest difference between the two correlations of a pair, and rounding of an eigenvalue.
_SAME, _SINGULAR = 1e-9, 1e-9
# Least share of the singular direction in a parameter for its mention.
_TAKES_PART = 0.1


@dataclass(frozen=True, kw_only=True)
class Place:
    """A place on the Earth, or its error; north and east are positive."""

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
    """Place of the camera as seen from the target, and its roll.

    Its azimuth is given either clockwise from north, or as phi: azimuth of the sun minus that of the camera, 180 where
    the camera looks toward the sun's side. Roll is counter-clockwise as the camera sees the scene.
    """

    camera_zenith_deg: Annotated[Uncertain, Within(ge=0, lt=90)]
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


class PointingSection(Section):
    """Correlation of the errors of the camera's and the panels' angles, from `rigctl calibrate pointing --write`.

    Tilts of panels from a picture depend on the camera's direction, so their errors are correlated. Each number has its
    own standard uncertainty.
    """

    parameters: Annotated[tuple[str, ...], Field(min_length=2)]
    """Angles with a std of their own. Example: `["geometry.camera_zenith_deg", "regions.black_panel.tilt_deg"]`."""
    correlation: tuple[tuple[Annotated[float, Field(ge=-1, le=1)], ...], ...]
    """Correlation of their errors, a row for each. Example: `[[1.0, 0.8], [0.8, 1.0]]`."""

    @model_validator(mode="after")
    def _is_correlation(self) -> "PointingSection":
        count = len(self.parameters)
        if len(set(self.parameters)) < count:
            raise ValueError("parameters names one twice")
        if len(self.correlation) != count or any(len(row) != count for row in self.correlation):
            raise ValueError(f"correlation needs {count} rows of {count} numbers, one for each of parameters")
        found = np.array(self.correlation)
        if np.any(np.abs(np.diag(found) - 1.0) > _SAME):
            raise ValueError("correlation is not 1 on its diagonal; standard uncertainties belong to the numbers")
        for i, j in zip(*np.nonzero(np.abs(found - found.T) > _SAME), strict=True):
            raise ValueError(
                f"correlation is not symmetric: [{i}][{j}] is {found[i, j]:g}, [{j}][{i}] is {found[j, i]:g}"
            )
        self._require_definite(found)
        return self

    def _require_definite(self, correlation: FloatArray) -> None:
        values, vectors = np.linalg.eigh(correlation)
        if values[0] > _SINGULAR:
            return
        strongest = np.argsort(-np.abs(vectors[:, 0]), kind="stable")
        names = ", ".join(self.parameters[k] for k in strongest if abs(vectors[k, 0]) > _TAKES_PART)
        if values[0] < -_SINGULAR:
            raise ValueError(f"correlation is impossible: {names} contradict (eigenvalue {values[0]:.2g})")
        raise ValueError(
            f"correlation is singular: one of {names} would be known exactly from the others; leave one out, or use a "
            "smaller correlation"
        )
