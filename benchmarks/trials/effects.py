"""Every effect that is left out of a random scene changes it by no more than its bound, alone and together.

For each scene, every effect that is there and has a bound below 1 is left out alone, whether or not the planner left it
out. Then all absent effects, and all that the planner leaves out at a random tolerance, are left out together. Each
number of the prediction is compared.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from model.accuracy.chain import LightStore, Readings, Settings, evaluate
from model.accuracy.effect_check import change, skylight_bound
from model.atmosphere.air import AtmosphereState
from model.atmosphere.layers import AerosolKind
from model.atmosphere.sky import Fidelity, SolarBand, SolverSettings
from model.effects.effect import ALL, Bound, Effect, EffectPlan
from model.effects.planner import plan
from model.scene.field import FieldPart
from model.scene.panel import View
from model.scene.scene import Air, LitRegion, LitScene, Readout
from model.sensor import Imperfections, Sensor, SensorNoise
from model.surface.pbrdf import Surface, Tilt

# Coarse: bounds are of effects, with and without at the same settings.
SETTINGS = Settings(
    wavelengths=2,
    solver=SolverSettings(fine_layers=False, nodes=4, element_depth=0.2, tolerance=1e-3),
    sky_zeniths=16,
    sky_azimuths=14,
    hemisphere_tolerance=0.05,
    tiles_per_side=2,
    negligible_spread=0.0,
    dolp_tolerance=1e-11,
)
# Under next to no air the sky rises at the horizon so steeply that a coarse grid misses more than it holds.
HOSTILE_SETTINGS = replace(SETTINGS, sky_zeniths=24, sky_azimuths=20, hemisphere_tolerance=1e-2)
_ANGLES_DEG = ((0.0, 45.0, 90.0, 135.0), (0.0, 60.0, 120.0), (0.0, 30.0, 60.0, 90.0, 120.0, 150.0), (0.0, 20.0, 75.0))


@dataclass
class Score:
    """What was found so far."""

    scenes: int = 0
    refused: int = 0
    checked: Counter[str] = field(default_factory=Counter)
    left_out: Counter[str] = field(default_factory=Counter)
    violations: list[str] = field(default_factory=list)


def run_effects(*, scenes: int = 2000, hostile: int = 300, thin: int = 300, first: int = 0) -> bool:
    """Check the bounds of random scenes, of hostile ones and of scenes under thin air; return whether all held."""
    sound = True
    for kind, count in (("random", scenes), ("hostile", hostile), ("thin", thin)):
        score = Score()
        for seed in range(first, first + count):
            score_scene(score, seed, kind=kind)
        print(f"{score.scenes} {kind} scenes ({score.refused} refused): {len(score.violations)} bounds violated")
        for effect in (*(effect.value for effect in Effect), _ABSENT, _LEFT_OUT):
            print(f"  {effect:32} checked {score.checked[effect]:5}, left out though there {score.left_out[effect]:5}")
        sound &= not score.violations
    return sound


def score_scene(score: Score, seed: int, *, kind: str = "random") -> None:
    """Check the bounds of one scene."""
    generator = np.random.default_rng([seed, 7])
    scene = _SCENES[kind](generator)
    tolerance = float(generator.choice(_TOLERANCES))
    try:
        _check(score, scene, seed, tolerance, SETTINGS if kind == "random" else HOSTILE_SETTINGS)
    except ValueError as error:
        # Such as a field that reaches above the horizon: no scene.
        score.refused += 1
        print(f"seed {seed}: refused: {error}")
        return
    score.scenes += 1


def _check(score: Score, scene: LitScene, seed: int, tolerance: float, settings: Settings) -> None:
    store = LightStore()

    def seen(effects: frozenset[Effect]) -> Readings:
        return evaluate(scene, settings, effects=effects, store=store).readings

    whole = seen(ALL)

    found = plan(scene, tolerance=tolerance, sharper=partial(skylight_bound, scene))
    for name, left_out, bound in _tried(found):
        actual = change(whole, seen(ALL - left_out))
        score.checked[name] += 1
        if not bound.holds(actual):
            score.violations.append(f"seed {seed}, {name}: bound {bound.in_words}; is {actual.in_words}")
            print(score.violations[-1], flush=True)
    score.left_out.update(one.effect.value for one in found.decisions if not one.acts and one.bound.largest > 0.0)


def _tried(found: EffectPlan) -> Iterator[tuple[str, frozenset[Effect], Bound]]:
    for one in found.decisions:
        if 0.0 < one.bound.largest < 1.0:
            yield one.effect.value, frozenset({one.effect}), one.bound
    absent = frozenset(one.effect for one in found.decisions if one.bound.largest == 0.0)
    yield _ABSENT, absent, Bound()
    yield _LEFT_OUT, ALL - found.active, found.spent


def random_scene(generator: np.random.Generator) -> LitScene:
    """A scene of two regions, by radiance or by material, with whatever a session may add."""
    return random_materials(generator) if generator.random() < 0.15 else _with_radiances(generator)


def hostile_scene(generator: np.random.Generator) -> LitScene:
    """A scene by material at the ends of what is allowed, most often under air so thin that bounds of its light bind.

    Sun at the zenith or 5 deg above the horizon, camera straight above or low, black or white ground, a field of up to
    50 deg. Such a scene may be impossible: a panel that turns its back, a field that reaches above the horizon.
    """
    scene = random_materials(generator)
    part = None if generator.random() < 0.4 else _part(generator, widest_deg=25.0)
    thin = generator.random() < 0.7
    # Thin air is bright in a line at the horizon alone, and no grid of the sky has what a tilted panel sees of that.
    tilt = Tilt(tilt_rad=0.0 if thin else 0.8 * generator.random(), azimuth_rad=1.0)
    view = View(
        zenith_rad=np.radians(float(generator.choice([0.0, 1e-6, 70.0 * generator.random()]))),
        azimuth_rad=2.0 * np.pi * generator.random(),
        height_m=float(generator.choice([0.0, _log(generator, 0.1, 8e4)])),
    )
    return replace(
        scene,
        air=_hostile_air(generator, thin=thin),
        view=view,
        regions=tuple(replace(one, part=part, tilt=tilt) for one in scene.regions),
    )


def thin_scene(generator: np.random.Generator) -> LitScene:
    """A scene of level materials without an extent under air so thin that once scattered light is most of its sky."""
    scene = random_materials(generator)
    air = replace(
        _air(generator),
        fidelity=Fidelity.FAST,
        sun_zenith_rad=np.radians(84.9 * generator.random()),
        state=AtmosphereState(
            aerosol_optical_depth=_log(generator, 1e-5, 4e-2),
            surface_pressure_pa=_log(generator, 10.0, 3e4),
            ozone_m=0.0,
        ),
    )
    level = Tilt(tilt_rad=0.0, azimuth_rad=0.0)
    return replace(scene, air=air, regions=tuple(replace(one, part=None, tilt=level) for one in scene.regions))


def _hostile_air(generator: np.random.Generator, *, thin: bool) -> Air:
    suns_deg = [0.0, 1e-5, 84.0, 84.99, 85.0 * generator.random()]
    return replace(
        _air(generator),
        sun_zenith_rad=np.radians(float(generator.choice(suns_deg))),
        state=AtmosphereState(
            aerosol_optical_depth=_log(generator, 1e-9, 1e-3) if thin else _log(generator, 1e-6, 2.0),
            surface_pressure_pa=_log(generator, 0.1, 1e3) if thin else _log(generator, 1e3, 1.08e5),
        ),
        ground_albedo=float(generator.choice([0.0, generator.random(), 1.0])),
    )


def _with_radiances(generator: np.random.Generator) -> LitScene:
    regions = tuple(
        LitRegion(name=name, radiance=_radiance(generator), **_texture(generator, with_cov=True)) for name in "ab"
    )
    return LitScene(regions=regions, **_rest(generator))


def random_materials(generator: np.random.Generator) -> LitScene:
    """One or two regions by material."""
    part = None if generator.random() < 0.5 else _part(generator)
    names = "ab" if generator.random() < 0.3 else "a"
    regions = tuple(
        LitRegion(
            name=name,
            surface=_surface(generator),
            tilt=Tilt(tilt_rad=0.0 if generator.random() < 0.7 else 0.3 * generator.random(), azimuth_rad=1.0),
            part=part,
            **_texture(generator, with_cov=False),
        )
        for name in names
    )
    view = View(
        zenith_rad=np.radians(60.0) * generator.random(),
        azimuth_rad=2.0 * np.pi * generator.random(),
        height_m=float(generator.choice([0.0, _log(generator, 0.1, 1e4)], p=[0.1, 0.9])),
    )
    return LitScene(
        regions=regions,
        air=_air(generator),
        view=view,
        sun_azimuth_rad=2.0 * np.pi * generator.random(),
        **_rest(generator, pairs=names == "ab"),
    )


def _air(generator: np.random.Generator) -> Air:
    """From air as thin as at 60 km to thick haze; bands from one nanometre to the whole visible."""
    middle, half = 450e-9 + 250e-9 * generator.random(), _log(generator, 0.5e-9, 100e-9)
    wavelength = np.linspace(middle - half, middle + half, 41)
    slope = 1.0 + generator.normal() * 2.0 * (wavelength / middle - 1.0)
    return Air(
        sun_zenith_rad=np.radians(80.0) * generator.random(),
        band=SolarBand(
            wavelength_m=wavelength,
            irradiance_w_per_m3=1.7e9 * np.maximum(slope, 0.1),
            response=np.ones_like(wavelength),
        ),
        fidelity=Fidelity.FAST if generator.random() < 0.6 else Fidelity.SINGLE,
        aerosol=generator.choice([AerosolKind.DEPOLARIZING, AerosolKind.POLARIZING]),
        state=AtmosphereState(
            aerosol_optical_depth=_log(generator, 1e-6, 1.0),
            surface_pressure_pa=_log(generator, 10.0, 1.05e5),
        ),
        ground_albedo=float(generator.choice([0.0, generator.random(), 1.0], p=[0.1, 0.85, 0.05])),
    )


def _surface(generator: np.random.Generator) -> Surface:
    n, slope = 1.3 + 0.7 * generator.random(), _log(generator, 0.05, 0.4)
    lobe_alone = generator.random() < 0.15
    return Surface(
        n=n,
        k=0.0 if generator.random() < 0.7 else 2.0 * generator.random(),
        slope_rms=slope,
        dhr=None if lobe_alone else 0.5 + 0.45 * generator.random(),
        specular_weight=1.0 if generator.random() < 0.5 else generator.random(),
    )


def _radiance(generator: np.random.Generator) -> np.ndarray:
    s0 = _log(generator, 0.5, 300.0)
    dolp = float(generator.choice([0.0, _log(generator, 1e-4, 1.0), 0.999], p=[0.1, 0.8, 0.1]))
    angle = np.pi * generator.random()
    return s0 * np.array([1.0, dolp * np.cos(2.0 * angle), dolp * np.sin(2.0 * angle)])


def _texture(generator: np.random.Generator, *, with_cov: bool) -> dict[str, object]:
    cov = np.zeros((3, 3))
    if with_cov and generator.random() < 0.3:
        half = generator.normal(size=(3, 3)) * _log(generator, 1e-4, 0.3)
        cov = half @ half.T
    return {"texture_rms": _maybe(generator, 1e-6, 0.05), "texture_cov": cov}


def _part(generator: np.random.Generator, *, widest_deg: float = 3.0) -> FieldPart:
    half = np.radians(_log(generator, 1e-5, widest_deg))
    across, upward = (0.0, 0.0) if generator.random() < 0.7 else np.radians(3.0) * generator.uniform(-1.0, 1.0, 2)
    return FieldPart(left_rad=across - half, right_rad=across + half, bottom_rad=upward - half, top_rad=upward + half)


def _rest(generator: np.random.Generator, *, pairs: bool = True) -> dict[str, object]:
    angles = np.radians(_ANGLES_DEG[generator.integers(len(_ANGLES_DEG))])
    along = 0.3 + 0.7 * generator.random()
    extinction = float(generator.choice([np.inf, _log(generator, 3.0, 1e7)], p=[0.1, 0.9]))
    noise = SensorNoise(
        gain_dn_per_e=_log(generator, 0.02, 5.0),
        read_noise_e=_maybe(generator, 1e-3, 100.0),
        dark_current_e_per_s=_maybe(generator, 1e-3, 1e6),
        black_level_dn=64.0,
        prnu=_maybe(generator, 1e-7, 0.02),
        dsnu_e=_maybe(generator, 1e-5, 10.0),
        noise_factor=float(generator.choice([1.0, _log(generator, 0.1, 10.0)])),
    )
    return {
        "sensor": Sensor(
            pixel_pitch_m=8e-6,
            f_number=2.0,
            optics_transmittance=0.9,
            quantum_efficiency=0.5,
            wavelength_m=550e-9,
            exposure_s=_log(generator, 1e-6, 1e-2),
            bit_depth=16,
            tau_parallel=along,
            tau_perpendicular=along / extinction,
            noise=noise,
        ),
        "readout": Readout(
            angles_rad=angles,
            channel_names=tuple(f"dn_{k}" for k in range(angles.size)),
            cycles=int(generator.choice([1, 8, 100])),
            extinction_ratio=extinction,
        ),
        "pairs": (("a", "b"), ("b", "a")) if pairs and generator.random() < 0.5 else (),
        "imperfections": Imperfections(
            polarizer_angle_std_rad=_maybe(generator, 1e-7, 0.05),
            misregistration_pixels=_maybe(generator, 1e-5, 3.0),
            texture_correlation_pixels=_log(generator, 0.3, 30.0),
            drift=_maybe(generator, 1e-7, 0.1),
            drift_order=tuple(generator.permutation(angles.size).tolist()),
            surround_albedo=None if generator.random() < 0.5 else generator.random(),
            off_axis_falloff=bool(generator.random() < 0.5),
        ),
    }


def _log(generator: np.random.Generator, least: float, most: float) -> float:
    return float(least * (most / least) ** generator.random())


def _maybe(generator: np.random.Generator, least: float, most: float) -> float:
    """Nothing in a third of the cases; else anything between, evenly in its logarithm."""
    return 0.0 if generator.random() < 1.0 / 3.0 else _log(generator, least, most)


_ABSENT, _LEFT_OUT = "absent effects together", "effects left out together"
_SCENES = {"random": random_scene, "hostile": hostile_scene, "thin": thin_scene}
_TOLERANCES = (1e-4, 1e-3, 1e-2, 0.1, 0.3)
