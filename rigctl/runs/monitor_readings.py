"""Readings of sensors beside the frames, as the events of a run hold them."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime

from pydantic import TypeAdapter, ValidationError

from rigctl.errors import RunFolderError
from rigctl.numbers.utc_time import is_utc_text
from rigctl.runs.run_description import explain_invalid
from rigctl.runs.run_events import EVENTS_FILE, RunEvent

MONITOR_EVENT = "monitor"
READINGS_EVENT = "monitor readings"


@dataclass(frozen=True, kw_only=True)
class MonitorFacts:
    """A sensor once it answers: its name in the rig file, its own name and unit, whether it follows the light."""

    monitor: str
    device: str
    unit: str
    follows_light: bool = False


@dataclass(frozen=True, kw_only=True)
class MonitorReadings:
    """Readings beside one exposure.

    Attributes
    ----------
    sequence : int
        Of the exposure's first frame.
    read_utc : str
        When they were asked for.
    readings : mapping
        By the name in the rig file; None where there is none.
    problems : mapping
        Why there is none, where that has changed since the last exposure.
    """

    sequence: int
    read_utc: str
    readings: dict[str, float | None]
    problems: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not is_utc_text(self.read_utc):
            raise ValueError(f"read_utc is {self.read_utc!r}, which is no time in UTC")


@dataclass(frozen=True, kw_only=True)
class MonitorTrace:
    """Readings of one sensor over a run.

    Attributes
    ----------
    facts : MonitorFacts
        Which; its unit is empty where it never answered.
    times_s, values : tuple of float
        Seconds since 1970 (UTC), and what was read.
    missing : int
        Exposures without a reading.
    problems : tuple of str
        Why, each once.
    """

    facts: MonitorFacts
    times_s: tuple[float, ...]
    values: tuple[float, ...]
    missing: int
    problems: tuple[str, ...]

    @property
    def change_per_hour(self) -> float | None:
        """Slope of a straight line through the readings; None of fewer than two times."""
        count = len(self.times_s)
        if count < 2 or self.times_s[-1] <= self.times_s[0]:
            return None
        mean_s, mean = sum(self.times_s) / count, sum(self.values) / count
        lever = sum((time - mean_s) ** 2 for time in self.times_s)
        slope = sum((t - mean_s) * (v - mean) for t, v in zip(self.times_s, self.values, strict=True)) / lever
        return slope * _S_PER_H

    def at(self, time_s: float) -> float | None:
        """Return the reading nearest to a time; None where there is none within five minutes."""
        nearest = min(range(len(self.times_s)), key=lambda k: abs(self.times_s[k] - time_s), default=None)
        if nearest is None or abs(self.times_s[nearest] - time_s) > _NEAR_S:
            return None
        return self.values[nearest]


_S_PER_H, _NEAR_S = 3600.0, 300.0
_FACTS, _READINGS = TypeAdapter(MonitorFacts), TypeAdapter(MonitorReadings)


def monitor_traces(events: Iterable[RunEvent]) -> tuple[MonitorTrace, ...]:
    """Return the readings of each sensor of a session, in the order of their rig file.

    Raises
    ------
    RunFolderError
        An event says that there are some, and not what.
    """
    facts: dict[str, MonitorFacts] = {}
    readings: list[MonitorReadings] = []
    try:
        for event in events:
            if event.event == MONITOR_EVENT:
                one = _FACTS.validate_python(event.facts)
                facts[one.monitor] = one
            elif event.event == READINGS_EVENT:
                readings.append(_READINGS.validate_python(event.facts))
    except ValidationError as error:
        raise RunFolderError(f"{EVENTS_FILE}: readings of a monitor: {explain_invalid(error)}") from error
    names = dict.fromkeys(name for reading in readings for name in reading.readings)
    return tuple(_trace(facts.get(name, MonitorFacts(monitor=name, device="", unit="")), readings) for name in names)


def _trace(facts: MonitorFacts, readings: Iterable[MonitorReadings]) -> MonitorTrace:
    mine = [reading for reading in readings if facts.monitor in reading.readings]
    found = [(datetime.fromisoformat(one.read_utc).timestamp(), one.readings[facts.monitor]) for one in mine]
    known = [(time_s, value) for time_s, value in found if value is not None]
    problems = dict.fromkeys(one.problems[facts.monitor] for one in mine if facts.monitor in one.problems)
    return MonitorTrace(
        facts=facts,
        times_s=tuple(time_s for time_s, _ in known),
        values=tuple(value for _, value in known),
        missing=len(found) - len(known),
        problems=tuple(problems),
    )


def monitor_line(trace: MonitorTrace) -> str:
    """Return the readings of a sensor in a line: range, mean, slope, and how many are missing."""
    facts, count = trace.facts, len(trace.values)
    missing = f"; {trace.missing} of {trace.missing + count} readings missing" if trace.missing else ""
    why = f" ({'; '.join(trace.problems)})" if trace.problems else ""
    if not count:
        return f"{facts.monitor}: never answered{missing}{why}"
    slope = trace.change_per_hour
    steep = "" if slope is None else f", {slope:+.3g} an hour"
    text = (
        f"{min(trace.values):.6g} to {max(trace.values):.6g} {facts.unit}, mean {sum(trace.values) / count:.6g}{steep}"
    )
    return f"{facts.monitor} ({facts.device}): {text}{missing}{why}"
