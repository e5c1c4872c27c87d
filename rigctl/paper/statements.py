"""Sentences of [MK14] about its figures, each with its check.

The words are in `rigctl/data/paper.toml`; `_CHECKS` has the inequalities of each sentence by its id. A sentence that
can be understood in several ways has several readings. A sentence about the authors' measured points has no check,
because the points are not available.
"""

import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from itertools import chain, pairwise, permutations
from math import hypot, log, log10, pi, sqrt
from typing import Any, Literal

import numpy as np

from rigctl.errors import ConfigError
from rigctl.files.scene_file import SceneFile
from rigctl.paper.scenes import (
    BACKGROUND,
    HEIGHTS_M,
    NOISE_FACTORS,
    ROC_NOISE_FACTORS,
    SUNS_DEG,
    TARGET,
    VIEWS_DEG,
    WHITE,
    Moment,
    Number,
    PaperScenes,
    Source,
    first_order_error,
)
from rigctl.scene.scene import get, parameters

Verdict = Literal["holds", "opposite", "saturated", "unpublished", "noise_floor", "ambiguous"]
IN_WORDS: dict[Verdict, str] = {
    "holds": "holds",
    "opposite": "opposite",
    "saturated": "saturated at 1",
    "unpublished": "needs unpublished data",
    "noise_floor": "noise floor",
    "ambiguous": "ambiguous",
}
# Exact mean over deviation of the DoLP of unpolarized light, and the SNR below which only noise is compared.
UNPOLARIZED_SNR, NOISE_FLOOR = sqrt(pi / (4.0 - pi)), 2.1
# Above this every target is detected, and differences vanish.
ALL_DETECTED = 0.999
# Least margin, in numerical errors.
_FAR = 3.0
# Factor for "much" and "significantly", for which the paper has no number.
_MUCH = 1.5
_AZIMUTHS_DEG = (0.0, 90.0, 180.0)
_PEAK_DEG = (40.0, 60.0)
_PATH_TURNED, _AS_STATED = "azimuth of the path radiance turned by 180 deg", "as stated"


# Comparisons of numbers.


@dataclass(frozen=True, kw_only=True)
class Test:
    """An inequality: it holds where `margin`, in the unit of the numbers, is above 0."""

    numbers: tuple[Number, ...]
    margin: float
    error: float  #: numerical error of the margin

    @property
    def verdict(self) -> Verdict:
        """The verdict on this inequality alone."""
        if self.numbers and all(one.kind == "p_detection" and one.value > ALL_DETECTED for one in self.numbers):
            return "saturated"
        if self.numbers and all(one.kind == "exact_snr" and one.value < NOISE_FLOOR for one in self.numbers):
            return "noise_floor"
        if abs(self.margin) <= _FAR * self.error:
            return "ambiguous"
        return "holds" if self.margin > 0.0 else "opposite"


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One way to understand a statement, and the inequalities that all have to hold."""

    name: str
    tests: tuple[Test, ...]

    @property
    def verdict(self) -> Verdict:
        """The most serious verdict of the tests; without tests, unpublished data are needed."""
        verdicts = [test.verdict for test in self.tests]
        order: tuple[Verdict, ...] = ("opposite", "noise_floor", "saturated", "ambiguous")
        return next((one for one in order if one in verdicts), "holds" if verdicts else "unpublished")

    @property
    def deciding(self) -> Test | None:
        """The test that decides: the least margin among those with the reading's verdict."""
        tests = [test for test in self.tests if test.verdict == self.verdict]
        return min(tests, key=lambda test: test.margin, default=None)


def above(more: Number, less: Number, *, factor: float = 1.0) -> Test:
    """Test that a number is above so many times another."""
    return Test(numbers=(more, less), margin=more.value - factor * less.value, error=more.error + factor * less.error)


def differ(first: Number, second: Number) -> Test:
    """Test that two numbers differ: it holds, or their distance is within the error."""
    return Test(numbers=(first, second), margin=abs(first.value - second.value), error=first.error + second.error)


def falls(numbers: Sequence[Number]) -> tuple[Test, ...]:
    """Test that numbers fall from each to the next."""
    return tuple(above(first, second) for first, second in pairwise(numbers))


def some_step_rises(numbers: Sequence[Number]) -> Test:
    """Test that numbers do not fall all along: the largest step upward decides."""
    largest = max((above(second, first) for first, second in pairwise(numbers)), key=lambda step: step.margin)
    return _with_all(largest, numbers)


def peak_within(numbers: Sequence[Number], places: Sequence[float], low: float, high: float) -> Test:
    """Test that the place of the largest number lies between two limits."""
    inside = [number for number, place in zip(numbers, places, strict=True) if low <= place <= high]
    outside = [number for number, place in zip(numbers, places, strict=True) if not low <= place <= high]
    best, rival = (max(part, key=lambda number: number.value) for part in (inside, outside))
    return _with_all(above(best, rival), numbers)


def _with_all(decided: Test, numbers: Sequence[Number]) -> Test:
    """Return a test with all numbers, those that decide first."""
    return replace(decided, numbers=(*decided.numbers, *(one for one in numbers if one not in decided.numbers)))


def _clearest(
    total: Sequence[Number], reflected: Sequence[Number], pairs: Iterable[tuple[int, int]]
) -> tuple[Test, ...]:
    """Test that in some pair the total of the first is higher and its reflected ratio lower: the clearest pair."""
    tests = [(above(total[i], total[j]), above(reflected[j], reflected[i])) for i, j in pairs]
    return max(tests, key=lambda pair: min(test.margin for test in pair))


# Series of numbers that several sentences compare.


def _fig9(p: PaperScenes, view: float, source: Source, *, turned: bool = False, where: str = "") -> list[Number]:
    """Return the DoLP SNR by azimuth."""
    return [
        p.snr(p.at(25.0, view, phi), source=source, turned=turned, label=f"{source} {where}phi {phi:g}")
        for phi in _AZIMUTHS_DEG
    ]


def _fig9_views(p: PaperScenes, source: Source, *, turned: bool = False) -> list[list[Number]]:
    """Return the DoLP SNR by azimuth at a view of 10 deg and at one of 50 deg."""
    return [_fig9(p, view, source, turned=turned, where=f"view {view:g} ") for view in (10.0, 50.0)]


def _path_share(p: PaperScenes, view: float, turned: bool) -> list[Number]:
    """Polarized light of the path over that of the target, by azimuth."""
    numbers = []
    for phi in _AZIMUTHS_DEG:
        path = p.polarized(p.at(25.0, view, 180.0 - phi if turned else phi), "path")
        reflected = p.polarized(p.at(25.0, view, phi), "reflected")
        value = path.value / reflected.value
        error = value * hypot(path.error / path.value, reflected.error / reflected.value)
        label = f"polarized path over reflected view {view:g} phi {phi:g}"
        numbers.append(Number(label=label, value=value, error=error))
    return numbers


def _by_height(number: Callable[..., Number], p: PaperScenes, label: str = "", **options: Any) -> list[Number]:
    """Return a number at the heights of Figs 10 and 11."""
    return [
        number(p.at(50.0, 50.0, height_m=height), label=f"{label}{height / 1000:g} km", **options)
        for height in HEIGHTS_M
    ]


def _fig10(p: PaperScenes, source: Source, *, turned: bool = False) -> list[Number]:
    return _by_height(p.snr, p, f"{source} ", source=source, turned=turned)


def _snr_at(p: PaperScenes, sun: float, view: float, kn: float = 1.0) -> Number:
    label = f"sun {sun:g} view {view:g}" + ("" if kn == 1.0 else f" Kn {kn:g}")
    return p.snr(p.at(sun, view, kn=kn), label=label)


def _fig12(p: PaperScenes, view: float, kn: float = 1.0) -> list[Number]:
    """DoLP SNR by the zenith angle of the sun."""
    return [_snr_at(p, sun, view, kn) for sun in SUNS_DEG]


def _fig13(p: PaperScenes, sun: float, view: float) -> Number:
    return p.p_detection(p.at(sun, view), label=f"sun {sun:g} view {view:g}")


def _fig15(p: PaperScenes, view: float) -> list[Number]:
    return [p.p_detection(p.at(50.0, view, kn=kn), label=f"view {view:g} Kn {kn:g}") for kn in ROC_NOISE_FACTORS]


# The checks, by the id of the statement.

Readings = tuple[Reading, ...]
_Check = Callable[[PaperScenes], Readings]


def _stated(tests: Callable[[PaperScenes], Iterable[Test]]) -> _Check:
    """Return the check with a single reading."""
    return lambda p: (Reading(name=_AS_STATED, tests=tuple(tests(p))),)


def _named(readings: Callable[[PaperScenes], Mapping[str, Iterable[Test]]]) -> _Check:
    """Return the check with readings by their names."""
    return lambda p: tuple(Reading(name=name, tests=tuple(tests)) for name, tests in readings(p).items())


def _azimuths(tests: Callable[[PaperScenes, bool], Iterable[Test]]) -> _Check:
    """Return the check with the azimuth of the path radiance as stated, and turned by 180 deg."""
    return _named(lambda p: {_AS_STATED: tests(p, False), _PATH_TURNED: tests(p, True)})


def _decibels(tests: Callable[[PaperScenes, float], Iterable[Test]]) -> _Check:
    """Return the check with decibels, which the paper does not define, of an amplitude (1) and of a power (2)."""
    return _named(lambda p: {"20 dB is an SNR of 10": tests(p, 1.0), "20 dB is an SNR of 100": tests(p, 2.0)})


def _first_order_is_worse(*pairs: tuple[float, float]) -> _Check:
    """Return the check that first-order moments are off by more at the first SNR of each pair [dB]."""
    moments: tuple[Moment, ...] = ("mean", "std")
    return _decibels(
        lambda _, scale: (
            above(first_order_error(moment, worse, scale=scale), first_order_error(moment, better, scale=scale))
            for moment in moments
            for worse, better in pairs
        )
    )


def _least_snr(p: PaperScenes, scale: float) -> Iterator[Test]:
    least = min(p.s0_snrs(), key=lambda number: number.value)
    value, error = 20.0 / scale * log10(least.value), 20.0 / scale / log(10.0) * least.error / least.value
    yield above(Number(label=f"least {least.label} [dB]", value=value, error=error), Number(label="20 dB", value=20.0))


def _total_differs(p: PaperScenes, turned: bool) -> Iterable[Test]:
    total, reflected = chain(*_fig9_views(p, "total", turned=turned)), chain(*_fig9_views(p, "reflected"))
    return (test for test in map(differ, total, reflected) if test.verdict != "noise_floor")


def _total_much_higher_at_0(p: PaperScenes) -> dict[str, Iterable[Test]]:
    reflected, readings = _fig9(p, 10.0, "reflected")[0], dict[str, Iterable[Test]]()
    for turned, azimuth in ((False, _AS_STATED), (True, _PATH_TURNED)):
        at_0, *others = _fig9(p, 10.0, "total", turned=turned)
        times = f"{_MUCH:g} times that of the"
        readings[f"{times} reflected radiance there; {azimuth}"] = (above(at_0, reflected, factor=_MUCH),)
        readings[f"{times} total at 90 and 180 deg; {azimuth}"] = [above(at_0, one, factor=_MUCH) for one in others]
    return readings


def _total_misleads(p: PaperScenes, turned: bool) -> Iterable[Test]:
    total, reflected = [*chain(*_fig9_views(p, "total", turned=turned))], [*chain(*_fig9_views(p, "reflected"))]
    return _clearest(total, reflected, permutations(range(len(total)), 2))


def _height_misleads(p: PaperScenes, turned: bool) -> Iterable[Test]:
    pairs = ((high, low) for low in range(len(HEIGHTS_M)) for high in range(low + 1, len(HEIGHTS_M)))
    return _clearest(_fig10(p, "total", turned=turned), _fig10(p, "reflected"), pairs)


def _path_rises(p: PaperScenes) -> dict[str, Iterable[Test]]:
    path = _by_height(p.radiance, p, "path ", source="path")
    much = (above(path[-1], path[0], factor=_MUCH),)
    return {"rises": falls(path[::-1]), f"at 9 km {_MUCH:g} times that at 3 km": much}


def _much_higher_low(p: PaperScenes) -> dict[str, Iterable[Test]]:
    low, *_, high = _fig10(p, "reflected")
    name = f"at 3 km {_MUCH:g} times that at 9 km"
    return {name: (above(low, high, factor=_MUCH),), "at 3 km above that at 9 km": (above(low, high),)}


def _oblique_above_steep(p: PaperScenes) -> Iterable[Test]:
    return map(above, _fig12(p, 40.0), _fig12(p, 20.0))


def _peaks(p: PaperScenes) -> dict[str, Iterable[Test]]:
    degrees = [[p.dolp(p.at(sun, view), TARGET) for sun in SUNS_DEG] for view in VIEWS_DEG]
    return {
        **{f"DoLP SNR at view {view:g}": [peak_within(_fig12(p, view), SUNS_DEG, *_PEAK_DEG)] for view in (40.0, 20.0)},
        "DoLP itself at both views": [peak_within(numbers, SUNS_DEG, *_PEAK_DEG) for numbers in degrees],
    }


def _background_is_polarized(p: PaperScenes) -> Iterator[Test]:
    places = [(sun, view) for sun in (10.0, 50.0) for view in VIEWS_DEG]
    for place in places:
        yield above(p.dolp(p.at(*place), BACKGROUND), Number(label="none", value=0.0))
    for sun, view in places:
        plain = p.p_detection_on_unpolarized(p.at(sun, view), label=f"sun {sun:g} view {view:g}")
        yield differ(_fig13(p, sun, view), plain)


def _peaks_with_noise(p: PaperScenes) -> dict[str, Iterable[Test]]:
    by_noise = [_fig12(p, 40.0, kn) for kn in NOISE_FACTORS]
    return {
        "largest at a sun of 40 to 60": [peak_within(numbers, SUNS_DEG, *_PEAK_DEG) for numbers in by_noise],
        "at 40 and at 60 above 10 to 30, 70 and 80": [
            above(numbers[SUNS_DEG.index(high)], numbers[SUNS_DEG.index(low)])
            for numbers in by_noise
            for high in _PEAK_DEG
            for low in (10.0, 20.0, 30.0, 70.0, 80.0)
        ],
    }


_CHECKS: dict[str, _Check] = {
    "5a": _first_order_is_worse((0.0, 10.0), (10.0, 20.0)),
    "5b": _first_order_is_worse(*((decibel, 20.0) for decibel in (0.0, 4.0, 8.0, 12.0, 16.0))),
    "8a": _stated(
        lambda p: (
            above(p.panel(TARGET, "dolp_pixels", "mean"), p.panel(WHITE, "dolp_pixels", "mean")),
            above(p.panel(WHITE, "s0", "mean"), p.panel(TARGET, "s0", "mean")),
        )
    ),
    "8b": _stated(
        lambda p: (
            *(above(p.panel(TARGET, of, "std"), p.panel(WHITE, of, "std")) for of in ("s1n", "s2n", "dolp_pixels")),
            above(p.panel_s0_snr(WHITE), p.panel_s0_snr(TARGET)),
        )
    ),
    "9a": _azimuths(_total_differs),
    "9b": _azimuths(
        lambda p, turned: map(above, _fig9(p, 10.0, "path", turned=turned)[:2], _fig9(p, 10.0, "reflected")[:2])
    ),
    "9c": _named(_total_much_higher_at_0),
    "9d": _azimuths(
        lambda p, turned: (
            above(
                p.polarized(p.at(25.0, 10.0, 180.0 if turned else 0.0), "path"),
                p.polarized(p.at(25.0, 10.0, 0.0), "reflected"),
            ),
        )
    ),
    "9e": _azimuths(_total_misleads),
    "9f": _stated(lambda p: [test for numbers in _fig9_views(p, "reflected") for test in falls(numbers[::-1])]),
    "9g": _stated(lambda p: map(above, *_fig9_views(p, "reflected")[::-1])),
    "9h": _stated(
        lambda p: [above(numbers[-1], other) for numbers in _fig9_views(p, "reflected") for other in numbers[:-1]]
    ),
    "9i": _azimuths(
        lambda p, turned: [
            above(other, shares[-1])
            for shares in (_path_share(p, view, turned) for view in (10.0, 50.0))
            for other in shares[:-1]
        ]
    ),
    "10a": _stated(lambda p: falls(_fig10(p, "reflected"))),
    "10b": _azimuths(lambda p, turned: (some_step_rises(_fig10(p, "total", turned=turned)),)),
    "10c": _named(_path_rises),
    "10d": _azimuths(_height_misleads),
    "11a": _stated(lambda p: falls(_by_height(p.p_detection, p))),
    "11b": _named(_much_higher_low),
    "11c": _stated(lambda p: (*falls(_by_height(p.p_detection, p)), *falls(_fig10(p, "reflected")))),
    "12a": _stated(_oblique_above_steep),
    "12b": _named(_peaks),
    "13a": _stated(lambda p: [above(_fig13(p, 50.0, view), _fig13(p, 10.0, view)) for view in VIEWS_DEG]),
    "13b": _stated(
        lambda p: (
            above(_fig13(p, 10.0, 40.0), _fig13(p, 10.0, 20.0)),
            above(_snr_at(p, 10.0, 40.0), _snr_at(p, 10.0, 20.0)),
        )
    ),
    "13c": _stated(lambda p: (above(_fig13(p, 50.0, 20.0), _fig13(p, 50.0, 40.0)),)),
    "13d": _stated(lambda p: (*_oblique_above_steep(p), above(_fig13(p, 50.0, 20.0), _fig13(p, 50.0, 40.0)))),
    "13e": _stated(_background_is_polarized),
    "13f": _stated(
        lambda p: (
            above(_snr_at(p, 50.0, 40.0), _snr_at(p, 50.0, 20.0)),
            above(_fig13(p, 50.0, 20.0), _fig13(p, 50.0, 40.0)),
        )
    ),
    "14a": _stated(
        lambda p: [
            test
            for by_noise in zip(*(_fig12(p, 40.0, kn) for kn in NOISE_FACTORS), strict=True)
            for test in falls(by_noise)
        ]
    ),
    "14b": _named(_peaks_with_noise),
    "15a": _named(lambda p: {f"view {view:g}": falls(_fig15(p, view)) for view in VIEWS_DEG}),
    "15b": _named(
        lambda p: {
            f"view {view:g}": (above(numbers[0], numbers[-1], factor=_MUCH),)
            for view, numbers in ((view, _fig15(p, view)) for view in VIEWS_DEG)
        }
    ),
    "V-a": _decibels(_least_snr),
}


# Statements and their verdicts.


@dataclass(frozen=True, kw_only=True)
class Statement:
    """A sentence of the paper that makes a testable claim."""

    id: str
    figure: str
    sentence: str
    geometry: str  #: where it is checked
    check: str  #: what is compared

    @property
    def figures(self) -> tuple[int, ...]:
        """Numbers of the figures that it is about."""
        if " to " in self.figure:
            first, last = self.figure.split(" to ")
            return tuple(range(int(first), int(last) + 1))
        return tuple(int(part.strip().rstrip("ab")) for part in self.figure.split(","))

    def readings(self, scenes: PaperScenes) -> Readings:
        """Return the readings of the sentence; one without tests if it is about the authors' measured points."""
        check = _CHECKS.get(self.id)
        return (Reading(name="without their data", tests=()),) if check is None else check(scenes)


@cache
def _file() -> dict[str, Any]:
    return tomllib.loads((files("rigctl") / "data" / "paper.toml").read_text(encoding="utf-8"))


@cache
def statements() -> tuple[Statement, ...]:
    """Return every sentence of sections II-C to VI that makes a testable claim."""
    return tuple(Statement(**one) for one in _file()["statements"])


def descriptions() -> tuple[tuple[int, str, str], ...]:
    """Return the descriptive sentences: figure, sentence, and how our figure follows it."""
    return tuple((one["figure"], one["sentence"], one["here"]) for one in _file()["descriptions"])


@dataclass(frozen=True, kw_only=True)
class Judged:
    """A statement with its readings for one set of materials."""

    statement: Statement
    materials: str
    readings: Readings
    as_paper: Readings = ()  #: the same, computed as the authors did; empty unless requested

    @property
    def id(self) -> str:
        """Set of materials and id of the statement."""
        return f"{self.materials}/{self.statement.id}"

    @property
    def verdict(self) -> Verdict:
        """The joint verdict: opposite if a reading is and no other can hold; ambiguous if readings differ otherwise."""
        return _joint(self.readings)

    @property
    def as_paper_verdict(self) -> Verdict | None:
        """The verdict on the numbers as the authors computed them."""
        return _joint(self.as_paper) if self.as_paper else None

    @property
    def margin(self) -> float | None:
        """Margin of the test that decides the first reading."""
        test = self.readings[0].deciding
        return None if test is None else test.margin

    @property
    def numerical_error(self) -> float | None:
        """Numerical error of that margin."""
        test = self.readings[0].deciding
        return None if test is None else test.error


def _joint(readings: Sequence[Reading]) -> Verdict:
    verdicts = {reading.verdict for reading in readings}
    if "opposite" in verdicts and not verdicts & {"holds", "ambiguous"}:
        return "opposite"
    return verdicts.pop() if len(verdicts) == 1 else "ambiguous"


def labelled(readings: Sequence[Reading]) -> tuple[tuple[str, Number], ...]:
    """Return label and number of every reading, each once; the name of a later reading follows the label."""
    numbers = dict[tuple[str, float], tuple[str, Number]]()
    for k, reading in enumerate(readings):
        for number in (number for test in reading.tests for number in test.numbers):
            label = number.label if k == 0 else f"{number.label} ({reading.name})"
            numbers.setdefault((number.label, number.value), (label, number))
    return tuple(numbers.values())


def judged(
    scenes: PaperScenes, materials: str, figures: Iterable[int] = (), *, as_paper: PaperScenes | None = None
) -> tuple[Judged, ...]:
    """Return the verdicts on the statements about some figures (all unless given) with one set of materials."""
    wanted = set(figures)
    chosen = [one for one in statements() if not wanted or wanted & set(one.figures)]
    results = {
        one.id: Judged(
            statement=one,
            materials=materials,
            readings=one.readings(scenes),
            as_paper=() if as_paper is None else one.readings(as_paper),
        )
        # Statements about several figures last: they reuse what the others computed.
        for one in sorted(chosen, key=lambda one: " to " in one.figure)
    }
    return tuple(results[one.id] for one in chosen)


# Search for the materials, within their stated uncertainties, with which most statements hold.

# Limit on redraws for an impossible surface (a lobe that alone reflects more than its dhr).
_MOST_REDRAWN = 50


@dataclass(frozen=True, kw_only=True)
class Search:
    """Sets of materials that were tried."""

    tried: tuple[tuple[int, Mapping[str, float]], ...]  #: statements that hold and the numbers by key, best first
    impossible: int  #: draws that no surface allowed


def search(
    scene: SceneFile, start: PaperScenes, *, sets: int, seed: int, tell: Callable[[int], None] = lambda _: None
) -> Search:
    """Judge the statements with random sets of materials, normal about those of a scene with their uncertainties.

    The first set is the scene's own (`start`, whose skies are reused). Nothing is computed to a tolerance: confirm a
    verdict with `--materials`.
    """
    generator = np.random.default_rng(seed)
    own = start.predictor.scene
    uncertain = [
        number
        for parameter in parameters(own)
        if (number := get(own, parameter.key)).std
        and number.key.startswith((f"regions.{TARGET}.", f"regions.{BACKGROUND}."))
    ]
    tried: list[tuple[int, Mapping[str, float]]] = [(_held(start), {})]
    impossible = 0
    for count in range(1, sets + 1):
        for _ in range(_MOST_REDRAWN):
            drawn = {
                number.key: min(max(float(generator.normal(number.value, number.std)), number.least), number.most)
                for number in uncertain
            }
            try:
                scenes = PaperScenes(
                    scene,
                    light=start.light,
                    snr=start.snr_form,
                    height_m=start.height_m,
                    changed=drawn,
                    tolerance=None,
                )
                tried.append((_held(scenes), drawn))
                break
            except (ConfigError, ValueError):
                impossible += 1
        tell(count)
    return Search(tried=tuple(sorted(tried, key=lambda one: -one[0])), impossible=impossible)


def _held(scenes: PaperScenes) -> int:
    return sum(one.verdict == "holds" for one in judged(scenes, ""))
