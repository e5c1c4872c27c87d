"""Numbers of the scenes of [MK14] with one set of materials: low light, the rooftop and the airborne scene."""

from collections.abc import Callable, Iterable, Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal, NamedTuple

import numpy as np

from model.accuracy.chain import Reading, evaluate
from model.accuracy.predict import predict as predict_to
from model.prediction import PairDetection, RegionPrediction, detections_of_cases, predict
from model.processing.dolp_studies import DolpAgainstSnr, dolp_against_snr, rx_draws
from model.scene.scene import RegionLight, Scenario
from rigctl.errors import ConfigError, as_config_error
from rigctl.files.choices import SnrForm
from rigctl.files.scene_file import SceneFile
from rigctl.prediction.predict import ROC_RATES, ScenePredictor
from rigctl.scene.light import SceneLight, settings_of
from rigctl.scene.scene import with_values

Source = Literal["total", "reflected", "path"]
Moment = Literal["mean", "std"]
# What a number is compared as: an exact DoLP SNR may be noise alone, a detection may be certain.
Kind = Literal["plain", "exact_snr", "p_detection"]

TARGET, BACKGROUND, WHITE = "black_paint", "asphalt", "white_paint"
PAIR = f"{TARGET} on {BACKGROUND}"
P_FALSE_ALARM = 1e-3
TOLERANCE = 3e-3
HEIGHTS_M = (3000.0, 5000.0, 7000.0, 9000.0)
SUNS_DEG = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)
VIEWS_DEG = (20.0, 40.0)
NOISE_FACTORS = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5)
ROC_NOISE_FACTORS = (1.0, 2.0, 3.0)

# The authors' way: K = 9 tiles at their midpoints, a sky on a 10 deg grid, 1e5 draws.
_AUTHORS_SETTINGS = {
    "tiles_per_side": 3,
    "tile_rule": "midpoint",
    "sky_zeniths": 9,
    "sky_azimuths": 18,
    "negligible_spread": 0.0,
}
_AUTHORS_DRAWS = 100_000

# The rooftop of section III: black and white paint. Height of the camera, exposure and texture are not in the paper.
PANELS = {TARGET: "black paint", WHITE: "white paint"}
ANGLES_DEG = (0, 45, 90, 135)
ASSUMED = {
    "geometry.camera_height_m": 20.0,
    "acquisition.exposure_ms": 0.02,
    f"regions.{TARGET}.texture_rms": 0.012,
    f"regions.{WHITE}.texture_rms": 0.008,
}
_ROOFTOP = {"sun.zenith_deg": 22.0, "geometry.camera_zenith_deg": 53.0, "geometry.phi_deg": 180.0}

# Fig. 5: DoLP at few electrons, S = (1, 0.5, 0.5).
DECIBELS = np.linspace(0.0, 40.0, 21)
_STOKES, _DRAWS = (1.0, 0.5, 0.5), 10_000


@dataclass(frozen=True, kw_only=True)
class Number:
    """A number, its absolute numerical error, and of what kind it is."""

    label: str
    value: float
    error: float = 0.0
    kind: Kind = "plain"


class Geometry(NamedTuple):
    """Sun, view and azimuth [deg], height of the camera [m], and the noise factor Kn."""

    sun: float
    view: float
    phi: float
    height_m: float
    kn: float


_KEYS = (
    "sun.zenith_deg",
    "geometry.camera_zenith_deg",
    "geometry.phi_deg",
    "geometry.camera_height_m",
    "noise.noise_factor",
)


@cache
def low_light() -> DolpAgainstSnr:
    """Return mean and deviation of DoLP against the SNR of S0, with shot noise alone: exact, first-order and drawn."""
    return dolp_against_snr(_STOKES, 10.0 ** (DECIBELS / 20.0), draws=_DRAWS, generator=np.random.default_rng(1))


def first_order_error(moment: Moment, decibel: float, *, scale: float = 1.0) -> Number:
    """Return the relative error of the first-order mean or deviation of DoLP at `scale` times an SNR of S0 in dB."""
    place = int(np.argmin(np.abs(DECIBELS - scale * decibel)))
    first, exact, error = (
        float(getattr(low_light(), name)[place])
        for name in (f"first_{moment}", f"true_{moment}", f"true_{moment}_error")
    )
    label = f"first-order {moment} at {decibel:g} dB off by"
    return Number(label=label, value=abs(first / exact - 1.0), error=error * first / exact**2)


class _Evaluated(NamedTuple):
    scenario: Scenario
    predictions: Mapping[str, RegionPrediction]
    errors: Mapping[Reading, float]  #: relative, but absolute for P_D


class PaperScenes:
    """The rooftop and the airborne scene with one set of materials; everything that was computed is kept."""

    def __init__(
        self,
        scene: SceneFile,
        *,
        light: SceneLight | None = None,
        snr: SnrForm = "exact",
        height_m: float = 3000.0,
        changed: Mapping[str, float] | None = None,
        tolerance: float | None = TOLERANCE,
    ) -> None:
        """Take a scene with the regions black_paint, asphalt and white_paint.

        `height_m` is used where the paper states no height. Without a tolerance the settings of the file are used, and
        the numbers of the airborne scene have no errors.
        """
        missing = {TARGET, BACKGROUND, WHITE} - {region.name for region in scene.regions}
        if missing:
            raise ConfigError(f"scene {scene.name}: rigctl paper needs regions named {', '.join(sorted(missing))}")
        self.light = SceneLight() if light is None else light
        self.predictor = ScenePredictor(scene, None, light=self.light, changes=changed)
        self.snr_form: SnrForm = snr
        self.height_m = height_m
        self._tolerance = tolerance
        self._is_as_paper = False
        self._evaluated: dict[tuple[Geometry, str], _Evaluated] = {}
        self._curves: dict[Geometry, PairDetection] = {}
        rooftop = self.predictor.lit_scene(with_values(self.predictor.scene, {**_ROOFTOP, **ASSUMED}))
        regions = tuple(region for region in rooftop.regions if region.name in PANELS)
        panels = replace(rooftop, regions=regions, pairs=())
        (case,) = predict_to([panels], tolerance=TOLERANCE, store=self.light.lights).cases
        self.panels: dict[str, RegionPrediction] = {name: case.result.predictions[name] for name in PANELS}
        self._panel_errors = case.budget.total

    def as_authors(self) -> "PaperScenes":
        """Return the same scenes, the airborne one computed as the authors did and with their DoLP SNR."""
        authors = copy(self)
        vars(authors).update(_is_as_paper=True, snr_form="first-order", _evaluated={}, _curves={})
        return authors

    def at(
        self, sun: float, view: float, phi: float = 180.0, *, height_m: float | None = None, kn: float = 1.0
    ) -> Geometry:
        """Return a geometry of section V."""
        return Geometry(sun, view, phi, self.height_m if height_m is None else height_m, kn)

    def snr(self, at: Geometry, *, source: Source = "total", turned: bool = False, label: str = "") -> Number:
        """Return the DoLP SNR of the target.

        With `turned` the path radiance is that of the opposite azimuth, as if azimuths were counted from there.
        """
        case = self._turned(at, source) if turned and source != "reflected" else self._of(at, source)
        statistic = "mean" if self.snr_form == "exact" else "first_order"
        # Wholly unpolarized light has no first-order ratio: it is 0.
        value = case.predictions[TARGET].quantities.get("dolp_snr", {}).get(statistic, 0.0)
        error = case.errors.get(Reading(TARGET, "dolp_snr", statistic), 0.0)
        kind: Kind = "exact_snr" if self.snr_form == "exact" else "plain"
        return Number(label=f"SNR {label or source}", value=value, error=error * value, kind=kind)

    def radiance(self, at: Geometry, source: Source, *, label: str) -> Number:
        """Return S0 of the light that comes from the target to the aperture."""
        case = self._of(at, source)
        s0 = float(case.scenario.regions[0].stokes_radiance[0])
        error = case.errors.get(Reading(TARGET, "radiance", "s0"), 0.0) * s0
        return Number(label=f"S0 {label} [W m-2 sr-1]", value=s0, error=error)

    def polarized(self, at: Geometry, source: Source) -> Number:
        """Return the polarized radiance that comes from the target to the aperture."""
        case = self._of(at, source)
        s0, s1, s2 = case.scenario.regions[0].stokes_radiance
        # Errors of S1 and S2 are shares of S0.
        of_s1, of_s2 = (case.errors.get(Reading(TARGET, "radiance", name), 0.0) for name in ("s1", "s2"))
        value, error = float(np.hypot(s1, s2)), float(np.hypot(of_s1, of_s2) * s0)
        return Number(label=f"sqrt(S1^2 + S2^2) {source} [W m-2 sr-1]", value=value, error=error)

    def dolp(self, at: Geometry, region: str) -> Number:
        """Return the DoLP of target or background."""
        value = float(
            self._of(at, "total" if region == TARGET else "pair").predictions[region].quantities["dolp"]["mean"]
        )
        # The error to which the light is computed, in parts of S0.
        return Number(label=f"DoLP {region} sun {at.sun:g} view {at.view:g}", value=value, error=TOLERANCE)

    def roc(self, at: Geometry) -> PairDetection:
        """Return the whole ROC of target on background."""
        if at not in self._curves:
            predictions, rates = self._of(at, "pair").predictions, ROC_RATES.tolist()
            self._curves[at] = (
                _drawn_roc(predictions, rates)
                if self._is_as_paper
                else detections_of_cases([(TARGET, BACKGROUND, predictions)], rates, tolerance=1e-8)[0]
            )
        return self._curves[at]

    def p_detection(self, at: Geometry, *, label: str) -> Number:
        """Return the probability of detection at `P_FALSE_ALARM`."""
        curve = self.roc(at)
        value = float(curve.p_detection[int(np.argmin(np.abs(curve.p_false_alarm - P_FALSE_ALARM)))])
        error = self._of(at, "pair").errors.get(Reading(PAIR, "p_detection", "0.001"), 0.0)
        return Number(label=f"P_D {label}", value=value, error=error, kind="p_detection")

    def p_detection_on_unpolarized(self, at: Geometry, *, label: str) -> Number:
        """Return the probability of detection at `P_FALSE_ALARM` if the background's mean were unpolarized."""
        predictions = self._of(at, "pair").predictions
        stokes = predictions[BACKGROUND].stokes_dn
        plain = replace(stokes, mean=stokes.mean * np.array([1.0, 0.0, 0.0]))
        changed = {**predictions, BACKGROUND: replace(predictions[BACKGROUND], stokes_dn=plain)}
        (curve,) = detections_of_cases([(TARGET, BACKGROUND, changed)], [P_FALSE_ALARM], tolerance=1e-8)
        sure = self.p_detection(at, label=f"{label} were the background unpolarized")
        return replace(sure, value=float(curve.p_detection[0]))

    def panel(self, region: str, quantity: str, statistic: str) -> Number:
        """Return one number of a panel on the rooftop."""
        value = float(self.panels[region].quantities[quantity][statistic])
        error = self._panel_errors.get(Reading(region, quantity, statistic), 0.0)
        is_absolute = statistic == "mean" and quantity in ("dolp", "dolp_pixels", "s1n", "s2n")
        label = f"{quantity} {statistic} {PANELS[region]}"
        return Number(label=label, value=value, error=error if is_absolute else error * abs(value))

    def panel_s0_snr(self, region: str) -> Number:
        """Return the ratio of S0 of a panel on the rooftop to its noise from frame to frame."""
        number = _s0_snr(region, self.panels[region], self._panel_errors)
        return replace(number, label=f"SNR of S0 {PANELS[region]}")

    def s0_snrs(self) -> Iterable[Number]:
        """Yield the ratio of S0 to its noise of all that was computed of the whole light, and of the panels."""
        for (_, source), case in self._evaluated.items():
            if source in ("total", "pair"):
                for name, prediction in case.predictions.items():
                    yield _s0_snr(name, prediction, case.errors)
        yield from map(self.panel_s0_snr, PANELS)

    def _of(self, at: Geometry, source: Source | Literal["pair"]) -> _Evaluated:
        """Return the target in some light; of "pair" target and background in all light."""
        return self._kept(at, source, lambda: self._evaluate(at, source))

    def _kept(self, at: Geometry, name: str, make: Callable[[], _Evaluated]) -> _Evaluated:
        if (at, name) not in self._evaluated:
            self._evaluated[at, name] = make()
        return self._evaluated[at, name]

    def _evaluate(self, at: Geometry, source: Source | Literal["pair"]) -> _Evaluated:
        scene = with_values(self.predictor.scene, dict(zip(_KEYS, at, strict=True)))
        lit = self.predictor.lit_scene(scene)
        regions = {region.name: region for region in lit.regions}
        if source == "pair":
            both = (regions[TARGET], regions[BACKGROUND])
            lit = replace(lit, regions=both, source="total", pairs=((TARGET, BACKGROUND),))
        else:
            lit = replace(lit, regions=(regions[TARGET],), source=source, pairs=())
        with as_config_error(f"scene {scene.name}"):
            if self._is_as_paper or self._tolerance is None:
                settings = settings_of(scene)
                if self._is_as_paper:
                    settings = replace(settings, **_AUTHORS_SETTINGS)  # type: ignore[arg-type]
                quick = evaluate(lit, settings, store=self.light.lights)
                return _Evaluated(quick.scenario, quick.predictions, {})
            (case,) = predict_to([lit], tolerance=self._tolerance, store=self.light.lights).cases
        return _Evaluated(case.result.scenario, case.result.predictions, case.budget.total)

    def _turned(self, at: Geometry, source: Source) -> _Evaluated:
        path = self._of(at._replace(phi=(at.phi + 180.0) % 360.0), "path")
        return path if source == "path" else self._kept(at, "turned", lambda: self._sum(at, path))

    def _sum(self, at: Geometry, path: _Evaluated) -> _Evaluated:
        """Return the reflected light of a geometry with the path radiance of another."""
        reflected = self._of(at, "reflected")
        (light,), (added,) = reflected.scenario.regions, path.scenario.regions
        both: RegionLight = replace(light, stokes_radiance=light.stokes_radiance + added.stokes_radiance)
        scenario = replace(reflected.scenario, regions=(both,))
        readings = set(reflected.errors) | set(path.errors)
        errors = {one: reflected.errors.get(one, 0.0) + path.errors.get(one, 0.0) for one in readings}
        return _Evaluated(scenario, predict(scenario), errors)


def _s0_snr(region: str, prediction: RegionPrediction, errors: Mapping[Reading, float]) -> Number:
    """Return the ratio of S0 of a region to its noise from frame to frame."""
    mean, noise = (prediction.quantities["s0"][statistic] for statistic in ("mean", "std_temporal"))
    relative = sum(errors.get(Reading(region, "s0", statistic), 0.0) for statistic in ("mean", "std_temporal"))
    return Number(label=f"SNR of S0 {region}", value=mean / noise, error=relative * mean / noise)


def _drawn_roc(predictions: Mapping[str, RegionPrediction], rates: list[float]) -> PairDetection:
    """Return the ROC by random vectors, the threshold drawn too, as [MK14] section IV-B has it."""
    target, background = predictions[TARGET].stokes_dn, predictions[BACKGROUND].stokes_dn
    # Fewer false alarms than two cannot be drawn, and all of them need no draw.
    every = np.array(rates)
    can_be = (every >= 2.0 / _AUTHORS_DRAWS) & (every < 1.0)
    detected, error = np.where(every == 1.0, 1.0, np.nan), np.zeros(every.size)
    detected[can_be], error[can_be] = rx_draws(
        every[can_be],
        target.mean,
        target.cov,
        background.mean,
        background.cov,
        draws=_AUTHORS_DRAWS,
        generator=np.random.default_rng(1),
    )
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
