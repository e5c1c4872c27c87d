"""The scene file: what the model is told of the scene and of the sensor, and how uncertain that is."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from model.surface.materials import MATERIALS
from model.surface.pbrdf import DiffuseKind, Shadowing
from rigctl.errors import ConfigError
from rigctl.files.config import Fraction, NotNegative, Positive, Section, Uncertain, load, with_std_apart
from rigctl.files.effect_sections import Drift, EffectsSection, ErrorsSection
from rigctl.files.light_sections import AtmosphereSection, FieldSection, ResponseSection, SunSection
from rigctl.files.material_file import find_material
from rigctl.files.place import GeometrySection, PointingSection, SiteSection
from rigctl.files.regions import Region, require_distinct
from rigctl.files.session_file import DEFAULT_ANGLES_DEG

StokesValues = tuple[Uncertain, Uncertain, Uncertain]
Row = tuple[Uncertain, Uncertain, Uncertain]
Limits = tuple[float, float]
# Of products of numbers as they are written.
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
    extinction_ratio: Positive
    """Transmittance of the polarizer along its axis over that across, above 1. Example: `5000.0`."""

    @property
    def has_band(self) -> bool:
        """True if it is known which wavelengths the sensor sees."""
        return self.response is not None or self.band_nm is not None

    @model_validator(mode="after")
    def _polarizes(self) -> "SensorSection":
        if self.extinction_ratio.value <= 1:
            raise ValueError(f"extinction_ratio is {self.extinction_ratio.value:g}, must be above 1")
        return self

    @model_validator(mode="after")
    def _one_band(self) -> "SensorSection":
        if self.response is not None and self.band_nm is not None:
            raise ValueError("needs one of response and band_nm, not both")
        if self.wavelength_nm is None and not self.has_band:
            raise ValueError("needs wavelength_nm, or a band (response or band_nm) from which it follows")
        return self


class NoiseSection(Section):
    """The sensor's noise where no calibration is given. These numbers are assumed, and called so.

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

    The exposure may be given as ``{value = 0.03, std = 0.0003}``: a run's exposures are then uncertain by as much of
    themselves.
    """

    exposure_ms: Annotated[float, Field(gt=0)]
    """Exposure of each frame. Example: `0.03`."""
    exposure_std_ms: Annotated[float, Field(ge=0)] = 0.0
    """Standard uncertainty of the exposure. Example: `0.0003`."""
    angles_deg: Annotated[tuple[float, ...], Field(min_length=3)] = DEFAULT_ANGLES_DEG
    """Polarizer angles of a cycle. Example: `[0, 90, 45, 135]`."""
    cycles: Annotated[int, Field(ge=1)] = 1
    """How often all angles are gone through. Example: `10`."""

    @model_validator(mode="before")
    @classmethod
    def _std_apart(cls, given: object) -> object:
        return with_std_apart(given, "exposure_ms")


class RigSection(Section):
    """Errors of the rig against what a run records of it; each is an input with an uncertainty, exact by default.

    `polarizer_offset_deg` is what would have to be added to every recorded angle of the polarizer, `angle_std_deg` how
    well each angle is known on its own, `exposure_ratio` the true exposure over the recorded one. `light_drift` is what
    `errors.illumination_drift` was called here.
    """

    polarizer_offset_deg: Uncertain = Uncertain(value=0.0)
    """To be added to every recorded angle of the polarizer. Example: `{ value = 0.0, std = 0.1 }`."""
    angle_std_deg: Annotated[float, Field(ge=0, lt=45)] = 0.0
    """How well each recorded angle is known on its own. Example: `0.02`."""
    exposure_ratio: Positive = Uncertain(value=1.0)
    """True exposure over the recorded one. Example: `{ value = 1.0, std = 0.01 }`."""
    light_drift: Drift | None = None
    """Former name of `errors.illumination_drift`. Example: `0.01`."""


def _is_covariance(rows: list[list[float]]) -> bool:
    """Return whether no principal minor of a symmetric matrix (3, 3) is below 0 but for rounding."""
    (a, d, e), (_, b, f), (_, _, c) = rows
    pairs = ((a, b, d), (a, c, e), (b, c, f))
    volume = a * b * c + 2.0 * d * e * f - a * f * f - b * e * e - c * d * d
    return (
        min(a, b, c) >= 0.0
        and all(one * other - shared**2 >= -_ROUNDING * one * other for one, other, shared in pairs)
        and volume >= -_ROUNDING * a * b * c
    )


class SceneRegion(Region):
    """A region, by the radiance that comes from it to the aperture, or by what it is made of and how it stands.

    `texture_rms` multiplies the whole Stokes vector that a pixel reflects by one random factor; `texture_diagonal` are
    deviations of S0, S1 and S2 independent of one another, as a share of the S0 that a material reflects (the form of
    [MK14]); `texture_covariance` is a further covariance of the pixels' Stokes radiance. All are of the surface, not of
    the sensor.
    `extent` says which part of the field of view a material fills: the point on the axis, all of it, or the region's
    own rectangle of the picture (that around a polygon).
    """

    stokes_radiance: StokesValues | None = None
    """S0, S1, S2 that come to the aperture in band, W m-2 sr-1. Example: `[20.0, 2.0, -1.0]`."""
    material: str | None = None
    """What it is made of, in place of a radiance: of the library, or a file. Example: `"material-mine.toml"`."""
    tilt_deg: NotNegative = Uncertain(value=0.0)
    """Angle of its normal from the zenith. Example: `10.0`."""
    tilt_azimuth_deg: Uncertain = Uncertain(value=0.0)
    """Azimuth to which it leans, clockwise from north. Example: `180.0`."""
    shadowing: Shadowing = "v-cavity"
    """How facets hide one another. Example: `"v-cavity"`."""
    diffuse: DiffuseKind = "coupled"
    """Form of the diffuse term. Example: `"coupled"`."""
    extent: Literal["point", "field", "rectangle"] = "point"
    """What it fills: the point on the axis, the whole field, or its own rectangle. Example: `"rectangle"`."""
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
                "texture_covariance is no covariance: along some direction of S0, S1, S2 its variance is below 0, "
                "such as where [0][1] squared is above [0][0] times [1][1]"
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
        """Return the radiance that the file states.

        Raises
        ------
        ConfigError
            The region is given by its material.
        """
        if self.stokes_radiance is None:
            raise ConfigError(
                f"region {self.name} is given by its material; here its stokes_radiance is needed, as a simulated rig "
                "paints what it is told and computes no light"
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
    """How frames are taken; of a run, what it records counts instead."""
    background_radiance: Annotated[float, Field(gt=0)] = 20.0
    """Radiance of what no region covers, in band, W m-2 sr-1. Example: `20.0`."""
    rig: RigSection = RigSection()
    """Errors of the rig against what a run records of it."""
    errors: ErrorsSection = ErrorsSection()
    """Errors that a session adds to the scene."""
    effects: EffectsSection = EffectsSection()
    """Effects that act, or are left out, whatever their bound."""
    site: SiteSection | None = None
    """Where the scene is."""
    sun: SunSection | None = None
    """The sun, by its angles or by a time."""
    geometry: GeometrySection | None = None
    """Where the camera is as seen from the target."""
    pointing: PointingSection | None = None
    """How the errors of the camera's and the panels' angles go together."""
    atmosphere: AtmosphereSection | None = None
    """The air."""
    field_of_view: FieldSection | None = None
    """The whole field of view, and how it is cut in tiles."""
    regions: Annotated[list[SceneRegion], Field(min_length=1)]
    """What the picture shows: regions with their light or material."""

    @property
    def has_materials(self) -> bool:
        """True if any region's light is to be computed."""
        return any(region.material is not None for region in self.regions)

    @model_validator(mode="after")
    def _distinct_names(self) -> "SceneFile":
        require_distinct([region.name for region in self.regions])
        return self

    @model_validator(mode="after")
    def _one_drift(self) -> "SceneFile":
        if self.rig.light_drift is not None and "illumination_drift" in self.errors.model_fields_set:
            raise ValueError("rig.light_drift and errors.illumination_drift are one number; leave the first out")
        return self

    @model_validator(mode="after")
    def _pointing_is_of_angles(self) -> "SceneFile":
        angles = pointing_angles(self)
        for key in () if self.pointing is None else self.pointing.parameters:
            number = angles.get(key)
            if number is None:
                there = ", ".join(angles) or "none: no [geometry] and no regions of a material"
                raise ValueError(f"pointing.parameters: {key!r} is no angle of camera or panel; there are {there}")
            if number.std == 0.0:
                raise ValueError(
                    f"pointing.parameters: {key} is stated as exact, so that its error goes together with nothing; "
                    f"give its std, {{ value = {number.value:g}, std = 0.5 }}, or leave it out of [pointing]"
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


def pointing_angles(scene: SceneFile) -> dict[str, Uncertain]:
    """Return the angles of camera and panels that a scene states, by their keys."""
    found: dict[str, Uncertain | None] = {}
    if scene.geometry is not None:
        found = {f"geometry.{name}": getattr(scene.geometry, name) for name in _CAMERA_ANGLES}
    for region in scene.regions:
        found |= {f"regions.{region.name}.{name}": getattr(region, name) for name in _PANEL_ANGLES}
    return {key: number for key, number in found.items() if number is not None}


def load_scene(path: str | Path) -> SceneFile:
    """Return the checked scene file; files that it names are sought beside it, and its materials are there.

    Raises
    ------
    ConfigError
        The file cannot be read or has problems, or a material that it names.
    """
    path = Path(path)
    scene = load(path, SceneFile)
    regions = [_with_material_found(region, path) for region in scene.regions]
    scene = scene.model_copy(update={"regions": regions})
    if scene.atmosphere is None or scene.atmosphere.table is None:
        return scene
    table = (path.parent / scene.atmosphere.table).resolve()
    return scene.model_copy(update={"atmosphere": scene.atmosphere.model_copy(update={"table": table})})


def scene_file(given: Path | SceneFile) -> SceneFile:
    """Return a scene file's content, read where only its path is given.

    Raises
    ------
    ConfigError
        The file cannot be read or has problems, or a material that it names.
    """
    return given if isinstance(given, SceneFile) else load_scene(given)


def _with_material_found(region: SceneRegion, path: Path) -> SceneRegion:
    if region.material is None or region.material in MATERIALS:
        return region
    try:
        find_material(region.material, beside=path.parent)
    except ConfigError as error:
        raise ConfigError(f"{path}: regions.{region.name}: {error}") from error
    return region.model_copy(update={"material": str((path.parent / region.material).resolve())})
