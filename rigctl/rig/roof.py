"""A simulated roof: the light of its regions by the model, under the sun of each moment. It can be perturbed."""

import math
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.layers import AerosolKind
from model.scene.scene import RegionLight as ModelLight
from rigctl.base.numbers import NS_PER_S, unix_ns, utc_text, wrapped
from rigctl.errors import ConfigError
from rigctl.files.choices import PERTURBATIONS, Perturbation, RoofChange
from rigctl.files.place import SiteSection
from rigctl.files.rig_file import RigFile, SimulatedCamera, SimulatedPolarizer
from rigctl.files.scene_file import SceneFile, SunSection
from rigctl.runs.records import SimulatedLight
from rigctl.scene.light import SceneLight, build_scenario, sun_text
from rigctl.scene.scene import Scene, get, parameters, scene_of_file, with_value
from rigctl.scene.sun import sun_position
from sim_devices.world import RegionLight

# Each is far above what the demo resolves, but would go unnoticed on a roof.
GAIN_FACTOR = 1.05
OFFSET_DEG = 2.0
EXTINCTION_RATIO = 25.0
# These would go unnoticed on a roof.
VISIBILITY_FACTOR = 0.7
DHR_FACTOR = 1.2
TILT_DEG = 3.0
# A thin cloud that comes and goes.
CLOUD_SHARE, CLOUD_S = 0.2, 45.0

_POLARIZER: dict[str, Callable[[SimulatedPolarizer], dict[str, float]]] = {
    "angle-offset": lambda truth: {"offset_deg": truth.offset_deg + OFFSET_DEG},
    "angle-sense": lambda truth: {"sense": -truth.sense},
    "extinction": lambda _: {"extinction_ratio": EXTINCTION_RATIO},
}


def perturbed(rig: RigFile, what: Perturbation) -> RigFile:
    """Return the rig with one simulated property changed; what the rig file tells the program stays the same."""
    if rig.simulation is None:
        raise ConfigError("only a simulated rig can be perturbed")
    if what not in PERTURBATIONS:
        raise ConfigError(f"--perturb: is {what!r}; allowed are {', '.join(PERTURBATIONS)}")
    truth = rig.simulation
    changed: dict[str, SimulatedCamera | SimulatedPolarizer]
    if what == "gain":
        gain = truth.camera.gain_dn_per_e * GAIN_FACTOR
        changed = {"camera": truth.camera.model_copy(update={"gain_dn_per_e": gain})}
    else:
        changed = {"polarizer": truth.polarizer.model_copy(update=_POLARIZER[what](truth.polarizer))}
    return rig.model_copy(update={"simulation": truth.model_copy(update=changed)})


def changed_roof(scene: Scene, what: RoofChange) -> tuple[Scene, str]:
    """Return a scene with one property changed, and a text about it; "drift" is done by `cloud_factor` instead."""
    changes: dict[RoofChange, Callable[[Scene], tuple[Scene, str]]] = {
        "visibility": _visibility,
        "aerosol": _aerosol,
        "dhr": lambda roof: _of_first(roof, "dhr", lambda value: min(1.0, value * DHR_FACTOR)),
        "tilt": lambda roof: _of_first(roof, "tilt_deg", lambda value: value + TILT_DEG),
        "drift": lambda roof: (roof, f"drift: the light falls by {CLOUD_SHARE:.0%} within {CLOUD_S:g} s, and is back"),
    }
    return changes[what](scene)


def cloud_factor(elapsed_ns: int) -> float:
    """Return the factor on the light under "drift" at a time since the beginning [ns]."""
    share = (elapsed_ns / NS_PER_S % CLOUD_S) / CLOUD_S
    return 1.0 - CLOUD_SHARE * share


def _visibility(scene: Scene) -> tuple[Scene, str]:
    known = {parameter.key for parameter in parameters(scene)}
    if "atmosphere.visibility_km" in known:
        return _changed(scene, "visibility", "atmosphere.visibility_km", lambda value: value * VISIBILITY_FACTOR)
    if "atmosphere.aerosol_optical_depth" in known:
        return _changed(
            scene, "visibility", "atmosphere.aerosol_optical_depth", lambda value: value / VISIBILITY_FACTOR
        )
    raise ConfigError("--perturb visibility: the scene states neither visibility_km nor aerosol_optical_depth")


def _aerosol(scene: Scene) -> tuple[Scene, str]:
    air = scene.atmosphere
    if air is None or air.table is not None:
        raise ConfigError("--perturb aerosol: the sky of the scene is a table, not an aerosol")
    other = AerosolKind.DEPOLARIZING if air.aerosol is AerosolKind.SPHERES else AerosolKind.SPHERES
    changed = replace(scene, atmosphere=air.model_copy(update={"aerosol": other}))
    return (changed, f"aerosol: atmosphere.aerosol {other}, not {air.aerosol}")


def _of_first(scene: Scene, name: str, change: Callable[[float], float]) -> tuple[Scene, str]:
    region = next(region.name for region in scene.regions if region.material is not None)
    return _changed(scene, name.removesuffix("_deg"), f"regions.{region}.{name}", change)


def _changed(scene: Scene, name: str, key: str, change: Callable[[float], float]) -> tuple[Scene, str]:
    before = get(scene, key).value
    after = change(before)
    return (with_value(scene, key, after), f"{name}: {key} {after:g}, not {before:g}")


FloatArray = NDArray[np.float64]

# Light is computed each minute and interpolated linearly: at 43 deg from the zenith the error is below 1e-5.
_NODE_NS = 60 * NS_PER_S
_NODES_KEPT = 64
# The model's atmosphere is flat; below this sun there is no light [deg].
LOWEST_SUN_DEG = 85.0
# Differences of place above this are reported [deg].
_NOTABLE_DEG = 0.05


class LitRoof:
    """The light of a scene of materials under the sun of a simulated rig."""

    def __init__(self, file: SceneFile, rig: RigFile) -> None:
        simulation = rig.simulation
        if simulation is None:
            raise ConfigError(f"rig {rig.name}: there is no [simulation] table")
        self._site = rig.site or file.site
        self._clock_ns = None if simulation.clock is None else unix_ns(simulation.clock)
        if self._clock_ns is not None and self._site is None:
            raise ConfigError("--clock: the light of the simulated roof depends on the sun: the rig file needs [site]")
        self._change: RoofChange | None = simulation.perturb
        self._begin_ns = self._clock_ns
        self._file = file if rig.geometry is None else file.model_copy(update={"geometry": rig.geometry})
        self._light = SceneLight()
        self._node = lru_cache(maxsize=_NODES_KEPT)(self._computed)
        self.record = self._record(file, rig)

    def at(self, utc_ns: int) -> dict[str, RegionLight]:
        """Return the light of each region at a time since 1970 (UTC) [ns]."""
        factor = self.dimmed(utc_ns)
        if self._clock_ns is None:
            return _times(self._node(None), factor)
        self.require_day(utc_ns + _NODE_NS)
        number, rest_ns = divmod(utc_ns, _NODE_NS)
        return _times(_between(self._node(number), self._node(number + 1), rest_ns / _NODE_NS), factor)

    def dimmed(self, utc_ns: int) -> float:
        """Return the factor on all light at a time [ns since 1970 UTC]: 1 unless there is a drift."""
        if self._begin_ns is None:
            self._begin_ns = utc_ns
        return cloud_factor(utc_ns - self._begin_ns) if self._change == "drift" else 1.0

    def is_day(self, utc_ns: int) -> bool:
        """Return True if the sun is high enough for the model, or is that of the scene file."""
        return self._clock_ns is None or self._zenith_deg(utc_ns) < LOWEST_SUN_DEG

    def require_day(self, utc_ns: int) -> None:
        """Raise ConfigError if the sun is too low for the model at a time since 1970 (UTC) [ns]."""
        if not self.is_day(utc_ns):
            raise ConfigError(
                f"the simulated roof has no light at {utc_text(utc_ns)[:16]}Z: the sun stands "
                f"{self._zenith_deg(utc_ns):.1f} deg from the zenith, and the model ends at {LOWEST_SUN_DEG:g}"
            )

    def sun_text(self, utc_ns: int) -> str:
        """Return a line with the sun, its time, and their source."""
        if self._clock_ns is None:
            return f"{sun_text(self._scene(None))}; by the scene file"
        scene = self._scene(utc_ns)
        return f"{sun_text(scene, time=utc_text(utc_ns)[:19] + 'Z')}; by the run's simulated clock"

    def _zenith_deg(self, utc_ns: int) -> float:
        if self._site is None:
            raise ConfigError("the sun needs [site]")
        time = datetime.fromtimestamp(utc_ns / NS_PER_S, tz=UTC)
        return math.degrees(sun_position(time, self._site.place).zenith_rad)

    def _computed(self, number: int | None) -> dict[str, RegionLight]:
        scene = self._scene(None if number is None else number * _NODE_NS)
        scenario = build_scenario(scene, light=self._light)
        return {region.name: _painted(region) for region in scenario.regions}

    def _scene(self, utc_ns: int | None) -> Scene:
        file = self._file
        if utc_ns is not None:
            time = datetime.fromtimestamp(utc_ns / NS_PER_S, tz=UTC)
            file = file.model_copy(update={"site": self._site, "sun": SunSection(time=time)})
        scene = scene_of_file(file)
        return scene if self._change is None else changed_roof(scene, self._change)[0]

    def _record(self, file: SceneFile, rig: RigFile) -> SimulatedLight:
        scene = scene_of_file(self._file)
        changed = None if self._change is None else changed_roof(scene, self._change)[1]
        remarks = (*self._of_time(file), *_of_place(file, rig.site), *_of_camera(file, rig))
        if self._clock_ns is not None or scene.sun is None:
            return SimulatedLight(scene=file.name, is_clocked=True, perturbed=changed, remarks=remarks)
        return SimulatedLight(
            scene=file.name,
            is_clocked=False,
            sun_zenith_deg=scene.sun.zenith_deg.value,
            sun_azimuth_deg=None if scene.sun.azimuth_deg is None else scene.sun.azimuth_deg.value,
            distance_factor=scene.sun.distance_factor.value,
            perturbed=changed,
            remarks=remarks,
        )

    def _of_time(self, file: SceneFile) -> tuple[str, ...]:
        if self._clock_ns is None:
            return ("time: the run's clock is the host's and moves no sun; that of the scene file shines (--clock)",)
        clock = utc_text(self._clock_ns)[:16] + "Z"
        if file.sun is None or file.sun.time is None:
            return (f"time: the sun is that of {clock} on; the scene file states it by angles, which are not used",)
        stated = file.sun.time.astimezone(UTC)
        if abs(unix_ns(stated) - self._clock_ns) < _NODE_NS:
            return ()
        return (
            f"time: the clock begins at {clock}, and the sun of the scene file is that of {stated:%Y-%m-%dT%H:%MZ}",
        )


def _of_place(file: SceneFile, site: SiteSection | None) -> tuple[str, ...]:
    stated = file.site
    if site is None:
        return () if stated is None else ("place: the rig file has no [site]; that of the scene file is taken",)
    if stated is None:
        return ()
    north = site.latitude_deg - stated.latitude_deg
    east = float(wrapped(site.longitude_deg - stated.longitude_deg, turn=360.0))
    if math.hypot(north, east) < _NOTABLE_DEG:
        return ()
    rigs, files = (f"{place.latitude_deg:g}, {place.longitude_deg:g}" for place in (site, stated))
    return (f"place: the rig stands at {rigs}, the scene file says {files}; the rig's is taken",)


def _of_camera(file: SceneFile, rig: RigFile) -> tuple[str, ...]:
    if rig.geometry is None or rig.geometry == file.geometry:
        return ()
    return ("geometry: that of the rig file is taken, the scene file's differs",)


def _painted(region: ModelLight) -> RegionLight:
    mean = np.asarray(region.stokes_radiance, dtype=np.float64)
    cov = region.texture_cov + region.texture_rms**2 * np.outer(mean, mean)
    return RegionLight(mean=mean, cov=cov if region.field_cov is None else cov + region.field_cov)


def _between(left: dict[str, RegionLight], right: dict[str, RegionLight], share: float) -> dict[str, RegionLight]:
    return {
        name: RegionLight(
            mean=one.mean + share * (right[name].mean - one.mean), cov=one.cov + share * (right[name].cov - one.cov)
        )
        for name, one in left.items()
    }


def _times(lights: dict[str, RegionLight], factor: float) -> dict[str, RegionLight]:
    if factor == 1.0:
        return lights
    return {name: RegionLight(mean=factor * one.mean, cov=factor**2 * one.cov) for name, one in lights.items()}
