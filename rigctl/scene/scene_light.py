"""The light of a scene's regions, computed from sun, atmosphere and materials."""

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import TYPE_CHECKING, Unpack

from model.atmosphere.layers import AerosolKind
from model.atmosphere.sky import FIDELITY_LEVELS
from rigctl.errors import as_config_error
from rigctl.files.choices import Engine
from rigctl.scene.effect_choice import acting_effects
from rigctl.scene.model_records import air_of, camera_view, lit_region, settings_of, state_of, sun_azimuth_rad
from rigctl.scene.skies.engine import require_engine

if TYPE_CHECKING:
    from model.accuracy.chain import LightStore, Settings
    from model.atmosphere.layers import Layer
    from model.atmosphere.sky import DiffuseLight, HowToSolve, LightSolver
    from model.scene.field import FieldLight
    from model.scene.scene import LightParts
    from model.scene.sky_light import Illumination
    from rigctl.files.light_sections import AtmosphereSection
    from rigctl.scene.scene_record import Scene, SceneRegionRecord
    from rigctl.scene.skies.sky_store import SkyStore

_REFERENCE_M = 550e-9
_BY_SASKTRAN2 = (
    "atmosphere: solved by sasktran2 as an independent check, not kept between runs; 2 to 10 deg from the zenith it is "
    "off by up to 1.6 % in radiance, and nearer than 1 deg to the horizon it is not to be used"
)


class SceneLight:
    """Computes the light of scenes, and keeps what it computed."""

    def __init__(
        self,
        store: "SkyStore | None" = None,
        *,
        engine: Engine = "own",
        is_kept_between_runs: bool = True,
        tell: Callable[[float], None] | None = None,
    ) -> None:
        """Set where solved skies are kept, and what solves them; those of another program are not kept between runs.

        Studies keep none: thousands of skies would be written to throw out those of others. `tell` is told the optical
        depth of each wavelength before it is solved, which takes seconds where the air is deep.

        Raises
        ------
        ConfigError
            The program is not installed.
        """
        require_engine(engine)
        self._engine = engine
        self._given, self._is_kept, self._tell = store, is_kept_between_runs, tell

    # What solves a sky takes a tenth of a second to import, and is not wanted where every radiance is stated.

    @cached_property
    def _solved(self) -> "SkyStore":
        from rigctl.scene.skies.sky_store import SkyStore, user_cache_folder

        return SkyStore(user_cache_folder()) if self._given is None else self._given

    @cached_property
    def lights(self) -> "LightStore":
        """The store in which the model keeps its lights."""
        from model.accuracy.chain import LightStore
        from model.atmosphere.sasktran2_engine import sasktran2_solution
        from model.atmosphere.solver import solve

        own = self._solved if self._is_kept else solve
        solver: LightSolver = own if self._engine == "own" else sasktran2_solution
        return LightStore(solver=solver if self._tell is None else _telling(solver, self._tell))

    def illumination(self, scene: "Scene") -> "Illumination":
        """Return sun, sky and air of a scene.

        Raises
        ------
        ConfigError
            A number is outside its range, such as a sun too low.
        """
        with as_config_error(f"scene {scene.name}"):
            return self.lights.illumination(
                air_of(scene),
                settings_of(scene),
                sun_azimuth_rad=sun_azimuth_rad(scene),
                parts=_parts(scene),
            )

    def region(self, scene: "Scene", region: "SceneRegionRecord", settings: "Settings | None" = None) -> "FieldLight":
        """Return the light of a region that is given by its material.

        Parameters
        ----------
        scene, region
            The region of a scene.
        settings
            Numerical settings in place of those of the file.

        Raises
        ------
        ConfigError
            A number is outside its range.
        """
        with as_config_error(f"scene {scene.name}"):
            return self.lights.region(
                lit_region(scene, region),
                settings_of(scene) if settings is None else settings,
                air=air_of(scene),
                view=camera_view(scene),
                sun_azimuth_rad=sun_azimuth_rad(scene),
                parts=_parts(scene),
            )

    def remarks(self, scene: "Scene") -> tuple[str, ...]:
        """Return what is to be said of the atmosphere: its depth, its effort, and what is least known of it."""
        if scene.atmosphere is None or scene.sun is None or not scene.sensor.has_band:
            return ()
        by_engine = () if self._engine == "own" else (_BY_SASKTRAN2,)
        return (*_of_atmosphere(scene.atmosphere), *by_engine, *self._solved.remarks)


def _parts(scene: "Scene") -> "LightParts":
    from model.effects.planner import acting_parts

    return acting_parts(acting_effects(scene))


def _telling(solver: "LightSolver", tell: Callable[[float], None]) -> "LightSolver":
    def told(layers: "tuple[Layer, ...]", **how: "Unpack[HowToSolve]") -> "DiffuseLight":
        tell(sum(layer.full_depth for layer in layers))
        return solver(layers, **how)

    return told


def _of_atmosphere(air: "AtmosphereSection") -> Iterable[str]:
    facts = FIDELITY_LEVELS[air.tier]
    state = state_of(air)
    if state is None:
        yield f"atmosphere: tier table ({facts.accuracy}), from {air.table}; its optical depth is the table's own"
        return
    from model.atmosphere.air import column

    at_550 = column(state, wavelength_m=_REFERENCE_M)
    yield (
        f"atmosphere: optical depth at 550 nm {at_550.depth:.3f}, of it aerosol {at_550.tau_aerosol:.3f} and molecules "
        f"{at_550.tau_rayleigh:.3f}; tier {air.tier} ({facts.accuracy})"
    )
    yield (
        f"atmosphere: aerosol taken as {air.aerosol} (of {', '.join(AerosolKind)}){_alternative(air)}. The kind of "
        "aerosol is the largest uncertainty of the sky: at the same optical depth its largest degree of polarization "
        "is 0.18 with a depolarizing aerosol, 0.23 with a polarizing one, 0.41 with spheres (rural, 23 km, 550 nm, "
        "black ground, sun 25 deg from the zenith). For this scene: rigctl sky SCENE.toml --compare-aerosols"
    )


def _alternative(air: "AtmosphereSection") -> str:
    if air.alternative is None:
        return ""
    other, share = air.alternative, air.alternative.share
    changed = [other.aerosol or "", other.aerosol_type or "", other.upper_aerosol_type or ""]
    own = [section.name for section in (other.own_aerosol, other.own_upper_aerosol) if section is not None]
    named = " ".join(word for word in (*changed, *own) if word)
    return f", with a share of {share.value:g} +- {share.std:g} of the light as if it were {named}"
