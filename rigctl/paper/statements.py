"""Sentences of [MK14] about its figures, each with its check.

The words stand in `rigctl/data/paper.toml`. A sentence that allows several readings is checked in all of them. One
about the authors' measured points has no check, for these are not at hand.
"""

import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from itertools import pairwise
from math import pi, sqrt
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
    TOLERANCE,
    VIEWS_DEG,
    WHITE,
    Airborne,
    Geometry,
    Number,
    PaperScenes,
    Rooftop,
    Source,
)
from rigctl.scene.scene import get, parameters

Verdict = Literal["holds", "opposite", "cannot_be_seen", "noise_floor", "ambiguous"]
IN_WORDS: dict[Verdict, str] = {
    "holds": "holds",
    "opposite": "opposite",
    "cannot_be_seen": "cannot be seen",
    "noise_floor": "noise floor",
    "ambiguous": "ambiguous",
}
# Ratio of exact mean and deviation of DoLP of light without any, sqrt(pi / (4 - pi)); below the other one it is noise.
UNPOLARIZED_SNR, NOISE_FLOOR = sqrt(pi / (4.0 - pi)), 2.1
# Above this everything is detected, and which of two is more cannot be seen.
ALL_DETECTED = 0.999
# How many numerical errors a margin has to have.
_FAR = 3.0
# Of words for which the paper has no number.
_MUCH, _SIGNIFICANT = 1.5, 1.5
_AZIMUTHS_DEG = (0.0, 90.0, 180.0)
_PEAK_DEG = (40.0, 60.0)
_PATH_TURNED, _AS_STATED = "azimuth of the path radiance turned by 180 deg", "as stated"


# What comparing numbers says.


@dataclass(frozen=True, kw_only=True)
class Test:
    """An inequality that a statement says: it holds where `margin`, in the unit of the numbers, is above 0."""

    numbers: tuple[Number, ...]
    margin: float
    error: float  #: numerical error of the margin

    @property
    def verdict(self) -> Verdict:
        """The verdict on this inequality alone."""
        if self.numbers and all(one.kind == "p_detection" and one.value > ALL_DETECTED for one in self.numbers):
            return "cannot_be_seen"
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


def _differ(one: Number, other: Number) -> Test:
    """Return the test of two numbers that are not the same: it holds, or their distance is within the error."""
    return Test(numbers=(one, other), margin=abs(one.value - other.value), error=one.error + other.error)


def falls(numbers: Sequence[Number]) -> tuple[Test, ...]:
    """Return the tests of numbers that fall from each to the next."""
    return tuple(above(first, second) for first, second in pairwise(numbers))


def some_step_rises(numbers: Sequence[Number]) -> Test:
    """Return the test of numbers that do not fall all along: the largest step upward."""
    largest = max((above(second, first) for first, second in pairwise(numbers)), key=lambda step: step.margin)
    return _with_all(largest, numbers)


def peak_within(numbers: Sequence[Number], places: Sequence[float], low: float, high: float) -> Test:
    """Return the test of a largest number whose place lies between two limits."""
    inside = [one for one, place in zip(numbers, places, strict=True) if low <= place <= high]
    outside = [one for one, place in zip(numbers, places, strict=True) if not low <= place <= high]
    best, rival = (max(part, key=lambda one: one.value) for part in (inside, outside))
    return _with_all(above(best, rival), numbers)


def _with_all(decided: Test, numbers: Sequence[Number]) -> Test:
    """Return a test with all numbers, those that decide at the head."""
    return replace(decided, numbers=(*decided.numbers, *(one for one in numbers if one not in decided.numbers)))


# The checks, by the id of the statement.

_Readings = tuple[Reading, ...]
_CHECKS: dict[str, Callable[[PaperScenes], _Readings]] = {}


def _checks(
    statement: str,
) -> Callable[[Callable[[PaperScenes], _Readings]], Callable[[PaperScenes], _Readings]]:
    def noted(check: Callable[[PaperScenes], _Readings]) -> Callable[[PaperScenes], _Readings]:
        _CHECKS[statement] = check
        return check

    return noted


def _one(*tests: Test) -> _Readings:
    return (Reading(name=_AS_STATED, tests=tests),)


def _azimuths(tests: Callable[[bool], Iterable[Test]]) -> _Readings:
    """Return the readings with the azimuth of the path radiance as stated, and turned by 180 deg."""
    return tuple(
        Reading(name=name, tests=tuple(tests(turned))) for turned, name in ((False, _AS_STATED), (True, _PATH_TURNED))
    )


def _decibels(tests: Callable[[float], Iterable[Test]]) -> _Readings:
    """Return the readings of decibels, which the paper does not define: of an amplitude, and of a power."""
    return tuple(
        Reading(name=f"20 dB is an SNR of {ratio}", tests=tuple(tests(scale)))
        for scale, ratio in ((1.0, 10), (2.0, 100))
    )


def _clearest(
    total: Sequence[Number], reflected: Sequence[Number], pairs: Iterable[tuple[int, int]]
) -> tuple[Test, ...]:
    """Return the tests of the pair in which the total of one most clearly is higher and its reflected ratio lower."""
    tests = [(above(total[i], total[j]), above(reflected[j], reflected[i])) for i, j in pairs]
    return max(tests, key=lambda pair: min(test.margin for test in pair))


def _first_order_off(scenes: PaperScenes, decibel: float, moment: Literal["mean", "std"], scale: float) -> Number:
    return replace(
        scenes.low_light.relative_error(scale * decibel, moment), label=f"first-order {moment} at {decibel:g} dB off by"
    )


def _fig5(scenes: PaperScenes, pairs: Sequence[tuple[float, float]]) -> _Readings:
    moments: tuple[Literal["mean", "std"], ...] = ("mean", "std")
    return _decibels(
        lambda scale: (
            above(*(_first_order_off(scenes, decibel, moment, scale) for decibel in pair))
            for moment in moments
            for pair in pairs
        )
    )


@_checks("5a")
def _diverges(scenes: PaperScenes) -> _Readings:
    return _fig5(scenes, ((0.0, 10.0), (10.0, 20.0)))


@_checks("5b")
def _agrees_above_20(scenes: PaperScenes) -> _Readings:
    return _fig5(scenes, [(decibel, 20.0) for decibel in (0.0, 4.0, 8.0, 12.0, 16.0)])


@_checks("V-a")
def _all_above_20(scenes: PaperScenes) -> _Readings:
    least = min((*scenes.airborne.s0_snrs(), *scenes.rooftop.s0_snrs()), key=lambda one: one.value)

    def decibels(scale: float) -> Number:
        return Number(
            label=f"least {least.label} [dB]",
            value=20.0 / scale * float(np.log10(least.value)),
            error=20.0 / scale / float(np.log(10.0)) * least.error / least.value,
        )

    return _decibels(lambda scale: (above(decibels(scale), Number(label="20 dB", value=20.0)),))


@_checks("8a")
def _black_is_higher(scenes: PaperScenes) -> _Readings:
    number = scenes.rooftop.number
    return _one(
        above(number(TARGET, "dolp_pixels", "mean"), number(WHITE, "dolp_pixels", "mean")),
        above(number(WHITE, "s0", "mean"), number(TARGET, "s0", "mean")),
    )


@_checks("8b")
def _white_is_narrower(scenes: PaperScenes) -> _Readings:
    number = scenes.rooftop.number
    black, white = scenes.rooftop.s0_snrs()
    quantities = ("s1n", "s2n", "dolp_pixels")
    return _one(
        *(above(number(TARGET, one, "std"), number(WHITE, one, "std")) for one in quantities), above(white, black)
    )


def _fig9(
    scenes: PaperScenes, view: float, phi: float, source: Source, label: str = "", *, turned: bool = False
) -> Number:
    name = f"{source} {label or f'view {view:g} phi {phi:g}'}"
    return scenes.airborne.snr(scenes.at(25.0, view, phi), source=source, label=name, turned=turned)


def _reflected9(scenes: PaperScenes, view: float) -> list[Number]:
    return [_fig9(scenes, view, phi, "reflected") for phi in _AZIMUTHS_DEG]


@_checks("9a")
def _total_differs(scenes: PaperScenes) -> _Readings:
    def tests(turned: bool) -> Iterator[Test]:
        for view in (10.0, 50.0):
            for phi in _AZIMUTHS_DEG:
                total = _fig9(scenes, view, phi, "total", turned=turned)
                test = _differ(total, _fig9(scenes, view, phi, "reflected"))
                if test.verdict != "noise_floor":
                    yield test

    return _azimuths(tests)


@_checks("9b")
def _path_above_reflected(scenes: PaperScenes) -> _Readings:
    return _azimuths(
        lambda turned: (
            above(
                _fig9(scenes, 10.0, phi, "path", f"phi {phi:g}", turned=turned),
                _fig9(scenes, 10.0, phi, "reflected", f"phi {phi:g}"),
            )
            for phi in _AZIMUTHS_DEG[:2]
        )
    )


@_checks("9c")
def _total_much_higher_at_0(scenes: PaperScenes) -> _Readings:
    def total(phi: float, turned: bool) -> Number:
        return _fig9(scenes, 10.0, phi, "total", f"phi {phi:g}", turned=turned)

    reflected = _fig9(scenes, 10.0, 0.0, "reflected", "phi 0")
    found = []
    for turned, azimuth in ((False, _AS_STATED), (True, _PATH_TURNED)):
        at_0 = total(0.0, turned)
        others = tuple(above(at_0, total(phi, turned), factor=_MUCH) for phi in _AZIMUTHS_DEG[1:])
        times = f"{_MUCH:g} times that of the"
        alone = (above(at_0, reflected, factor=_MUCH),)
        found.append(Reading(name=f"{times} reflected radiance there; {azimuth}", tests=alone))
        found.append(Reading(name=f"{times} total at 90 and 180 deg; {azimuth}", tests=others))
    return tuple(found)


@_checks("9d")
def _path_dominates(scenes: PaperScenes) -> _Readings:
    def tests(turned: bool) -> Iterator[Test]:
        path = scenes.airborne.polarized(scenes.at(25.0, 10.0, 180.0 if turned else 0.0), "path")
        yield above(path, scenes.airborne.polarized(scenes.at(25.0, 10.0, 0.0), "reflected"))

    return _azimuths(tests)


@_checks("9e")
def _total_misleads(scenes: PaperScenes) -> _Readings:
    def tests(turned: bool) -> tuple[Test, ...]:
        points = [(view, phi) for view in (10.0, 50.0) for phi in _AZIMUTHS_DEG]
        total = [_fig9(scenes, view, phi, "total", turned=turned) for view, phi in points]
        reflected = [_fig9(scenes, view, phi, "reflected") for view, phi in points]
        pairs = ((i, j) for i in range(len(points)) for j in range(len(points)) if i != j)
        return _clearest(total, reflected, pairs)

    return _azimuths(tests)


@_checks("9f")
def _reflected_rises(scenes: PaperScenes) -> _Readings:
    return _one(*(test for view in (10.0, 50.0) for test in falls(_reflected9(scenes, view)[::-1])))


@_checks("9g")
def _oblique_is_higher(scenes: PaperScenes) -> _Readings:
    steep, oblique = (_reflected9(scenes, view) for view in (10.0, 50.0))
    return _one(*map(above, oblique, steep))


@_checks("9h")
def _forward_is_strongest(scenes: PaperScenes) -> _Readings:
    tests: list[Test] = []
    for view in (10.0, 50.0):
        *others, forward = _reflected9(scenes, view)
        tests += [above(forward, other) for other in others]
    return _one(*tests)


@_checks("9i")
def _forward_is_purest(scenes: PaperScenes) -> _Readings:
    def share(view: float, phi: float, turned: bool) -> Number:
        seen = scenes.at(25.0, view, 180.0 - phi if turned else phi)
        path = scenes.airborne.polarized(seen, "path")
        reflected = scenes.airborne.polarized(scenes.at(25.0, view, phi), "reflected")
        value = path.value / reflected.value
        error = value * float(np.hypot(path.error / path.value, reflected.error / reflected.value))
        return Number(label=f"polarized path over reflected view {view:g} phi {phi:g}", value=value, error=error)

    def tests(turned: bool) -> Iterator[Test]:
        for view in (10.0, 50.0):
            *others, forward = (share(view, phi, turned) for phi in _AZIMUTHS_DEG)
            yield from (above(other, forward) for other in others)

    return _azimuths(tests)


def _fig10(scenes: PaperScenes, source: Source, *, turned: bool = False) -> list[Number]:
    snr = scenes.airborne.snr
    return [snr(at, source=source, turned=turned, label=f"{source} {_km(at)}") for at in _heights()]


def _heights() -> list[Geometry]:
    return [Geometry(sun=50.0, view=50.0, height_m=height) for height in HEIGHTS_M]


def _km(at: Geometry) -> str:
    return f"{at.height_m / 1000:g} km"


@_checks("10a")
def _reflected_falls(scenes: PaperScenes) -> _Readings:
    return _one(*falls(_fig10(scenes, "reflected")))


@_checks("10b")
def _total_does_not_fall(scenes: PaperScenes) -> _Readings:
    return _azimuths(lambda turned: (some_step_rises(_fig10(scenes, "total", turned=turned)),))


@_checks("10c")
def _path_grows(scenes: PaperScenes) -> _Readings:
    found = [scenes.airborne.radiance(at, "path", label=f"path {_km(at)}") for at in _heights()]
    much = (above(found[-1], found[0], factor=_SIGNIFICANT),)
    return (
        Reading(name="rises", tests=falls(found[::-1])),
        Reading(name=f"at 9 km {_SIGNIFICANT:g} times that at 3 km", tests=much),
    )


@_checks("10d")
def _height_misleads(scenes: PaperScenes) -> _Readings:
    def tests(turned: bool) -> tuple[Test, ...]:
        total, reflected = _fig10(scenes, "total", turned=turned), _fig10(scenes, "reflected")
        pairs = ((high, low) for low in range(len(total)) for high in range(low + 1, len(total)))
        return _clearest(total, reflected, pairs)

    return _azimuths(tests)


def _fig11(scenes: PaperScenes) -> list[Number]:
    return [scenes.airborne.p_detection(at, label=_km(at)) for at in _heights()]


@_checks("11a")
def _detection_falls(scenes: PaperScenes) -> _Readings:
    return _one(*falls(_fig11(scenes)))


@_checks("11c")
def _both_fall(scenes: PaperScenes) -> _Readings:
    return _one(*falls(_fig11(scenes)), *falls(_fig10(scenes, "reflected")))


@_checks("11b")
def _much_higher_low(scenes: PaperScenes) -> _Readings:
    low, *_, high = _fig10(scenes, "reflected")
    return (
        Reading(name=f"at 3 km {_MUCH:g} times that at 9 km", tests=(above(low, high, factor=_MUCH),)),
        Reading(name="at 3 km above that at 9 km", tests=(above(low, high),)),
    )


def _fig12(scenes: PaperScenes, view: float, kn: float = 1.0) -> list[Number]:
    label = f"view {view:g}" + ("" if kn == 1.0 else f" Kn {kn:g}")
    return [scenes.airborne.snr(scenes.at(sun, view, kn=kn), label=f"sun {sun:g} {label}") for sun in SUNS_DEG]


def _oblique_above_steep(scenes: PaperScenes) -> tuple[Test, ...]:
    return tuple(map(above, _fig12(scenes, 40.0), _fig12(scenes, 20.0)))


def _dolp(scenes: PaperScenes, region: str, sun: float, view: float) -> Number:
    value = scenes.airborne.quantity(scenes.at(sun, view), region, "dolp")
    # The error to which the light is computed, in parts of S0.
    return Number(label=f"DoLP {region} sun {sun:g} view {view:g}", value=value, error=TOLERANCE)


@_checks("12a")
def _oblique_has_more(scenes: PaperScenes) -> _Readings:
    return _one(*_oblique_above_steep(scenes))


@_checks("12b")
def _peaks(scenes: PaperScenes) -> _Readings:
    def peak(numbers: Sequence[Number]) -> Test:
        return peak_within(numbers, SUNS_DEG, *_PEAK_DEG)

    degrees = tuple(peak([_dolp(scenes, TARGET, sun, view) for sun in SUNS_DEG]) for view in VIEWS_DEG)
    return (
        *(Reading(name=f"DoLP SNR at view {view:g}", tests=(peak(_fig12(scenes, view)),)) for view in (40.0, 20.0)),
        Reading(name="DoLP itself at both views", tests=degrees),
    )


def _fig13(scenes: PaperScenes, sun: float, view: float) -> Number:
    return scenes.airborne.p_detection(scenes.at(sun, view), label=f"sun {sun:g} view {view:g}")


def _fig13_snr(scenes: PaperScenes, sun: float) -> Test:
    """Return the test of the ratio at a view of 40 above that at 20."""
    at = {view: scenes.airborne.snr(scenes.at(sun, view), label=f"sun {sun:g} view {view:g}") for view in VIEWS_DEG}
    return above(at[40.0], at[20.0])


def _steep_detects_more(scenes: PaperScenes) -> Test:
    return above(_fig13(scenes, 50.0, 20.0), _fig13(scenes, 50.0, 40.0))


@_checks("13a")
def _sun_50_is_better(scenes: PaperScenes) -> _Readings:
    return _one(*(above(_fig13(scenes, 50.0, view), _fig13(scenes, 10.0, view)) for view in VIEWS_DEG))


@_checks("13b")
def _view_40_at_10(scenes: PaperScenes) -> _Readings:
    return _one(above(_fig13(scenes, 10.0, 40.0), _fig13(scenes, 10.0, 20.0)), _fig13_snr(scenes, 10.0))


@_checks("13c")
def _view_20_at_50(scenes: PaperScenes) -> _Readings:
    return _one(_steep_detects_more(scenes))


@_checks("13d")
def _not_as_snr(scenes: PaperScenes) -> _Readings:
    return _one(*_oblique_above_steep(scenes), _steep_detects_more(scenes))


@_checks("13f")
def _background_counts(scenes: PaperScenes) -> _Readings:
    return _one(_fig13_snr(scenes, 50.0), _steep_detects_more(scenes))


@_checks("13e")
def _background_is_polarized(scenes: PaperScenes) -> _Readings:
    nothing = Number(label="none", value=0.0)
    unpolarized = scenes.airborne.p_detection_on_unpolarized
    places = [(sun, view) for sun in (10.0, 50.0) for view in VIEWS_DEG]
    return _one(
        *(above(_dolp(scenes, BACKGROUND, sun, view), nothing) for sun, view in places),
        *(
            _differ(_fig13(scenes, sun, view), unpolarized(scenes.at(sun, view), label=f"sun {sun:g} view {view:g}"))
            for sun, view in places
        ),
    )


@_checks("14a")
def _snr_falls(scenes: PaperScenes) -> _Readings:
    by_noise = [_fig12(scenes, 40.0, kn) for kn in NOISE_FACTORS]
    return _one(*(test for numbers in zip(*by_noise, strict=True) for test in falls(numbers)))


@_checks("14b")
def _snr_peaks(scenes: PaperScenes) -> _Readings:
    by_noise = [_fig12(scenes, 40.0, kn) for kn in NOISE_FACTORS]
    both = tuple(
        above(found[SUNS_DEG.index(high)], found[SUNS_DEG.index(low)])
        for found in by_noise
        for high in _PEAK_DEG
        for low in (10.0, 20.0, 30.0, 70.0, 80.0)
    )
    peaks = tuple(peak_within(found, SUNS_DEG, *_PEAK_DEG) for found in by_noise)
    return (
        Reading(name="largest at a sun of 40 to 60", tests=peaks),
        Reading(name="at 40 and at 60 above 10 to 30, 70 and 80", tests=both),
    )


def _fig15(scenes: PaperScenes, tests: Callable[[Sequence[Number]], tuple[Test, ...]]) -> _Readings:
    detected = scenes.airborne.p_detection
    return tuple(
        Reading(
            name=f"view {view:g}",
            tests=tests(
                [detected(scenes.at(50.0, view, kn=kn), label=f"view {view:g} Kn {kn:g}") for kn in ROC_NOISE_FACTORS]
            ),
        )
        for view in VIEWS_DEG
    )


@_checks("15a")
def _noise_lowers_detection(scenes: PaperScenes) -> _Readings:
    return _fig15(scenes, falls)


@_checks("15b")
def _noise_lowers_it_much(scenes: PaperScenes) -> _Readings:
    return _fig15(scenes, lambda found: (above(found[0], found[-1], factor=_SIGNIFICANT),))


# Statements, and what comes out of them.


@dataclass(frozen=True, kw_only=True)
class Statement:
    """A sentence of the paper that can hold or not."""

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

    def readings(self, scenes: PaperScenes) -> _Readings:
        """Return the readings of the sentence with their numbers; without the authors' points one without any."""
        check = _CHECKS.get(self.id)
        return (Reading(name="without their data", tests=()),) if check is None else check(scenes)


@dataclass(frozen=True, kw_only=True)
class Description:
    """A sentence that says what a figure shows or how it was made, and what the figure of this program has of it."""

    figure: int
    sentence: str
    here: str


@cache
def _file() -> dict[str, Any]:
    return tomllib.loads((files("rigctl") / "data" / "paper.toml").read_text(encoding="utf-8"))


@cache
def statements() -> tuple[Statement, ...]:
    """Return every sentence of sections II-C to VI that can hold or not."""
    return tuple(Statement(**one) for one in _file()["statements"])


@cache
def descriptions() -> tuple[Description, ...]:
    """Return the other sentences about the figures."""
    return tuple(Description(**one) for one in _file()["descriptions"])


@dataclass(frozen=True, kw_only=True)
class Judged:
    """A statement and what comes out with one set of materials."""

    statement: Statement
    materials: str
    readings: _Readings
    as_paper: _Readings = ()  #: the same, computed as the authors did; empty where that was not asked for

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
        """Label and number of every reading; the name of a later reading stands behind the label."""
        return tuple(_labelled(self.readings))

    @property
    def as_paper_numbers(self) -> tuple[tuple[str, Number], ...]:
        """The same as the authors computed them."""
        return tuple(_labelled(self.as_paper))


def _joint(readings: Sequence[Reading]) -> Verdict:
    verdicts = {reading.verdict for reading in readings}
    return verdicts.pop() if len(verdicts) == 1 else "ambiguous"


def _labelled(readings: Sequence[Reading]) -> Iterator[tuple[str, Number]]:
    seen: set[tuple[str, float]] = set()
    for k, reading in enumerate(readings):
        for number in reading.numbers:
            if (number.label, number.value) not in seen:
                seen.add((number.label, number.value))
                yield (number.label if k == 0 else f"{number.label} ({reading.name})"), number


def judged(
    scenes: PaperScenes, materials: str, figures: Iterable[int] = (), *, as_paper: PaperScenes | None = None
) -> tuple[Judged, ...]:
    """Return what comes out of the statements about some figures (all unless named) with one set of materials."""
    wanted = set(figures)
    chosen = [one for one in statements() if not wanted or wanted & set(one.figures)]
    found = {
        one.id: Judged(
            statement=one,
            materials=materials,
            readings=one.readings(scenes),
            as_paper=() if as_paper is None else one.readings(as_paper),
        )
        # A statement about all geometries comes last, when they are there.
        for one in sorted(chosen, key=lambda one: " to " in one.figure)
    }
    return tuple(found[one.id] for one in chosen)


# Materials within their stated uncertainties with which most statements hold.

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


def search(
    scene: SceneFile, start: PaperScenes, *, sets: int, seed: int, tell: Callable[[int], None] = lambda _: None
) -> Search:
    """Return what comes out of random sets of materials, normal about those of a scene with their uncertainties.

    The scene's own materials (`start`, whose skies are used again) are the first set. Without a tolerance: a verdict of
    a search is to be confirmed with `--materials`.
    """
    generator = np.random.default_rng(seed)
    found, impossible = [_tried(start, {})], 0
    for count in range(1, sets + 1):
        for numbers in _draws(start.airborne, generator):
            try:
                airborne = Airborne(
                    scene, light=start.airborne.light, snr=start.airborne.snr_form, changed=numbers, tolerance=None
                )
                found.append(_tried(replace(start, airborne=airborne, rooftop=Rooftop(airborne)), numbers))
                break
            except (ConfigError, ValueError):
                impossible += 1
        tell(count)
    return Search(tried=tuple(sorted(found, key=lambda one: -one.held)), impossible=impossible)


def _tried(scenes: PaperScenes, numbers: Mapping[str, float]) -> Tried:
    return Tried(numbers=dict(numbers), verdicts={one.statement.id: one.verdict for one in judged(scenes, "")})


def _draws(airborne: Airborne, generator: np.random.Generator) -> Iterator[dict[str, float]]:
    scene = airborne.predictor.scene
    # Whatever the materials, or the scene of these two regions, state an uncertainty of.
    own = [
        one for parameter in parameters(scene) if (one := get(scene, parameter.key)).key.startswith(_OWN) and one.std
    ]
    for _ in range(_MOST_REDRAWN):
        drawn = {one.key: float(generator.normal(one.value, one.std)) for one in own}
        yield {one.key: min(max(drawn[one.key], one.least), one.most) for one in own}
