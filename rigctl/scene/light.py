"""The light of a scene: its record, in the units of the file, is converted to records of the model.

`lit_scene` and `build_scenario` give the inputs of a prediction. `SceneLight` computes the light of materials and keeps
it. `SkyStore` keeps solved skies between runs in the user's cache folder, each under a hash of all inputs and of the
solver's source. `read_sky_table` reads a user's own sky from a numpy archive.
"""

import contextlib
import hashlib
import importlib.util
import io
import os
from collections.abc import Callable, Iterable
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from functools import cache, cached_property
from importlib.resources import files
from importlib.resources.abc import Traversable
from itertools import permutations
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import LightStore, Settings, scenario_of, settings_of_fidelity
from model.atmosphere.aerosols import angstrom_law
from model.atmosphere.air import AtmosphereState, column
from model.atmosphere.layers import AerosolKind, Layer, ScatteringMatrix
from model.atmosphere.sky import FIDELITY_LEVELS, Fidelity, Solver, TableLighting
from model.atmosphere.solver import ModeBlock, Solution, solve
from model.quantities import counts_name
from model.scene.field import FieldPart, part_of_picture, whole_field
from model.scene.panel import View
from model.scene.scene import Air, LitRegion, LitScene, Readout, Scenario
from model.sensor import Imperfections, Sensor, SensorNoise
from model.surface.materials import surface_here
from model.surface.pbrdf import Tilt
from rigctl.base.durable import MOST_RECORD_BYTES, read_arrays, read_bounded
from rigctl.base.numbers import wrapped
from rigctl.errors import ConfigError, DataError, as_config_error
from rigctl.files.choices import Engine
from rigctl.files.scene_file import COVARIANCE_PAIRS, NoiseSection
from rigctl.files.toml import Uncertain
from rigctl.scene.scene import Scene, acting_effects
from rigctl.scene.sun import band_points, response_band

if TYPE_CHECKING:
    from model.atmosphere.aerosols import AerosolChoice
    from model.atmosphere.sky import DiffuseLight, HowToSolve, Lighting, LightSolver
    from model.scene.field import FieldLight, Source
    from model.scene.scene import LightParts
    from model.scene.sky_light import Illumination
    from rigctl.files.scene_file import AtmosphereSection, FieldSection
    from rigctl.scene.scene import SceneRegionRecord


def require_engine(engine: Engine, *, tier: Fidelity | None = None) -> None:
    """Refuse an engine that is not installed, or a tier that needs no solver."""
    if engine == "own":
        return
    if tier is not None and FIDELITY_LEVELS[tier].settings is None:
        raise ConfigError(f"--engine {engine}: solves the tiers fast and standard; tier '{tier}' calls no solver")
    if importlib.util.find_spec("sasktran2") is None:
        raise ConfigError(
            "--engine sasktran2: is not installed; run pip install 'rigctl[check]', or leave --engine out"
        )


# A user's own sky


# Largest difference between the sun of the scene and the table's.
_SAME_SUN_DEG = 0.5
# Arrays of the archive, with their shapes: Z zenith angles, P azimuths, H heights.
ARRAYS = {
    "sun_zenith_deg": "()",
    "direct_irradiance": "() in W m-2, on a plane normal to the beam at the ground",
    "zenith_deg": "(Z,)",
    "phi_deg": "(P,): azimuth of the sun minus that of the point or sensor, 0 to 180 or 0 to 360",
    "sky_stokes": "(Z, P, 3) in W m-2 sr-1",
    "height_m": "(H,), from 0",
    "path_transmittance": "(H, Z)",
    "path_stokes": "(H, Z, P, 3) in W m-2 sr-1",
}


def read_sky_table(path: Path, *, sun_zenith_rad: float) -> TableLighting:
    """Return the light of a table."""
    try:
        found = read_arrays(path)
        arrays = {name: np.asarray(found[name], dtype=np.float64) for name in ARRAYS if name in found}
    except DataError as error:
        raise ConfigError(str(error)) from error
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: holds a value that is not a number: {error}") from error
    missing = [f"{name} {shape}" for name, shape in ARRAYS.items() if name not in arrays]
    if missing:
        raise ConfigError("\n  ".join([f"{path}: a table of the sky also needs", *missing]))
    table_deg, scene_deg = arrays["sun_zenith_deg"], float(np.degrees(sun_zenith_rad))
    if table_deg.shape != () or abs(float(table_deg) - scene_deg) > _SAME_SUN_DEG:
        raise ConfigError(
            f"{path}: is for a sun at {table_deg} deg from the zenith, the scene's is at {scene_deg:.2f} deg; allowed "
            f"is a difference of {_SAME_SUN_DEG} deg"
        )
    try:
        return TableLighting(
            direct_irradiance=float(arrays["direct_irradiance"]),
            zenith_rad=np.deg2rad(arrays["zenith_deg"]),
            phi_rad=np.deg2rad(arrays["phi_deg"]),
            sky_stokes=arrays["sky_stokes"],
            height_m=arrays["height_m"],
            path_transmittance=arrays["path_transmittance"],
            path_stokes=arrays["path_stokes"],
        )
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: {error}") from error


# Skies kept between runs


_MAGIC = b"rigctl sky 2 sha256 "
_LAYER_NUMBERS = ("tau_rayleigh", "tau_aerosol", "ssa_aerosol", "g_aerosol", "delta", "forward_share")
# Room for eighty sun positions in four wavelengths, at some 1.5 MB per wavelength.
LIMIT_BYTES = 500_000_000


def user_cache_folder() -> Path:
    """Return the folder of this user's computed skies, below XDG_CACHE_HOME or ~/.cache."""
    stated = os.environ.get("XDG_CACHE_HOME", "")
    base = Path(stated) if Path(stated).is_absolute() else Path.home() / ".cache"
    return base / "rigctl" / "skies"


class SkyStore:
    """Solves an atmosphere, or reads the solution from the folder; called like `model.atmosphere.solver.solve`.

    The name of an entry is the hash of every input and of the solver's source code. An entry that does not match its
    own checksum is computed again.
    """

    def __init__(self, folder: Path, *, solver: Solver | None = None, limit_bytes: int = LIMIT_BYTES) -> None:
        self._folder, self._solver, self._limit_bytes = folder, solver or solve, limit_bytes
        self.remarks: list[str] = []

    def __call__(self, layers: tuple[Layer, ...], **settings: Any) -> Solution:
        """Return the solution of an atmosphere; arguments as `model.atmosphere.solver.solve`."""
        # Other versions of the solver do not use these entries.
        key = hashlib.sha256((_code_hash() + fingerprint((layers, settings))).encode()).hexdigest()
        path = self._folder / f"{key}.sky"
        kept = self._read(path)
        if kept is None:
            kept = self._solver(layers, **settings)
            self._write(path, kept)
        return kept

    def _read(self, path: Path) -> Solution | None:
        try:
            data = read_bounded(path, MOST_RECORD_BYTES)
        except FileNotFoundError:
            return None
        except OSError as error:
            self.remarks.append(f"computed skies: {path} cannot be read ({error.strerror}); computed again")
            return None
        solution = _checked(data)
        if solution is None:
            self.remarks.append(f"computed skies: {path} is damaged; computed again")
            return None
        with contextlib.suppress(OSError):
            os.utime(path)  # marks it as used, since a full folder removes the least recently used
        return solution

    def _write(self, path: Path, solution: Solution) -> None:
        try:
            body = _encoded(solution)
            self._folder.mkdir(parents=True, exist_ok=True)
            part = path.with_name(f"{path.name}.{os.getpid()}.part")
            # Not flushed: an entry damaged by a power cut fails its checksum.
            part.write_bytes(_MAGIC + hashlib.sha256(body).hexdigest().encode() + b"\n" + body)
            part.replace(path)
            self._make_room()
        except OSError as error:
            self.remarks.append(f"computed skies: {self._folder} cannot be written ({error.strerror})")

    def _make_room(self) -> None:
        """Remove the least recently used entries until the rest fits."""
        entries = sorted(
            (path for path in self._folder.iterdir() if path.suffix == ".sky"), key=lambda path: path.stat().st_mtime_ns
        )
        size = sum(path.stat().st_size for path in entries)
        for path in entries:
            if size <= self._limit_bytes:
                return
            size -= path.stat().st_size
            path.unlink()


@cache
def _code_hash() -> str:
    """Return a hash of the sources of the atmosphere."""
    digest = hashlib.sha256()
    for name, source in sorted(solver_sources().items()):
        digest.update(name.encode() + b"\0" + source.read_bytes() + b"\0")
    return digest.hexdigest()


def solver_sources() -> dict[str, Traversable]:
    """Return every source file that a solution depends on, by its path in the package of the atmosphere."""
    return sources_of(files("model.atmosphere"))


def sources_of(folder: Traversable, prefix: str = "") -> dict[str, Traversable]:
    """Return the sources of a package and of the packages in it, by their paths."""
    found: dict[str, Traversable] = {}
    for entry in folder.iterdir():
        if entry.is_dir():
            found |= sources_of(entry, f"{prefix}{entry.name}/")
        elif entry.name.endswith(".py"):
            found[prefix + entry.name] = entry
    return found


def fingerprint(value: object) -> str:
    """Return a hash of the numbers and the structure of a record."""
    digest = hashlib.sha256()

    def feed(one: Any) -> None:
        if isinstance(one, np.ndarray):
            digest.update(f"{one.dtype.str}{one.shape}".encode() + np.ascontiguousarray(one).tobytes())
        elif is_dataclass(one):
            feed((type(one).__name__, *(getattr(one, field.name) for field in fields(one) if field.init)))
        elif isinstance(one, dict):
            feed(tuple(sorted(one.items())))
        elif isinstance(one, tuple):
            digest.update(f"{len(one)}:".encode())
            for part in one:
                feed(part)
        else:
            plain = one.value if isinstance(one, Enum) else one.item() if isinstance(one, np.generic) else one
            digest.update(f"{plain!r},".encode())

    feed(value)
    return digest.hexdigest()


def _encoded(sky: Solution) -> bytes:
    """Return a solution as the bytes of a numpy archive; a scattering matrix that layers share is written once."""
    matrices = {id(layer.matrix): layer.matrix for layer in sky.layers if layer.matrix is not None}
    places = {None: -1} | {matrix: k for k, matrix in enumerate(matrices.values())}
    arrays: dict[str, Any] = {
        "numbers": [sky.mu0, sky.ground_radiance, sky.diffuse_irradiance, sky.orders, sky.converged],
        "edges": sky.edges,
        "layers": [[getattr(layer, name) for name in _LAYER_NUMBERS] for layer in sky.layers],
        "matrix_of_layer": [places[layer.matrix] for layer in sky.layers],
        "matrix_errors": [matrix.error_estimate for matrix in matrices.values()],
        "modes": [(block.modes.start, block.modes.stop, block.modes.step) for block in sky.blocks],
    }
    arrays |= {f"matrix_{k}": matrix.coefficients for k, matrix in enumerate(matrices.values())}
    arrays |= {f"block_{k}": block.expansion for k, block in enumerate(sky.blocks)}
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def _checked(data: bytes) -> Solution | None:
    """Return the solution of an entry; None if it is damaged."""
    head, _, body = data.partition(b"\n")
    if head != _MAGIC + hashlib.sha256(body).hexdigest().encode():
        return None
    try:
        with np.load(io.BytesIO(body), allow_pickle=False) as archive:
            mu0, ground, irradiance, orders, converged = archive["numbers"].tolist()
            matrices = [
                ScatteringMatrix(coefficients=archive[f"matrix_{k}"], error_estimate=error)
                for k, error in enumerate(archive["matrix_errors"].tolist())
            ]
            return Solution(
                layers=tuple(
                    Layer(**dict(zip(_LAYER_NUMBERS, numbers, strict=True)), matrix=None if k < 0 else matrices[k])
                    for numbers, k in zip(archive["layers"].tolist(), archive["matrix_of_layer"].tolist(), strict=True)
                ),
                mu0=mu0,
                edges=archive["edges"],
                blocks=tuple(
                    ModeBlock(modes=range(*modes), expansion=archive[f"block_{k}"])
                    for k, modes in enumerate(archive["modes"].tolist())
                ),
                ground_radiance=ground,
                diffuse_irradiance=irradiance,
                orders=int(orders),
                converged=bool(converged),
            )
    except (KeyError, TypeError, ValueError, OSError):
        return None


# The scene as records of the model


# South, as the sun's azimuth if the scene file states only phi; no result depends on it.
_ANY_AZIMUTH_DEG = 180.0
_M_PER_DU, _PA_PER_HPA = 1e-5, 100.0


def wavelength_m(scene: Scene) -> float:
    """Return the effective wavelength of a scene's sensor [m]."""
    if scene.sensor.wavelength_nm is None:
        raise ConfigError(f"scene {scene.name}: the sensor needs wavelength_nm or a band")
    return scene.sensor.wavelength_nm.value * 1e-9


def air_of(scene: Scene) -> Air:
    """Return the inputs of the light of sun and sky."""
    given, sun = scene.atmosphere, scene.sun
    if given is None or sun is None or not scene.sensor.has_band:
        raise ConfigError(f"scene {scene.name}: needs [sun], [atmosphere] and the sensor's band to compute a sky")
    nm, response = np.array(band_points(scene.sensor, scene.name)).T
    zenith_rad = radians(sun.zenith_deg)
    air = Air(
        sun_zenith_rad=zenith_rad,
        band=response_band(wavelength_nm=nm, response=response, distance_factor=sun.distance_factor.value),
        fidelity=given.tier,
        aerosol=given.aerosol,
        state=state_of(given),
        ground_albedo=given.ground_albedo.value,
        dolp_max=given.dolp_max.value,
        table=_table(given, zenith_rad),
    )
    other = given.alternative
    if other is None:
        return air
    state = _state(given, lower=other.lower or given.lower, upper=other.upper or given.upper)
    alternative = replace(air, aerosol=other.aerosol or given.aerosol, state=state)
    return replace(air, alternative=alternative, share=other.share.value)


def state_of(air: "AtmosphereSection") -> AtmosphereState | None:
    """Return the state of the air; None for a user's own table."""
    return None if air.tier is Fidelity.TABLE else _state(air, lower=air.lower, upper=air.upper)


def camera_view(scene: Scene) -> View:
    """Return where the camera stands."""
    given = scene.geometry
    if given is None:
        raise ConfigError(f"scene {scene.name}: needs [geometry]")
    if given.phi_deg is not None:
        azimuth_rad = sun_azimuth_rad(scene) - radians(given.phi_deg)
    else:
        azimuth_rad = radians(given.camera_azimuth_deg)
    return View(
        zenith_rad=radians(given.camera_zenith_deg),
        azimuth_rad=azimuth_rad,
        roll_rad=radians(given.camera_roll_deg),
        height_m=given.camera_height_m.value,
    )


def sun_azimuth_rad(scene: Scene) -> float:
    """Return the azimuth of the sun [rad]; south where the scene file states none."""
    stated = None if scene.sun is None else scene.sun.azimuth_deg
    return float(np.deg2rad(_ANY_AZIMUTH_DEG if stated is None else stated.value))


def settings_of(scene: Scene) -> Settings:
    """Return the numerical settings in a scene file, for use without a tolerance."""
    air, field = scene.atmosphere, scene.field_of_view
    settings = settings_of_fidelity(
        Fidelity.STANDARD if air is None else air.tier, wavelengths=4 if air is None else air.wavelengths
    )
    if field is None:
        return settings
    return replace(settings, tiles_per_side=field.tiles_per_side, tile_rule=field.rule)


def lit_region(scene: Scene, region: "SceneRegionRecord") -> LitRegion:
    """Return one region of a scene."""
    given = region.given
    covariance, texture_rms = _texture_covariance(region), given.texture_rms.value
    if given.stokes_radiance is not None:
        radiance = np.array([component.value for component in given.stokes_radiance])
        return LitRegion(name=region.name, radiance=radiance, texture_rms=texture_rms, texture_cov=covariance)
    if region.material is None:
        raise ConfigError(f"scene {scene.name}, region {region.name}: needs stokes_radiance or a material")
    r0, r1, r2 = (number.value for number in given.texture_diagonal or (Uncertain(value=0.0),) * 3)
    try:
        return LitRegion(
            name=region.name,
            # Its properties are already those at the sensor's wavelength.
            surface=surface_here(region.material, shadowing=given.shadowing, diffuse=given.diffuse),
            tilt=Tilt(tilt_rad=radians(given.tilt_deg), azimuth_rad=radians(given.tilt_azimuth_deg)),
            part=field_part(scene, region),
            texture_rms=texture_rms,
            texture_diagonal=(r0, r1, r2),
            texture_cov=covariance,
        )
    except ValueError as error:
        raise ConfigError(f"scene {scene.name}, region {region.name}: {error}") from error


def field_part(scene: Scene, region: "SceneRegionRecord") -> FieldPart | None:
    """Return the part of the field of view that a region fills; None for a point on the axis."""
    field, extent = scene.field_of_view, region.given.extent
    if extent == "point" or field is None:
        return None
    picture = (field.focal_length_mm, field.width_pixels, field.height_pixels)
    if extent == "field" and None in picture:
        return whole_field(width_rad=radians(field.width_deg), height_rad=radians(field.height_deg))
    return _picture_part(scene, region, field)


def _picture_part(scene: Scene, region: "SceneRegionRecord", field: "FieldSection") -> FieldPart:
    if field.focal_length_mm is None or field.width_pixels is None or field.height_pixels is None:
        raise ConfigError(
            f'scene {scene.name}, region {region.name}: extent = "rectangle" needs [field_of_view] by '
            "focal_length_mm, width_pixels and height_pixels"
        )
    columns, rows = field.width_pixels, field.height_pixels
    x, y = (-0.5, columns - 0.5), (-0.5, rows - 0.5)
    if region.given.extent == "rectangle":
        corners_x, corners_y = zip(*region.given.outline(), strict=True)
        x, y = (min(corners_x), max(corners_x)), (min(corners_y), max(corners_y))
    return part_of_picture(
        left_pixel=x[0],
        right_pixel=x[1],
        top_pixel=y[0],
        bottom_pixel=y[1],
        picture=(columns, rows),
        pixel_pitch_m=scene.sensor.pixel_pitch_um.value * 1e-6,
        focal_length_m=field.focal_length_mm.value * 1e-3,
    )


def _texture_covariance(region: "SceneRegionRecord") -> NDArray[np.float64]:
    found = np.zeros((3, 3))
    rows = region.given.texture_covariance
    if rows is not None:
        for i, j in COVARIANCE_PAIRS:
            found[i, j] = found[j, i] = rows[i][j].value
    return found


def _table(air: "AtmosphereSection", sun_zenith_rad: float) -> "Lighting | None":
    if air.tier is not Fidelity.TABLE:
        return None
    if air.table is None:
        raise ConfigError("atmosphere: tier 'table' needs table = \"FILE.npz\"")
    return read_sky_table(air.table, sun_zenith_rad=sun_zenith_rad)


def _state(air: "AtmosphereSection", *, lower: "AerosolChoice", upper: "AerosolChoice") -> AtmosphereState:
    exponent, depth = _spectrum(air)
    return AtmosphereState(
        visibility_m=None if air.visibility_km is None else air.visibility_km.value * 1e3,
        aerosol_optical_depth=depth,
        boundary_aerosol=lower,
        upper_aerosol=upper,
        angstrom_exponent=exponent,
        relative_humidity=air.relative_humidity.value,
        ozone_m=air.ozone_du.value * _M_PER_DU,
        surface_pressure_pa=air.surface_pressure_hpa.value * _PA_PER_HPA,
    )


def _spectrum(air: "AtmosphereSection") -> tuple[float | None, float | None]:
    """Angstrom's exponent and optical depth at 550 nm, as stated or as measured at two wavelengths."""
    if air.measured_depths is None:
        return _value(air.angstrom_exponent), _value(air.aerosol_optical_depth)
    first, second = air.measured_depths
    return angstrom_law(
        first_m=first.wavelength_nm * 1e-9,
        first_depth=first.optical_depth.value,
        second_m=second.wavelength_nm * 1e-9,
        second_depth=second.optical_depth.value,
    )


def _value(number: Uncertain | None) -> float | None:
    return None if number is None else number.value


def radians(number: Uncertain | None) -> float:
    """Return an angle of a file in radians; 0 if missing."""
    return 0.0 if number is None else np.deg2rad(number.value).item()


_REFERENCE_M = 550e-9
_BY_SASKTRAN2 = (
    "atmosphere: solved by sasktran2 as an independent check, without a cache; 2 to 10 deg from the zenith its "
    "radiance is off by up to 1.6 %, and within 1 deg of the horizon it is wrong"
)


class SceneLight:
    """Computes and caches the light of scenes."""

    def __init__(
        self,
        store: SkyStore | None = None,
        *,
        engine: Engine = "own",
        is_kept_between_runs: bool = True,
        tell: Callable[[float], None] | None = None,
    ) -> None:
        """Set the solver of skies and their storage; only skies of our own solver are stored between runs.

        Studies store none, since their thousands of skies would displace all others. `tell` is called with the optical
        depth of each wavelength before it is solved, which takes seconds in deep air.
        """
        require_engine(engine)
        self._engine = engine
        self._solved = SkyStore(user_cache_folder()) if store is None else store
        self._is_kept, self._tell = is_kept_between_runs, tell

    @cached_property
    def lights(self) -> LightStore:
        """The model's cache of lights."""
        solver: LightSolver = self._solved if self._is_kept else solve
        if self._engine != "own":
            from model.atmosphere.sasktran2_engine import sasktran2_solution as solver
        tell = self._tell

        def solve_and_report(layers: "tuple[Layer, ...]", **how: "Unpack[HowToSolve]") -> "DiffuseLight":
            if tell is not None:
                tell(sum(layer.full_depth for layer in layers))
            return solver(layers, **how)

        return LightStore(solver=solve_and_report)

    def illumination(self, scene: Scene) -> "Illumination":
        """Return sun, sky and air of a scene."""
        with as_config_error(f"scene {scene.name}"):
            return self.lights.illumination(
                air_of(scene),
                settings_of(scene),
                sun_azimuth_rad=sun_azimuth_rad(scene),
                parts=_parts(scene),
            )

    def region(self, scene: Scene, region: "SceneRegionRecord", settings: "Settings | None" = None) -> "FieldLight":
        """Return the light of a region with a material."""
        from model.accuracy.chain import LightRequest

        with as_config_error(f"scene {scene.name}"):
            request = LightRequest(
                region=lit_region(scene, region),
                settings=settings_of(scene) if settings is None else settings,
                air=air_of(scene),
                view=camera_view(scene),
                sun_azimuth_rad=sun_azimuth_rad(scene),
                parts=_parts(scene),
            )
            return self.lights.light(request)

    def remarks(self, scene: Scene) -> tuple[str, ...]:
        """Return depth, accuracy and largest uncertainty of the atmosphere, in words."""
        if scene.atmosphere is None or scene.sun is None or not scene.sensor.has_band:
            return ()
        by_engine = () if self._engine == "own" else (_BY_SASKTRAN2,)
        return (*_of_atmosphere(scene.atmosphere), *by_engine, *self._solved.remarks)


def _parts(scene: Scene) -> "LightParts":
    from model.effects.planner import acting_parts

    return acting_parts(acting_effects(scene))


def _of_atmosphere(air: "AtmosphereSection") -> Iterable[str]:
    facts = FIDELITY_LEVELS[air.tier]
    state = state_of(air)
    if state is None:
        yield f"atmosphere: tier table ({facts.accuracy}), from {air.table}; its optical depth is the table's own"
        return
    at_550 = column(state, wavelength_m=_REFERENCE_M)
    yield (
        f"atmosphere: optical depth at 550 nm {at_550.depth:.3f}, of it aerosol {at_550.tau_aerosol:.3f} and molecules "
        f"{at_550.tau_rayleigh:.3f}; tier {air.tier} ({facts.accuracy})"
    )
    yield (
        f"atmosphere: aerosol assumed {air.aerosol} (of {', '.join(AerosolKind)}){_alternative(air)}. The kind of "
        "aerosol is the largest uncertainty of the sky: at the same optical depth its largest degree of polarization "
        "is 0.18 with a depolarizing aerosol, 0.23 with a polarizing one, 0.41 with spheres (rural, 23 km, 550 nm, "
        "black ground, sun 25 deg from the zenith). For this scene: rigctl sky SCENE.toml --compare-aerosols"
    )
    if air.own_aerosol is not None:
        yield f"atmosphere: spheres below 2 km: {air.own_aerosol.name}, {air.own_aerosol.source}"


def _alternative(air: "AtmosphereSection") -> str:
    if air.alternative is None:
        return ""
    other, share = air.alternative, air.alternative.share
    changed = [other.aerosol or "", other.aerosol_type or "", other.upper_aerosol_type or ""]
    own = [section.name for section in (other.own_aerosol, other.own_upper_aerosol) if section is not None]
    named = " ".join(word for word in (*changed, *own) if word)
    return f", with a share of {share.value:g} +- {share.std:g} of the light of {named}"


def build_scenario(
    scene: Scene,
    *,
    readout: Readout | None = None,
    exposure_s: float | None = None,
    light: SceneLight | None = None,
    source: "Source" = "total",
    settings: "Settings | None" = None,
) -> Scenario:
    """Return the scenario of a scene; readout, exposure and settings are those of the file unless given."""
    used = settings_of(scene) if settings is None else settings
    lit = lit_scene(scene, readout=readout, exposure_s=exposure_s, source=source)
    effects = acting_effects(scene)
    if not scene.has_materials:
        return scenario_of(lit, used, effects=effects)
    computer = SceneLight() if light is None else light
    with as_config_error(f"scene {scene.name}"):
        return scenario_of(lit, used, effects=effects, store=computer.lights)


def lit_scene(
    scene: Scene, *, readout: Readout | None = None, exposure_s: float | None = None, source: "Source" = "total"
) -> LitScene:
    """Return a scene as one record of the model; readout and exposure are those of the file unless given."""
    with as_config_error(f"scene {scene.name}"):
        lit = scene.has_materials
        readout = readout_of(scene) if readout is None else readout
        return LitScene(
            air=air_of(scene) if lit else None,
            view=camera_view(scene) if lit else None,
            sun_azimuth_rad=sun_azimuth_rad(scene),
            regions=tuple(lit_region(scene, region) for region in scene.regions),
            sensor=sensor_of(scene, scene.exposure_s if exposure_s is None else exposure_s),
            readout=readout,
            source=source,
            pairs=tuple(permutations((region.name for region in scene.regions), 2)),
            imperfections=imperfections_of(scene, frames=readout.angles_rad.size),
        )


def readout_of(scene: Scene) -> Readout:
    """Return angles and cycles of the scene file, for a prediction without a run."""
    angles_deg = sorted(angle % 180.0 for angle in scene.acquisition.angles_deg)
    return Readout(
        angles_rad=np.deg2rad(angles_deg),
        channel_names=tuple(counts_name(f"{angle:g}") for angle in angles_deg),
        cycles=scene.acquisition.cycles,
        extinction_ratio=scene.sensor.extinction_ratio.value,
    )


def sensor_of(scene: Scene, exposure_s: float) -> Sensor:
    """Return the sensor of a scene at an exposure [s]."""
    given = scene.sensor
    along = given.polarizer_transmittance.value
    noise = {name: getattr(scene.noise, name).value for name in NoiseSection.model_fields}
    return Sensor(
        pixel_pitch_m=given.pixel_pitch_um.value * 1e-6,
        f_number=given.f_number.value,
        optics_transmittance=given.optics_transmittance.value,
        quantum_efficiency=given.quantum_efficiency.value,
        wavelength_m=wavelength_m(scene),
        exposure_s=exposure_s,
        bit_depth=given.bit_depth,
        tau_parallel=along,
        tau_perpendicular=along / given.extinction_ratio.value,
        noise=SensorNoise(**noise),
    )


def imperfections_of(scene: Scene, *, frames: int) -> Imperfections:
    """Return the imperfections of the session; angles are in order of time in the file, ascending in the readout."""
    errors = scene.errors
    angles_deg = np.mod(scene.acquisition.angles_deg, 180.0)
    in_time = tuple(np.argsort(angles_deg, kind="stable").tolist()) if scene.rig is None else scene.rig.frame_order
    return Imperfections(
        drift=errors.illumination_drift.value,
        drift_order=in_time if len(in_time) == frames else (),
        off_axis_falloff=errors.off_axis_falloff,
        polarizer_angle_std_rad=radians(errors.polarizer_angle_std_deg),
        misregistration_pixels=errors.misregistration_px.value,
        texture_correlation_pixels=errors.texture_correlation_px.value,
        surround_albedo=None if errors.surround_albedo is None else errors.surround_albedo.value,
    )


def sun_text(scene: Scene, *, time: str | None = None) -> str:
    """Return zenith angle and azimuth of the sun, phi (the sun's azimuth minus the camera's), and the time."""
    if scene.sun is None or scene.geometry is None:
        return "none"
    azimuth = scene.sun.azimuth_deg
    apart_deg = float(np.rad2deg(sun_azimuth_rad(scene) - camera_view(scene).azimuth_rad))
    # In (-180, 180], to the displayed digits: at 180 the camera looks toward the sun's side.
    phi_deg = -float(wrapped(-round(apart_deg, 2), turn=360.0))
    parts = (
        f"zenith {scene.sun.zenith_deg.value:.2f} deg",
        "azimuth not stated" if azimuth is None else f"azimuth {azimuth.value:.2f} deg",
        f"phi {phi_deg:.2f} deg",
        *(() if time is None else (time,)),
    )
    return ", ".join(parts)
