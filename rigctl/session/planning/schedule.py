"""Times at which the rounds of a session begin."""

from collections.abc import Iterator

from rigctl.errors import ConfigError
from rigctl.files.place import SiteSection
from rigctl.files.session_file import ScheduleSection, SessionFile
from rigctl.numbers.utc_time import NS_PER_S, unix_ns
from rigctl.session.planning.sun_track import SunTrack

_NS_PER_MIN = 60 * NS_PER_S
_NS_PER_H = 3600 * NS_PER_S
_MOST_ROUNDS = 100_000


def round_times_ns(
    session: SessionFile, site: SiteSection | None, *, now_ns: int, until_ns: int | None = None
) -> tuple[int | None, ...]:
    """Return when each round is due, in ascending order [ns since 1970 UTC]; one None where there is no schedule.

    Parameters
    ----------
    session : SessionFile
        With the schedule.
    site : SiteSection or None
        Where the sun is looked at.
    now_ns : int
        Where a schedule without a start begins.
    until_ns : int or None
        Rounds from then on are left out.

    Raises
    ------
    ConfigError
        No round is left, there are more than 100 000, or the schedule asks for the sun and there is no site.
    """
    schedule = session.schedule
    if schedule is None:
        return (None,)
    if schedule.needs_sun and site is None:
        raise ConfigError("the schedule asks for the sun: the rig file needs [site] with latitude_deg, longitude_deg")
    start_ns = now_ns if schedule.start is None else unix_ns(schedule.start)
    end_ns = start_ns + round(schedule.duration_h * _NS_PER_H) if schedule.end is None else unix_ns(schedule.end)
    end_ns = end_ns if until_ns is None else min(end_ns, until_ns)
    sun = None if site is None else SunTrack(site)
    times = sorted({time for time in _candidates(schedule, sun, start_ns, end_ns) if _wanted(schedule, sun, time)})
    if not times:
        raise ConfigError("schedule: there is no round between its start and its end; look at `rigctl plan`")
    return tuple(times)


def _candidates(schedule: ScheduleSection, sun: SunTrack | None, start_ns: int, end_ns: int) -> Iterator[int]:
    for time in schedule.times or ():
        if start_ns <= unix_ns(time) < end_ns:
            yield unix_ns(time)
    if schedule.every_min is not None:
        step_ns = round(schedule.every_min * _NS_PER_MIN)
        if (end_ns - start_ns) / step_ns > _MOST_ROUNDS:
            raise ConfigError(f"schedule.every_min: makes more than {_MOST_ROUNDS} rounds")
        yield from range(start_ns, end_ns, step_ns)
    for zenith_deg in schedule.zenith_passes_deg or ():
        if sun is not None:
            yield from sun.crossings_ns(zenith_deg, start_ns=start_ns, end_ns=end_ns)


def _wanted(schedule: ScheduleSection, sun: SunTrack | None, time_ns: int) -> bool:
    below, above = schedule.while_zenith_below_deg, schedule.while_zenith_above_deg
    if sun is None or (below is None and above is None):
        return True
    zenith_deg = sun.at(time_ns).zenith_deg
    return (below is None or zenith_deg < below) and (above is None or zenith_deg > above)
