"""The tables of a scene file that say what light there is: sun, atmosphere, field of view, the sensor's response."""

from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, AwareDatetime, Field, model_validator

from model.atmosphere.aerosols import AerosolChoice, AerosolType
from model.atmosphere.layers import AerosolKind
from model.atmosphere.sky import Fidelity
from model.scene.field import TileRule
from rigctl.files.aerosol_section import OwnAerosolSection
from rigctl.files.config import Allowed, NotNegative, Positive, Section, Uncertain

Number = Annotated[float, Field(strict=True)]
# The tables of aerosols end there, and the widest field that a flat sensor is taken for.
HUMIDITY_MOST, FIELD_MOST_DEG = 0.8, 170.0


def _share(number: Uncertain) -> Uncertain:
    if not 0.0 <= number.value <= 1.0:
        raise ValueError(f"is {number.value:g}, must lie in [0, 1]")
    return number


def _humidity(number: Uncertain) -> Uncertain:
    if not 0.0 <= number.value <= HUMIDITY_MOST:
        raise ValueError(f"is {number.value:g}, must lie in [0, {HUMIDITY_MOST:g}]")
    return number


def _field_angle(number: Uncertain) -> Uncertain:
    if not 0.0 < number.value < FIELD_MOST_DEG:
        raise ValueError(f"is {number.value:g}, must lie in (0, {FIELD_MOST_DEG:g})")
    return number


Share = Annotated[Uncertain, AfterValidator(_share), Allowed("from 0, to 1")]
Humidity = Annotated[Uncertain, AfterValidator(_humidity), Allowed(f"from 0, to {HUMIDITY_MOST:g}")]
FieldAngle = Annotated[Uncertain, AfterValidator(_field_angle), Allowed(f"above 0, below {FIELD_MOST_DEG:g}")]


class ResponseSection(Section):
    """Relative response of the sensor, 1 at its peak: linear between the points, 0 beyond."""

    wavelength_nm: Annotated[list[Number], Field(min_length=2)]
    """Rising wavelengths. Example: `[400.0, 550.0, 700.0]`."""
    response: Annotated[list[Annotated[Number, Field(ge=0, le=1)]], Field(min_length=2)]
    """Relative response there, 1 at its peak: linear between, 0 beyond. Example: `[0.2, 1.0, 0.3]`."""

    @model_validator(mode="after")
    def _table(self) -> "ResponseSection":
        if len(self.wavelength_nm) != len(self.response):
            raise ValueError(f"has {len(self.wavelength_nm)} wavelengths and {len(self.response)} values")
        if sorted(set(self.wavelength_nm)) != self.wavelength_nm:
            raise ValueError("wavelength_nm must rise")
        return self


class SunSection(Section):
    """The sun by its angles, or by a time (with its zone) at the scene's site.

    `distance_factor` is the irradiance outside the atmosphere over that at the mean distance; a day says it too.
    """

    zenith_deg: NotNegative | None = None
    """Angle of the sun from the zenith; in place of a time. Example: `40.0`."""
    azimuth_deg: Uncertain | None = None
    """Azimuth of the sun, clockwise from north. Example: `180.0`."""
    day_of_year: Annotated[float, Field(ge=1, lt=367)] | None = None
    """Day, which says the distance of the sun. Example: `172.0`."""
    distance_factor: Positive | None = None
    """Irradiance outside the atmosphere over that at the mean distance. Example: `0.97`."""
    time: AwareDatetime | None = None
    """Time with its zone, which says where the sun stands at the site. Example: `2026-06-21T12:00:00+02:00`."""

    @model_validator(mode="after")
    def _angles_or_time(self) -> "SunSection":
        if (self.zenith_deg is None) == (self.time is None):
            raise ValueError("needs exactly one of zenith_deg and time")
        if self.time is not None and (self.azimuth_deg is not None or self.day_of_year is not None):
            raise ValueError("time says azimuth_deg and day_of_year too; leave them out")
        if self.distance_factor is not None and (self.time is not None or self.day_of_year is not None):
            raise ValueError("time and day_of_year say distance_factor too; leave one of them out")
        return self


class MeasuredDepthSection(Section):
    """Optical depth of the aerosol at a wavelength, as a sun photometer measures it."""

    wavelength_nm: Annotated[Number, Field(gt=0)]
    """Wavelength of the sun photometer. Example: `500.0`."""
    optical_depth: Positive
    """Optical depth of the aerosol there. Example: `0.12`."""


class AlternativeSection(Section):
    """Another aerosol that it might as well be, and how much of the light is taken as of that one.

    What is left out is as in [atmosphere]. Between two skies light is mixed linearly. The standard uncertainty of
    `share` is how unsure one is of the kind: ``share = { value = 0.0, std = 0.5 }`` lets a prediction carry half the
    difference between the two as uncertainty.
    """

    aerosol: AerosolKind | None = None
    """What the other aerosol does to polarization. Example: `"spheres"`."""
    aerosol_type: AerosolType | None = None
    """The other aerosol below 2 km. Example: `"dust"`."""
    upper_aerosol_type: AerosolType | None = None
    """The other aerosol above 2 km. Example: `"tropospheric"`."""
    own_aerosol: OwnAerosolSection | None = None
    """The other aerosol below 2 km, of one's own."""
    own_upper_aerosol: OwnAerosolSection | None = None
    """The other aerosol above 2 km, of one's own."""
    share: Share
    """How much of the light is taken as of the other. Example: `{ value = 0.0, std = 0.5 }`."""

    @property
    def lower(self) -> AerosolChoice | None:
        """Aerosol below 2 km, where it is another."""
        return self.aerosol_type if self.own_aerosol is None else self.own_aerosol.aerosol()

    @property
    def upper(self) -> AerosolChoice | None:
        """Aerosol above 2 km, where it is another."""
        return self.upper_aerosol_type if self.own_upper_aerosol is None else self.own_upper_aerosol.aerosol()

    @model_validator(mode="after")
    def _is_another(self) -> "AlternativeSection":
        if (self.aerosol, self.lower, self.upper) == (None, None, None):
            raise ValueError("needs what is another: aerosol, aerosol_type, own_aerosol, or those of the upper air")
        return self


class AtmosphereSection(Section):
    """The air: US standard atmosphere of 1976 with so much aerosol, or a table of somebody's own.

    How much aerosol: by visibility, by its optical depth at 550 nm, or by its optical depth measured at two wavelengths
    (Angstrom's law). `aerosol` says what it does to polarization, `aerosol_type` and `upper_aerosol_type` of what kind
    it is below and above 2 km; `own_aerosol` and `own_upper_aerosol`, spheres of one's own, take the place of these.
    """

    tier: Fidelity = Fidelity.STANDARD
    """How the light of the air is computed. Example: `"standard"`."""
    visibility_km: Positive | None = None
    """Visibility, which says how much aerosol there is. Example: `23.0`."""
    aerosol_optical_depth: NotNegative | None = None
    """Optical depth of the aerosol at 550 nm, in place of a visibility. Example: `0.2`."""
    measured_depths: tuple[MeasuredDepthSection, MeasuredDepthSection] | None = None
    """Its optical depth at two wavelengths, in place of a visibility."""
    aerosol: AerosolKind = AerosolKind.DEPOLARIZING
    """What the aerosol does to polarization. Example: `"depolarizing"`."""
    aerosol_type: AerosolType = AerosolType.RURAL
    """Kind of the aerosol below 2 km. Example: `"rural"`."""
    upper_aerosol_type: AerosolType = AerosolType.TROPOSPHERIC
    """Kind of the aerosol above 2 km. Example: `"tropospheric"`."""
    own_aerosol: OwnAerosolSection | None = None
    """Spheres of one's own below 2 km."""
    own_upper_aerosol: OwnAerosolSection | None = None
    """Spheres of one's own above 2 km."""
    alternative: AlternativeSection | None = None
    """Another aerosol that it might as well be."""
    angstrom_exponent: Uncertain | None = None
    """Angstrom's exponent of the optical depth; that of the kind without. Example: `1.3`."""
    relative_humidity: Humidity = Uncertain(value=0.5)
    """Relative humidity of the air with the aerosol. Example: `0.5`."""
    ozone_du: NotNegative = Uncertain(value=344.0)
    """Column of ozone. Example: `344.0`."""
    surface_pressure_hpa: Positive = Uncertain(value=1013.25)
    """Pressure at the ground. Example: `1013.25`."""
    ground_albedo: Share = Uncertain(value=0.1)
    """Albedo of the ground around. Example: `0.1`."""
    wavelengths: Annotated[int, Field(ge=1, le=20)] = 4
    """How many wavelengths the band is computed at. Example: `4`."""
    dolp_max: Share = Uncertain(value=0.2)
    """Largest DoLP of the sky, of tier analytic. Example: `0.2`."""
    table: Path | None = None
    """Table of somebody's own light, of tier table. Example: `"sky.npz"`."""

    @property
    def lower(self) -> AerosolChoice:
        """Aerosol below 2 km."""
        return self.aerosol_type if self.own_aerosol is None else self.own_aerosol.aerosol()

    @property
    def upper(self) -> AerosolChoice:
        """Aerosol above 2 km."""
        return self.upper_aerosol_type if self.own_upper_aerosol is None else self.own_upper_aerosol.aerosol()

    @model_validator(mode="after")
    def _one_source(self) -> "AtmosphereSection":
        sources = ("visibility_km", "aerosol_optical_depth", "measured_depths", "table")
        given = [name for name in sources if getattr(self, name) is not None]
        if self.tier is Fidelity.TABLE and given != ["table"]:
            raise ValueError("tier 'table' needs table = \"FILE.npz\", and neither visibility_km nor an optical depth")
        if self.tier is not Fidelity.TABLE and (len(given) != 1 or self.table is not None):
            raise ValueError(
                f"tier '{self.tier}' needs exactly one of visibility_km, aerosol_optical_depth and measured_depths"
            )
        return self

    @model_validator(mode="after")
    def _one_spectrum(self) -> "AtmosphereSection":
        if self.measured_depths is not None and self.angstrom_exponent is not None:
            raise ValueError("measured_depths say the angstrom_exponent too; leave it out")
        if self.measured_depths is not None and len({one.wavelength_nm for one in self.measured_depths}) != 2:
            raise ValueError("measured_depths need two different wavelengths")
        if self.tier is Fidelity.TABLE and (self.alternative or self.own_aerosol or self.own_upper_aerosol):
            raise ValueError(
                "tier 'table' has its own aerosol: leave out alternative, own_aerosol and own_upper_aerosol"
            )
        return self


class FieldSection(Section):
    """The whole field of view by its angles, or by the picture and the focal length; and how it is cut in tiles."""

    width_deg: FieldAngle | None = None
    """Width of the whole field. Example: `20.0`."""
    height_deg: FieldAngle | None = None
    """Height of the whole field. Example: `15.0`."""
    focal_length_mm: Positive | None = None
    """Focal length of the lens, in place of angles. Example: `25.0`."""
    width_pixels: Annotated[int, Field(gt=0)] | None = None
    """Pixels a row. Example: `782`."""
    height_pixels: Annotated[int, Field(gt=0)] | None = None
    """Rows of pixels. Example: `582`."""
    tiles_per_side: Annotated[int, Field(ge=1, le=50)] = 5
    """Tiles along each side, over which light is computed. Example: `5`."""
    rule: TileRule = "gauss-legendre"
    """Where in the tiles it is computed. Example: `"gauss-legendre"`."""

    @model_validator(mode="after")
    def _angles_or_picture(self) -> "FieldSection":
        angles = (self.width_deg, self.height_deg)
        picture = (self.focal_length_mm, self.width_pixels, self.height_pixels)
        by_angles = None not in angles and picture == (None, None, None)
        by_picture = None not in picture and angles == (None, None)
        if not (by_angles or by_picture):
            raise ValueError("needs width_deg and height_deg, or focal_length_mm, width_pixels and height_pixels")
        return self
