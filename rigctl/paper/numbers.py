"""Numbers with their numerical errors, and what comparing them says."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi, sqrt
from typing import Literal

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
    """An inequality that a statement says: `margin` is above 0 where it is so.

    Attributes
    ----------
    numbers : tuple of Number
        That are compared.
    margin, error : float
        By how much, and the numerical error of that, in the unit of the numbers.
    """

    numbers: tuple[Number, ...]
    margin: float
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
class Reading:
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
