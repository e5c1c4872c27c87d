"""Faults drawn for the trial of the diagnosis: how large they are, and whether any program could tell them apart.

Three readings of "can be told apart", all in the Fisher information of a run of the same scene, at the faults drawn:

- of the two alone: fitted together they correlate below 0.9 and each is above ten of its errors;
- of every term at once: the same with all throughputs, angles, dark levels, shifts and responses free beside them,
  whatever all frames have in common being nothing by convention;
- beside every other explanation: any other set of one or two causes leaves as much of them as ten errors are.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from model.processing.fault_fit import PER_FRAME, Evidence, JointFit, estimates
from tests.worldlike import Faults

FloatArray = NDArray[np.float64]
Which = tuple[str, int | None]

SIGMAS = 10.0
# Largest faults that are tried, in the units of the diagnosis; dark levels as a share of the light.
_LARGEST = {
    "throughput": 0.05,
    "throughput of pairs": 0.05,
    "drift": 0.03,
    "angle": float(np.radians(3.0)),
    "shift": 2.0,
    "dark level": 0.1,
    "response power law": 0.2,
}
_ALIKE = 0.9
# Of the variance of a score: covariances of tiles are not known better.
_FLOOR = 0.01
_NOTHING_LEFT = 1e-9


def family(one: Which) -> Which:
    """Return a cause, a curved response and a power law being one."""
    return ("response", None) if one[0].startswith("response") else one


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnFaults:
    """Faults of a run, and the fit to a run of the same scene without any.

    Attributes
    ----------
    fit
        About no faults.
    chosen
        Numbers of the causes.
    sizes
        In their units.
    """

    fit: JointFit
    chosen: tuple[int, ...]
    sizes: tuple[FloatArray, ...]

    @property
    def names(self) -> tuple[Which, ...]:
        """Names and frames of the causes."""
        return tuple(_which(self.fit.evidence, index) for index in self.chosen)

    @property
    def left_by_others(self) -> float:
        """The least chi-square that another set of at most as many causes leaves of them."""
        return _Information(self.fit.evidence).left_by_others(self.chosen, self.sizes, self.fit.candidates)

    def stand_beside_all(self) -> bool:
        """Return whether each stands above ten errors with every parameter of the model free."""
        return _Information(self.fit.evidence).is_free_of_all(self.chosen, self.sizes)

    def are_possible(self) -> bool:
        """Return whether rigs have faults of such sizes."""
        causes, light = self.fit.evidence.causes, self.fit.light
        return all(
            np.linalg.norm(size) <= _LARGEST[causes[index].name] * (light if causes[index].unit == "DN" else 1.0)
            for index, size in zip(self.chosen, self.sizes, strict=True)
        )

    def of_world(self) -> Faults:
        """Return them as a world takes them."""
        causes = self.fit.evidence.causes
        parts = _sum(self.fit.evidence, self.chosen, self.sizes)[:-2].reshape(len(PER_FRAME), -1)
        tones = zip(self.chosen, self.sizes, strict=True)
        return Faults(
            throughput=dict(enumerate(parts[0].tolist())),
            angle_deg=dict(enumerate(np.degrees(parts[1]).tolist())),
            dark_dn=dict(enumerate(parts[2].tolist())),
            shift_pixels=dict(enumerate(map(tuple, parts[3:5].T.tolist()))),
            tone=1.0 + sum(float(size[0]) for index, size in tones if causes[index].name == "response power law"),
        )


def drawn(fit: JointFit, rng: np.random.Generator, count: int) -> DrawnFaults | None:
    """Return one or two causes and their sizes, ten errors of each; None where they would be too large or too alike."""
    causes = fit.evidence.causes
    chosen: list[int] = []
    while len(chosen) < count:
        kind = str(rng.choice(list(_LARGEST)))
        of_kind = [index for index in fit.candidates.tolist() if causes[index].name == kind and index not in chosen]
        if of_kind:
            chosen.append(int(rng.choice(of_kind)))
    fitted = estimates(fit.evidence, chosen)
    if not fitted.is_determined or (count == 2 and _Information(fit.evidence).correlation(*chosen) > _ALIKE):
        return None
    sizes = []
    for part in fitted.parts:
        spread = fitted.covariance[part, part]
        along = rng.normal(size=len(spread))
        sizes.append(SIGMAS * along / np.sqrt(along @ np.linalg.solve(spread, along)))
    found = DrawnFaults(fit=fit, chosen=tuple(chosen), sizes=tuple(sizes))
    return found if found.are_possible() else None


def told_from_all(faults: DrawnFaults) -> DrawnFaults | None:
    """Return faults, larger where need be, of which every other set of as many causes leaves ten errors; or None."""
    left = faults.left_by_others
    if not left > _NOTHING_LEFT:
        return None
    larger = replace(faults, sizes=tuple(size * max(1.0, 1.001 * SIGMAS / np.sqrt(left)) for size in faults.sizes))
    return larger if larger.are_possible() else None


def _which(evidence: Evidence, index: int) -> Which:
    return evidence.causes[index].name, evidence.causes[index].frame


def _sum(evidence: Evidence, chosen: Sequence[int], sizes: Sequence[FloatArray]) -> FloatArray:
    parts = [evidence.causes[index].directions @ size for index, size in zip(chosen, sizes, strict=True)]
    return np.asarray(np.sum(parts, axis=0))


class _Information:
    """The Fisher information of a run about all parameters of single frames and the response."""

    def __init__(self, evidence: Evidence) -> None:
        self._evidence = evidence
        size = np.sqrt(np.diag(evidence.covariance))
        held = size > 0.0
        scaled = evidence.covariance[np.ix_(held, held)] / np.outer(size[held], size[held])
        values, vectors = np.linalg.eigh(scaled + _FLOOR * np.eye(len(scaled)))
        self._seen = (vectors / np.sqrt(values)).T @ (evidence.information[held] / size[held, None])

    def correlation(self, one: int, other: int) -> float:
        """Return the largest correlation of what two causes do (their estimates correlate by its opposite)."""
        mine, its = (np.linalg.qr(self._of(index))[0] for index in (one, other))
        return float(np.linalg.norm(mine.T @ its, 2))

    def left_by_others(self, chosen: Sequence[int], sizes: Sequence[FloatArray], candidates: NDArray[np.intp]) -> float:
        """Return the least chi-square that another set of at most as many causes leaves of some faults."""
        truth = {family(_which(self._evidence, index)) for index in chosen}
        done = self._seen @ _sum(self._evidence, chosen, sizes)
        return min(
            _left(done, np.column_stack([self._of(index) for index in others]))
            for others in self._sets(candidates.tolist(), len(chosen))
            if not {family(_which(self._evidence, index)) for index in others} >= truth
        )

    def is_free_of_all(self, chosen: Sequence[int], sizes: Sequence[FloatArray]) -> bool:
        frames = (self._seen.shape[1] - 2) // len(PER_FRAME)
        common = np.zeros((self._seen.shape[1], len(PER_FRAME)))
        for kind in range(len(PER_FRAME)):
            common[kind * frames : (kind + 1) * frames, kind] = 1.0 / np.sqrt(frames)
        relative = np.eye(len(common)) - common @ common.T
        for index, size in zip(chosen, sizes, strict=True):
            mine = relative @ self._evidence.causes[index].directions @ size
            free = np.linalg.svd(relative - np.outer(mine, mine) / (mine @ mine))[0][:, : -len(PER_FRAME) - 1]
            if not _left(self._seen @ mine, self._seen @ free) >= SIGMAS**2:
                return False
        return True

    def _of(self, index: int) -> FloatArray:
        return np.asarray(self._seen @ self._evidence.causes[index].directions)

    @staticmethod
    def _sets(candidates: Sequence[int], most: int) -> Iterator[tuple[int, ...]]:
        for count in range(1, most + 1):
            yield from combinations(candidates, count)


def _left(done: FloatArray, others: FloatArray) -> float:
    """Return the square of what is left of a vector after others."""
    size = np.sqrt(np.sum(others**2, axis=0))
    vectors, values, _ = np.linalg.svd(others[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    along = vectors[:, values > np.sqrt(_NOTHING_LEFT) * values[0]].T @ done
    return float(max(done @ done - along @ along, 0.0))
