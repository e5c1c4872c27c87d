"""Trial of a run's diagnosis over worldlike runs of other kinds: false findings, one fault, two faults, odd pictures.

Usage: python -m benchmarks.trials.diagnosis [--seeds 400] [--first-seed 0] [--processes 2] [--parts null two ...]

Faults are ten of their own errors, as a run of the same scene without a fault states them (two: of their joint errors);
scenes are the same with the fault and without, noise is not. A fault counts as named where it is named, or where the
line that names another says that the two are not to be told apart. "apart" are pairs that can be told from every other
set of causes (see `drawn_faults`): both have to be named, and no confusion said.
"""

import argparse
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

from benchmarks.trials.drawn_faults import SIGMAS, DrawnFaults, Which, drawn, family, told_from_all
from model.processing.diagnosis import Diagnosis, diagnose
from model.processing.fault_fit import FALSE_FINDING_RATE, JointFit, fit_faults, known_causes
from model.processing.reconstruction import design
from tests.worldlike import Faults, World, expose, other_world, random_world

Frames = NDArray[np.uint16]

_CHANCE, _TRIES = 1e-3, 20
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
    is_apart, is_free
        Whether it can be told from every other set of as many causes, and with every term of the model free.
    """

    seed: int
    kind: str
    truth: tuple[Which, ...]
    named: tuple[Which, ...]
    strict: bool
    found: bool
    reason: str = ""
    outright: bool = False
    is_apart: bool = False
    is_free: bool = False


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
    return _without_fault(seed, _world(np.random.default_rng([seed, 1]), seed))


def _without_fault(seed: int, world: World) -> Tried:
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


def flat_without_fault(seed: int) -> Tried:
    """Diagnose a run of 8 bits without a fault, of flat parts and hardly any noise: each part has its own rounding."""
    rng = np.random.default_rng([seed, 7])
    world = other_world(
        rng,
        scene=str(rng.choice(["steps", "half flat", "checker", "stripes"])),
        full_scale_dn=255,
        electrons=1e9,
        read_noise_dn=float(rng.choice([0.0, 0.03, 0.1])),
        is_evenly_polarized=True,
        is_demosaiced=False,
        resampled_deg=0.0,
    )
    return _without_fault(seed, world)


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


def _judged(seed: int, world: World, faults: DrawnFaults, found: Diagnosis) -> Tried:
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
        is_apart=faults.left_by_others >= SIGMAS**2,
        is_free=faults.stand_beside_all(),
    )


def odd_picture(seed: int) -> Tried:
    """Diagnose a run of which hardly anything, or something odd, is usable: it must end, and give whole numbers."""
    rng = np.random.default_rng([seed, 4])
    world = _world(rng, seed)
    frames = expose(world, Faults(clipped_share=float(rng.choice([0.0, 0.3]))), rng)
    pictures, usable, angles_rad = _inputs(world, frames)
    kept = rng.choice(["one pixel", "nothing", "a line", "at random", "a corner", "even", "dark"])
    mask = np.zeros_like(usable)
    if kept == "one pixel":
        mask[tuple(rng.integers(0, side) for side in mask.shape)] = True
    elif kept == "a line":
        mask[int(rng.integers(0, len(mask)))] = True
    elif kept == "at random":
        mask = rng.random(mask.shape) < rng.uniform(0.05, 0.95)
    elif kept == "a corner":
        mask[: int(rng.integers(1, 40)), : int(rng.integers(1, 40))] = True
    elif kept in ("even", "dark"):
        mask[:] = True
        pictures[:] = 0.0 if kept == "dark" else 77.0
    order, plan = range(len(pictures)), design(angles_rad)
    found = diagnose(plan, pictures, usable & mask, angles_rad=angles_rad, times=order, step=1.0)
    numbers = [number for term in found.terms for number in (term.value, term.std_error) if number is not None]
    whole = bool(np.all(np.isfinite(numbers))) and all(term.is_testable or term.reason for term in found.terms)
    return Tried(
        seed=seed, kind=str(kept), truth=(), named=_named(found), strict=whole, found=whole, reason=found.reason
    )


_PARTS: dict[str, Callable[[int], Tried | None]] = {
    "null": without_fault,
    "flat": flat_without_fault,
    "one": with_one,
    "two": with_two,
    "apart": with_two_apart,
    "odd": odd_picture,
}
_LEAST_SHARE = {
    "null": 1.0 - FALSE_FINDING_RATE,
    "flat": 1.0 - FALSE_FINDING_RATE,
    "one": _WANTED_FIRST,
    "two": _WANTED_BOTH,
    "apart": _WANTED_BOTH,
    "odd": 1.0,
}


def run_diagnoses(seeds: int, *, first_seed: int = 0, processes: int = 2, parts: Sequence[str] = tuple(_PARTS)) -> bool:
    """Run the trial; return whether all is as stated."""
    sound = True
    with ProcessPoolExecutor(max_workers=processes) as pool:
        for part in parts:
            numbers = range(first_seed, first_seed + seeds)
            tried = [one for one in pool.map(_PARTS[part], numbers, chunksize=5) if one is not None]
            sound &= _told(part, tried)
    return sound


def _told(part: str, tried: Sequence[Tried]) -> bool:
    passed = [one.outright if part == "apart" else one.found for one in tried]
    sound = bool(sum(passed) >= binom.ppf(_CHANCE, len(tried), _LEAST_SHARE[part]))
    print(
        f"{part}: {_counted(tried)}; {sum(bool(one.reason) for one in tried)} not testable"
        f"{'' if sound else '   <- NOT AS STATED'}"
    )
    if part in ("one", "two", "apart"):
        print(f"    told from every other set of as many: {_counted([one for one in tried if one.is_apart])}")
        print(f"    every term of the model free:         {_counted([one for one in tried if one.is_free])}")
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


def main() -> int:
    """Run the trial; return 1 where it fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=400)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--parts", nargs="*", default=list(_PARTS), choices=list(_PARTS))
    chosen = parser.parse_args()
    as_stated = run_diagnoses(
        chosen.seeds, first_seed=chosen.first_seed, processes=chosen.processes, parts=chosen.parts
    )
    return 0 if as_stated else 1


if __name__ == "__main__":
    raise SystemExit(main())
