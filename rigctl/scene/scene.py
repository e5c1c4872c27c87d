"""The scene as one record, and every number of it by a key.

`scene_of_file` makes a `Scene` of a scene file and a noise calibration. What the file may state in several ways becomes
one: the sun by its angles, materials at the sensor's wavelength, calibrated noise in place of the assumed one. A run, a
sweep or an option makes a changed copy of the record; nothing goes back to the file.

Every number of the scene file that may be uncertain is a parameter. `rigctl.files.scene_file` defines its key, range
and meaning. `parameters`, `get` and `with_values` read and set parameters by these keys, which `--set` and `sweep` use.
The rows below add the numbers of regions and materials, whose place in the record differs from their place in the file.

`gather` returns the numbers that a prediction rests on as `Inputs`: values, ranges and covariance.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from difflib import get_close_matches
from functools import cached_property
from math import cos, hypot, inf, radians, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args, get_origin

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from model.atmosphere.sky import distance_factor
from model.effects.effect import ALL, Effect
from model.prediction import RigErrors
from model.sensor import effective_wavelength_m
from model.surface.facets import SLOPE_RMS_MIN
from model.surface.materials import Material, Property, assumed_properties
from model.surface.pbrdf import ASYMMETRY_MOST
from rigctl.base.numbers import percent
from rigctl.errors import ConfigError, as_config_error
from rigctl.files.materials import find_material
from rigctl.files.place import GeometrySection, PointingSection
from rigctl.files.scene_file import (
    COVARIANCE_PAIRS,
    AcquisitionSection,
    AlternativeSection,
    AtmosphereSection,
    EffectsSection,
    ErrorsSection,
    FieldSection,
    MeasuredDepthSection,
    NoiseSection,
    RigSection,
    SceneFile,
    SceneRegion,
    SensorSection,
    SunSection,
    effect_names,
    effect_of,
    pointing_angles,
)
from rigctl.files.toml import Section, Uncertain, Within, key_texts, unit_of
from rigctl.scene.sun import band_points, response_band, sun_covariance_deg2, sun_position

if TYPE_CHECKING:
    from rigctl.calibrations.noise import NoiseParameters

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Sun:
    """Position of the sun, and its irradiance outside the atmosphere over that at the mean distance.

    `azimuth_deg` is None where the file states phi alone.
    """

    zenith_deg: Uncertain
    azimuth_deg: Uncertain | None
    distance_factor: Uncertain


@dataclass(frozen=True, kw_only=True)
class Rig:
    """Errors of the rig that takes a cycle of frames, against what is recorded of it."""

    polarizer_offset_deg: Uncertain  #: as in the scene file's [rig], widened by what the rig file of a run states
    exposure_ratio: Uncertain  #: widened by what the scene file states of the exposure
    angle_deg: tuple[Uncertain, ...]  #: error of each angle of the cycle on its own
    angle_names: tuple[str, ...]  #: of these angles, such as "45"
    frame_order: tuple[int, ...]  #: place of each angle's frame in the cycle, from 0

    @property
    def is_ideal(self) -> bool:
        """True if the values are as recorded."""
        turned = any(angle.value for angle in (self.polarizer_offset_deg, *self.angle_deg))
        return not turned and self.exposure_ratio.value == 1.0

    @property
    def is_exact(self) -> bool:
        """True if the values are as recorded and have no uncertainty."""
        stated = (self.polarizer_offset_deg, self.exposure_ratio, *self.angle_deg)
        return self.is_ideal and not any(number.std for number in stated)


@dataclass(frozen=True, kw_only=True)
class SceneRegionRecord:
    """A region as the file has it, and its material at the sensor's wavelength; None where its radiance is given."""

    given: SceneRegion
    material: Material | None

    @property
    def name(self) -> str:
        """Name of the region."""
        return self.given.name


# Keys of numbers with correlated errors, and the covariance of these errors in the units of the file.
JointErrors = tuple[tuple[str, ...], FloatArray]
# Beginning of the keys of angles whose errors [pointing] correlates.
_POINTED = ("geometry.", "regions.")


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """A scene, its sensor and its rig."""

    name: str
    sensor: SensorSection  #: With the effective wavelength.
    noise: NoiseSection  #: A calibration's numbers in place of those of the file.
    acquisition: AcquisitionSection
    regions: tuple[SceneRegionRecord, ...]
    errors: ErrorsSection
    effects: EffectsSection
    sun: Sun | None = None  #: By its angles, however the file states it.
    geometry: GeometrySection | None = None
    atmosphere: AtmosphereSection | None = None
    field_of_view: FieldSection | None = None
    rig: Rig | None = None  #: None: as it is recorded.
    sun_time: datetime | None = None  #: As the file states it; None where it states the angles.
    pointing: PointingSection | None = None  #: Correlation of the errors of camera and panel angles.
    joint_errors: tuple[JointErrors, ...] = ()  #: Of what is off together; all other errors are independent.
    assumed: tuple[str, ...] = ()  #: What is assumed of noise and materials, in words.
    changed: tuple[str, ...] = ()  #: What options have changed, in words.

    @property
    def has_materials(self) -> bool:
        """True if any region's light is to be computed."""
        return any(region.material is not None for region in self.regions)

    @property
    def exposure_s(self) -> float:
        """Exposure of a frame as the file has it [s]."""
        return self.acquisition.exposure_ms / 1000.0

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is assumed, left out or changed, and where the geometry is beyond the model."""
        left_out = ", ".join(self.effects.left_out)
        together = [keys for keys, _ in self.joint_errors if keys[0].startswith(_POINTED)]
        return (
            *self.assumed,
            *([f"left out by request: {left_out}; rigctl effects says what that may change"] if left_out else []),
            *_geometry_remarks(self),
            *(f"the errors of {', '.join(keys)} are correlated, as [pointing] states" for keys in together),
            *self.changed,
        )


EXPOSURE = "acquisition.exposure_ms"
GAIN, NOISE_FACTOR = "noise.gain_dn_per_e", "noise.noise_factor"
EFFICIENCY, TRANSMITTANCE = "sensor.quantum_efficiency", "sensor.optics_transmittance"
SUN_ZENITH, SUN_AZIMUTH = "sun.zenith_deg", "sun.azimuth_deg"
OFFSET, EXPOSURE_RATIO = "rig.polarizer_offset_deg", "rig.exposure_ratio"
DRIFT = "errors.illumination_drift"
# Before the name of each angle.
ANGLE = "rig.angle_deg."

# Just above the horizon; an index of refraction is not 0.
_LOWEST_DEG, _LEAST_INDEX = 89.0, 1e-3
_RADIANCE = "W m-2 sr-1"
_RADIANCE_2 = f"({_RADIANCE})^2"

Place = tuple[str | int, ...]


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A number of a scene."""

    key: str  #: As in files, in --sweep and in reports; in the table, of a region, within that region.
    unit: str  #: Of the file; empty for a pure number.
    words: str = ""  #: Its meaning in one line, where no table of the scene file has its key.
    section: type[Section] | None = None  #: The table of the scene file that has its key.
    least: float = 0.0  #: Between which numbers it has to stay; infinite where there is no limit.
    most: float = inf
    place: str = ""  #: Where it stands in the record, where that is not its key.
    value: float = math.nan  #: It, and its standard uncertainty, in `unit`; in the table there is none.
    std: float = 0.0

    @cached_property
    def path(self) -> Place:
        """Steps from the record to the parameter: attributes, and places in a tuple."""
        return tuple(int(step) if step.isdigit() else step for step in (self.place or self.key).split("."))

    @property
    def meaning(self) -> str:
        """Its meaning in one line."""
        return self.words if self.section is None else key_texts(self.section)[self.key.rpartition(".")[2]][0]


def _row(key: str, unit: str, words: str, least: float = 0.0, most: float = inf, place: str = "") -> Parameter:
    return Parameter(key=key, unit=unit, words=words, least=least, most=most, place=place)


def _rows_of(table: str, section: type[Section]) -> Iterator[Parameter]:
    """Yield a row for each key of a table of the scene file that is a number with an uncertainty."""
    for name, field in section.model_fields.items():
        range_ = _range_of(field)
        if range_ is not None:
            key = f"{table}.{name}"
            most = _LOWEST_DEG if name in _ZENITHS else range_.most
            yield Parameter(key=key, unit=unit_of(key), section=section, least=range_.least, most=most)


def _range_of(field: FieldInfo) -> Within | None:
    """Return the range of a number with an uncertainty; None for a key of another kind."""
    kinds = [field.annotation, *get_args(field.annotation)]
    inner = [annotated for kind in kinds for annotated in (kind, *get_args(kind))]
    if Uncertain not in inner or any(get_origin(kind) is tuple for kind in kinds):
        return None
    return next((one for one in (*field.metadata, *inner) if isinstance(one, Within)), Within())


_ZENITHS = ("zenith_deg", "camera_zenith_deg")
SCENE_ROWS = tuple(
    row
    for table, section in (
        ("sensor", SensorSection),
        ("noise", NoiseSection),
        ("sun", SunSection),
        ("geometry", GeometrySection),
        ("atmosphere", AtmosphereSection),
        ("atmosphere.measured_depths.0", MeasuredDepthSection),
        ("atmosphere.measured_depths.1", MeasuredDepthSection),
        ("atmosphere.alternative", AlternativeSection),
        ("field_of_view", FieldSection),
        ("errors", ErrorsSection),
    )
    for row in _rows_of(table, section)
    if row.key != DRIFT
)

# Within "regions.NAME.".
REGION_ROWS = (
    *(
        _row(
            f"stokes_radiance.{k}",
            _RADIANCE,
            f"S{k} at the aperture, in band",
            -inf,
            place=f"given.stokes_radiance.{k}",
        )
        for k in range(3)
    ),
    _row("texture_rms", "", "Relative deviation of the pixels' whole Stokes vector", place="given.texture_rms"),
    *(
        _row(
            f"texture_covariance.{i}.{j}",
            _RADIANCE_2,
            f"Further covariance of the pixels' S{i} and S{j}",
            0.0 if i == j else -inf,
            place=f"given.texture_covariance.{i}.{j}",
        )
        for i, j in COVARIANCE_PAIRS
    ),
)

# Of a region that is given by its material.
MATERIAL_ROWS = (
    *(
        _row(f"texture_diagonal.{k}", "", f"Deviation of the pixels' S{k} over S0", place=f"given.texture_diagonal.{k}")
        for k in range(3)
    ),
    _row("tilt_deg", "deg", "Tilt of the surface from level", place="given.tilt_deg"),
    _row("tilt_azimuth_deg", "deg", "Azimuth to which it is tilted", -inf, place="given.tilt_azimuth_deg"),
    _row("n", "", "Index of refraction, real part", _LEAST_INDEX, place="material.n"),
    _row("k", "", "Index of refraction, imaginary part", place="material.k"),
    _row("slope_rms", "", "Deviation of the facets' slopes, per axis", SLOPE_RMS_MIN, place="material.slope_rms"),
    _row("dhr", "", "Directional-hemispherical reflectance", most=1.0, place="material.dhr"),
    _row("specular_weight", "", "Weight of the specular lobe", most=1.0, place="material.specular_weight"),
    *(
        _row(key, "", meaning, least, most, place=f"material.{key}")
        for key, meaning, least, most in (
            ("single_scattering", "Weight of light that keeps the pattern of one scattering", 0.0, 1.0),
            ("asymmetry", "Mean cosine of the angle by which a particle scatters", -ASYMMETRY_MOST, ASYMMETRY_MOST),
            ("single_dolp", "DoLP of light that one particle scatters by 90 deg", 0.0, 1.0),
            ("depolarization", "Share of polarized light that a particle depolarizes", 0.0, 1.0),
        )
    ),
    *(
        _row(
            f"table_{key}",
            "",
            f"Error of a tabulated material's {meaning}, in standard errors",
            -inf,
            place=f"material.table_{key}",
        )
        for key, meaning in (("f00", "reflectance"), ("s1", "S1/S0"), ("s2", "S2/S0"))
    ),
    _row("dhr_angle_deg", "deg", "Zenith angle at which the dhr was measured", place="material.dhr_angle_rad"),
)

RIG_ROWS = (*_rows_of("rig", RigSection), *(row for row in _rows_of("errors", ErrorsSection) if row.key == DRIFT))
_ANGLE_ROW = _row(ANGLE, "deg", "Error of one polarizer angle", -inf)
# Its uncertainty is that of rig.exposure_ratio.
_EXPOSURE_ROW = _row(EXPOSURE, "ms", "Exposure of a frame")


def describe() -> tuple[Parameter, ...]:
    """Return all parameters that scenes can have: NAME stands for a region, ANGLE for an angle."""
    regions = tuple(replace(row, key=f"regions.NAME.{row.key}") for row in (*REGION_ROWS, *MATERIAL_ROWS))
    return (*SCENE_ROWS, *regions, *RIG_ROWS, replace(_ANGLE_ROW, key=f"{ANGLE}ANGLE"), _EXPOSURE_ROW)


def parameters(scene: Scene) -> tuple[Parameter, ...]:
    """Return every number of a scene that may be changed, in the order of the file's tables."""
    return tuple(_parameter(*found) for found in _found(scene))


def get(scene: Scene, key: str) -> Parameter:
    """Return one number of a scene."""
    for found in _found(scene):
        if found[0] == key:
            return _parameter(*found)
    raise ConfigError(_unknown(scene, key))


def with_value(scene: Scene, key: str, value: float) -> Scene:
    """Return a copy of the scene with one value changed; standard uncertainties stay."""
    return with_values(scene, {key: value})


def with_values(scene: Scene, values: Mapping[str, float]) -> Scene:
    """Return a copy of the scene with values changed by key; standard uncertainties stay.

    Ranges are not checked here; the model raises an error for values that it cannot compute.
    """
    found = {key: (place, leaf) for key, _, place, leaf in _found(scene)} if values else {}
    changed = scene
    for key, value in values.items():
        place, leaf = found.get(key, ((), None))
        if leaf is None:
            raise ConfigError(_unknown(scene, key))
        if _number(place, leaf)[0] != value:
            changed = _with(changed, place, value)
    return changed


def require_within(scene: Scene, values: Mapping[str, float], *, option: str) -> None:
    """Raise ConfigError if a value is outside of its range."""
    for key, value in values.items():
        one = get(scene, key)
        if not one.least <= value <= one.most:
            limits = f"from {one.least:g}" if math.isinf(one.most) else f"{one.least:g} to {one.most:g}"
            raise ConfigError(f"{option}: {key} = {value:g} {one.unit}".rstrip() + f", allowed is {limits}")


def parse_changes(requests: Iterable[str], *, option: str = "--set") -> dict[str, float]:
    """Parse ``KEY=VALUE`` texts into values by key."""
    found: dict[str, float] = {}
    for request in requests:
        key, _, text = request.partition("=")
        name = key.strip()
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not name or not math.isfinite(value):
            raise ConfigError(f"{option}: is {request!r}, must be KEY=VALUE, for instance sun.zenith_deg=35")
        if name in found:
            raise ConfigError(f"{option}: {name} is given twice; a number has one value")
        found[name] = value
    return found


# Number of keys that are suggested for an unknown one.
_SUGGESTED = 4


def _unknown(scene: Scene, key: str) -> str:
    """Return the message for an unknown key, with the keys to try."""
    keys = [parameter.key for parameter in parameters(scene)]
    if key in {row.key for row in describe()}:
        return f"the scene does not state the number {key!r}; there are {', '.join(keys)}"
    close = get_close_matches(key, keys, n=_SUGGESTED, cutoff=0.6)
    alike = f"did you mean {', '.join(close)}?" if close else f"there are {', '.join(keys)}"
    return f"the scene has no number {key!r}; {alike}"


def _placed_rows(scene: Scene) -> Iterator[tuple[str, Parameter, Place]]:
    """Yield key, row and place in the record of every possible parameter, in the order of the inputs."""
    for row in SCENE_ROWS:
        yield row.key, row, row.path
    for k, region in enumerate(scene.regions):
        rows = REGION_ROWS if region.material is None else (*REGION_ROWS, *MATERIAL_ROWS)
        for row in rows:
            yield f"regions.{region.name}.{row.key}", row, ("regions", k, *row.path)
    for row in RIG_ROWS:
        yield row.key, row, row.path
    for k, name in enumerate(() if scene.rig is None else scene.rig.angle_names):
        yield f"{ANGLE}{name}", _ANGLE_ROW, ("rig", "angle_deg", k)
    yield EXPOSURE, _EXPOSURE_ROW, _EXPOSURE_ROW.path


def _found(scene: Scene) -> Iterator[tuple[str, Parameter, Place, Any]]:
    """Yield the parameters that the scene has, each with the value at its place."""
    for key, row, place in _placed_rows(scene):
        leaf = _at(scene, place)
        if leaf is not None:
            yield key, row, place, leaf


def _parameter(key: str, row: Parameter, place: Place, leaf: Any) -> Parameter:
    value, std = _number(place, leaf)
    return replace(row, key=key, value=value, std=std)


def _number(place: Place, leaf: Any) -> tuple[float, float]:
    if isinstance(leaf, Uncertain):
        return leaf.value, leaf.std
    if isinstance(leaf, Property):
        return leaf.values[0], leaf.standard_uncertainty
    return (math.degrees(leaf) if _is_angle(place) else float(leaf)), 0.0


def _at(record: Any, place: Place) -> Any:
    for step in place:
        if record is None:
            return None
        record = record[step] if isinstance(step, int) else getattr(record, step)
    return record


def _with(record: Any, place: Place, value: float) -> Any:
    """Return a copy of a record with the number at a place changed."""
    step, rest = place[0], place[1:]
    leaf = _at(record, (step,))
    changed = _with(leaf, rest, value) if rest else _leaf(place, leaf, value)
    if isinstance(step, int):
        return (*record[:step], changed, *record[step + 1 :])
    if isinstance(record, BaseModel):
        return record.model_copy(update={step: changed})
    return replace(record, **{step: changed})


def _leaf(place: Place, leaf: Any, value: float) -> Any:
    if isinstance(leaf, Uncertain):
        return leaf.model_copy(update={"value": value})
    if isinstance(leaf, Property):
        return replace(leaf, values=(value,))
    return np.deg2rad(value).item() if _is_angle(place) else value


def _is_angle(place: Place) -> bool:
    """Return whether a number of the record is an angle in radians, which files have in degrees."""
    return str(place[-1]).endswith("_rad")


def with_geometry(scene: Scene, geometry: GeometrySection | None, pointing: PointingSection | None) -> Scene:
    """Return the scene with another viewing geometry and the correlation of its angle errors."""
    others = [one for one in scene.joint_errors if not one[0][0].startswith(_POINTED)]
    regions = [region.given for region in scene.regions]
    joint = (*others, *_pointing(pointing, geometry, regions))
    return replace(scene, geometry=geometry, pointing=pointing, joint_errors=joint)


def with_sun(scene: Scene, sun: Sun) -> Scene:
    """Return the scene under another sun, whose angle errors are not correlated by the site."""
    joint = tuple(one for one in scene.joint_errors if one[0][0] != SUN_ZENITH)
    return replace(scene, sun=sun, joint_errors=joint)


def without_effects(scene: Scene, effects: frozenset[Effect]) -> Scene:
    """Return the scene with some effects left out, in addition to those that it leaves out itself."""
    names = tuple(name for name in effect_names() if effect_of(name) in effects)
    return replace(scene, effects=chosen_effects(scene.effects, (), names))


def forced_effects(scene: Scene) -> dict[Effect, bool]:
    """Return the effects that are forced on (True) or off (False)."""
    return forced(scene.effects, scene.name)


def acting_effects(scene: Scene) -> frozenset[Effect]:
    """Return the effects that act without a tolerance: all but those that the user leaves out."""
    return ALL - {effect for effect, acts in forced_effects(scene).items() if not acts}


def assumed_materials(regions: Iterable[SceneRegionRecord]) -> Iterable[str]:
    """Yield a line for each region with the material properties that are assumed."""
    for region in regions:
        assumed = () if region.material is None else assumed_properties(region.material)
        if region.material is not None and assumed:
            yield f"assumed, not measured: {', '.join(assumed)} of {region.material.name} (region {region.name})"


def rig_errors(scene: Scene) -> RigErrors | None:
    """Return the errors of the rig of a scene; None if it is as recorded."""
    rig = scene.rig
    if rig is None or rig.is_ideal:
        return None
    single_deg = np.array([angle.value for angle in rig.angle_deg])
    return RigErrors(
        turned_rad=np.deg2rad(single_deg + rig.polarizer_offset_deg.value),
        exposure_ratio=rig.exposure_ratio.value,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Inputs:
    """The k numbers that a prediction depends on."""

    scene: Scene  #: The scene that they belong to.
    names: tuple[str, ...]  #: Keys, such as "regions.black_panel.stokes_radiance.0".
    values: FloatArray  #: In the units of the file.
    cov: FloatArray  #: Their covariance.
    least: FloatArray  #: Limits of each; infinite if unlimited.
    most: FloatArray
    #: Inputs that were fitted together with others, whose covariance with these is of first order.
    fitted: tuple[str, ...] = ()

    def at(self, values: FloatArray) -> Scene:
        """Return the scene with other values of these numbers."""
        return with_values(self.scene, dict(zip(self.names, values.tolist(), strict=True)))

    def of(self, key: str) -> float:
        """Return the value of one of them."""
        return float(self.values[self.names.index(key)])


def gather(scene: Scene) -> Inputs:
    """Return the numbers of a scene with their covariance; a rig exactly as recorded adds none."""
    found = [parameter for parameter in parameters(scene) if _is_input(scene, parameter)]
    return Inputs(
        scene=scene,
        names=tuple(parameter.key for parameter in found),
        values=np.array([parameter.value for parameter in found]),
        cov=_covariance(scene, found),
        least=np.array([parameter.least for parameter in found]),
        most=np.array([parameter.most for parameter in found]),
    )


def _is_input(scene: Scene, parameter: Parameter) -> bool:
    if parameter.key.startswith(ANGLE) and parameter.std == 0.0:
        return False
    if parameter.key.startswith("rig."):
        return scene.rig is not None and not scene.rig.is_exact
    # The uncertainty of the exposure is in rig.exposure_ratio.
    return parameter.key != EXPOSURE


def only_uncertain(inputs: Inputs) -> Inputs:
    """Return the inputs that have an uncertainty."""
    kept = np.flatnonzero(np.diag(inputs.cov) > 0.0)
    return replace(
        inputs,
        names=tuple(inputs.names[k] for k in kept),
        values=inputs.values[kept],
        cov=inputs.cov[np.ix_(kept, kept)],
        least=inputs.least[kept],
        most=inputs.most[kept],
    )


def _covariance(scene: Scene, found: list[Parameter]) -> FloatArray:
    cov = np.diag([parameter.std**2 for parameter in found])
    places = {parameter.key: k for k, parameter in enumerate(found)}
    for keys, joint in scene.joint_errors:
        there = [places[key] for key in keys]
        cov[np.ix_(there, there)] = joint
    return cov


# Up to this zenith angle a plane-parallel atmosphere needs no remark.
_PLANE_TO_DEG = 85.0
_EARTH_RADIUS_M = 6.371e6
# A wider field, from corner to corner, may come near the horizon, where few tiles do not resolve the light.
_WIDE_DEG = 90.0


def _geometry_remarks(scene: Scene) -> Iterator[str]:
    """Yield a remark for each part of the geometry outside of the model's range, with the size of the error."""
    if not scene.has_materials:
        return
    if scene.geometry is not None and _PLANE_TO_DEG < scene.geometry.camera_zenith_deg.value < 90.0:
        yield _of_view(scene.geometry)
    field = scene.field_of_view
    if field is not None and field.width_deg is not None and field.height_deg is not None:
        width, height = field.width_deg.value, field.height_deg.value
        if hypot(width, height) > _WIDE_DEG:
            yield (
                f"field of view {width:g} x {height:g} deg: {field.tiles_per_side} x {field.tiles_per_side} tiles are "
                "too few near the horizon; --tolerance chooses their number and lists results that it cannot guarantee"
            )


def _slant_path_m(*, height_m: float, zenith_rad: float) -> float:
    """Return the length of path from the ground to a height over a round earth, without refraction [m].

    Definition: law of cosines in the triangle with the earth's centre.
    """
    along = _EARTH_RADIUS_M * cos(zenith_rad)
    beyond = height_m * (2.0 * _EARTH_RADIUS_M + height_m)
    # The difference of two long paths, without loss of digits.
    return beyond / (sqrt(along**2 + beyond) + along) if height_m > 0.0 else 0.0


def _of_view(geometry: GeometrySection) -> str:
    zenith_deg, height_m = geometry.camera_zenith_deg.value, geometry.camera_height_m.value
    zenith_rad = radians(zenith_deg)
    if height_m == 0.0:
        return (
            f"camera zenith {zenith_deg:g} deg: above {_PLANE_TO_DEG:g} deg the reflected light "
            "comes from sky near the horizon, where a plane-parallel atmosphere is wrong"
        )
    plane_m, round_m = height_m / cos(zenith_rad), _slant_path_m(height_m=height_m, zenith_rad=zenith_rad)
    return (
        f"camera zenith {zenith_deg:g} deg: above {_PLANE_TO_DEG:g} deg a plane-parallel atmosphere is "
        f"wrong; its path to the camera is {plane_m / 1000.0:.3g} km long, over a round earth "
        f"{round_m / 1000.0:.3g} km ({percent(plane_m / round_m - 1.0)} too long)"
    )


def chosen_effects(stated: EffectsSection, switched_on: Sequence[str], left_out: Sequence[str]) -> EffectsSection:
    """Return the stated effects with some forced by name, which have priority."""
    for name in (*switched_on, *left_out):
        if name not in effect_names():
            close = get_close_matches(name, effect_names(), n=1)
            alike = f"did you mean {close[0]}?" if close else f"allowed are {', '.join(effect_names())}"
            raise ConfigError(f"effect {name!r} is not known; {alike}")
    mine = {*switched_on, *left_out}
    return EffectsSection.model_validate(
        {
            "with": (*switched_on, *(one for one in stated.switched_on if one not in mine)),
            "without": (*left_out, *(one for one in stated.left_out if one not in mine)),
        }
    )


def forced(effects: EffectsSection, scene_name: str) -> dict[Effect, bool]:
    """Return the effects that are forced on (True) or off (False); ConfigError if one is both."""
    both = sorted(set(effects.switched_on) & set(effects.left_out))
    if both:
        raise ConfigError(f"scene {scene_name}: effects {', '.join(both)} are both switched on and left out")
    return {effect_of(name): True for name in effects.switched_on} | {
        effect_of(name): False for name in effects.left_out
    }


def _pointing(
    pointing: PointingSection | None, geometry: GeometrySection | None, regions: Sequence[SceneRegion]
) -> Iterable[JointErrors]:
    """Yield the covariance of those camera and panel angles that the model uses."""
    if pointing is None:
        return
    given = {f"regions.{region.name}." for region in regions if region.material is None}
    keys, angles = pointing.parameters, pointing_angles(geometry, regions)
    used = [k for k, key in enumerate(keys) if key in angles and key.rpartition(".")[0] + "." not in given]
    std = np.array([angles[keys[k]].std for k in used])
    correlation = np.array(pointing.correlation)[np.ix_(used, used)]
    if len(used) > 1:
        yield tuple(keys[k] for k in used), correlation * np.outer(std, std)


_NM_PER_M = 1e9


def scene_of_file(file: SceneFile, noise: "NoiseParameters | None" = None) -> Scene:
    """Return the scene of a file; the numbers of a noise calibration take the place of the assumed noise."""
    sensor = _with_wavelength(file)
    wavelength_m = 0.0 if sensor.wavelength_nm is None else sensor.wavelength_nm.value * 1e-9
    sun, by_site = _sun(file)
    known, joint = _calibrated(noise)
    regions = tuple(_region(region, wavelength_m) for region in file.regions)
    scene = Scene(
        name=file.name,
        sensor=sensor,
        noise=file.noise.model_copy(update=known),
        acquisition=file.acquisition,
        regions=regions,
        errors=file.errors,
        effects=file.effects,
        sun=sun,
        geometry=file.geometry,
        atmosphere=file.atmosphere,
        field_of_view=file.field_of_view,
        sun_time=None if file.sun is None else file.sun.time,
        joint_errors=(*joint, *by_site),
        rig=_rig(file),
        assumed=(*_of_noise(file, noise, known), *assumed_materials(regions)),
    )
    return with_geometry(scene, file.geometry, file.pointing)


def with_choices(scene: SceneFile, *, switched_on: Sequence[str], left_out: Sequence[str]) -> SceneFile:
    """Return the scene file with effects forced by options, which go before those of the file."""
    chosen = scene.model_copy(update={"effects": chosen_effects(scene.effects, switched_on, left_out)})
    forced(chosen.effects, scene.name)
    return chosen


def _with_wavelength(file: SceneFile) -> SensorSection:
    """Return the sensor with an effective wavelength that is not stated: that of sunlight in its band."""
    if file.sensor.wavelength_nm is not None:
        return file.sensor
    nm, response = np.array(band_points(file.sensor, file.name)).T
    with as_config_error(f"scene {file.name}"):
        band = response_band(wavelength_nm=nm, response=response, distance_factor=1.0)
    wavelength_nm = effective_wavelength_m(band.wavelength_m, band.weighted) * _NM_PER_M
    return file.sensor.model_copy(update={"wavelength_nm": Uncertain(value=wavelength_nm)})


def _calibrated(noise: "NoiseParameters | None") -> tuple[dict[str, Uncertain], tuple[JointErrors, ...]]:
    """Return what a calibration knows, by the names of the file, and the covariance of its errors."""
    if noise is None:
        return {}, ()
    names = [name for name in NoiseSection.model_fields if name in noise.known]
    values = {name: 0.0 if name in noise.below_zero else noise.known[name].value for name in names}
    found = {name: Uncertain(value=values[name], std=noise.known[name].std_error) for name in names}
    keys = tuple(f"noise.{name}" for name in names)
    return found, ((keys, noise.covariance_of(names)),)


def _of_noise(file: SceneFile, noise: "NoiseParameters | None", known: Mapping[str, Uncertain]) -> tuple[str, ...]:
    below = (
        f"noise.{name}: the calibration's estimate {value:.3g} is below 0 by its error; 0 is used"
        for name, value in (noise.below_zero if noise is not None else {}).items()
    )
    # The noise factor is a choice of the user's, not a property of a sensor: no calibration gives it.
    assumed = [
        f"noise.{name} = {getattr(file.noise, name).value:g}"
        for name in NoiseSection.model_fields
        if name not in known and f"noise.{name}" != NOISE_FACTOR
    ]
    return (*below, *([f"assumed, not calibrated: {', '.join(assumed)}"] if assumed else []))


def _rig(file: SceneFile) -> Rig:
    """Return the rig of a scene file, with the cycle that the file states; errors of exposure and ratio are apart."""
    stated, taken = file.rig, file.acquisition
    in_time_deg = np.mod(taken.angles_deg, 180.0)
    ratio = stated.exposure_ratio
    exposure_std = taken.exposure_std_ms / taken.exposure_ms * ratio.value
    return Rig(
        polarizer_offset_deg=stated.polarizer_offset_deg,
        exposure_ratio=Uncertain(value=ratio.value, std=float(np.hypot(ratio.std, exposure_std))),
        angle_deg=(Uncertain(value=0.0, std=stated.angle_std_deg),) * len(in_time_deg),
        angle_names=tuple(f"{angle:g}" for angle in np.sort(in_time_deg)),
        frame_order=tuple(np.argsort(in_time_deg, kind="stable").tolist()),
    )


def _sun(file: SceneFile) -> tuple[Sun | None, tuple[JointErrors, ...]]:
    """Return the sun by its angles, and what one place moves together of them."""
    stated = file.sun
    if stated is None:
        return None, ()
    if stated.time is not None:
        return _sun_of_time(file, stated.time)
    if stated.zenith_deg is None:
        raise ConfigError(f"scene {file.name}: [sun] needs zenith_deg or time")
    factor = stated.distance_factor
    if factor is None:
        day = stated.day_of_year
        factor = Uncertain(value=1.0 if day is None else distance_factor(day_of_year=day))
    return Sun(zenith_deg=stated.zenith_deg, azimuth_deg=stated.azimuth_deg, distance_factor=factor), ()


def _sun_of_time(file: SceneFile, time: datetime) -> tuple[Sun, tuple[JointErrors, ...]]:
    if file.site is None:
        raise ConfigError(f"scene {file.name}: sun.time also needs [site]")
    position, covariance = sun_position(time, file.site.place), sun_covariance_deg2(file.site, time)
    zenith_std, azimuth_std = np.sqrt(np.diag(covariance)).tolist()
    sun = Sun(
        zenith_deg=Uncertain(value=math.degrees(position.zenith_rad), std=zenith_std),
        azimuth_deg=Uncertain(value=math.degrees(position.azimuth_rad), std=azimuth_std),
        distance_factor=Uncertain(value=position.distance_factor),
    )
    return sun, (((SUN_ZENITH, SUN_AZIMUTH), covariance),) if file.site.is_uncertain else ()


def _region(region: SceneRegion, wavelength_m: float) -> SceneRegionRecord:
    if region.material is None:
        return SceneRegionRecord(given=region, material=None)
    # A file's path was made absolute when the scene file was read.
    material = find_material(region.material, beside=Path())
    try:
        here = material.at(wavelength_m)
    except ValueError as error:
        raise ConfigError(f"region {region.name}: {error}") from error
    return SceneRegionRecord(given=region, material=here)
