"""Trial of a run's diagnosis over worldlike runs of other kinds: false findings, one fault, two faults.

Faults are ten of their own errors, as a run of the same scene without a fault states them (two: of their joint errors);
scenes are the same with the fault and without, noise is not. A fault counts as named where it is named, or where the
line that names another says that the two are not to be told apart. "apart" are pairs that can be told from every other
set of causes (see `_Information`): both have to be named, and no confusion said.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from benchmarks.trials.harness import is_high_enough, over
from model.processing.diagnosis import Diagnosis, diagnose
from model.processing.fault_fit import (
    FALSE_FINDING_RATE,
    PER_FRAME,
    Evidence,
    JointFit,
    estimates,
    fit_faults,
    known_causes,
)
from model.processing.reconstruction import design
from tests.worldlike import Faults, World, expose, other_world, random_world

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
Frames = NDArray[np.uint16]

_TRIES = 20
_WANTED_FIRST, _WANTED_BOTH = 0.95, 0.90


@dataclass(frozen=True, kw_only=True)
class Tried:
    """What was wrong with one run, and what was found.

    Attributes
    ----------
    seed, kind
        Of the run.
    truth, named
        What was wrong, and what was named.
    strict, outright, found
        Whether it was named itself, without any confusion with others, or named or in a stated confusion.
    reason
        Why nothing is testable.
    """

    seed: int
    kind: str
    truth: tuple[Which, ...]
    named: tuple[Which, ...]
    strict: bool
    found: bool
    reason: str = ""
    outright: bool = False


def _inputs(world: World, frames: Frames) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    usable = np.all((frames > 0) & (frames < world.full_scale_dn), axis=0)
    return frames.astype(np.float64), usable, np.radians(world.angles_deg)


def diagnosed(world: World, frames: Frames) -> Diagnosis:
    """Return the diagnosis of a run."""
    pictures, usable, angles_rad = _inputs(world, frames)
    times = range(len(frames))
    return diagnose(design(angles_rad), pictures, usable, angles_rad=angles_rad, times=times, step=1.0)


def _fitted(world: World, frames: Frames) -> JointFit | None:
    pictures, usable, angles_rad = _inputs(world, frames)
    light = float(pictures[:, usable].mean())
    causes = known_causes(angles_rad, range(len(frames)), light=light)
    return fit_faults(design(angles_rad).system, pictures, usable, causes, light=light, step=1.0)


def _world(rng: np.random.Generator, seed: int) -> World:
    """Return a world of the other kinds, every fourth of those that the thresholds were chosen on."""
    return other_world(rng) if seed % 4 else random_world(rng)


def _named(found: Diagnosis) -> tuple[Which, ...]:
    return tuple((term.name, term.frame) for term in found.terms if term.is_named)


def without_fault(seed: int) -> Tried:
    """Diagnose a run without a fault."""
    world = _world(np.random.default_rng([seed, 1]), seed)
    found = diagnosed(world, expose(world, Faults(), np.random.default_rng([seed, 2])))
    return Tried(
        seed=seed,
        kind=world.scene,
        truth=(),
        named=_named(found),
        strict=not _named(found),
        found=not _named(found),
        reason=found.reason,
    )


def with_one(seed: int) -> Tried | None:
    """Diagnose a run with one fault; None where no world of this seed allows one of this size."""
    return _with_faults(seed, 1)


def with_two(seed: int) -> Tried | None:
    """Diagnose a run with two faults that can be told apart when nothing else is thought of."""
    return _with_faults(seed, 2)


def with_two_apart(seed: int) -> Tried | None:
    """Diagnose a run with two faults that can be told from every other set of one or two."""
    return _with_faults(seed, 2, is_apart=True)


def _with_faults(seed: int, count: int, *, is_apart: bool = False) -> Tried | None:
    rng = np.random.default_rng([seed, 3, count, is_apart] if is_apart else [seed, 3, count])
    for _ in range(_TRIES):
        world, scene = _world(rng, seed), int(rng.integers(1 << 30))
        fit = _fitted(world, expose(world, Faults(), np.random.default_rng(scene)))
        faults = drawn(fit, rng, count) if fit is not None and not fit.named else None
        faults = told_from_all(faults) if faults is not None and is_apart else faults
        if faults is None:
            continue
        frames = expose(world, faults.of_world(), np.random.default_rng(scene), np.random.default_rng(scene + 1))
        return _judged(seed, world, faults, diagnosed(world, frames))
    return None


def _judged(seed: int, world: World, faults: "DrawnFaults", found: Diagnosis) -> Tried:
    truth, named = {family(one) for one in faults.names}, _named(found)
    said = {(term.name, term.frame): term.confused_with for term in found.terms if term.is_named}
    looked_at = named[:1] if len(truth) == 1 else named
    alike = {family(other) for one in looked_at for other in (one, *said[one])}
    themselves = {family(one) for one in looked_at}
    return Tried(
        seed=seed,
        kind=f"{world.scene}, {len(world.angles_deg)} angles",
        truth=faults.names,
        named=named,
        strict=themselves >= truth,
        outright=themselves >= truth and alike == themselves,
        found=alike >= truth,
    )


_PARTS: dict[str, Callable[[int], Tried | None]] = {
    "null": without_fault,
    "one": with_one,
    "two": with_two,
    "apart": with_two_apart,
}
_LEAST_SHARE = {
    "null": 1.0 - FALSE_FINDING_RATE,
    "one": _WANTED_FIRST,
    "two": _WANTED_BOTH,
    "apart": _WANTED_BOTH,
}


def run_diagnoses(*parts: str, seeds: int = 400, first_seed: int = 0) -> bool:
    """Diagnose runs of each part, or of the named ones."""
    sound = True
    for part in parts or _PARTS:
        numbers = range(first_seed, first_seed + seeds)
        sound &= _told(part, [tried for tried in over(_PARTS[part], numbers, chunk=5) if tried is not None])
    return sound


def _told(part: str, tried: Sequence[Tried]) -> bool:
    passed = [one.outright if part == "apart" else one.found for one in tried]
    sound = is_high_enough(sum(passed), len(tried), _LEAST_SHARE[part])
    print(
        f"{part}: {_counted(tried)}; {sum(bool(one.reason) for one in tried)} not testable"
        f"{'' if sound else '   <- NOT AS STATED'}"
    )
    for one, is_passed in zip(tried, passed, strict=True):
        if not is_passed:
            print(f"    seed {one.seed} ({one.kind}): {list(one.truth)} -> {list(one.named)}", flush=True)
    return sound


def _counted(tried: Sequence[Tried]) -> str:
    found, strict, outright = (
        sum(one.found for one in tried),
        sum(one.strict for one in tried),
        sum(one.outright for one in tried),
    )
    return f"{len(tried)} runs, named or in a confusion {found}, themselves {strict}, without confusion {outright}"


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
    """The Fisher information of a run about all parameters of single frames and the response.

    It answers twice whether faults can be told apart, in a run of the same scene and at the faults drawn:

    - of the two alone: fitted together they correlate below 0.9 and each is above ten of its errors;
    - beside every other explanation: any other set of one or two causes leaves as much of them as ten errors are.
    """

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
