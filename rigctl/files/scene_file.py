"""The scene file: light, regions, sensor and session as the model takes them, each number with its uncertainty.

Every table of the file is a section below. Each key states its type, range and meaning once: the page of keys
(docs/file-keys.md) and the parameters of a scene (`rigctl.scene.scene`) are made from them. `load_scene` reads a file
and reports all problems at once; `write_into_scene` writes measured angles into a file and keeps its comments.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from math import inf, log
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, AwareDatetime, BeforeValidator, Field, model_validator

from model.atmosphere.aerosols import AerosolChoice, AerosolType
from model.atmosphere.layers import AerosolKind
from model.atmosphere.mie import (
    LogNormal,
    MieAerosol,
    ParticleMode,
    RefractiveIndex,
    SizeDistribution,
    TabulatedSizes,
    log_normal,
    number_of_volume,
)
from model.atmosphere.sky import Fidelity
from model.effects.effect import Effect
from model.scene.field import TileRule
from model.surface.facets import Shadowing
from model.surface.materials import MATERIALS
from model.surface.pbrdf import DiffuseKind
from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded, write_durably
from rigctl.errors import ConfigError
from rigctl.files.aeronet import Aeronet, read_aeronet
from rigctl.files.materials import TABLE_SUFFIXES, find_material
from rigctl.files.place import GeometrySection, PointingSection, SiteSection
from rigctl.files.regions import Region, require_distinct
from rigctl.files.session_file import DEFAULT_ANGLES_DEG
from rigctl.files.toml import Fraction, NotNegative, Positive, Section, Share, Uncertain, Within, load, with_std_apart

NM_PER_M = 1e9
UM_PER_M = 1e6

Number = Annotated[float, Field(strict=True)]
Above0 = Annotated[Number, Field(gt=0)]


def _listed(given: object) -> object:
    return given if isinstance(given, list) else [given]


OneOrMore = Annotated[list[Number], BeforeValidator(_listed), Field(min_length=1)]


class ModeSection(Section):
    """Particles of one substance with one law of size.

    The law is log-normal, by the median radius of the number or of the volume and the deviation of the natural or the
    decimal logarithm; or a table of the number per ln(radius). `number_share` counts particles, `volume_share` their
    volume; shares of several modes count relative to each other. n and k are plain numbers, or lists over
    `wavelength_nm`.
    """

    number_share: Above0 | None = None
    """Share of the particles, relative to the other modes. Example: `0.9`."""
    volume_share: Above0 | None = None
    """Share of the volume, relative to the other modes. Example: `0.5`."""
    number_median_radius_um: Above0 | None = None
    """Median radius of the number. Example: `0.03`."""
    volume_median_radius_um: Above0 | None = None
    """Median radius of the volume. Example: `0.2`."""
    ln_sigma: Above0 | None = None
    """Deviation of the radius' natural logarithm. Example: `0.8`."""
    log10_sigma: Above0 | None = None
    """Deviation of the radius' decimal logarithm. Example: `0.35`."""
    largest_radius_um: Above0 | None = None
    """Largest radius of the law. Example: `20.0`."""
    radius_um: list[Number] | None = None
    """Radii of a table of sizes, in place of a law. Example: `[0.01, 0.1, 1.0]`."""
    number_per_log_radius: list[Number] | None = None
    """Number per ln(radius) at each radius. Example: `[1.0, 0.5, 0.001]`."""
    n: OneOrMore
    """Real part of the refractive index, or one for each wavelength. Example: `1.45`."""
    k: OneOrMore
    """Imaginary part of the refractive index, or one for each wavelength. Example: `0.005`."""
    wavelength_nm: tuple[Number, ...] = ()
    """Wavelengths of n and k, where these are lists. Example: `[400.0, 700.0]`."""

    @model_validator(mode="after")
    def _possible(self) -> "ModeSection":
        if self.number_share is not None and self.volume_share is not None:
            raise ValueError("needs one of number_share and volume_share, not both")
        self._require_one_law()
        if self.volume_share is not None and self.volume_median_radius_um is None:
            raise ValueError("volume_share needs volume_median_radius_um")
        self.mode()
        return self

    def mode(self) -> ParticleMode:
        """Return the mode as the model takes it."""
        index = RefractiveIndex(
            n=tuple(self.n), k=tuple(self.k), wavelength_m=tuple(nm / NM_PER_M for nm in self.wavelength_nm)
        )
        return ParticleMode(number_share=self._share(), sizes=self._sizes(), index=index)

    def _require_one_law(self) -> None:
        table = (self.radius_um, self.number_per_log_radius)
        if None not in table and self._log_normal_keys() == []:
            return
        if table != (None, None):
            raise ValueError(
                "a table of sizes needs radius_um and number_per_log_radius, and no median, sigma or largest"
            )
        if (self.number_median_radius_um is None) == (self.volume_median_radius_um is None):
            raise ValueError("needs exactly one of number_median_radius_um and volume_median_radius_um, or a table")
        if (self.ln_sigma is None) == (self.log10_sigma is None):
            raise ValueError("needs exactly one of ln_sigma and log10_sigma")

    def _log_normal_keys(self) -> list[str]:
        names = (
            "number_median_radius_um",
            "volume_median_radius_um",
            "ln_sigma",
            "log10_sigma",
            "largest_radius_um",
        )
        return [name for name in names if getattr(self, name) is not None]

    def _sizes(self) -> SizeDistribution:
        if self.radius_um is not None and self.number_per_log_radius is not None:
            return TabulatedSizes(
                radius_m=tuple(um / UM_PER_M for um in self.radius_um),
                number_per_log_radius_at=tuple(self.number_per_log_radius),
            )
        return self._log_normal()

    def _log_normal(self) -> LogNormal:
        return log_normal(
            number_median_radius_m=_metres(self.number_median_radius_um),
            volume_median_radius_m=_metres(self.volume_median_radius_um),
            ln_sigma=self.ln_sigma,
            log10_sigma=self.log10_sigma,
            largest_radius_m=inf if self.largest_radius_um is None else self.largest_radius_um / UM_PER_M,
        )

    def _share(self) -> float:
        if self.volume_share is None or self.volume_median_radius_um is None:
            return 1.0 if self.number_share is None else self.number_share
        ln_sigma = self.ln_sigma if self.ln_sigma is not None else log(10.0) * (self.log10_sigma or 0.0)
        # Only the ratio of two modes matters; micrometres keep the numbers near 1.
        return number_of_volume(
            volume=self.volume_share, volume_median_radius_m=self.volume_median_radius_um, ln_sigma=ln_sigma
        )


class OwnAerosolSection(Section):
    """Spheres of your own: name, source and modes."""

    name: Annotated[str, Field(pattern=r"\S")] = "own"
    """Its name. Example: `"smoke"`."""
    source: Annotated[str, Field(pattern=r"\S")] = "no source given"
    """Source of its numbers. Example: `"AERONET, 2026-05-04"`."""
    modes: Annotated[list[ModeSection], Field(min_length=1)]
    """Its modes of particles."""

    @model_validator(mode="after")
    def _one_kind_of_share(self) -> "OwnAerosolSection":
        given = {(mode.number_share is not None, mode.volume_share is not None) for mode in self.modes}
        if len(given) > 1:
            raise ValueError("modes: all need number_share, or all volume_share")
        if len(self.modes) > 1 and given == {(False, False)}:
            raise ValueError("modes: several need number_share or volume_share")
        return self

    def aerosol(self) -> MieAerosol:
        """Return the aerosol as the model takes it."""
        return MieAerosol(name=self.name, modes=tuple(mode.mode() for mode in self.modes), source=self.source)


def _metres(micrometres: float | None) -> float | None:
    return None if micrometres is None else micrometres / UM_PER_M


# End of the tables of aerosols, and the widest field of a flat sensor.
HUMIDITY_MOST, FIELD_MOST_DEG = 0.8, 170.0


Humidity = Annotated[Uncertain, Within(ge=0, le=HUMIDITY_MOST)]
FieldAngle = Annotated[Uncertain, Within(gt=0, lt=FIELD_MOST_DEG)]


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

    `distance_factor` is the irradiance outside the atmosphere over that at the mean distance; a day gives it too.
    """

    distance_factor: Positive | None = None
    """Irradiance outside the atmosphere over that at the mean distance. Example: `0.97`."""
    zenith_deg: NotNegative | None = None
    """Angle of the sun from the zenith; in place of a time. Example: `40.0`."""
    azimuth_deg: Uncertain | None = None
    """Azimuth of the sun, clockwise from north. Example: `180.0`."""
    day_of_year: Annotated[float, Field(ge=1, lt=367)] | None = None
    """Day of the year, which gives the distance of the sun. Example: `172.0`."""
    time: AwareDatetime | None = None
    """Time with its zone, which gives the position of the sun at the site. Example: `2026-06-21T12:00:00+02:00`."""

    @model_validator(mode="after")
    def _angles_or_time(self) -> "SunSection":
        if (self.zenith_deg is None) == (self.time is None):
            raise ValueError("needs exactly one of zenith_deg and time")
        if self.time is not None and (self.azimuth_deg is not None or self.day_of_year is not None):
            raise ValueError("time gives azimuth_deg and day_of_year; leave them out")
        if self.distance_factor is not None and (self.time is not None or self.day_of_year is not None):
            raise ValueError("time and day_of_year give distance_factor; leave one of them out")
        return self


class MeasuredDepthSection(Section):
    """Optical depth of the aerosol at a wavelength, as a sun photometer measures it."""

    wavelength_nm: Annotated[Number, Field(gt=0)]
    """Wavelength of the sun photometer. Example: `500.0`."""
    optical_depth: Positive
    """Optical depth of the aerosol at that wavelength. Example: `0.12`."""


class AlternativeSection(Section):
    """Another possible aerosol, and its share of the light.

    Keys that are left out are those of [atmosphere]. Light of the two skies is mixed linearly. The standard uncertainty
    of `share` states how uncertain the kind of the aerosol is: with ``share = { value = 0.0, std = 0.5 }`` half the
    difference between the two is an uncertainty of the prediction.
    """

    aerosol: AerosolKind | None = None
    """Effect of the other aerosol on polarization. Example: `"spheres"`."""
    aerosol_type: AerosolType | None = None
    """The other aerosol below 2 km. Example: `"dust"`."""
    upper_aerosol_type: AerosolType | None = None
    """The other aerosol above 2 km. Example: `"tropospheric"`."""
    own_aerosol: OwnAerosolSection | None = None
    """The other aerosol below 2 km, as spheres of your own."""
    own_upper_aerosol: OwnAerosolSection | None = None
    """The other aerosol above 2 km, as spheres of your own."""
    share: Share
    """Share of the light that is as of the other aerosol. Example: `{ value = 0.0, std = 0.5 }`."""

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
            raise ValueError(
                "needs one of aerosol, aerosol_type, own_aerosol, upper_aerosol_type and own_upper_aerosol"
            )
        return self


class AtmosphereSection(Section):
    """The air: US standard atmosphere of 1976 with an aerosol, or a table of your own.

    Amount of aerosol: by visibility, by its optical depth at 550 nm, by its optical depth measured at two wavelengths
    (Angstrom's law), or by AERONET files: of these the row next to the time of [sun], or the mean of all rows where it
    states angles. An inversion product makes spheres of its sizes and refractive index, unless this table says
    otherwise. `aerosol` is its effect on polarization, `aerosol_type` and `upper_aerosol_type` its kind below and above
    2 km; `own_aerosol` and `own_upper_aerosol`, user-defined spheres, replace these.
    """

    tier: Fidelity = Fidelity.STANDARD
    """How the light of the air is computed. Example: `"standard"`."""
    visibility_km: Positive | None = None
    """Visibility, which gives the amount of aerosol. Example: `23.0`."""
    aerosol_optical_depth: NotNegative | None = None
    """Optical depth of the aerosol at 550 nm, in place of a visibility. Example: `0.2`."""
    measured_depths: tuple[MeasuredDepthSection, MeasuredDepthSection] | None = None
    """Its optical depth at two wavelengths, in place of a visibility."""
    aeronet: Annotated[tuple[Path, ...], BeforeValidator(_listed)] | None = None
    """AERONET files (version 3, level 1.5 or 2.0), in place of a visibility. Example: `["site.lev20", "site.all"]`."""
    aerosol: AerosolKind = AerosolKind.DEPOLARIZING
    """Effect of the aerosol on polarization. Example: `"depolarizing"`."""
    aerosol_type: AerosolType = AerosolType.RURAL
    """Kind of the aerosol below 2 km. Example: `"rural"`."""
    upper_aerosol_type: AerosolType = AerosolType.TROPOSPHERIC
    """Kind of the aerosol above 2 km. Example: `"tropospheric"`."""
    own_aerosol: OwnAerosolSection | None = None
    """Spheres of your own below 2 km."""
    own_upper_aerosol: OwnAerosolSection | None = None
    """Spheres of your own above 2 km."""
    alternative: AlternativeSection | None = None
    """Another possible aerosol."""
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
    """Number of wavelengths at which the band is computed. Example: `4`."""
    dolp_max: Share = Uncertain(value=0.2)
    """Largest DoLP of the sky, of tier analytic. Example: `0.2`."""
    table: Path | None = None
    """Your own table of light, of tier table. Example: `"sky.npz"`."""

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
        sources = ("visibility_km", "aerosol_optical_depth", "measured_depths", "aeronet", "table")
        given = [name for name in sources if getattr(self, name) is not None]
        if self.tier is Fidelity.TABLE and given != ["table"]:
            raise ValueError("tier 'table' needs table = \"FILE.npz\", and neither visibility_km nor an optical depth")
        if self.tier is not Fidelity.TABLE and (len(given) != 1 or self.table is not None):
            raise ValueError(
                f"tier '{self.tier}' needs exactly one of visibility_km, aerosol_optical_depth, measured_depths and "
                "aeronet"
            )
        return self

    @model_validator(mode="after")
    def _one_spectrum(self) -> "AtmosphereSection":
        if (self.measured_depths or self.aeronet) is not None and self.angstrom_exponent is not None:
            raise ValueError("measured_depths and aeronet give the angstrom_exponent; leave it out")
        if self.measured_depths is not None and len({one.wavelength_nm for one in self.measured_depths}) != 2:
            raise ValueError("measured_depths need two different wavelengths")
        if self.tier is Fidelity.TABLE and (self.alternative or self.own_aerosol or self.own_upper_aerosol):
            raise ValueError(
                "tier 'table' has its own aerosol: leave out alternative, own_aerosol and own_upper_aerosol"
            )
        return self


# Beyond the wavelengths of an inversion the index is constant, since a band may begin below 440 nm.
_INDEX_ENDS_NM = (300.0, 2500.0)


def _with_aeronet(air: AtmosphereSection, given: Aeronet) -> AtmosphereSection:
    """Return the table completed with the numbers of AERONET files."""
    update: dict[str, object] = {
        "aeronet": None,
        "measured_depths": tuple(
            MeasuredDepthSection(wavelength_nm=nm, optical_depth=Uncertain(value=depth, std=std))
            for nm, depth, std in given.depths
        ),
    }
    if given.ozone_du is not None:
        update["ozone_du"] = Uncertain(value=given.ozone_du)
    if given.has_particles:
        number = [v / r**3 for r, v in zip(given.radius_um, given.volume_per_log_radius, strict=True)]
        wavelengths = (_INDEX_ENDS_NM[0], *given.index_wavelength_nm, _INDEX_ENDS_NM[1])
        mode = ModeSection(
            radius_um=list(given.radius_um),
            number_per_log_radius=number,
            n=[given.n[0], *given.n, given.n[-1]],
            k=[given.k[0], *given.k, given.k[-1]],
            wavelength_nm=wavelengths,
        )
        spheres = OwnAerosolSection(name="aeronet", source=given.source, modes=[mode])
        update |= {"aerosol": AerosolKind.SPHERES}
        if "aerosol_type" not in air.model_fields_set:
            update["own_aerosol"] = spheres
        if "upper_aerosol_type" not in air.model_fields_set:
            update["own_upper_aerosol"] = spheres
    kept = {key: value for key, value in update.items() if key == "aeronet" or key not in air.model_fields_set}
    return air.model_copy(update=kept)


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
    """Points of the tiles where light is computed. Example: `"gauss-legendre"`."""

    @model_validator(mode="after")
    def _angles_or_picture(self) -> "FieldSection":
        angles = (self.width_deg, self.height_deg)
        picture = (self.focal_length_mm, self.width_pixels, self.height_pixels)
        by_angles = None not in angles and picture == (None, None, None)
        by_picture = None not in picture and angles == (None, None)
        if not (by_angles or by_picture):
            raise ValueError("needs width_deg and height_deg, or focal_length_mm, width_pixels and height_pixels")
        return self


def _known(name: str) -> str:
    if name not in effect_names():
        raise ValueError(f"is {name!r}; allowed are {', '.join(effect_names())}")
    return name


EffectName = Annotated[str, AfterValidator(_known)]


class ErrorsSection(Section):
    """Errors that a session adds to a scene; by default none. These are random or known, and predicted with the rest.

    `polarizer_angle_std_deg` is the independent error of each angle, `misregistration_px` the shift of the picture from
    frame to frame along each axis (both standard deviations), `texture_correlation_px` the distance at which the
    correlation of the texture has fallen to 0.61, `illumination_drift` the change of the light from the first frame of
    a cycle to the last over its mean, `surround_albedo` that of the near surroundings if it differs from
    atmosphere.ground_albedo, `off_axis_falloff` false if frames are divided by a flat field, which removes the fall of
    light as cos^4. Each number may have a standard uncertainty.
    """

    polarizer_angle_std_deg: Annotated[Uncertain, Within(ge=0, le=20)] = Uncertain(value=0.0)
    """Scatter of the polarizer's angle from frame to frame. Example: `0.1`."""
    misregistration_px: Annotated[Uncertain, Within(ge=0, le=1e4)] = Uncertain(value=0.0)
    """Shift of the picture from frame to frame, along each axis. Example: `0.2`."""
    texture_correlation_px: Annotated[Uncertain, Within(gt=0, le=1e4)] = Uncertain(value=1.0)
    """Distance at which the texture's correlation is 0.61. Example: `3.0`."""
    surround_albedo: Share | None = None
    """Albedo of the near surroundings, where it is not `atmosphere.ground_albedo`. Example: `0.2`."""
    illumination_drift: Annotated[Uncertain, Within(ge=-1, le=1)] = Uncertain(value=0.0)
    """Change of the light from the first frame of a cycle to the last, over its mean. Example: `0.01`."""
    off_axis_falloff: bool = True
    """Light falls as cos^4 over a region's extent; false for frames divided by a flat field. Example: `false`."""


class EffectsSection(Section):
    """Effects that always act (`with`), or are always left out (`without`), regardless of their bounds."""

    switched_on: tuple[EffectName, ...] = Field(default=(), alias="with")
    """Effects that act whatever their bound. Example: `["misregistration"]`."""
    left_out: tuple[EffectName, ...] = Field(default=(), alias="without")
    """Effects that are left out whatever their bound. Example: `["adjacency"]`."""


def effect_names() -> tuple[str, ...]:
    """Return the names of effects in files and options: without spaces."""
    return tuple(effect.value.replace(" ", "-") for effect in Effect)


def effect_of(name: str) -> Effect:
    """Return the effect of a name in a file or an option."""
    return tuple(Effect)[effect_names().index(name)]


StokesValues = tuple[Uncertain, Uncertain, Uncertain]
Row = tuple[Uncertain, Uncertain, Uncertain]
Limits = tuple[float, float]
# Of products of numbers as written.
_ROUNDING = 1e-9
_CAMERA_ANGLES = ("camera_zenith_deg", "camera_azimuth_deg", "phi_deg", "camera_roll_deg")
_PANEL_ANGLES = ("tilt_deg", "tilt_azimuth_deg")
# Places of a covariance of S0, S1, S2 on and above its diagonal.
COVARIANCE_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


class SensorSection(Section):
    """Optics and sensor; efficiency and transmittance are those at the effective wavelength.

    The band is a table of the sensor's relative response, or two wavelengths between which it is flat. The effective
    wavelength follows from the band unless it is given.
    """

    pixel_pitch_um: Positive
    """Distance of the pixels' centres. Example: `8.3`."""
    f_number: Positive
    """Focal length over the diameter of the entrance pupil. Example: `2.0`."""
    optics_transmittance: Fraction
    """Transmittance of the optics. Example: `0.9`."""
    quantum_efficiency: Fraction
    """Electrons per photon at the effective wavelength. Example: `{ value = 0.5, std = 0.02 }`."""
    wavelength_nm: Positive | None = None
    """Effective wavelength; follows from the band unless given. Example: `550.0`."""
    response: ResponseSection | None = None
    """The band as a table of the sensor's relative response."""
    band_nm: Limits | None = None
    """The band as two wavelengths between which it is flat. Example: `[400.0, 700.0]`."""
    bit_depth: Annotated[int, Field(ge=8, le=16)]
    """Bits of a count. Example: `12`."""
    polarizer_transmittance: Fraction
    """Transmittance of the polarizer along its axis. Example: `0.8`."""
    extinction_ratio: Annotated[Uncertain, Within(gt=1)]
    """Transmittance of the polarizer along its axis over that across. Example: `5000.0`."""

    @property
    def has_band(self) -> bool:
        """True if the band of the sensor is known."""
        return self.response is not None or self.band_nm is not None

    @model_validator(mode="after")
    def _one_band(self) -> "SensorSection":
        if self.response is not None and self.band_nm is not None:
            raise ValueError("needs one of response and band_nm, not both")
        if self.wavelength_nm is None and not self.has_band:
            raise ValueError("needs wavelength_nm, or a band (response or band_nm) from which it follows")
        return self


class NoiseSection(Section):
    """The sensor's noise without a calibration. These numbers are assumed, and marked so.

    `noise_factor` is Kn of [MK14] eq. (32): it multiplies the deviation of all temporal noise.
    """

    gain_dn_per_e: Positive
    """Counts per electron. Example: `0.25`."""
    read_noise_e: NotNegative
    """Deviation of the read noise. Example: `8.0`."""
    dark_current_e_per_s: NotNegative
    """Dark current of a pixel. Example: `5.0`."""
    black_level_dn: NotNegative
    """Counts without light at no exposure. Example: `64.0`."""
    prnu: NotNegative
    """Relative deviation of the pixels' response. Example: `0.005`."""
    dsnu_e: NotNegative
    """Deviation of the pixels' dark signal. Example: `2.0`."""
    noise_factor: NotNegative = Uncertain(value=1.0)
    """Factor on the deviation of all temporal noise, Kn of [MK14] eq. (32). Example: `1.0`."""


class AcquisitionSection(Section):
    """The acquisition of the frames; `rigctl compare` takes these from the run instead.

    The exposure may be given as ``{value = 0.03, std = 0.0003}``: a run's exposures then have the same relative
    uncertainty.
    """

    exposure_ms: Annotated[float, Field(gt=0)]
    """Exposure of each frame. Example: `0.03`."""
    exposure_std_ms: Annotated[float, Field(ge=0)] = 0.0
    """Standard uncertainty of the exposure. Example: `0.0003`."""
    angles_deg: Annotated[tuple[float, ...], Field(min_length=3)] = DEFAULT_ANGLES_DEG
    """Polarizer angles of a cycle. Example: `[0, 90, 45, 135]`."""
    cycles: Annotated[int, Field(ge=1)] = 1
    """Number of repetitions of all angles. Example: `10`."""

    @model_validator(mode="before")
    @classmethod
    def _std_apart(cls, given: object) -> object:
        return with_std_apart(given, "exposure_ms")


class RigSection(Section):
    """Errors of the rig relative to the record of a run; each is an input with an uncertainty, exact by default.

    `polarizer_offset_deg` is the correction to every recorded angle of the polarizer, `angle_std_deg` the independent
    uncertainty of each angle, `exposure_ratio` the true exposure over the recorded one.
    """

    polarizer_offset_deg: Uncertain = Uncertain(value=0.0)
    """Correction to be added to every recorded angle of the polarizer. Example: `{ value = 0.0, std = 0.1 }`."""
    angle_std_deg: Annotated[float, Field(ge=0, lt=45)] = 0.0
    """Standard uncertainty of each recorded angle on its own. Example: `0.02`."""
    exposure_ratio: Positive = Uncertain(value=1.0)
    """True exposure over the recorded one. Example: `{ value = 1.0, std = 0.01 }`."""


def _is_covariance(rows: list[list[float]]) -> bool:
    """Return whether no principal minor of a symmetric matrix (3, 3) is below 0 beyond rounding."""
    (a, d, e), (_, b, f), (_, _, c) = rows
    pairs = ((a, b, d), (a, c, e), (b, c, f))
    volume = a * b * c + 2.0 * d * e * f - a * f * f - b * e * e - c * d * d
    return (
        min(a, b, c) >= 0.0
        and all(one * other - shared**2 >= -_ROUNDING * one * other for one, other, shared in pairs)
        and volume >= -_ROUNDING * a * b * c
    )


def _material_name(given: object) -> object:
    """Return a material by its name or file; a table may be given by its key."""
    if not isinstance(given, dict):
        return given
    if list(given) != ["table"] or not isinstance(given["table"], str):
        raise ValueError('needs a name, a file, or { table = "FILE.csv" }')
    if Path(given["table"]).suffix.lower() not in TABLE_SUFFIXES:
        raise ValueError(f"table is {given['table']!r}, must be a file that ends in {', '.join(TABLE_SUFFIXES)}")
    return given["table"]


class SceneRegion(Region):
    """A region, by its radiance at the aperture, or by material and tilt.

    `texture_rms` multiplies the whole Stokes vector that a pixel reflects by one random factor; `texture_diagonal` are
    deviations of S0, S1 and S2 independent of one another, as a share of the S0 that a material reflects (the form of
    [MK14]); `texture_covariance` is a further covariance of the pixels' Stokes radiance. All are of the surface, not of
    the sensor. `extent` is the part of the field of view that a material fills: the point on the axis, all of it, or
    the region's own rectangle of the picture (that around a polygon).
    """

    stokes_radiance: StokesValues | None = None
    """S0, S1, S2 that come to the aperture in band, W m-2 sr-1. Example: `[20.0, 2.0, -1.0]`."""
    material: Annotated[str | None, BeforeValidator(_material_name)] = None
    """Material, in place of a radiance: a name of the library, a TOML file, or a table of measured BRDF (CSV, also
    written `{ table = "FILE.csv" }`). Example: `"material-mine.toml"`."""
    tilt_deg: NotNegative = Uncertain(value=0.0)
    """Angle of its normal from the zenith. Example: `10.0`."""
    tilt_azimuth_deg: Uncertain = Uncertain(value=0.0)
    """Azimuth to which it leans, clockwise from north. Example: `180.0`."""
    shadowing: Shadowing = "v-cavity"
    """How facets shadow one another. Example: `"v-cavity"`."""
    diffuse: DiffuseKind | None = None
    """Form of the diffuse term, in place of the material's own. Example: `"coupled"`."""
    extent: Literal["point", "field", "rectangle"] = "point"
    """Part of the field that it fills: the axis, all of it, or its own rectangle. Example: `"rectangle"`."""
    texture_rms: NotNegative = Uncertain(value=0.0)
    """Relative deviation of the pixels' whole Stokes vector. Example: `0.02`."""
    texture_diagonal: tuple[NotNegative, NotNegative, NotNegative] | None = None
    """Deviations of S0, S1, S2 over the S0 reflected, independent. Example: `[0.02, 0.01, 0.01]`."""
    texture_covariance: tuple[Row, Row, Row] | None = None
    """Further covariance of the pixels' Stokes radiance. Example: `[[0.2, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]`."""

    @model_validator(mode="after")
    def _one_source(self) -> "SceneRegion":
        if (self.stokes_radiance is None) == (self.material is None):
            raise ValueError("needs exactly one of stokes_radiance and material")
        if self.texture_diagonal is not None and self.material is None:
            raise ValueError("texture_diagonal is for a material; with stokes_radiance give a texture_covariance")
        return self

    @model_validator(mode="after")
    def _symmetric(self) -> "SceneRegion":
        rows = self.texture_covariance
        if rows is not None and any(rows[i][j] != rows[j][i] for i, j in COVARIANCE_PAIRS):
            raise ValueError(
                "texture_covariance is not symmetric: [0][1] and [1][0], [0][2] and [2][0], ... are one number"
            )
        if rows is not None and not _is_covariance([[one.value for one in row] for row in rows]):
            raise ValueError(
                "texture_covariance is not a covariance: along some direction of S0, S1, S2 its variance is below 0, "
                "for instance if [0][1] squared is above [0][0] times [1][1]"
            )
        return self

    @model_validator(mode="after")
    def _physical(self) -> "SceneRegion":
        if self.stokes_radiance is None:
            return self
        s0, s1, s2 = (component.value for component in self.stokes_radiance)
        if s0 <= 0:
            raise ValueError(f"stokes_radiance has S0 = {s0:g}, must be above 0")
        if s1 * s1 + s2 * s2 > s0 * s0:
            raise ValueError(f"stokes_radiance ({s0:g}, {s1:g}, {s2:g}) has a degree of polarization above 1")
        return self

    def given_radiance(self) -> StokesValues:
        """Return the radiance that the file states."""
        if self.stokes_radiance is None:
            raise ConfigError(
                f"region {self.name} is given by its material; a simulated rig shows stated radiances only and needs "
                "its stokes_radiance"
            )
        return self.stokes_radiance


class SceneFile(Section):
    """Content of a scene file."""

    schema_version: Literal[1] = 1
    """Version of the layout. Example: `1`."""
    name: str
    """Name of the scene, in every report. Example: `"rooftop, noon"`."""
    sensor: SensorSection
    """Optics and sensor."""
    noise: NoiseSection
    """Noise of the sensor where no calibration is given."""
    acquisition: AcquisitionSection
    """How frames are taken; for a run, its own record is used instead."""
    background_radiance: Annotated[float, Field(gt=0)] = 20.0
    """Radiance outside of all regions, in band, W m-2 sr-1. Example: `20.0`."""
    rig: RigSection = RigSection()
    """Errors of the rig relative to the record of a run."""
    errors: ErrorsSection = ErrorsSection()
    """Errors that a session adds to the scene."""
    effects: EffectsSection = EffectsSection()
    """Effects that act, or are left out, regardless of their bound."""
    site: SiteSection | None = None
    """Where the scene is."""
    sun: SunSection | None = None
    """The sun, by its angles or by a time."""
    geometry: GeometrySection | None = None
    """Where the camera is as seen from the target."""
    pointing: PointingSection | None = None
    """Correlation of the errors of the camera's and the panels' angles."""
    atmosphere: AtmosphereSection | None = None
    """The air."""
    field_of_view: FieldSection | None = None
    """The whole field of view, and how it is cut in tiles."""
    regions: Annotated[list[SceneRegion], Field(min_length=1)]
    """Regions of the picture with their light or material."""

    @property
    def has_materials(self) -> bool:
        """True if any region's light is to be computed."""
        return any(region.material is not None for region in self.regions)

    @model_validator(mode="after")
    def _distinct_names(self) -> "SceneFile":
        require_distinct([region.name for region in self.regions])
        return self

    @model_validator(mode="after")
    def _pointing_is_of_angles(self) -> "SceneFile":
        angles = pointing_angles(self.geometry, self.regions)
        for key in () if self.pointing is None else self.pointing.parameters:
            number = angles.get(key)
            if number is None:
                there = ", ".join(angles) or "none: no [geometry] and no regions of a material"
                raise ValueError(
                    f"pointing.parameters: {key!r} is not an angle of camera or panel; allowed are {there}"
                )
            if number.std == 0.0:
                raise ValueError(
                    f"pointing.parameters: {key} is stated as exact and has no error to correlate; give its std, {{ "
                    f"value = {number.value:g}, std = 0.5 }}, or leave it out of [pointing]"
                )
        return self

    @model_validator(mode="after")
    def _a_material_needs_light(self) -> "SceneFile":
        if not self.has_materials:
            return self
        missing = [f"[{name}]" for name in ("sun", "geometry", "atmosphere") if getattr(self, name) is None]
        if not self.sensor.has_band:
            missing.append("a band of the sensor (band_nm or response)")
        if missing:
            raise ValueError(f"a region given by its material also needs {', '.join(missing)}")
        if self.field_of_view is None and any(region.extent != "point" for region in self.regions):
            raise ValueError("a region with an extent also needs [field_of_view]")
        return self

    @model_validator(mode="after")
    def _directions_are_known(self) -> "SceneFile":
        if self.sun is not None and self.sun.time is not None and self.site is None:
            raise ValueError("sun.time also needs [site] with latitude_deg and longitude_deg")
        if self.sun is None or self.geometry is None:
            return self
        by_phi = self.geometry.phi_deg is not None
        if not by_phi and self.sun.time is None and self.sun.azimuth_deg is None:
            raise ValueError("geometry.camera_azimuth_deg also needs sun.azimuth_deg, or give geometry.phi_deg alone")
        tilted = any(region.tilt_deg.value > 0 for region in self.regions)
        if by_phi and self.sun.time is None and self.sun.azimuth_deg is None and tilted:
            raise ValueError("a tilted region needs azimuths: sun.azimuth_deg, and camera_azimuth_deg or phi_deg")
        return self


def pointing_angles(geometry: GeometrySection | None, regions: Iterable[SceneRegion]) -> dict[str, Uncertain]:
    """Return the angles of camera and panels in a scene, by their keys."""
    found: dict[str, Uncertain | None] = {}
    if geometry is not None:
        found = {f"geometry.{name}": getattr(geometry, name) for name in _CAMERA_ANGLES}
    for region in regions:
        found |= {f"regions.{region.name}.{name}": getattr(region, name) for name in _PANEL_ANGLES}
    return {key: number for key, number in found.items() if number is not None}


def load_scene(path: str | Path) -> SceneFile:
    """Return the checked scene file; files that it names are looked up in its folder.

    Raises
    ------
    ConfigError
        The file cannot be read or has problems, or a material that it names.
    """
    path = Path(path)
    scene = load(path, SceneFile)
    regions = [_with_material_found(region, path) for region in scene.regions]
    scene = scene.model_copy(update={"regions": regions})
    if scene.atmosphere is not None and scene.atmosphere.aeronet is not None:
        files = [path.parent / one for one in scene.atmosphere.aeronet]
        try:
            given = read_aeronet(files, near=None if scene.sun is None else scene.sun.time)
            scene = scene.model_copy(update={"atmosphere": _with_aeronet(scene.atmosphere, given)})
        except (ConfigError, ValueError) as error:
            raise ConfigError(f"{path}: atmosphere.aeronet: {error}") from error
    if scene.atmosphere is None or scene.atmosphere.table is None:
        return scene
    table = (path.parent / scene.atmosphere.table).resolve()
    return scene.model_copy(update={"atmosphere": scene.atmosphere.model_copy(update={"table": table})})


def scene_file(given: Path | SceneFile) -> SceneFile:
    """Return a scene file's content, given as such or by its path."""
    return given if isinstance(given, SceneFile) else load_scene(given)


def _with_material_found(region: SceneRegion, path: Path) -> SceneRegion:
    if region.material is None or region.material in MATERIALS:
        return region
    try:
        find_material(region.material, beside=path.parent)
    except ConfigError as error:
        raise ConfigError(f"{path}: regions.{region.name}: {error}") from error
    return region.model_copy(update={"material": str((path.parent / region.material).resolve())})


_HEADER = re.compile(r"^\[\[?([A-Za-z_][\w.]*)\]\]?[ \t]*(?:#[^\n]*)?$", re.MULTILINE)
_OURS = "  # rigctl calibrate pointing"
_BY_PHI = "phi_deg"
# Digits behind the point, and more for small standard uncertainties.
_DIGITS = 4
# The last line of a table of ours with a key, a number or a bracket.
_LAST_KEY = re.compile(r"(?s:.*)^[^#\n]*[\w\]\"][^\n]*\n?", re.MULTILINE)


def write_into_scene(
    path: Path,
    geometry: Mapping[str, tuple[float, float]],
    regions: Mapping[str, Mapping[str, tuple[float, float]]],
    pointing: PointingSection | None,
) -> tuple[str, ...]:
    """Write numbers with their standard uncertainties and correlations into a scene file."""
    load_scene(path)
    before = read_bounded(path, MOST_TEXT_BYTES)
    text = before.decode("utf-8")
    for name, numbers in regions.items():
        start, end = _region(path, text, name)
        text = text[:start] + _with(text[start:end], numbers) + text[end:]
    if geometry:
        text = _with_geometry(text, geometry)
    text = _with_pointing(text, pointing)
    write_durably(path, text.encode("utf-8"))
    try:
        load_scene(path)
    except ConfigError:
        write_durably(path, before)
        raise
    return tuple(_changes(before.decode("utf-8").splitlines(), text.splitlines()))


def _with_geometry(text: str, geometry: Mapping[str, tuple[float, float]]) -> str:
    place = _place(text, "geometry")
    if place is None:
        text = f"{text.rstrip()}\n\n[geometry]\n"
        place = (len(text) - len("[geometry]\n"), len(text))
    inside = text[place[0] : place[1]]
    if "camera_azimuth_deg" in geometry:
        inside = re.sub(rf"^{_BY_PHI}\s*=[^\n]*\n?", "", inside, flags=re.MULTILINE)
    return text[: place[0]] + _with(inside, geometry) + text[place[1] :]


def _with_pointing(text: str, pointing: PointingSection | None) -> str:
    place = _place(text, "pointing")
    if place is not None:
        # Text behind the last key of a table belongs to the next.
        last = _LAST_KEY.search(text[place[0] : place[1]])
        text = text[: place[0]] + text[place[0] + (last.end() if last else 0) :].lstrip("\n")
    if pointing is None:
        return text
    rows = "".join(f"  [{', '.join(map(repr, row))}],\n" for row in pointing.correlation)
    names = ", ".join(f'"{name}"' for name in pointing.parameters)
    table = f"[pointing]{_OURS}\nparameters = [{names}]\ncorrelation = [\n{rows}]\n"
    return f"{text.rstrip()}\n\n{table}"


def _place(text: str, table: str) -> tuple[int, int] | None:
    return next(((start, end) for name, start, end in _tables(text) if name == table), None)


def _tables(text: str) -> Iterator[tuple[str, int, int]]:
    headers = list(_HEADER.finditer(text))
    ends = [header.start() for header in headers[1:]] + [len(text)]
    for header, end in zip(headers, ends, strict=True):
        yield header[1], header.start(), end


def _region(path: Path, text: str, name: str) -> tuple[int, int]:
    line = re.compile(rf"^name\s*=\s*(['\"]){re.escape(name)}\1", re.MULTILINE)
    for table, start, end in _tables(text):
        if table == "regions" and line.search(text[start:end]):
            return start, end
    raise ConfigError(f"{path}: has no [[regions]] named {name}")


def _with(table: str, numbers: Mapping[str, tuple[float, float]]) -> str:
    for key, (value, std) in numbers.items():
        digits = max(_DIGITS, 2 - math.floor(math.log10(std)))
        number = f"{{ value = {value:.{digits}f}, std = {std:.{digits}f} }}"
        line = re.compile(rf"^({key}\s*=\s*)[^#\r\n]*?([ \t]*#[^\r\n]*)?(\r?)$", re.MULTILINE)
        was = line.search(table)
        if was is not None:
            table = f"{table[: was.start()]}{was[1]}{number}{was[2] or _OURS}{was[3]}{table[was.end() :]}"
        else:
            head, _, rest = table.partition("\n")
            table = f"{head}\n{key} = {number}{_OURS}\n{rest}"
    return table


def _changes(before: list[str], after: list[str]) -> Iterator[str]:
    yield from (f"- {line}" for line in before if line not in after)
    yield from (f"+ {line}" for line in after if line not in before)
