"""Points of the paper's own figures, read off by somebody who has them.

Numbers with their numerical errors, and what comparing them says.

[MK14] Fig. 5: DoLP at few electrons, first order against the exact law of Poisson counts.

The other sentences of [MK14] about its figures: those that say what is drawn, and claim nothing of it.

Each with how the figure here follows it.

The airborne scene of [MK14] section V: DoLP SNR and detection at any geometry, each with its numerical error.

The rooftop of [MK14] section III: black and white paint at sun 22, view 53, phi 180 deg.

A sentence of [MK14] with its check, the scenes that it is checked in, and readings of a sentence.

Checks of section V-A, Fig. 9: what of the polarization is the target's, and what is of the air before it.

Checks of sections II-C, III and V-B to V-D: low light, the rooftop, height, geometry of the scene, noise.

Every sentence of [MK14] sections II-C to VI about what a figure shows, as a typed record with its check.

The sentences are the paper's own words. A sentence that allows several readings has all of them.

Verdicts on the paper's statements with one set of materials.

Materials within their stated uncertainties with which most statements hold.

All that a check of the paper found, by set of materials.

What a scene file calls assumed, in words.

The curves of [MK14] Figs 5 and 7 to 15 with one set of materials.

What comes out of the paper as tables and text: its statements, and what noise does to DoLP.

The figures of [MK14] as the model has them, and what noise does to the degree of polarization.

The page on the paper: its statements with their verdicts, its figures, what was assumed.

The files of a check of the paper: a page, statements as CSV and JSON, a picture of each figure.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import pi, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import Reading, evaluate
from model.accuracy.predict import predict as predict_to
from model.prediction import PairDetection, pair_detection, predict
from model.processing.dolp_studies import dolp_against_snr, rx_draws
from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
from rigctl.errors import ConfigError, as_config_error
from rigctl.prediction.predict import ROC_RATES, ScenePredictor
from rigctl.report.data_files import csv_rows, finite
from rigctl.report.document import Bullets, Paragraph, Picture, Report, Section
from rigctl.report.drawing import COLOURS, MEASURED, PREDICTED, legend_below, legend_of_all, png, say_beneath, subplots
from rigctl.report.output import html, write_folder
from rigctl.report.prediction import laws_of, sky_picture
from rigctl.report.table import Column, Table
from rigctl.scene.light import SceneLight, settings_of
from rigctl.scene.scene import get, parameters, with_values
from rigctl.scene.sky_map import sky_map

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from model.accuracy.chain import Settings
    from model.prediction import RegionPrediction
    from model.processing.dolp_studies import DolpAgainstSnr, EstimatorError
    from model.scene.scene import RegionLight, Scenario
    from rigctl.console.json_text import Json
    from rigctl.files.choices import SnrForm
    from rigctl.files.scene_file import SceneFile


COLUMNS = ("figure", "panel", "label", "x", "y")


@dataclass(frozen=True, kw_only=True)
class DigitisedPoint:
    """A point: number of the figure, letter of its panel (empty for all), which curve, and where."""

    figure: int
    panel: str
    label: str
    x: float
    y: float


def read_digitised(path: Path) -> tuple[DigitisedPoint, ...]:
    """Return the points of a CSV file with the columns figure, panel, label, x, y."""
    try:
        rows = list(csv.DictReader(read_bounded(path, MOST_TEXT_BYTES).decode("utf-8").splitlines()))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    if not rows or not set(COLUMNS) <= set(rows[0]):
        raise ConfigError(f"{path}: needs a first line {','.join(COLUMNS)} and a point a line")
    return tuple(_point(path, line, row) for line, row in enumerate(rows, start=2))


def _point(path: Path, line: int, row: dict[str, str]) -> DigitisedPoint:
    try:
        x, y = float(row["x"]), float(row["y"])
        if not (math.isfinite(x) and math.isfinite(y)):
            raise ValueError("x and y must be finite")
        return DigitisedPoint(figure=int(row["figure"]), panel=row["panel"].strip(), label=row["label"], x=x, y=y)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}, line {line}: {error}") from error


Verdict = Literal["holds", "opposite", "cannot_be_seen", "noise_floor", "ambiguous"]
# Ratio of exact mean and deviation of DoLP of light without any, sqrt(pi / (4 - pi)); below the other one it is noise.
UNPOLARIZED_SNR, NOISE_FLOOR = sqrt(pi / (4.0 - pi)), 2.1
# Above this everything is detected, and which of two is more cannot be seen.
ALL_DETECTED = 0.999
# How many numerical errors a margin has to have.
FAR = 3.0

Kind = Literal["plain", "exact_snr", "p_detection"]


@dataclass(frozen=True, kw_only=True)
class Number:
    """A number, its absolute numerical error, and of what kind it is."""

    label: str
    value: float
    error: float = 0.0
    kind: Kind = "plain"


@dataclass(frozen=True, kw_only=True)
class Test:
    """An inequality that a statement says: `margin` is above 0 where it is so."""

    numbers: tuple[Number, ...]  #: That are compared.
    margin: float  #: By how much, and the numerical error of that, in the unit of the numbers.
    error: float

    @property
    def verdict(self) -> Verdict:
        """What it comes to, by itself."""
        if self.numbers and all(one.kind == "p_detection" and one.value > ALL_DETECTED for one in self.numbers):
            return "cannot_be_seen"
        if self.numbers and all(one.kind == "exact_snr" and one.value < NOISE_FLOOR for one in self.numbers):
            return "noise_floor"
        if abs(self.margin) <= FAR * self.error:
            return "ambiguous"
        return "holds" if self.margin > 0.0 else "opposite"


@dataclass(frozen=True, kw_only=True)
class Understanding:
    """One way to understand a statement: what it is, and the inequalities that all have to hold."""

    name: str
    tests: tuple[Test, ...]

    @property
    def verdict(self) -> Verdict:
        """Of all tests: one that is reversed refutes; what cannot be seen in one is not seen in all."""
        found = [test.verdict for test in self.tests]
        order: tuple[Verdict, ...] = ("opposite", "noise_floor", "cannot_be_seen", "ambiguous")
        return next((one for one in order if one in found), "holds" if found else "cannot_be_seen")

    @property
    def deciding(self) -> Test | None:
        """The test that decides: the least margin among those with the reading's verdict."""
        tests = [test for test in self.tests if test.verdict == self.verdict]
        return min(tests, key=lambda test: test.margin, default=None)

    @property
    def numbers(self) -> tuple[Number, ...]:
        """All numbers of its tests, each once."""
        return tuple({one.label: one for test in self.tests for one in test.numbers}.values())


def above(more: Number, less: Number, *, factor: float = 1.0) -> Test:
    """Return the test of one number above so many times another."""
    return Test(numbers=(more, less), margin=more.value - factor * less.value, error=more.error + factor * less.error)


def differ(one: Number, other: Number) -> Test:
    """Return the test of two numbers that are not the same: it holds, or their distance is within the error."""
    return Test(numbers=(one, other), margin=abs(one.value - other.value), error=one.error + other.error)


def falls(numbers: Sequence[Number]) -> tuple[Test, ...]:
    """Return the tests of numbers that fall from each to the next."""
    return tuple(above(first, second) for first, second in pairwise(numbers))


def some_step_rises(numbers: Sequence[Number]) -> Test:
    """Return the test of numbers that do not fall all along: the largest step upward."""
    steps = [above(second, first) for first, second in pairwise(numbers)]
    largest = max(steps, key=lambda step: step.margin)
    return Test(numbers=_first(largest, numbers), margin=largest.margin, error=largest.error)


def peak_within(numbers: Sequence[Number], places: Sequence[float], low: float, high: float) -> Test:
    """Return the test of a largest number whose place lies between two limits."""
    inside = [one for one, place in zip(numbers, places, strict=True) if low <= place <= high]
    outside = [one for one, place in zip(numbers, places, strict=True) if not low <= place <= high]
    best, rival = (max(part, key=lambda one: one.value) for part in (inside, outside))
    found = above(best, rival)
    return Test(numbers=_first(found, numbers), margin=found.margin, error=found.error)


def _first(decided: Test, numbers: Sequence[Number]) -> tuple[Number, ...]:
    """Return all numbers, those that decide at the head."""
    return (*decided.numbers, *(one for one in numbers if one not in decided.numbers))


STOKES = (1.0, 0.5, 0.5)
DECIBEL = np.linspace(0.0, 40.0, 21)
_DRAWS, _SEED = 10_000, 1


class LowLight:
    """Mean and deviation of DoLP against the SNR of S0."""

    def __init__(self) -> None:
        self.found: DolpAgainstSnr = dolp_against_snr(
            STOKES, 10.0 ** (DECIBEL / 20.0), draws=_DRAWS, generator=np.random.default_rng(_SEED)
        )

    def relative_error(self, decibel: float, moment: Literal["mean", "std"]) -> Number:
        """Return what the first-order mean or deviation is off, as a share of the exact one."""
        place = int(np.argmin(np.abs(DECIBEL - decibel)))
        first = float(getattr(self.found, f"first_{moment}")[place])
        exact, error = (float(values[place]) for values in self.found.truth(moment))
        return Number(
            label=f"first-order {moment} at {decibel:g} dB off by",
            value=abs(first / exact - 1.0),
            error=error * first / exact**2,
        )


@dataclass(frozen=True, kw_only=True)
class Description:
    """A sentence that says what a figure shows or how it was made."""

    figure: int  #: Its number.
    sentence: str  #: The paper's words.
    here: str  #: What the figure of this program has of it.


def _said(figure: int, sentence: str, here: str) -> Description:
    return Description(figure=figure, sentence=sentence, here=here)


_SO = "so"
DESCRIPTIONS: tuple[Description, ...] = (
    _said(
        2,
        "In Fig. 2, we present a simulation of the Stokes parameters of downwelling radiance after iteratively running "
        "MODTRAN-P 370 times.",
        "own solver on a finer grid; sun, air and band of section V, for Table I is not at hand",
    ),
    _said(
        2,
        "The zenith angle is changed from 0 to 90 deg with a 10 deg step, and the azimuth angle is changed from 0 to "
        "360 deg, also with a 10 deg step.",
        "10 x 37 directions are those 370; --as-paper takes a sky on that grid",
    ),
    _said(
        5,
        "The experiments are performed based on specified Stoke vector radiance received by the sensor, and are run at "
        "different SNR of S0.",
        "0 to 40 dB in steps of 2",
    ),
    _said(
        5,
        "A four polarization sensitive imaging system with the analyzers rotated at 0, 45, 90, and 135 deg is "
        "considered. In the sensor model, only shot noise is considered.",
        _SO,
    ),
    _said(5, "With an increasing SNR of S0, 1e4 realizations of the intensity are generated for each SNR.", _SO),
    _said(
        5,
        "The analytical model predictions of DoLP statistics is compared with the results generated by Monte Carlo "
        "simulations in Fig. 5. In the simulation, the incident light is with normalized Stokes vector "
        "S = [1 0.5 0.5]^T.",
        "so, and the exact law beside both",
    ),
    _said(
        6,
        "The panchromatic and DoLP images of the black- and white-painted panels collected at one of the scene "
        "geometries are shown in Fig. 6.",
        "pixels drawn from the predicted law; which geometry is not said: that of Figs 7 and 8",
    ),
    _said(
        7,
        "We compare the model-predicted mean and standard deviation of the intensity to the real measurement of the "
        "black paint and white paint as an intermediate result. The results for the measurement taken at 22, 53, 180 "
        "deg are shown in Fig. 7.",
        "the model; their measured points are not at hand",
    ),
    _said(
        7,
        "The statistics of the intensity are compared at four different channels, which were measured using the "
        "modified Pickering method with 0, 45, 90, and 135 deg analyzer rotations.",
        _SO,
    ),
    _said(
        8,
        "The histograms of the normalized S1 and S2 Stokes parameters and the DoLP values as observed from the black "
        "paint and white paint are shown in Fig. 8(a). The histograms of the real data were fitted by Gaussian curves, "
        "which are shown as solid lines in the figures.",
        "not at hand; the sentences about Fig. 8(a) are checked on Fig. 8(b)",
    ),
    _said(
        8,
        "The mean and variance of the Stokes parameters and DoLP were predicted using the analytical model, from which "
        "Gaussian curves are plotted in Fig. 8(b).",
        "so, to first order; the exact law is the broad line",
    ),
    _said(
        9,
        "The DoLP SNR of a black-painted object with contributions from each radiometric source is computed at "
        "different scene geometries, and the results are compared in Fig. 9.",
        "so, at steps of 30 deg in azimuth; of the total also with the azimuth of the path turned by 180 deg",
    ),
    _said(
        10,
        "The DoLP SNRs of the black paint are estimated at platform altitudes of 3, 5, 7, and 9 km, with scene "
        "geometry at 50, 50, and 180 deg. The simulation results are shown in Fig. 10.",
        _SO,
    ),
    _said(
        10,
        "In Fig. 10(a), the DoLP SNR was calculated based on reflected radiance, and in Fig. 10(b), the DoLP SNR was "
        "calculated based on the total radiance.",
        _SO,
    ),
    _said(
        11,
        "The target detection performance is compared at different platform altitudes in Fig. 11.",
        "so, at the geometry of Fig. 10, which is not said again",
    ),
    _said(
        12,
        "The DoLP SNRs of black paint were estimated at different solar incident and sensor viewing angles, and the "
        "results are shown in Fig. 12. In the simulations shown in the following, two different sensor viewing angles "
        "were considered: 20 and 40 deg. For each of the value, the solar incident angles were changed from 10 to 80 "
        "deg with a 10 deg increment.",
        _SO,
    ),
    _said(
        13,
        "The ROC curves are plotted in Fig. 13 by performing RX detection at four different scene geometries.",
        "suns of 10 and 50, views of 20 and 40: the four that the text names",
    ),
    _said(
        14,
        "The DoLP SNR of black paint was first studied by changing the sensor noise factor from 1 to 3.5 with 0.5 "
        "step, and the results are shown in Fig. 14. The DoLP SNR was also analyzed at different solar incident zenith "
        "angles.",
        "so, at suns of 10 to 80",
    ),
    _said(
        15,
        "The target detection performance was also studied with three different sensor noise factors Kn = 1, 2, and 3, "
        "and the ROC curves are compared in Fig. 15. In this simulation, the incident zenith angle was fixed at 50 "
        "deg.",
        "so; the view is not said: 20 and 40",
    ),
)


FloatArray = NDArray[np.float64]
Source = Literal["total", "reflected", "path"]

TARGET, BACKGROUND = "black_paint", "asphalt"
WHITE = "white_paint"
P_FALSE_ALARM = 1e-3
TOLERANCE = 3e-3
# The authors' way: K = 9 tiles at their midpoints, a sky on a 10 deg grid, 1e5 draws.
_PAPER_TILES, _PAPER_ZENITHS, _PAPER_AZIMUTHS, _PAPER_DRAWS, _PAPER_SEED = 3, 9, 18, 100_000, 1


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
        """Return the DoLP SNR of the target."""
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
            found = predict_to(lit, tolerance=self._tolerance, store=self.light.lights)
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
        found = predict_to(replace(lit, regions=regions, pairs=()), tolerance=TOLERANCE, store=airborne.light.lights)
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


HEIGHTS_M = (3000.0, 5000.0, 7000.0, 9000.0)
SUNS_DEG = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)
VIEWS_DEG = (20.0, 40.0)
NOISE_FACTORS = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5)
ROC_NOISE_FACTORS = (1.0, 2.0, 3.0)
AZIMUTHS_DEG = (0.0, 90.0, 180.0)
# Of words for which the paper has no number.
MUCH, SIGNIFICANT = 1.5, 1.5
PATH_TURNED = "azimuth of the path radiance turned by 180 deg"
AS_STATED = "as stated"


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


@dataclass(frozen=True, kw_only=True)
class Statement:
    """A sentence and its check."""

    id: str  #: Its own name, and that of the figure.
    figure: str
    sentence: str  #: The paper's words.
    geometry: str  #: Where, and what is compared.
    check: str
    readings: Callable[[PaperScenes], tuple[Understanding, ...]]  #: Scenes to the readings of the sentence.


def one_reading(*tests: Test) -> tuple[Understanding, ...]:
    """Return the only reading that a sentence has."""
    return (Understanding(name=AS_STATED, tests=tests),)


def both_azimuths(tests: Callable[[bool], tuple[Test, ...]]) -> tuple[Understanding, ...]:
    """Return the readings with the azimuth of the path radiance as stated, and turned by 180 deg."""
    return (Understanding(name=AS_STATED, tests=tests(False)), Understanding(name=PATH_TURNED, tests=tests(True)))


def without_their_data(_: PaperScenes) -> tuple[Understanding, ...]:
    """Return the reading of a sentence about measured points."""
    return (Understanding(name="without their data", tests=()),)


def fig9_total_differs(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that total differs from reflected."""

    def tests(turned: bool) -> tuple[Test, ...]:
        found = (
            differ(
                scenes.airborne.snr(at, label=f"total {_place(at)}", turned=turned),
                scenes.airborne.snr(at, source="reflected", label=f"reflected {_place(at)}"),
            )
            for at in _fig9(scenes, (10.0, 50.0))
        )
        return tuple(test for test in found if test.verdict != "noise_floor")

    return both_azimuths(tests)


def fig9_path_above_reflected(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the path has the higher ratio."""

    def tests(turned: bool) -> tuple[Test, ...]:
        return tuple(
            above(
                scenes.airborne.snr(at, source="path", label=f"path phi {at.phi:g}", turned=turned),
                scenes.airborne.snr(at, source="reflected", label=f"reflected phi {at.phi:g}"),
            )
            for at in _fig9(scenes, (10.0,))
            if at.phi < 180.0
        )

    return both_azimuths(tests)


def fig9_total_much_higher_at_0(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the total is much higher at an azimuth of 0."""
    snr, at = scenes.airborne.snr, scenes.at(25.0, 10.0, 0.0)
    reflected = snr(at, source="reflected", label="reflected phi 0")

    def total(turned: bool) -> Number:
        return snr(at, label="total phi 0", turned=turned)

    def others(turned: bool) -> tuple[Test, ...]:
        return tuple(
            above(total(turned), snr(one, label=f"total phi {one.phi:g}", turned=turned), factor=MUCH)
            for one in (scenes.at(25.0, 10.0, 90.0), scenes.at(25.0, 10.0, 180.0))
        )

    return tuple(
        Understanding(name=f"{name}; {azimuth}", tests=found)
        for turned, azimuth in ((False, AS_STATED), (True, PATH_TURNED))
        for name, found in (
            (f"{MUCH:g} times that of the reflected radiance there", (above(total(turned), reflected, factor=MUCH),)),
            (f"{MUCH:g} times that of the total at 90 and 180 deg", others(turned)),
        )
    )


def fig9_path_dominates(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the path is the more polarized light."""

    def tests(turned: bool) -> tuple[Test, ...]:
        path = scenes.airborne.polarized(scenes.at(25.0, 10.0, 180.0 if turned else 0.0), "path")
        return (above(path, scenes.airborne.polarized(scenes.at(25.0, 10.0, 0.0), "reflected")),)

    return both_azimuths(tests)


def fig9_total_misleads(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test two geometries of which the one with the higher total has the lower reflected ratio: the clearest pair."""

    def tests(turned: bool) -> tuple[Test, ...]:
        points = _fig9(scenes, (10.0, 50.0))
        total = [scenes.airborne.snr(at, label=f"total {_place(at)}", turned=turned) for at in points]
        reflected = [scenes.airborne.snr(at, source="reflected", label=f"reflected {_place(at)}") for at in points]
        pairs = [
            (above(total[i], total[j]), above(reflected[j], reflected[i]))
            for i in range(len(points))
            for j in range(len(points))
            if i != j
        ]
        return max(pairs, key=lambda pair: min(test.margin for test in pair))

    return both_azimuths(tests)


def fig9_reflected_rises(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the reflected ratio rises with the azimuth."""
    tests: list[Test] = []
    for view in (10.0, 50.0):
        found = [
            scenes.airborne.snr(at, source="reflected", label=f"reflected {_place(at)}")
            for at in _fig9(scenes, (view,))
        ]
        tests += falls(found[::-1])
    return one_reading(*tests)


def fig9_forward_is_strongest(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the reflected ratio is largest at an azimuth of 180."""
    tests: list[Test] = []
    for view in (10.0, 50.0):
        *others, forward = (
            scenes.airborne.snr(at, source="reflected", label=f"reflected {_place(at)}")
            for at in _fig9(scenes, (view,))
        )
        tests += [above(forward, other) for other in others]
    return one_reading(*tests)


def fig9_forward_is_purest(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that polarized light of the path over that of the target is least at an azimuth of 180."""

    def tests(turned: bool) -> tuple[Test, ...]:
        found: list[Test] = []
        for view in (10.0, 50.0):
            *others, forward = (_path_share(scenes, at, turned=turned) for at in _fig9(scenes, (view,)))
            found += [above(other, forward) for other in others]
        return tuple(found)

    return both_azimuths(tests)


def _path_share(scenes: PaperScenes, at: Geometry, *, turned: bool) -> Number:
    seen = scenes.at(at.sun, at.view, 180.0 - at.phi) if turned else at
    path, reflected = scenes.airborne.polarized(seen, "path"), scenes.airborne.polarized(at, "reflected")
    value = path.value / reflected.value
    error = value * float(np.hypot(path.error / path.value, reflected.error / reflected.value))
    return Number(label=f"polarized path over reflected {_place(at)}", value=value, error=error)


def fig9_oblique_is_higher(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that an oblique view has the higher ratio."""
    snr = scenes.airborne.snr
    return one_reading(
        *(
            above(
                snr(scenes.at(25.0, 50.0, phi), source="reflected", label=f"reflected view 50 phi {phi:g}"),
                snr(scenes.at(25.0, 10.0, phi), source="reflected", label=f"reflected view 10 phi {phi:g}"),
            )
            for phi in AZIMUTHS_DEG
        )
    )


def _fig9(scenes: PaperScenes, views: tuple[float, ...]) -> list[Geometry]:
    return [scenes.at(25.0, view, phi) for view in views for phi in AZIMUTHS_DEG]


def _place(at: Geometry) -> str:
    return f"view {at.view:g} phi {at.phi:g}"


_MOMENTS: tuple[Literal["mean", "std"], ...] = ("mean", "std")


def fig5_diverges(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the first order gets worse towards low light."""
    return _both_decibels(
        lambda scale: tuple(
            above(_off(scenes, first, moment, scale), _off(scenes, second, moment, scale))
            for moment in _MOMENTS
            for first, second in ((0.0, 10.0), (10.0, 20.0))
        )
    )


def fig5_agrees_above_20(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that at 20 dB first order is better than below."""
    return _both_decibels(
        lambda scale: tuple(
            above(_off(scenes, decibel, moment, scale), _off(scenes, 20.0, moment, scale))
            for moment in _MOMENTS
            for decibel in (0.0, 4.0, 8.0, 12.0, 16.0)
        )
    )


def _both_decibels(tests: Callable[[float], tuple[Test, ...]]) -> tuple[Understanding, ...]:
    """Return the readings of decibels, which the paper does not define: of an amplitude, and of a power."""
    return (
        Understanding(name="20 dB is an SNR of 10", tests=tests(1.0)),
        Understanding(name="20 dB is an SNR of 100", tests=tests(2.0)),
    )


def _off(scenes: PaperScenes, decibel: float, moment: Literal["mean", "std"], scale: float) -> Number:
    return replace(
        scenes.low_light.relative_error(scale * decibel, moment), label=f"first-order {moment} at {decibel:g} dB off by"
    )


def all_above_20(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that all scenes are brighter than 20 dB."""
    least = min((*scenes.airborne.s0_snrs(), *scenes.rooftop.s0_snrs()), key=lambda one: one.value)
    return _both_decibels(
        lambda scale: (
            above(
                Number(
                    label=f"least {least.label} [dB]",
                    value=20.0 / scale * float(np.log10(least.value)),
                    error=20.0 / scale / float(np.log(10.0)) * least.error / least.value,
                ),
                Number(label="20 dB", value=20.0),
            ),
        )
    )


def fig8_black_is_higher(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the black panel has more DoLP, the white one more light."""
    black, white = (scenes.rooftop.number(name, "dolp_pixels", "mean") for name in (TARGET, WHITE))
    bright, dark = (scenes.rooftop.number(name, "s0", "mean") for name in (WHITE, TARGET))
    return one_reading(above(black, white), above(bright, dark))


def fig8_white_is_narrower(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the white panel scatters less, and has the higher ratio of S0 to its noise."""
    number = scenes.rooftop.number
    black, white = scenes.rooftop.s0_snrs()
    return one_reading(
        *(above(number(TARGET, quantity, "std"), number(WHITE, quantity, "std")) for quantity in _NORMALIZED),
        above(white, black),
    )


_NORMALIZED = ("s1n", "s2n", "dolp_pixels")


def _heights(scenes: PaperScenes, source: str, *, turned: bool = False) -> list[Number]:
    snr = scenes.airborne.snr
    return [
        snr(
            Geometry(sun=50.0, view=50.0, height_m=height),
            source="reflected" if source == "reflected" else "total",
            turned=turned,
            label=f"{source} {height / 1000:g} km",
        )
        for height in HEIGHTS_M
    ]


def fig10_reflected_falls(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the reflected ratio falls with height."""
    return one_reading(*falls(_heights(scenes, "reflected")))


def fig10_total_does_not(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the total ratio does not fall all along."""
    return both_azimuths(lambda turned: (some_step_rises(_heights(scenes, "total", turned=turned)),))


def fig10_total_misleads(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test two heights of which the higher has more total and less reflected ratio: the clearest pair."""

    def tests(turned: bool) -> tuple[Test, ...]:
        total, reflected = _heights(scenes, "total", turned=turned), _heights(scenes, "reflected")
        pairs = [
            (above(total[high], total[low]), above(reflected[low], reflected[high]))
            for low in range(len(total))
            for high in range(low + 1, len(total))
        ]
        return max(pairs, key=lambda pair: min(test.margin for test in pair))

    return both_azimuths(tests)


def fig10_path_grows(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the path gains light with height."""
    found = []
    for height in HEIGHTS_M:
        at = Geometry(sun=50.0, view=50.0, height_m=height)
        found.append(scenes.airborne.radiance(at, "path", label=f"path {height / 1000:g} km"))
    return (
        Understanding(name="rises", tests=falls(found[::-1])),
        Understanding(
            name=f"at 9 km {SIGNIFICANT:g} times that at 3 km", tests=(above(found[-1], found[0], factor=SIGNIFICANT),)
        ),
    )


def _fig11_detection(scenes: PaperScenes) -> list[Number]:
    at = [Geometry(sun=50.0, view=50.0, height_m=height) for height in HEIGHTS_M]
    return [scenes.airborne.p_detection(one, label=f"{one.height_m / 1000:g} km") for one in at]


def fig11_falls(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that detection falls with height."""
    return one_reading(*falls(_fig11_detection(scenes)))


def fig11_as_fig10(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that detection and the reflected ratio fall together."""
    return one_reading(*falls(_fig11_detection(scenes)), *falls(_heights(scenes, "reflected")))


def fig11_much_higher_low(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the reflected ratio is much higher low down."""
    found = _heights(scenes, "reflected")
    return (
        Understanding(name=f"at 3 km {MUCH:g} times that at 9 km", tests=(above(found[0], found[-1], factor=MUCH),)),
        Understanding(name="at 3 km above that at 9 km", tests=(above(found[0], found[-1]),)),
    )


def _fig12(scenes: PaperScenes, view: float, kn: float = 1.0) -> list[Number]:
    label = f"view {view:g}" + ("" if kn == 1.0 else f" Kn {kn:g}")
    return [scenes.airborne.snr(scenes.at(sun, view, kn=kn), label=f"sun {sun:g} {label}") for sun in SUNS_DEG]


def fig12_oblique_is_higher(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the oblique view has the higher ratio at every sun."""
    return one_reading(
        *(above(more, less) for more, less in zip(_fig12(scenes, 40.0), _fig12(scenes, 20.0), strict=True))
    )


def fig12_peaks(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the ratio, and the polarization itself, are largest at a sun of 40 to 60 deg."""
    ratios = {view: peak_within(_fig12(scenes, view), SUNS_DEG, *_PEAK_DEG) for view in VIEWS_DEG}
    degrees = (peak_within(_fig12_dolp(scenes, view), SUNS_DEG, *_PEAK_DEG) for view in VIEWS_DEG)
    return (
        Understanding(name="DoLP SNR at view 40", tests=(ratios[40.0],)),
        Understanding(name="DoLP SNR at view 20", tests=(ratios[20.0],)),
        Understanding(name="DoLP itself at both views", tests=tuple(degrees)),
    )


_PEAK_DEG = (40.0, 60.0)


def _fig12_dolp(scenes: PaperScenes, view: float) -> list[Number]:
    return [_dolp(scenes, TARGET, sun, view) for sun in SUNS_DEG]


def _dolp(scenes: PaperScenes, region: str, sun: float, view: float) -> Number:
    value = scenes.airborne.quantity(scenes.at(sun, view), region, "dolp")
    # What the light is computed to, in parts of S0.
    return Number(label=f"DoLP {region} sun {sun:g} view {view:g}", value=value, error=TOLERANCE)


def _fig13(scenes: PaperScenes, sun: float, view: float) -> Number:
    return scenes.airborne.p_detection(scenes.at(sun, view), label=f"sun {sun:g} view {view:g}")


def fig13_sun_50_is_better(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that detection is better with the lower sun."""
    return one_reading(*(above(_fig13(scenes, 50.0, view), _fig13(scenes, 10.0, view)) for view in VIEWS_DEG))


def fig13_view_40_at_10(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that with the high sun the oblique view detects better, and has the higher ratio."""
    steep, oblique = (scenes.airborne.snr(scenes.at(10.0, view), label=f"sun 10 view {view:g}") for view in VIEWS_DEG)
    return one_reading(above(_fig13(scenes, 10.0, 40.0), _fig13(scenes, 10.0, 20.0)), above(oblique, steep))


def fig13_view_20_at_50(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that with the lower sun the steep view detects better."""
    return one_reading(above(_fig13(scenes, 50.0, 20.0), _fig13(scenes, 50.0, 40.0)))


def fig13_not_as_snr(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the ratio is higher at the oblique view with every sun, and detection worse there at a sun of 50."""
    steep, oblique = (_fig12(scenes, view) for view in VIEWS_DEG)
    return one_reading(
        *(above(more, less) for more, less in zip(oblique, steep, strict=True)),
        above(_fig13(scenes, 50.0, 20.0), _fig13(scenes, 50.0, 40.0)),
    )


def fig13_background_counts(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the ratio of the target and detection on the background go different ways at a sun of 50."""
    steep, oblique = (scenes.airborne.snr(scenes.at(50.0, view), label=f"sun 50 view {view:g}") for view in VIEWS_DEG)
    return one_reading(above(oblique, steep), above(_fig13(scenes, 50.0, 20.0), _fig13(scenes, 50.0, 40.0)))


def fig13_background_is_polarized(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the asphalt is polarized, and that detection would not be the same were it not."""
    nothing = Number(label="none", value=0.0)
    unpolarized = scenes.airborne.p_detection_on_unpolarized
    places = [(sun, view) for sun in (10.0, 50.0) for view in VIEWS_DEG]
    return one_reading(
        *(above(_dolp(scenes, BACKGROUND, sun, view), nothing) for sun, view in places),
        *(
            differ(_fig13(scenes, sun, view), unpolarized(scenes.at(sun, view), label=f"sun {sun:g} view {view:g}"))
            for sun, view in places
        ),
    )


def fig14_falls(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the ratio falls with noise."""
    by_noise = [_fig12(scenes, 40.0, kn) for kn in NOISE_FACTORS]
    return one_reading(*(test for numbers in zip(*by_noise, strict=True) for test in falls(numbers)))


def fig14_peaks(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that the peak stays with every noise."""
    by_noise = [_fig12(scenes, 40.0, kn) for kn in NOISE_FACTORS]
    both = tuple(
        above(found[SUNS_DEG.index(high)], found[SUNS_DEG.index(low)])
        for found in by_noise
        for high in (40.0, 60.0)
        for low in (10.0, 20.0, 30.0, 70.0, 80.0)
    )
    return (
        Understanding(
            name="largest at a sun of 40 to 60", tests=tuple(peak_within(n, SUNS_DEG, *_PEAK_DEG) for n in by_noise)
        ),
        Understanding(name="at 40 and at 60 above 10 to 30, 70 and 80", tests=both),
    )


def _fig15(scenes: PaperScenes, view: float) -> list[Number]:
    detected = scenes.airborne.p_detection
    return [detected(scenes.at(50.0, view, kn=kn), label=f"view {view:g} Kn {kn:g}") for kn in ROC_NOISE_FACTORS]


def fig15_falls(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that detection falls with noise."""
    return tuple(Understanding(name=f"view {view:g}", tests=falls(_fig15(scenes, view))) for view in VIEWS_DEG)


def fig15_significantly(scenes: PaperScenes) -> tuple[Understanding, ...]:
    """Test that detection falls by much with noise."""
    found = []
    for view in VIEWS_DEG:
        first, *_, last = _fig15(scenes, view)
        found.append(Understanding(name=f"view {view:g}", tests=(above(first, last, factor=SIGNIFICANT),)))
    return tuple(found)


_NEEDS_DATA = "their measured points: not at hand; --digitised overlays points of whoever has the figures"
_SUN_25 = "sun 25; view 10 and 50; phi 0, 90, 180"
_SUN_25_STEEP = "sun 25; view 10; phi 0, 90, 180"
_HEIGHTS = "sun 50, view 50, phi 180; 3, 5, 7, 9 km"
_FOUR = "sun 10 and 50, view 20 and 40, phi 180"
_SUNS = "sun 10 to 80; view 20 and 40; phi 180"
_AT_RATE = "P_D at P_FA 1e-3"


def _statement(
    name: str,
    figure: str,
    sentence: str,
    geometry: str,
    check: str,
    readings: Callable[[PaperScenes], tuple[Understanding, ...]],
) -> Statement:
    return Statement(id=name, figure=figure, sentence=sentence, geometry=geometry, check=check, readings=readings)


STATEMENTS: tuple[Statement, ...] = (
    _statement(
        "5a", "5",
        "It is shown that the analytical-model-predicted statistics of DoLP diverge at low SNR, which is accordance "
        "with the observation presented in [57].",
        "S = (1, 0.5, 0.5), four angles, shot noise",
        "relative error of the first-order mean and deviation against the exact law grows from 20 to 10 to 0 dB",
        fig5_diverges,
    ),
    _statement(
        "5b", "5",
        "... the S0 SNR larger than 20 dB to guarantee the model-predicted DoLP statistics have better agreement with "
        "the true values.",
        "S = (1, 0.5, 0.5), 20 dB",
        "relative error of the first-order mean and deviation at 20 dB below those at 0, 4, 8, 12, 16 dB",
        fig5_agrees_above_20,
    ),
    _statement(
        "7a", "7",
        "It can be seen that the analytical model can predict the trend of the data very well, although some "
        "discrepancy between the model predictions and real measurements can be seen in magnitude.",
        GEOMETRY, _NEEDS_DATA, without_their_data,
    ),
    _statement(
        "8a", "8",
        "It is shown that the black paint and white paint exhibit different polarization properties, and the black "
        "paint shows higher DoLP due to its lower reflectance.",
        GEOMETRY, "mean DoLP of pixels: black above white; S0: white above black", fig8_black_is_higher,
    ),
    _statement(
        "8b", "8",
        "The white paint shows smaller variance than the black paint in both Stokes parameters and DoLP since the "
        "signal, as measured from the white paint, has a higher SNR.",
        GEOMETRY, "deviation of s1, s2, DoLP of pixels: black above white; SNR of S0: white above black",
        fig8_white_is_narrower,
    ),
    _statement(
        "8c", "8",
        "It is shown that the predicted statistics have a close match with the measured data.",
        GEOMETRY, _NEEDS_DATA, without_their_data,
    ),
    _statement(
        "8d", "8",
        "However, the results show that the analytical model is able to predict the general polarization behavior of "
        "different materials and data trends at different scene geometries ...",
        GEOMETRY, _NEEDS_DATA, without_their_data,
    ),
    _statement(
        "8e", "8",
        "The discrepancy between the model predictions and real measurements are possibly due to differences between "
        "the real atmosphere and the predicted atmosphere by MODTRAN-P, any diversity between the estimated and actual "
        "material properties, or calibration error of the sensor.",
        GEOMETRY, _NEEDS_DATA, without_their_data,
    ),
    _statement(
        "9a", "9",
        "In Fig. 9, it is shown that the DoLP SNR calculated based on the total radiance is different from the "
        "radiance truly reflected from the object surface, which is due to the contamination from the upwelling "
        "radiance.",
        _SUN_25, "DoLP SNR: total differs from reflected wherever it is above the noise floor", fig9_total_differs,
    ),
    _statement(
        "9b", "9a",
        "At certain scene geometries, such as 25 deg and 10 deg, as shown in Fig. 9(a), the upwelling radiance results "
        "in an even higher DoLP SNR than the reflected radiance at 0 and 90 deg.",
        "sun 25; view 10; phi 0, 90", "DoLP SNR: path above reflected at both", fig9_path_above_reflected,
    ),
    _statement(
        "9c", "9a",
        "... the DoLP SNR of the total radiance is much higher at 0 deg ...",
        _SUN_25_STEEP, f"DoLP SNR of the total at phi 0, much taken as {MUCH:g} times", fig9_total_much_higher_at_0,
    ),
    _statement(
        "9d", "9a",
        "... the polarization information obtained at this azimuth angle is dominated by the upwelling radiance and "
        "reflects very little information about the polarimetric signature of the object.",
        "sun 25; view 10; phi 0", "polarized radiance: path above reflected", fig9_path_dominates,
    ),
    _statement(
        "9e", "9",
        "... a higher DoLP SNR does not necessarily mean a stronger polarimetric signature.",
        _SUN_25, "two geometries: the one with the higher total has the lower reflected DoLP SNR",
        fig9_total_misleads,
    ),
    _statement(
        "9f", "9",
        "... the general trend that the DoLP SNR of reflected radiance increases when the azimuth angle changes from 0 "
        "to 180 deg ...",
        _SUN_25, "DoLP SNR of reflected rises from phi 0 to 90 to 180", fig9_reflected_rises,
    ),
    _statement(
        "9g", "9",
        "A higher DoLP SNR of reflected radiance is also observed at an oblique viewing angle, such as 50 deg shown in "
        "Fig. 9(b).",
        _SUN_25, "DoLP SNR of reflected: view 50 above view 10", fig9_oblique_is_higher,
    ),
    _statement(
        "9h", "9",
        "... and therefore stronger polarimetric signature is expected to be captured at the forward reflection "
        "direction.",
        _SUN_25, "DoLP SNR of reflected: phi 180 above 0 and 90", fig9_forward_is_strongest,
    ),
    _statement(
        "9i", "9",
        "In the following performance studies, we will concentrate on the azimuth angle of 180 deg, at which more "
        "accurate polarimetric signatures of the object are expected to be captured.",
        _SUN_25, "polarized radiance of the path over that of the target: least at phi 180", fig9_forward_is_purest,
    ),
    _statement(
        "10a", "10a",
        "It is shown that the DoLP SNR of reflected radiance decreases at higher altitude and therefore results in a "
        "weaker polarimetric signature.",
        _HEIGHTS, "DoLP SNR of reflected falls with height", fig10_reflected_falls,
    ),
    _statement(
        "10b", "10b",
        "However, this trend is not followed in Fig. 10(b) when DoLP SNR is calculated based on the total radiance.",
        _HEIGHTS, "DoLP SNR of total: some step upward with height", fig10_total_does_not,
    ),
    _statement(
        "10c", "10",
        "This is because, at higher altitudes, upwelling radiance is increased significantly.",
        _HEIGHTS, f"S0 of path rises with height; significantly taken as {SIGNIFICANT:g} times from 3 to 9 km",
        fig10_path_grows,
    ),
    _statement(
        "10d", "10",
        "The observations suggest that, at higher altitudes, higher DoLP SNR does not necessarily mean a stronger "
        "polarimetric signature since the polarimetric signature may be severely contaminated by the upwelling "
        "radiance.",
        _HEIGHTS, "two heights: the higher one has more DoLP SNR of the total and less of the reflected",
        fig10_total_misleads,
    ),
    _statement(
        "11a", "11",
        "It is shown that the detection performance decreases by increasing the altitude.",
        _HEIGHTS, f"{_AT_RATE} falls with height", fig11_falls,
    ),
    _statement(
        "11c", "10, 11",
        "The observation is in accordance with the results shown in Fig. 10.",
        _HEIGHTS, f"{_AT_RATE} and DoLP SNR of reflected fall with height", fig11_as_fig10,
    ),
    _statement(
        "11b", "10, 11",
        "At a lower platform altitude, the DoLP SNR of reflected radiance from target is much higher; therefore, "
        "stronger polarimetric signature is present.",
        _HEIGHTS, f"DoLP SNR of reflected: 3 km above 9 km; much taken as {MUCH:g} times", fig11_much_higher_low,
    ),
    _statement(
        "12a", "12",
        "It is shown that, at an oblique viewing angle 40 deg, the black paint shows higher DoLP SNR ...",
        _SUNS, "DoLP SNR: view 40 above view 20 at every sun", fig12_oblique_is_higher,
    ),
    _statement(
        "12b", "12",
        "... and stronger polarization can be found around 40-60 deg incident angles.",
        _SUNS, "largest DoLP SNR, or DoLP, at a sun of 40 to 60", fig12_peaks,
    ),
    _statement(
        "13a", "13",
        "It is shown that, at an oblique solar incident angle 50 deg, the detection performance is enhanced.",
        _FOUR, f"{_AT_RATE}: sun 50 above sun 10, at both views", fig13_sun_50_is_better,
    ),
    _statement(
        "13b", "13",
        "When 10 deg, the detection at an oblique sensor viewing angle 40 deg outperforms the detection at 20 deg, and "
        "the result is in accordance with the DoLP SNR analysis shown in Fig. 12.",
        "sun 10, view 20 and 40, phi 180", f"{_AT_RATE} and DoLP SNR: view 40 above view 20", fig13_view_40_at_10,
    ),
    _statement(
        "13c", "13",
        "When 50 deg, the detection at 20 deg outperforms the detection at 40 deg.",
        "sun 50, view 20 and 40, phi 180", f"{_AT_RATE}: view 20 above view 40", fig13_view_20_at_50,
    ),
    _statement(
        "13d", "13",
        "This result however does not follow the observation that we have in Fig. 12, where the DoLP SNR of black "
        "paint at 40 deg is always higher than the DoLP SNR at 20 deg.",
        "sun 10 to 80, view 20 and 40, phi 180",
        f"DoLP SNR: view 40 above view 20 at every sun, and {_AT_RATE} at a sun of 50 the other way", fig13_not_as_snr,
    ),
    _statement(
        "13f", "13",
        "This is mainly due to the fact that the DoLP SNR is calculated solely based on the target object, but the "
        "detection performance is determined by the combined factors of both the target and background.",
        "sun 50, view 20 and 40, phi 180", f"the target's own DoLP SNR is higher where {_AT_RATE} is lower",
        fig13_background_counts,
    ),
    _statement(
        "13e", "13",
        "In this simulation, the background object asphalt is not randomly polarized, and its polarization properties "
        "also determine the target detection performance.",
        _FOUR, f"DoLP of asphalt above 0; {_AT_RATE} differs from that on asphalt whose mean S1 and S2 are 0",
        fig13_background_is_polarized,
    ),
    _statement(
        "14a", "14",
        "It is shown that, with a larger sensor noise factor, the DoLP SNR of black paint decreases.",
        "sun 10 to 80; view 40; phi 180; Kn 1 to 3.5", "DoLP SNR falls with Kn at every sun", fig14_falls,
    ),
    _statement(
        "14b", "14",
        "The black paint presents higher DoLP SNR at an incident zenith angle of around 40 and 60 deg, showing good "
        "agreement with the results presented earlier.",
        "sun 10 to 80; view 40; phi 180; Kn 1 to 3.5", "DoLP SNR by the sun, for every Kn: largest around 40 and 60",
        fig14_peaks,
    ),
    _statement(
        "15a", "15",
        "The PD value at a constant false alarm rate decreases when the sensor noise factor is increased.",
        "sun 50; view not stated (20 and 40); phi 180; Kn 1, 2, 3", f"{_AT_RATE} falls with Kn", fig15_falls,
    ),
    _statement(
        "15b", "15",
        "The target detection performance is affected significantly by the level of sensor noise.",
        "sun 50; view not stated (20 and 40); phi 180; Kn 1, 3",
        f"{_AT_RATE}: at Kn 1 {SIGNIFICANT:g} times that at Kn 3", fig15_significantly,
    ),
    _statement(
        "V-a", "7 to 15",
        "In this paper, all the experiments are performed with the S0 SNR larger than 20 dB ...",
        "all geometries of Figs 7 to 15", "least SNR of S0 above 20 dB", all_above_20,
    ),
    _statement(
        "VI-a", "7, 8",
        "The results based on model prediction have shown good agreement with experimental measurement.",
        GEOMETRY, _NEEDS_DATA, without_their_data,
    ),
)  # fmt: skip


IN_WORDS: dict[Verdict, str] = {
    "holds": "holds",
    "opposite": "opposite",
    "cannot_be_seen": "cannot be seen",
    "noise_floor": "noise floor",
    "ambiguous": "ambiguous",
}


@dataclass(frozen=True, kw_only=True)
class Result:
    """A statement and what comes out."""

    statement: Statement  #: The sentence.
    materials: str  #: Which set.
    readings: tuple[Understanding, ...]  #: Each with its numbers.
    #: The same, computed as the authors did; empty where that was not asked for.
    as_paper: tuple[Understanding, ...] = ()

    @property
    def id(self) -> str:
        """Its name among all results: set of materials and statement."""
        return f"{self.materials}/{self.statement.id}"

    @property
    def verdict(self) -> Verdict:
        """That of all readings; ambiguous where they differ."""
        return _joint(self.readings)

    @property
    def as_paper_verdict(self) -> Verdict | None:
        """The verdict on the numbers as the authors computed them."""
        return _joint(self.as_paper) if self.as_paper else None

    @property
    def margin(self) -> float | None:
        """Of the test that decides the first reading."""
        test = self.readings[0].deciding
        return None if test is None else test.margin

    @property
    def numerical_error(self) -> float | None:
        """Of that margin."""
        test = self.readings[0].deciding
        return None if test is None else test.error

    @property
    def numbers(self) -> tuple[tuple[str, Number], ...]:
        """Label and number of every reading; that of a reading beside the first is named before it."""
        return tuple(_labelled(self.readings))

    @property
    def as_paper_numbers(self) -> tuple[tuple[str, Number], ...]:
        """The same as the authors computed them."""
        return tuple(_labelled(self.as_paper))


def _joint(readings: Sequence[Understanding]) -> Verdict:
    verdicts = {reading.verdict for reading in readings}
    return verdicts.pop() if len(verdicts) == 1 else "ambiguous"


def _labelled(readings: Sequence[Understanding]) -> Iterable[tuple[str, Number]]:
    seen: set[tuple[str, float]] = set()
    for k, reading in enumerate(readings):
        for number in reading.numbers:
            if (number.label, number.value) not in seen:
                seen.add((number.label, number.value))
                yield (number.label if k == 0 else f"{number.label} ({reading.name})"), number


def chosen(figures: Sequence[int]) -> tuple[Statement, ...]:
    """Return the statements about some figures; about all where none is named."""
    wanted = set(figures)
    return tuple(one for one in STATEMENTS if not wanted or wanted & set(figures_of(one)))


def figures_of(statement: Statement) -> tuple[int, ...]:
    """Return the numbers of the figures that a statement is about."""
    if " to " in statement.figure:
        first, last = statement.figure.split(" to ")
        return tuple(range(int(first), int(last) + 1))
    return tuple(int(part.strip().rstrip("ab")) for part in statement.figure.split(","))


def results(
    scenes: PaperScenes,
    materials: str,
    statements: Iterable[Statement] = STATEMENTS,
    *,
    as_paper: PaperScenes | None = None,
) -> tuple[Result, ...]:
    """Return what comes out of statements."""
    # What is said of all geometries is asked last, when they are there.
    ordered = sorted(statements, key=lambda one: " to " in one.figure)
    found = {
        one.id: Result(
            statement=one,
            materials=materials,
            readings=one.readings(scenes),
            as_paper=() if as_paper is None else one.readings(as_paper),
        )
        for one in ordered
    }
    return tuple(found[one.id] for one in statements if one.id in found)


_OWN = tuple(f"regions.{region}." for region in (TARGET, BACKGROUND))
# Draws that no surface allows (a lobe that alone reflects more than its dhr) are made anew this many times.
_MOST_REDRAWN = 50


@dataclass(frozen=True, kw_only=True)
class Tried:
    """A set of materials that was tried: its numbers by their keys, and the verdict on every statement."""

    numbers: Mapping[str, float]
    verdicts: Mapping[str, Verdict]

    @property
    def held(self) -> int:
        """How many statements hold."""
        return sum(verdict == "holds" for verdict in self.verdicts.values())


@dataclass(frozen=True, kw_only=True)
class Search:
    """Sets of materials that were tried, the best first, and how many draws no surface allowed."""

    tried: tuple[Tried, ...]
    impossible: int

    @property
    def best(self) -> Tried:
        """That with which most statements hold; the first of equals."""
        return self.tried[0]


def search(
    scene: SceneFile,
    start: PaperScenes,
    *,
    sets: int,
    seed: int,
    progress: Callable[[int], None] | None = None,
) -> Search:
    """Return what comes out of random sets of materials, normal about those of a scene with their uncertainties.

    Settings of the scene file, without a tolerance: a verdict of a search is to be confirmed with `--materials`.
    """
    generator = np.random.default_rng(seed)
    found, impossible = [_tried(start, {}, "start")], 0
    for count in range(1, sets + 1):
        for numbers in _draws(start.airborne, generator):
            try:
                airborne = Airborne(
                    scene, light=start.airborne.light, snr=start.airborne.snr_form, changed=numbers, tolerance=None
                )
                scenes = PaperScenes(
                    airborne=airborne,
                    rooftop=Rooftop(airborne),
                    low_light=start.low_light,
                    height_m=start.height_m,
                )
                found.append(_tried(scenes, numbers, str(count)))
                break
            except ConfigError:
                impossible += 1
            except ValueError:
                impossible += 1
        if progress is not None:
            progress(count)
    return Search(tried=tuple(sorted(found, key=lambda one: -one.held)), impossible=impossible)


def _tried(scenes: PaperScenes, numbers: Mapping[str, float], name: str) -> Tried:
    found = results(scenes, name)
    return Tried(numbers=dict(numbers), verdicts={one.statement.id: one.verdict for one in found})


def _draws(airborne: Airborne, generator: np.random.Generator) -> Iterator[dict[str, float]]:
    scene = airborne.predictor.scene
    # Whatever the materials, or the scene of these two regions, state an uncertainty of.
    own = [
        one for parameter in parameters(scene) if (one := get(scene, parameter.key)).key.startswith(_OWN) and one.std
    ]
    for _ in range(_MOST_REDRAWN):
        drawn = {one.key: float(generator.normal(one.value, one.std)) for one in own}
        yield {one.key: min(max(drawn[one.key], one.least), one.most) for one in own}


@dataclass(frozen=True, kw_only=True, eq=False)
class MaterialSet:
    """One set of materials: its scenes, what comes out of the statements, and what is assumed."""

    name: str
    scene: SceneFile
    scenes: PaperScenes
    as_paper: PaperScenes | None
    results: tuple[Result, ...]
    assumed: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperResult:
    """What was found, by set of materials."""

    sets: tuple[MaterialSet, ...]  #: In the order of the request.
    figures: tuple[int, ...]  #: Which were asked for.
    search: Search | None  #: About the first set.
    points: tuple[DigitisedPoint, ...]  #: Of the paper's figures, where somebody has them.
    remarks: tuple[str, ...]  #: What is to be said.

    @property
    def results(self) -> tuple[Result, ...]:
        """Of all sets."""
        return tuple(one for each in self.sets for one in each.results)


_LINE = re.compile(r"^\s*(?P<key>[A-Za-z_]+)\s*=\s*(?P<value>[^#]*?)\s*#\s*assumed:?\s*(?P<why>.*)$")
_TABLE = re.compile(r"^\s*\[+(?P<name>[\w.]+)\]+")
_NAME = re.compile(r'^\s*name\s*=\s*"(?P<name>[^"]*)"')


def assumed_lines(path: Path) -> tuple[str, ...]:
    """Return a text for each number of a scene file whose line says in a comment that it is assumed."""
    table, found = "", []
    for line in path.read_text(encoding="utf-8").splitlines():
        head, name, one = _TABLE.match(line), _NAME.match(line), _LINE.match(line)
        if head is not None:
            table = f"{head['name']}."
        elif name is not None and table.startswith("regions."):
            table = f"regions.{name['name']}."
        if one is not None:
            why = f" ({one['why']})" if one["why"] else ""
            found.append(f"assumed: {table}{one['key']} = {one['value']}{why}")
    return tuple(found)


FIGURES = (2, *range(5, 16))
_AZIMUTHS_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0)
_P_FA, _P_D, _P_MISS = "probability of false alarm", "probability of detection", "probability of a miss"


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A line, or points where `marker` says so."""

    label: str
    x: FloatArray
    y: FloatArray
    marker: str = "."
    line: str = "-"


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """Curves over one pair of axes; the letter is the paper's."""

    letter: str
    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    log_x: bool = False
    log_y: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperFigure:
    """A figure of the paper as the model has it."""

    number: int
    title: str
    panels: tuple[Panel, ...]


def _curve(label: str, x: Sequence[float] | FloatArray, y: Sequence[float] | FloatArray, **look: str) -> Curve:
    return Curve(label=label, x=np.asarray(x, dtype=np.float64), y=np.asarray(y, dtype=np.float64), **look)


def _fig5(scenes: PaperScenes) -> PaperFigure:
    found = scenes.low_light.found
    decibel = 20.0 * np.log10(found.snr)
    panels = tuple(
        Panel(
            letter=letter,
            title=f"({letter}) {name} of DoLP",
            x_label="SNR of S0 [dB, amplitude]",
            y_label=f"{name} of DoLP",
            curves=(
                _curve("1e4 Poisson draws", decibel, drawn, marker="o", line=""),
                _curve("first order, [MK14]", decibel, first, marker="", line="--"),
                _curve("exact: Poisson counts", decibel, exact, marker=""),
            ),
        )
        for letter, name, drawn, first, exact in (
            ("a", "mean", found.drawn_mean, found.first_mean, found.true_mean),
            ("b", "deviation", found.drawn_std, found.first_std, found.true_std),
        )
    )
    return PaperFigure(number=5, title="DoLP under shot noise, S = (1, 0.5, 0.5)", panels=panels)


def _fig7(scenes: PaperScenes) -> PaperFigure:
    angles = [float(angle) for angle in ANGLES]
    panels = tuple(
        Panel(
            letter=letter,
            title=f"({letter}) {name}",
            x_label="angle of the polarizer [deg]",
            y_label=f"{name} of the counts [DN]",
            curves=tuple(
                _curve(label, angles, [scenes.rooftop.number(panel, f"dn_{a}", statistic).value for a in ANGLES])
                for panel, label in PANELS.items()
            ),
        )
        for letter, name, statistic in (("a", "mean", "mean"), ("b", "deviation", "std"))
    )
    return PaperFigure(number=7, title="counts of the panels: sun 22, view 53, phi 180", panels=panels)


def _fig9_curves(scenes: PaperScenes) -> PaperFigure:
    sources: tuple[tuple[Source, str], ...] = (("reflected", "reflected"), ("path", "upwelling"), ("total", "total"))
    panels = []
    for letter, view in (("a", 10.0), ("b", 50.0)):
        at = [scenes.at(25.0, view, phi) for phi in _AZIMUTHS_DEG]
        snr = scenes.airborne.snr
        curves = [
            _curve(name, _AZIMUTHS_DEG, [snr(one, source=source).value for one in at]) for source, name in sources
        ]
        turned = [snr(one, turned=True).value for one in at]
        curves.append(_curve("total, azimuth of path turned by 180 deg", _AZIMUTHS_DEG, turned, line=":"))
        if scenes.airborne.snr_form == "exact":
            floor, label = [UNPOLARIZED_SNR] * len(at), f"of unpolarised light, {UNPOLARIZED_SNR:.3f}"
            curves.append(_curve(label, _AZIMUTHS_DEG, floor, marker="", line="-."))
        title = f"({letter}) sun 25, view {view:g}"
        panels.append(_snr_panel(scenes, letter, title, "relative azimuth phi [deg]", curves))
    return PaperFigure(number=9, title="parts of the light", panels=tuple(panels))


def _snr_panel(scenes: PaperScenes, letter: str, title: str, x_label: str, curves: Sequence[Curve]) -> Panel:
    form = {"exact": "exact law", "first-order": "first order"}[scenes.airborne.snr_form]
    y_label = f"DoLP SNR of black paint, {form}"
    return Panel(letter=letter, title=title, x_label=x_label, y_label=y_label, curves=tuple(curves))


def _fig10(scenes: PaperScenes) -> PaperFigure:
    at = [Geometry(sun=50.0, view=50.0, height_m=height) for height in HEIGHTS_M]
    km = [height / 1000.0 for height in HEIGHTS_M]
    parts: tuple[tuple[str, Source, str], ...] = (("a", "reflected", "reflected"), ("b", "total", "total"))
    snr = scenes.airborne.snr
    panels = []
    for letter, source, name in parts:
        curves = [_curve(name, km, [snr(one, source=source).value for one in at])]
        if source == "total":
            turned = [snr(one, turned=True).value for one in at]
            curves.append(_curve("total, azimuth of path turned by 180 deg", km, turned, line=":"))
        panels.append(_snr_panel(scenes, letter, f"({letter}) {name} radiance", "height of the camera [km]", curves))
    return PaperFigure(number=10, title="sun 50, view 50, phi 180", panels=tuple(panels))


def _roc(scenes: PaperScenes, letter: str, title: str, points: Sequence[tuple[str, Geometry]]) -> tuple[Panel, ...]:
    """Return the curves; where all of them lie at 1 from the rate of the statements on, what is missed beside them."""
    found = [(label, scenes.airborne.roc(at)) for label, at in points]
    curves = [_curve(label, one.p_false_alarm, one.p_detection, marker="") for label, one in found]
    shown = Panel(letter=letter, title=title, x_label=_P_FA, y_label=_P_D, curves=tuple(curves), log_x=True)
    place = int(np.argmin(np.abs(found[0][1].p_false_alarm - P_FALSE_ALARM)))
    if any(one.p_detection[place] <= ALL_DETECTED for _, one in found):
        return (shown,)
    missed = [
        _curve(label, one.p_false_alarm[one.p_miss > 0.0], one.p_miss[one.p_miss > 0.0], marker="")
        for label, one in found
    ]
    title = f"{title}: the same, 1 - P_D"
    return shown, replace(
        shown, letter=f"{letter} missed", title=title, y_label=_P_MISS, curves=tuple(missed), log_y=True
    )


def _fig11(scenes: PaperScenes) -> PaperFigure:
    points = [(f"{h / 1000:g} km", Geometry(sun=50.0, view=50.0, height_m=h)) for h in HEIGHTS_M]
    return PaperFigure(number=11, title="ROC by height", panels=_roc(scenes, "a", "sun 50, view 50, phi 180", points))


def _fig12_curves(scenes: PaperScenes) -> PaperFigure:
    snr = scenes.airborne.snr
    curves = [
        _curve(f"view {view:g} deg", SUNS_DEG, [snr(scenes.at(sun, view)).value for sun in SUNS_DEG])
        for view in VIEWS_DEG
    ]
    panel = _snr_panel(scenes, "a", "phi 180", "solar zenith angle [deg]", curves)
    return PaperFigure(number=12, title="DoLP SNR by sun and view", panels=(panel,))


def _fig13_curves(scenes: PaperScenes) -> PaperFigure:
    points = [(f"sun {sun:g}, view {view:g}", scenes.at(sun, view)) for sun in (10.0, 50.0) for view in VIEWS_DEG]
    return PaperFigure(number=13, title="ROC by geometry", panels=_roc(scenes, "a", "phi 180", points))


def _fig14(scenes: PaperScenes) -> PaperFigure:
    snr = scenes.airborne.snr
    curves = [
        _curve(f"sun {sun:g} deg", NOISE_FACTORS, [snr(scenes.at(sun, 40.0, kn=kn)).value for kn in NOISE_FACTORS])
        for sun in SUNS_DEG
    ]
    panel = _snr_panel(scenes, "a", "view 40, phi 180", "noise factor Kn", curves)
    return PaperFigure(number=14, title="DoLP SNR by noise factor", panels=(panel,))


def _fig15_curves(scenes: PaperScenes) -> PaperFigure:
    panels = tuple(
        panel
        for letter, view in zip("ab", VIEWS_DEG, strict=True)
        for panel in _roc(
            scenes,
            letter,
            f"sun 50, view {view:g} (not stated), phi 180",
            [(f"Kn {kn:g}", scenes.at(50.0, view, kn=kn)) for kn in ROC_NOISE_FACTORS],
        )
    )
    return PaperFigure(number=15, title="ROC by noise factor", panels=panels)


_MADE: dict[int, Callable[[PaperScenes], PaperFigure]] = {
    5: _fig5,
    7: _fig7,
    9: _fig9_curves,
    10: _fig10,
    11: _fig11,
    12: _fig12_curves,
    13: _fig13_curves,
    14: _fig14,
    15: _fig15_curves,
}


def curves_of(number: int, scenes: PaperScenes, *, as_paper: PaperScenes | None = None) -> PaperFigure | None:
    """Return the curves of a figure; None for Figs 2, 6 and 8, which are pictures and laws."""
    made = _MADE.get(number)
    if made is None:
        return None
    figure = made(scenes)
    if as_paper is None or number < 9:
        return figure
    theirs = {panel.letter: panel.curves for panel in made(as_paper).panels}
    panels = tuple(
        replace(one, curves=(*one.curves, *(_as_paper(curve) for curve in theirs.get(one.letter, ()))))
        for one in figure.panels
    )
    return replace(figure, panels=panels)


def _as_paper(curve: Curve) -> Curve:
    return replace(curve, label=f"{curve.label}, as the paper", line="--")


# More numbers of a statement stand in CSV and JSON.
_MOST_SHOWN = 8
_HEAD = """# What [MK14] says of its figures, and what comes out

Every sentence of sections II-C to VI about what a figure shows, checked through the whole chain with two sets of
materials, for the optical properties of the paper stand in a reference that is not at hand. Written by `rigctl paper`
(`python -m tests.rigctl.paper.statements_page > docs/paper-statements.md`); a test fails when page and program differ.

- **library**: black paint (slope 0.15) and asphalt (slope 0.30) of the material library, with a texture that
  multiplies all Stokes parameters of the asphalt alike (`examples/paper/library.toml`);
- **rough**: paint of slope 0.30, asphalt of slope 0.40, and the diagonal texture of eq. (10), 5 % of the reflected S0
  in S0, S1 and S2 each (`examples/paper/rough.toml`). Nothing was tuned beyond these two sets.

| verdict | means |
|---|---|
| holds | every inequality of the sentence holds, by more than three numerical errors |
| opposite | at least one is reversed, by more than three numerical errors |
| cannot be seen | every P_D compared is above .999; or it needs the authors' measured points, which nobody here has |
| noise floor | exact DoLP SNRs compared lie below 2.1: those of light without polarization are 1.913 |
| ambiguous | readings of the sentence differ, each is named; or the margin is within the numerical error |

"""
_NOTES = """
**What brings them about.** Fig. 9a: at a view of 10 deg and phi 0 all these ratios lie near 1.913, the exact SNR of
unpolarised light; to first order (`--snr first-order`) they may be any number down to 0. Fig. 10: near the glint the
smooth paint of the library is so bright that the path dilutes its polarization more than it adds; rougher paint is
darker there, and the path's own polarization, which grows with altitude, makes up for it. Fig. 13: with the library's
slopes the paint is 1.5 times as bright as the asphalt at a view of 40 deg (S0 2408 to 1642 DN) and is found by its
brightness; with those of the rough set the two are alike there (1346 to 1409 DN). How model and data agree cannot be
judged without the authors' points.
"""
_SAID = """
## Sentences that say what is drawn

The other sentences of the text about these figures claim nothing that could hold or not. (Figs 1, 3 and 4 are drawings
of the model.)

| figure | sentence | here |
|---|---|---|
"""
# Heading, and what stands under it.
_FIG5 = (
    ("mean: first", "first_mean"),
    ("Gaussian", "mean"),
    ("Poisson", "poisson_mean"),
    ("drawn", "drawn_mean"),
    ("std: first", "first_std"),
    ("Gaussian", "std"),
    ("Poisson", "poisson_std"),
    ("drawn", "drawn_std"),
)


def statement_json(found: Sequence[Result]) -> list[dict[str, Json]]:
    """Return the statements as programs read them."""
    return [_object(one) for one in found]


def _object(one: Result) -> dict[str, Json]:
    content: dict[str, Json] = {
        "id": one.id,
        "figure": one.statement.figure,
        "sentence": one.statement.sentence,
        "geometry": one.statement.geometry,
        "check": one.statement.check,
        "numbers": {label: finite(number.value) for label, number in one.numbers},
        "margin": one.margin,
        "numerical_error": one.numerical_error,
        "verdict": one.verdict,
        "materials": one.materials,
        "readings": {reading.name: reading.verdict for reading in one.readings},
    }
    if one.as_paper:
        content["as_paper"] = {
            "numbers": {label: finite(number.value) for label, number in one.as_paper_numbers},
            "verdict": one.as_paper_verdict,
        }
    return content


def statement_csv(found: Sequence[Result]) -> bytes:
    """Return a row a statement."""
    columns: tuple[Column[Result], ...] = (
        Column(key="id"),
        *(Column(key=name, value=_of_statement(name)) for name in ("figure", "sentence", "geometry", "check")),
        Column(key="numbers", value=lambda one: "; ".join(_number(*pair, digits=8) for pair in one.numbers)),
        Column(key="margin"),
        Column(key="numerical_error"),
        Column(key="verdict"),
        Column(key="materials"),
        Column(key="readings", value=lambda one: "; ".join(f"{r.name}: {r.verdict}" for r in one.readings)),
        Column(
            key="as_paper_numbers",
            value=lambda one: "; ".join(_number(*pair, digits=8) for pair in one.as_paper_numbers),
        ),
        Column(key="as_paper_verdict"),
    )
    return csv_rows(Table(columns=columns, rows=tuple(found)))


def _of_statement(name: str) -> Any:
    return lambda one: getattr(one.statement, name)


def _number(label: str, number: Number, *, digits: int = 4) -> str:
    return f"{label} {number.value:.{digits}g}"


def statement_table(found: Sequence[Result], *, title: str = "") -> Table[Result]:
    """Return the statements with their verdicts, and the numbers of each."""
    columns: tuple[Column[Result], ...] = (
        Column(title="id", text=lambda one: one.id, left=True, unbroken=True),
        Column(title="sentence", text=lambda one: one.statement.sentence, left=True, wide=True),
        Column(title="where", text=lambda one: one.statement.geometry, left=True),
        Column(title="check", text=lambda one: one.statement.check, left=True),
        Column(title="numbers", text=_numbers_text, left=True),
        Column(title="margin", text=lambda one: "–" if one.margin is None else f"{one.margin:.3g}"),
        Column(
            title="num. error", text=lambda one: "–" if one.numerical_error is None else f"{one.numerical_error:.1g}"
        ),
        Column(title="verdict", text=verdict_text, brief=lambda one: IN_WORDS[one.verdict], left=True),
    )
    return Table(title=title, columns=columns, rows=tuple(found), is_off=lambda one: one.verdict == "opposite")


def description_table(figure: int) -> Table[Description]:
    """Return the sentences that say what a figure shows, and how the figure here follows them."""
    columns: tuple[Column[Description], ...] = (
        Column(title="what the text says is drawn", text=lambda one: one.sentence, left=True, wide=True),
        Column(title="here", text=lambda one: one.here, left=True),
    )
    return Table(columns=columns, rows=tuple(one for one in DESCRIPTIONS if one.figure == figure))


def terminal_statements(found: Sequence[Result]) -> Table[Result]:
    """Return what fits a terminal: id, check, margin, verdict."""
    whole = statement_table(found)
    kept = {"id", "check", "margin", "num. error", "verdict"}
    return Table(columns=tuple(column for column in whole.columns if column.title in kept), rows=whole.rows)


def _numbers_text(one: Result) -> str:
    pairs = one.numbers
    more = f"; {len(pairs) - _MOST_SHOWN} more in statements.json" if len(pairs) > _MOST_SHOWN else ""
    text = "; ".join(_number(*pair) for pair in pairs[:_MOST_SHOWN]) + more
    if not one.as_paper:
        return text
    costs = {label: number.value for label, number in one.as_paper_numbers}
    shown = [f"{label} {costs[label]:.4g} ({costs[label] - number.value:+.2g})" for label, number in pairs[:_MOST_SHOWN]
             if label in costs]  # fmt: skip
    return f"{text} | as the paper computes: {'; '.join(shown)}"


def verdict_text(one: Result) -> str:
    """Return the verdict, with that of each reading where they differ."""
    text = IN_WORDS[one.verdict]
    if len({reading.verdict for reading in one.readings}) > 1:
        text += " (" + "; ".join(f"{reading.name}: {IN_WORDS[reading.verdict]}" for reading in one.readings) + ")"
    if one.as_paper_verdict is not None and one.as_paper_verdict != one.verdict:
        text += f"; as the paper computes: {IN_WORDS[one.as_paper_verdict]}"
    return text


def tally(found: Sequence[Result]) -> str:
    """Return how many statements have each verdict."""
    counts = Counter(one.verdict for one in found)
    return ", ".join(f"{IN_WORDS[name]} {counts[name]}" for name in IN_WORDS if counts[name])


def statements_page(found: Sequence[Result], materials: Sequence[str]) -> str:
    """Return the page of docs/ on the statements."""
    by_key = {(one.materials, one.statement.id): one for one in found}
    head = "| figure | id | sentence | where | check | " + " | ".join(materials) + " |\n"
    rule = "|---" * (5 + len(materials)) + "|\n"
    rows = []
    for one in STATEMENTS:
        cells = [verdict_cell(by_key[name, one.id]) for name in materials]
        rows.append(
            f"| {one.figure} | {one.id} | {one.sentence} | {one.geometry} | {one.check} | {' | '.join(cells)} |\n"
        )
    said = "".join(f"| {one.figure} | {one.sentence} | {one.here} |\n" for one in DESCRIPTIONS)
    return _HEAD + head + rule + "".join(rows) + _NOTES + _SAID + said


def verdict_cell(one: Result) -> str:
    """Return verdict and deciding numbers of a statement, as a cell of the page."""
    text = IN_WORDS[one.verdict]
    if len({reading.verdict for reading in one.readings}) > 1:
        text += ": " + "; ".join(f"{reading.name}: {IN_WORDS[reading.verdict]}" for reading in one.readings)
    test = one.readings[0].deciding
    numbers = ", ".join(f"{number.label} {number.value:.3g}" for number in (() if test is None else test.numbers[:2]))
    return f"**{text}**. {numbers}".rstrip(". ") if numbers else f"**{text}**"


def search_lines(found: Search | None) -> Iterable[str]:
    """Return what a search came to."""
    if found is None:
        return
    start = next(one for one in found.tried if not one.numbers)
    yield (
        f"search: {len(found.tried)} sets of materials tried, the first set itself among them, and {found.impossible} "
        f"draws that are no possible surface; most statements that hold {found.best.held} of "
        f"{len(found.best.verdicts)}, with the first set {start.held}"
    )
    for key, value in found.best.numbers.items():
        yield f"  {key} = {value:.4g}"


def verdict_lines(found: Iterable[Result]) -> tuple[str, ...]:
    """Return a line a statement, as it stands under a picture."""
    return tuple(f"{one.statement.id} {verdict_text(one)}: {one.statement.check}" for one in found)


def fig5_table(found: DolpAgainstSnr) -> Table[int]:
    """Return mean and deviation of DoLP against the SNR of S0: first order, exact, drawn."""
    columns: tuple[Column[int], ...] = (
        Column(title="SNR [dB]", text=lambda k: f"{20 * np.log10(found.snr[k]):.0f}"),
        Column(title="S0 [e-]", text=lambda k: f"{found.s0_e[k]:.4g}"),
        *(Column(title=title, text=partial(_five_digits, values=getattr(found, name))) for title, name in _FIG5),
    )
    return Table(columns=columns, rows=tuple(range(len(found.snr))))


def estimator_table(found: Mapping[str, EstimatorError], true_snr: Sequence[float]) -> Table[int]:
    """Return bias and rms error of estimators of the true DoLP, a row a true signal-to-noise ratio."""
    columns: tuple[Column[int], ...] = (
        Column(title="true SNR", text=lambda k: f"{true_snr[k]:g}"),
        *(Column(title=name, text=partial(_errors, found=error), unbroken=True) for name, error in found.items()),
    )
    return Table(title="bias/rms error", columns=columns, rows=tuple(range(len(true_snr))))


def _five_digits(k: int, values: Sequence[float]) -> str:
    return "-" if np.isnan(values[k]) else f"{values[k]:.5f}"


def _errors(k: int, found: EstimatorError) -> str:
    return f"{found.bias[k]:+.3f}/{found.rms[k]:.3f}"


_PANEL_PIXELS = 120
_MOST_FALSE_ALARMS = 0.03
_DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)))


def curves_png(figure: PaperFigure, beneath: Sequence[str], points: Sequence[DigitisedPoint] = ()) -> bytes:
    """Return a figure of curves; points of the paper's own figure, where somebody has them, lie over them."""
    columns = len(figure.panels)
    drawn, axes = subplots(1, columns, size=(max(6.4 * columns, 8.5), 4.8 + 0.16 * len(beneath)))
    for ax, panel in zip(axes, figure.panels, strict=True):
        _draw(ax, panel)
        if not panel.log_y:
            _overlay(ax, [one for one in points if one.panel in ("", panel.letter)])
        legend_below(ax)
    drawn.suptitle(f"[MK14] Fig. {figure.number}: {figure.title}", fontsize=11)
    say_beneath(drawn, beneath)
    return png(drawn)


def _draw(ax: Axes, panel: Panel) -> None:
    colours = len(COLOURS)
    for k, curve in enumerate(panel.curves):
        # Where colours come round again, lines are broken.
        line = "--" if k >= colours and curve.line == "-" else curve.line
        ax.plot(curve.x, curve.y, linestyle=line or "none", marker=curve.marker or None, label=curve.label)
    if panel.log_x:
        ax.set_xscale("log")
    if panel.log_y:
        ax.set_yscale("log")
        # Toward false alarms everywhere next to nothing is missed, by so many decades that they would hide the others.
        shown = np.concatenate([curve.y[curve.x <= _MOST_FALSE_ALARMS] for curve in panel.curves])
        ax.set_ylim(0.1 * float(np.min(shown)), 10.0 * float(np.max(shown)))
    elif panel.log_x:
        ax.set_ylim(0.0, 1.03)
    else:
        ax.set_ylim(0.0, 1.05 * max(float(np.nanmax(curve.y)) for curve in panel.curves))
    ax.set_title(panel.title, fontsize=9)
    ax.set_xlabel(panel.x_label)
    ax.set_ylabel(panel.y_label)


def _overlay(ax: Axes, points: Sequence[DigitisedPoint]) -> None:
    for name in dict.fromkeys(point.label for point in points):
        own = [point for point in points if point.label == name]
        ax.plot([point.x for point in own], [point.y for point in own], "kx", markersize=6, label=f"digitised: {name}")


def panels_png(predictions: Mapping[str, RegionPrediction], names: Mapping[str, str], beneath: Sequence[str]) -> bytes:
    """Return Fig. 6: S0 and DoLP of panels, each pixel drawn from the predicted law (seed 1)."""
    generator = np.random.default_rng(1)
    size = (_PANEL_PIXELS * _PANEL_PIXELS, 3)
    s0, degree = [], []
    for name in names:
        stokes = predictions[name].stokes_dn
        pixels = stokes.mean + generator.standard_normal(size) @ np.linalg.cholesky(stokes.cov).T
        s0.append(pixels[:, 0].reshape(_PANEL_PIXELS, -1))
        degree.append(np.hypot(pixels[:, 1], pixels[:, 2]).reshape(_PANEL_PIXELS, -1) / s0[-1])
    figure, axes = subplots(1, 2, size=(12.0, 4.0))
    for ax, parts, label, cmap in zip(axes, (s0, degree), ("S0 [DN]", "DoLP"), ("gray", "magma"), strict=True):
        shown = ax.imshow(np.hstack(parts), cmap=cmap, vmin=0.0)
        ax.set_title(f"{label}: {', '.join(names.values())} (left to right)", fontsize=9)
        ax.set_xlabel("x [pixel]")
        ax.set_ylabel("y [pixel]")
        figure.colorbar(shown, ax=ax, label=label, shrink=0.8)
    figure.suptitle("[MK14] Fig. 6: panels drawn from the predicted law; no picture of the authors", fontsize=11)
    say_beneath(figure, beneath)
    return png(figure)


def laws_figure_png(
    predictions: Mapping[str, RegionPrediction],
    names: Mapping[str, str],
    beneath: Sequence[str],
    points: Sequence[DigitisedPoint] = (),
) -> bytes:
    """Return Fig. 8 (b): laws of s1, s2 and DoLP of the panels' pixels, exact and, dashed, Gaussian to first order."""
    figure, axes = subplots(1, 3, size=(14.0, 4.6 + 0.16 * len(beneath)))
    quantities = ("s1n", "s2n", "dolp")
    for name, label in names.items():
        one = predictions[name]
        for ax, quantity, (x, density) in zip(axes, quantities, laws_of(one), strict=True):
            # Where both are the same the thin line lies on the broad one.
            (line,) = ax.plot(x, density, linewidth=4.0, alpha=0.35, label=f"{label}, exact")
            mean, std = one.quantities[quantity]["mean"], one.quantities[quantity]["std"]
            gauss = np.exp(-0.5 * ((x - mean) / std) ** 2) / (std * np.sqrt(2.0 * np.pi))
            ax.plot(x, gauss, "--", color=line.get_color(), linewidth=1.4, label=f"{label}, first order")
    for letter, ax, label in zip("abc", axes, ("s1 = S1/S0", "s2 = S2/S0", "DoLP"), strict=True):
        _overlay(ax, [one for one in points if one.panel in ("", letter)])
        ax.set_xlabel(f"{label} of a pixel")
        ax.set_ylabel("density")
        ax.locator_params(axis="x", nbins=6)
        ax.set_ylim(bottom=0.0)
        legend_below(ax)
    figure.suptitle("[MK14] Fig. 8 (b): sun 22, view 53, phi 180", fontsize=11)
    say_beneath(figure, beneath)
    return png(figure)


def fig5_plot(found: DolpAgainstSnr) -> bytes:
    """Return mean and deviation of DoLP against the SNR of S0: draws, first order, exact, as [MK14] Fig. 5."""
    figure, axes = subplots(1, 2, size=(11.0, 4.2))
    decibel = 20 * np.log10(found.snr)
    rows = (
        (axes[0], "mean of DoLP", found.drawn_mean, found.drawn_mean_error, found.first_mean, found.true_mean),
        (axes[1], "deviation of DoLP", found.drawn_std, found.drawn_std_error, found.first_std, found.true_std),
    )
    for ax, label, drawn, error, first, exact in rows:
        ax.errorbar(decibel, drawn, yerr=error, fmt="o", markersize=4, color=MEASURED, label="Poisson draws")
        ax.plot(decibel, first, color="0.45", linestyle="--", label="first order, [MK14]")
        ax.plot(decibel, exact, color=PREDICTED, label="exact law of Poisson counts")
        ax.axvline(20.0, color="0.8", linewidth=1.0)
        ax.set_xlabel("SNR of S0 [dB, amplitude]")
        ax.set_ylabel(label)
        ax.set_ylim(0.0, 1.15 * float(np.max(drawn)))
    legend_of_all(figure, axes[1])
    return png(figure)


def estimator_plot(true_snr: NDArray[np.float64], errors: Mapping[str, EstimatorError]) -> bytes:
    """Return bias and rms error of every estimator against the true signal-to-noise ratio."""
    figure, axes = subplots(1, 2, size=(11.0, 4.2))
    for (name, found), dash in zip(errors.items(), _DASHES, strict=True):
        axes[0].plot(true_snr, found.bias, linestyle=dash, label=name)
        axes[1].plot(true_snr, found.rms, linestyle=dash, label=name)
    for ax, label in zip(axes, ("bias", "rms error"), strict=True):
        ax.set_xlabel("true DoLP / deviation")
        ax.set_ylabel(f"{label} / deviation")
        ax.axhline(0.0 if label == "bias" else 1.0, color="0.8", linewidth=1.0)
    legend_of_all(figure, axes[1])
    return png(figure)


NOTHING_STATED = "The text says what is drawn, and nothing of it that could be held or not."
_MEANING = (
    "holds, opposite: margins above three numerical errors. Cannot be seen: every P_D compared above .999, or the "
    "authors' measured points are needed. Noise floor: exact DoLP SNRs below 2.1, that of unpolarised light is 1.913. "
    "Ambiguous: readings of the sentence differ, each is named. A statement that does not come out is a result: the "
    "optical properties of the paper are not at hand."
)


def paper_report(found: PaperResult, pictures: Mapping[str, bytes]) -> Report:
    """Return the report on the paper."""
    return Report(
        title="[MK14] figure by figure and sentence by sentence",
        source="Meng & Kerekes, An Analytical Model for Optical Polarimetric Imaging Systems, IEEE TGRS 2014",
        sections=[_summary(found), *_figures(found, pictures), *_search(found), *_assumed(found)],
    )


def _summary(found: PaperResult) -> Section:
    lines = tuple(f"{one.name}: {tally(one.results)}" for one in found.sets)
    return Section(title="What comes out", blocks=(Bullets(items=lines), Paragraph(text=_MEANING)))


def _figures(found: PaperResult, pictures: Mapping[str, bytes]) -> Iterable[Section]:
    for number in found.figures:
        shown = [Picture(png=png, caption=name) for name, png in pictures.items() if name.startswith(f"fig{number}-")]
        rows = [one for one in found.results if number in figures_of(one.statement)]
        judged = [statement_table(rows)] if rows else [Paragraph(text=NOTHING_STATED)]
        blocks = (*shown, *judged, description_table(number))
        yield Section(title=f"Fig. {number}", blocks=blocks)


def _search(found: PaperResult) -> Iterable[Section]:
    if found.search is None:
        return
    note = "Without a tolerance: to be confirmed with --materials."
    yield Section(title="Search", blocks=(Bullets(items=(*search_lines(found.search), note)),))


def _assumed(found: PaperResult) -> Iterable[Section]:
    yield Section(title="Assumed", blocks=(Bullets(items=found.remarks),))
    for one in found.sets:
        yield Section(title=f"Assumed in {one.name}", blocks=(Bullets(items=one.assumed),), folded=True)


_SAME_FOR_ALL = (2, 5)
_FIG2 = (
    "[MK14] Fig. 2: Stokes parameters and DoLP of the sky, with the sun and air of section V: Table I is not at hand"
)


def write_paper(found: PaperResult, out: Path) -> tuple[str, ...]:
    """Write paper.html, statements.csv, statements.json, curves.csv and fig*.png; return their names."""
    curves = {(one.name, number): _curves(one, number) for one in found.sets for number in found.figures}
    pictures = dict(_pictures(found, curves))
    contents = {
        "paper.html": html(paper_report(found, pictures)).encode(),
        "statements.json": (json.dumps(statement_json(found.results), indent=2, allow_nan=False) + "\n").encode(),
        "statements.csv": statement_csv(found.results),
        "curves.csv": _curves_csv(curves),
        **pictures,
    }
    return write_folder(out, contents)


def _curves(one: MaterialSet, number: int) -> PaperFigure | None:
    return curves_of(number, one.scenes, as_paper=one.as_paper)


def _pictures(found: PaperResult, curves: dict[tuple[str, int], PaperFigure | None]) -> Iterable[tuple[str, bytes]]:
    for number in found.figures:
        for k, one in enumerate(found.sets):
            if number in _SAME_FOR_ALL and k > 0:
                continue
            label = "model" if number in _SAME_FOR_ALL else one.name
            yield f"fig{number}-{label}.png", _picture(found, one, number, curves[one.name, number])


def _picture(found: PaperResult, one: MaterialSet, number: int, curves: PaperFigure | None) -> bytes:
    rows = [row for row in one.results if number in figures_of(row.statement)]
    of_what = "the same for all materials" if number in _SAME_FOR_ALL else f"materials: {one.name}"
    beneath = (of_what, *(verdict_lines(rows) or (NOTHING_STATED,)))
    points = [point for point in found.points if point.figure == number]
    if curves is not None:
        return curves_png(curves, beneath, points)
    if number == 2:
        return sky_picture(sky_map(one.scene), title=(_FIG2,), beneath=beneath)
    panels = one.scenes.rooftop.predictions
    return panels_png(panels, PANELS, beneath) if number == 6 else laws_figure_png(panels, PANELS, beneath, points)


def _curves_csv(curves: dict[tuple[str, int], PaperFigure | None]) -> bytes:
    """Return the points of all curves: a row a point."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("materials", "figure", "panel", "label", "x", "y"))
    for (name, number), figure in curves.items():
        if figure is None:
            continue
        for panel in figure.panels:
            for curve in panel.curves:
                writer.writerows(
                    (name, number, panel.letter, curve.label, x, y) for x, y in zip(curve.x, curve.y, strict=True)
                )
    return text.getvalue().encode()
