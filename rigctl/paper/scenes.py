"""The scenes of [MK14] in which its sentences are checked: low light, the rooftop and the airborne scene."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import Reading, Settings, evaluate
from model.accuracy.predict import predict as predict_to
from model.prediction import PairDetection, RegionPrediction, pair_detection, predict
from model.processing.dolp_studies import DolpAgainstSnr, dolp_against_snr, rx_draws
from model.scene.scene import RegionLight, Scenario
from rigctl.errors import ConfigError, as_config_error
from rigctl.files.choices import SnrForm
from rigctl.files.scene_file import SceneFile
from rigctl.prediction.predict import ROC_RATES, ScenePredictor
from rigctl.scene.light import SceneLight, settings_of
from rigctl.scene.scene import with_values

FloatArray = NDArray[np.float64]
Source = Literal["total", "reflected", "path"]

TARGET, BACKGROUND = "black_paint", "asphalt"
WHITE = "white_paint"
P_FALSE_ALARM = 1e-3
TOLERANCE = 3e-3
# The authors' way: K = 9 tiles at their midpoints, a sky on a 10 deg grid, 1e5 draws.
_PAPER_TILES, _PAPER_ZENITHS, _PAPER_AZIMUTHS, _PAPER_DRAWS, _PAPER_SEED = 3, 9, 18, 100_000, 1


# What a number is compared as: an exact DoLP SNR may be noise alone, a detection may be certain.
Kind = Literal["plain", "exact_snr", "p_detection"]


@dataclass(frozen=True, kw_only=True)
class Number:
    """A number, its absolute numerical error, and of what kind it is."""

    label: str
    value: float
    error: float = 0.0
    kind: Kind = "plain"


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """Sun, view and azimuth [deg], height of the camera [m], and the noise factor Kn."""

    sun: float
    view: float
    phi: float = 180.0
    height_m: float = 3000.0
    kn: float = 1.0

    @property
    def text(self) -> str:
        """In words."""
        noise = "" if self.kn == 1.0 else f", Kn {self.kn:g}"
        return f"sun {self.sun:g}, view {self.view:g}, phi {self.phi:g}, {self.height_m / 1000:g} km{noise}"

    def numbers(self) -> dict[str, float]:
        """By their keys in a scene."""
        return {
            "sun.zenith_deg": self.sun,
            "geometry.camera_zenith_deg": self.view,
            "geometry.phi_deg": self.phi,
            "geometry.camera_height_m": self.height_m,
            "noise.noise_factor": self.kn,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluated:
    """What was found at a geometry, with the relative errors of its numbers (absolute for P_D)."""

    scenario: Scenario
    predictions: Mapping[str, RegionPrediction]
    errors: Mapping[Reading, float]


class Airborne:
    """The scene with one set of materials; everything that was computed is kept."""

    def __init__(
        self,
        scene: SceneFile,
        *,
        light: SceneLight | None = None,
        snr: SnrForm = "exact",
        as_paper: bool = False,
        changed: Mapping[str, float] | None = None,
        tolerance: float | None = TOLERANCE,
    ) -> None:
        """Take a scene with the regions black_paint, asphalt and white_paint.

        `tolerance` None takes the settings of the file, without errors.
        """
        names = {region.name for region in scene.regions}
        missing = {TARGET, BACKGROUND, WHITE} - names
        if missing:
            raise ConfigError(f"scene {scene.name}: rigctl paper needs regions named {', '.join(sorted(missing))}")
        self.light = SceneLight() if light is None else light
        self.predictor = ScenePredictor(scene, None, light=self.light, changes=changed)
        self.snr_form: SnrForm = "first-order" if as_paper else snr
        self.as_paper = as_paper
        self._tolerance = tolerance
        self._found: dict[object, Evaluated] = {}
        self._curves: dict[object, PairDetection] = {}

    def snr(self, at: Geometry, *, source: Source = "total", turned: bool = False, label: str = "") -> Number:
        """Return the DoLP SNR of the target.

        Parameters
        ----------
        at : Geometry
            Where.
        source : {"total", "reflected", "path"}
            Which light.
        turned : bool
            Whether the path radiance is that of the opposite azimuth, as if its azimuth were counted from the other
            side.
        label : str
            What it is called.
        """
        found = self._turned(at, source) if turned and source != "reflected" else self._target(at, source)
        statistic = "mean" if self.snr_form == "exact" else "first_order"
        # Wholly unpolarised light has no first-order ratio: it is 0.
        value = found.predictions[TARGET].quantities.get("dolp_snr", {}).get(statistic, 0.0)
        error = found.errors.get(Reading(TARGET, "dolp_snr", statistic), 0.0)
        kind: Kind = "exact_snr" if self.snr_form == "exact" else "plain"
        return Number(label=f"SNR {label or source}", value=value, error=error * value, kind=kind)

    def stokes(self, at: Geometry, source: Source) -> FloatArray:
        """Return the Stokes radiance that comes from the target to the aperture, shape (3,)."""
        return self._target(at, source).scenario.regions[0].stokes_radiance

    def radiance(self, at: Geometry, source: Source, *, label: str) -> Number:
        """Return S0 of the light that comes from the target to the aperture."""
        found = self._target(at, source)
        s0 = float(found.scenario.regions[0].stokes_radiance[0])
        error = found.errors.get(Reading(TARGET, "radiance", "s0"), 0.0) * s0
        return Number(label=f"S0 {label} [W m-2 sr-1]", value=s0, error=error)

    def polarized(self, at: Geometry, source: Source) -> Number:
        """Return the polarized radiance that comes from the target to the aperture."""
        found = self._target(at, source)
        s0, s1, s2 = found.scenario.regions[0].stokes_radiance
        # Errors of S1 and S2 are shares of S0.
        of_s1, of_s2 = (found.errors.get(Reading(TARGET, "radiance", name), 0.0) for name in ("s1", "s2"))
        value, error = float(np.hypot(s1, s2)), float(np.hypot(of_s1, of_s2) * s0)
        return Number(label=f"sqrt(S1^2 + S2^2) {source} [W m-2 sr-1]", value=value, error=error)

    def quantity(self, at: Geometry, region: str, quantity: str, statistic: str = "mean") -> float:
        """Return one number of the prediction of target and background."""
        found = self._target(at, "total") if region == TARGET else self._pair(at)
        return float(found.predictions[region].quantities[quantity][statistic])

    def p_detection(self, at: Geometry, *, label: str) -> Number:
        """Return the probability of detection at `P_FALSE_ALARM`."""
        curve = self.roc(at)
        place = int(np.argmin(np.abs(curve.p_false_alarm - P_FALSE_ALARM)))
        value = float(curve.p_detection[place])
        error = self._pair(at).errors.get(Reading(f"{TARGET} on {BACKGROUND}", "p_detection", "0.001"), 0.0)
        return Number(label=f"P_D {label}", value=value, error=error, kind="p_detection")

    def p_detection_on_unpolarized(self, at: Geometry, *, label: str) -> Number:
        """Return the probability of detection at `P_FALSE_ALARM` if the background's mean were unpolarized."""
        found = self._pair(at).predictions
        stokes = found[BACKGROUND].stokes_dn
        plain = replace(stokes, mean=stokes.mean * np.array([1.0, 0.0, 0.0]))
        changed = {**found, BACKGROUND: replace(found[BACKGROUND], stokes_dn=plain)}
        curve = pair_detection(TARGET, BACKGROUND, changed, [P_FALSE_ALARM], tolerance=1e-8)
        error = self.p_detection(at, label=label).error
        name = f"P_D {label} were the background unpolarized"
        return Number(label=name, value=float(curve.p_detection[0]), error=error, kind="p_detection")

    def roc(self, at: Geometry) -> PairDetection:
        """Return the whole ROC of target on background."""
        if at not in self._curves:
            found = self._pair(at).predictions
            rates = ROC_RATES.tolist()
            self._curves[at] = (
                _drawn(found, rates)
                if self.as_paper
                else pair_detection(TARGET, BACKGROUND, found, rates, tolerance=1e-8)
            )
        return self._curves[at]

    def s0_snrs(self) -> Iterable[Number]:
        """Yield the ratio of S0 to its noise of all that was computed of the whole light."""
        for key, found in self._found.items():
            if isinstance(key, tuple) and key[1] in ("total", "pair"):
                for name, one in found.predictions.items():
                    yield s0_snr(name, one, found.errors)

    def _target(self, at: Geometry, source: Source) -> Evaluated:
        return self._kept((at, source), lambda: self._evaluated(at, (TARGET,), source))

    def _pair(self, at: Geometry) -> Evaluated:
        return self._kept((at, "pair"), lambda: self._evaluated(at, (TARGET, BACKGROUND), "total"))

    def _kept(self, key: object, make: Callable[[], Evaluated]) -> Evaluated:
        if key not in self._found:
            self._found[key] = make()
        return self._found[key]

    def _evaluated(self, at: Geometry, names: tuple[str, ...], source: Source) -> Evaluated:
        scene = with_values(self.predictor.scene, at.numbers())
        lit = self.predictor.lit_scene(scene)
        pairs = () if len(names) == 1 else ((TARGET, BACKGROUND),)
        kept = {region.name: region for region in lit.regions}
        lit = replace(lit, regions=tuple(kept[name] for name in names), source=source, pairs=pairs)
        with as_config_error(f"scene {scene.name}"):
            if self.as_paper or self._tolerance is None:
                settings = settings_of(scene)
                settings = _paper_settings(settings) if self.as_paper else settings
                quick = evaluate(lit, settings, store=self.light.lights)
                return Evaluated(scenario=quick.scenario, predictions=quick.predictions, errors={})
            (found,) = predict_to([lit], tolerance=self._tolerance, store=self.light.lights).cases
        result = found.result
        return Evaluated(scenario=result.scenario, predictions=result.predictions, errors=found.budget.total)

    def _turned(self, at: Geometry, source: Source) -> Evaluated:
        opposite = replace(at, phi=(at.phi + 180.0) % 360.0 if at.phi else 180.0)
        path = self._target(opposite, "path")
        return path if source == "path" else self._kept((at, "turned"), lambda: self._sum(at, path))

    def _sum(self, at: Geometry, path: Evaluated) -> Evaluated:
        """Return the reflected light of a geometry with the path radiance of another."""
        reflected = self._target(at, "reflected")
        one, other = reflected.scenario.regions[0], path.scenario.regions[0]
        light: RegionLight = replace(one, stokes_radiance=one.stokes_radiance + other.stokes_radiance)
        scenario = replace(reflected.scenario, regions=(light,))
        keys = set(reflected.errors) | set(path.errors)
        errors = {key: reflected.errors.get(key, 0.0) + path.errors.get(key, 0.0) for key in keys}
        return Evaluated(scenario=scenario, predictions=predict(scenario), errors=errors)


def s0_snr(region: str, prediction: RegionPrediction, errors: Mapping[Reading, float]) -> Number:
    """Return the ratio of S0 of a region to its noise from frame to frame."""
    mean, noise = (prediction.quantities["s0"][statistic] for statistic in ("mean", "std_temporal"))
    relative = sum(errors.get(Reading(region, "s0", statistic), 0.0) for statistic in ("mean", "std_temporal"))
    return Number(label=f"SNR of S0 {region}", value=mean / noise, error=relative * mean / noise)


def _paper_settings(settings: Settings) -> Settings:
    return replace(
        settings,
        tiles_per_side=_PAPER_TILES,
        tile_rule="midpoint",
        sky_zeniths=_PAPER_ZENITHS,
        sky_azimuths=_PAPER_AZIMUTHS,
        negligible_spread=0.0,
    )


def _drawn(found: Mapping[str, RegionPrediction], rates: list[float]) -> PairDetection:
    """Return the ROC by random vectors, the threshold drawn too, as [MK14] section IV-B has it."""
    target, background = found[TARGET].stokes_dn, found[BACKGROUND].stokes_dn
    # Fewer false alarms than two cannot be drawn, and all of them need no draw.
    every = np.array(rates)
    can_be = (every >= 2.0 / _PAPER_DRAWS) & (every < 1.0)
    drawn = rx_draws(
        every[can_be],
        target.mean,
        target.cov,
        background.mean,
        background.cov,
        draws=_PAPER_DRAWS,
        generator=np.random.default_rng(_PAPER_SEED),
        draw_threshold=True,
    )
    detected, error = np.where(every == 1.0, 1.0, np.nan), np.zeros(every.size)
    detected[can_be], error[can_be] = drawn.p_detection, drawn.standard_error
    return PairDetection(
        target=TARGET,
        background=BACKGROUND,
        p_false_alarm=every,
        p_detection=detected,
        p_miss=1.0 - detected,
        auc=float(np.trapezoid(np.nan_to_num(detected), every)),
        p_detection_error=error,
        auc_error=float("nan"),
        warnings=(),
    )


# The rooftop of section III: black and white paint at sun 22, view 53, phi 180 deg.
GEOMETRY = "sun 22, view 53, phi 180"
ANGLES = ("0", "45", "90", "135")
# Height of the camera, exposure and texture are not in the paper.
ASSUMED = {
    "geometry.camera_height_m": 20.0,
    "acquisition.exposure_ms": 0.02,
    f"regions.{TARGET}.texture_rms": 0.012,
    f"regions.{WHITE}.texture_rms": 0.008,
}
_STATED = {"sun.zenith_deg": 22.0, "geometry.camera_zenith_deg": 53.0, "geometry.phi_deg": 180.0}
PANELS = {TARGET: "black paint", WHITE: "white paint"}


class Rooftop:
    """Predictions of the two panels, with their numerical errors."""

    def __init__(self, airborne: Airborne) -> None:
        scene = with_values(airborne.predictor.scene, {**_STATED, **ASSUMED})
        lit = airborne.predictor.lit_scene(scene)
        regions = tuple(region for region in lit.regions if region.name in PANELS)
        panels = replace(lit, regions=regions, pairs=())
        (found,) = predict_to([panels], tolerance=TOLERANCE, store=airborne.light.lights).cases
        self.predictions: dict[str, RegionPrediction] = {name: found.result.predictions[name] for name in PANELS}
        self._errors = found.budget.total

    def number(self, region: str, quantity: str, statistic: str) -> Number:
        """Return one number of a panel."""
        value = float(self.predictions[region].quantities[quantity][statistic])
        error = self._errors.get(Reading(region, quantity, statistic), 0.0)
        relative = statistic != "mean" or quantity not in ("dolp", "dolp_pixels", "s1n", "s2n")
        return Number(
            label=f"{quantity} {statistic} {PANELS[region]}",
            value=value,
            error=error * abs(value) if relative else error,
        )

    def s0_snrs(self) -> Iterable[Number]:
        """Yield the ratio of S0 of each panel to its noise from frame to frame."""
        for name, label in PANELS.items():
            yield replace(s0_snr(name, self.predictions[name], self._errors), label=f"SNR of S0 {label}")


# Fig. 5: DoLP at few electrons, first order against the exact law of Poisson counts.
_STOKES = (1.0, 0.5, 0.5)
_DECIBEL = np.linspace(0.0, 40.0, 21)
_DRAWS, _SEED = 10_000, 1


class LowLight:
    """Mean and deviation of DoLP against the SNR of S0."""

    def __init__(self) -> None:
        self.found: DolpAgainstSnr = dolp_against_snr(
            _STOKES, 10.0 ** (_DECIBEL / 20.0), draws=_DRAWS, generator=np.random.default_rng(_SEED)
        )

    def relative_error(self, decibel: float, moment: Literal["mean", "std"]) -> Number:
        """Return what the first-order mean or deviation is off, as a share of the exact one."""
        place = int(np.argmin(np.abs(_DECIBEL - decibel)))
        first = float(getattr(self.found, f"first_{moment}")[place])
        exact, error = (float(values[place]) for values in self.found.truth(moment))
        return Number(
            label=f"first-order {moment} at {decibel:g} dB off by",
            value=abs(first / exact - 1.0),
            error=error * first / exact**2,
        )


HEIGHTS_M = (3000.0, 5000.0, 7000.0, 9000.0)
SUNS_DEG = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)
VIEWS_DEG = (20.0, 40.0)
NOISE_FACTORS = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5)
ROC_NOISE_FACTORS = (1.0, 2.0, 3.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperScenes:
    """Scenes in which the statements are checked; `height_m` is that where the paper names none."""

    airborne: Airborne
    rooftop: Rooftop
    low_light: LowLight
    height_m: float = 3000.0

    def at(self, sun: float, view: float, phi: float = 180.0, kn: float = 1.0) -> Geometry:
        """Return a geometry of section V at the height that is taken where none is stated."""
        return Geometry(sun=sun, view=view, phi=phi, height_m=self.height_m, kn=kn)
