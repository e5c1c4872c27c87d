"""Trial of the noise calibration over simulated sets with known truth: intervals, wrong levels, false names."""

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from benchmarks.trials.harness import is_high_enough, is_low_enough, over
from calibration.estimate import Estimate
from calibration.results import Flag, RefusedFramesError
from calibration.sensor.noise import NoiseCalibration
from tests.calibration.sensor.drawn_sets import DRAWN_GOOD, DRAWN_OUTSIDE, DRAWN_WRONG
from tests.calibration.sensor.noise_sets import (
    GOOD,
    ONE_WRONG,
    OUTSIDE,
    SetMaker,
    calibrated,
    names_level,
    tells_of_level,
)

_INTERVAL = 1.959964
# Nothing that is given is further off than this.
_FURTHEST = 5.0
_NAMED, _FALSELY_NAMED = 0.99, 0.01


@dataclass(kw_only=True)
class Count:
    """What was found over the seeds of one kind of set."""

    refused: int = 0
    not_judged: int = 0
    named: int = 0
    falsely_named: int = 0
    scores: dict[str, list[float]] = field(default_factory=partial(defaultdict, list))
    causes: Counter[str] = field(default_factory=Counter)


def count(make: SetMaker, seeds: range) -> Count:
    found = Count()
    for seed in seeds:
        one = make(seed)
        try:
            noise = calibrated(one)
        except RefusedFramesError as error:
            found.refused += 1
            found.causes.update(flag.name for flag in error.flags if flag.refuses)
            continue
        named = [flag for flag in noise.flags if flag.level is not None]
        found.causes.update({flag.name for flag in named})
        wrong = [mean_dn for mean_dn in one.wrong_means_dn[: one.n_to_name] if _is_judged(noise, mean_dn)]
        found.not_judged += not wrong
        told = [*named, *(flag for flag in noise.flags if flag.name == "exposure_offset")]
        found.named += bool(wrong) and all(any(tells_of_level(flag, mean_dn) for flag in told) for mean_dn in wrong)
        found.causes.update(flag.name for flag in told[len(named) :])
        found.falsely_named += any(not _is_of(one.wrong_means_dn, flag) for flag in named)
        for name, truth in one.truth.items():
            estimate: Estimate | None = getattr(noise, name)
            if estimate is not None:
                found.scores[name].append((estimate.value - truth) / estimate.std_error)
    return found


def _is_judged(noise: NoiseCalibration, mean_dn: float) -> bool:
    """Whether a level is judged: all but flats above 95 % of saturation, which are in no number."""
    return all(
        flat.mean_dn != mean_dn or one.mean_off is not None or one.variance_off is not None
        for flat, one in zip(noise.flats, noise.influence, strict=True)
    )


def _is_of(means_dn: tuple[float, ...], flag: Flag) -> bool:
    return any(names_level(flag, mean_dn) for mean_dn in means_dn)


def misses(found: Count, seeds: int, *, has_wrong: bool) -> list[str]:
    """Return what is not as stated, for one kind of set."""
    left = seeds - found.refused - found.not_judged
    said = []
    if not is_low_enough(found.falsely_named, seeds, _FALSELY_NAMED):
        said.append(f"false names in {found.falsely_named}")
    if has_wrong and not is_high_enough(found.named, left, _NAMED):
        said.append(f"named in {found.named} of {left}")
    for name, listed in found.scores.items():
        scores = np.abs(listed)
        inside = int(np.sum(scores < _INTERVAL))
        if not is_high_enough(inside, len(scores), 0.95) or scores.max() >= _FURTHEST:
            said.append(
                f"{name}: {inside} of {len(scores)} inside, mean z {np.mean(listed):+.2f}, sd {np.std(listed):.2f}, "
                f"furthest {scores.max():.1f}"
            )
    return said


def run_noise_sets(*sets: str, seeds: int = 200, first_seed: int = 0) -> bool:
    """Calibrate sets of each kind, or of the named kinds, and print a table."""
    all_sound = True
    every = (*GOOD, *DRAWN_GOOD, *ONE_WRONG, *DRAWN_WRONG, *OUTSIDE, *DRAWN_OUTSIDE)
    makers = [make for make in every if not sets or make.__name__ in sets]
    print(f"{seeds} sets of each kind; inside: the least share of any number within its 95 % interval")
    print(f"{'set':20s}{'refused':>8s}{'named':>9s}{'false':>7s}{'given':>7s}{'inside':>8s}{'furthest':>10s}  causes")
    counts = over(partial(count, seeds=range(first_seed, first_seed + seeds)), makers)
    for make, found in zip(makers, counts, strict=True):
        all_sound &= _told(make, found, seeds)
    return all_sound


def _told(make: SetMaker, found: Count, seeds: int) -> bool:
    """Print the row of one kind of set, and what of it is not as stated."""
    has_wrong = make in (*ONE_WRONG, *DRAWN_WRONG)
    scores = [np.abs(listed) for listed in found.scores.values()]
    given = sum(len(listed) for listed in scores)
    inside = f"{min(float(np.mean(one < _INTERVAL)) for one in scores):.3f}" if given else "-"
    furthest = f"{max(float(one.max()) for one in scores):.1f}" if given else "-"
    named = f"{found.named}/{seeds - found.refused - found.not_judged}" if has_wrong else "-"
    causes = ", ".join(f"{name} {n}" for name, n in found.causes.most_common())
    print(
        f"{make.__name__:20s}{found.refused:8d}{named:>9s}{found.falsely_named:7d}{given:7d}{inside:>8s}{furthest:>10s}"
        f"  {causes}"
    )
    missed = misses(found, seeds, has_wrong=has_wrong)
    print("".join(f"    not as stated: {one}\n" for one in missed), end="", flush=True)
    return not missed
