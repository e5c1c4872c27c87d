"""Change of the light over a run, beside sensors that follow it: what is left of it once they are divided out."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rigctl.live.cycle_history import CycleHistory
from rigctl.numbers.number_text import percent
from rigctl.runs.monitor_readings import MonitorTrace


@dataclass(frozen=True, kw_only=True)
class FollowedLight:
    """Relative changes from the first cycle to the last, and the largest from the first to any.

    Attributes
    ----------
    monitor : str
        The sensor's name in the rig file.
    light, reading, left : float
        Change of the reference region's light, of the reading, and of the light divided by it.
    most_light, most_left : float
        Largest change of light, and of light divided by the reading, either way.
    """

    monitor: str
    light: float
    reading: float
    left: float
    most_light: float
    most_left: float


def followed_light(history: CycleHistory, trace: MonitorTrace) -> FollowedLight | None:
    """Return how the light changed beside a sensor; None with fewer than two cycles that have both."""
    found = []
    for look in history.looks:
        region, reading = look.regions.get(history.reference), trace.at(look.time_s)
        if region is not None and reading is not None and reading > 0.0 and region.light_dn_per_s > 0.0:
            found.append((region.light_dn_per_s, reading))
    if len(found) < 2:
        return None
    first_light, first_reading = found[0]
    light = [one / first_light - 1.0 for one, _ in found]
    left = [one / first_light * first_reading / reading - 1.0 for one, reading in found]
    return FollowedLight(
        monitor=trace.facts.monitor,
        light=light[-1],
        reading=found[-1][1] / first_reading - 1.0,
        left=left[-1],
        most_light=max(map(abs, light)),
        most_left=max(map(abs, left)),
    )


def light_lines(history: CycleHistory, monitors: Sequence[MonitorTrace]) -> Iterator[str]:
    """Give in words what sensors that follow the light explain of its change."""
    for trace in monitors:
        found = followed_light(history, trace) if trace.facts.follows_light else None
        if found is not None:
            yield (
                f"Light of {history.reference} changed by {percent(found.light, sign=True)} over the run and by "
                f"{percent(found.most_light)} at most, {found.monitor} by {percent(found.reading, sign=True)}; divided "
                f"by it {percent(found.left, sign=True)} is left, {percent(found.most_left)} at most"
            )
