"""A session laid out in time: its steps, where the sun stands at them, and what they need."""

from dataclasses import asdict, dataclass
from typing import TypedDict

from rigctl.console.json_text import Json
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import SessionFile
from rigctl.numbers.utc_time import NS_PER_S, utc_text
from rigctl.session.planning.drift_cost import false_dolp, grouping_cost, missing_axes
from rigctl.session.planning.schedule import round_times_ns
from rigctl.session.planning.session_steps import Step, estimate, plan_steps, step_times_ns
from rigctl.session.planning.sun_track import SunTrack

SUN_ANGLES = ("sun_zenith_deg", "sun_azimuth_deg", "phi_deg")


class _Moment(TypedDict):
    utc: str
    sun_zenith_deg: float | None
    sun_azimuth_deg: float | None
    phi_deg: float | None


@dataclass(frozen=True, kw_only=True)
class PlannedRound:
    """Beginning of a round, and the sun then; phi is the sun's azimuth less the camera's, in (-180, 180]."""

    round: int
    utc: str
    sun_zenith_deg: float | None
    sun_azimuth_deg: float | None
    phi_deg: float | None


@dataclass(frozen=True, kw_only=True)
class PlannedStep:
    """A frame, about when it is taken, and the sun then; an exposure of None is metered."""

    sequence: int
    round: int
    utc: str
    sun_zenith_deg: float | None
    sun_azimuth_deg: float | None
    phi_deg: float | None
    kind: str
    cycle: int
    angle_deg: float | None
    exposure_ms: float | None


@dataclass(frozen=True, kw_only=True, eq=False)
class SessionPlan:
    """A session laid out in time.

    Attributes
    ----------
    steps : tuple of Step
        What is taken.
    times_ns : tuple of int
        About when [ns since 1970 UTC].
    start_ns : int
        When it begins.
    sun : SunTrack or None
        The sun above the site, where the rig file has one.
    camera_azimuth_deg : float or None
        Where the camera stands as seen from the target.
    disk_bytes : int or None
        What the frames take; None where their size is not known.
    remarks : tuple of str
        What one should know before climbing the roof.
    """

    steps: tuple[Step, ...]
    times_ns: tuple[int, ...]
    start_ns: int
    sun: SunTrack | None
    camera_azimuth_deg: float | None
    disk_bytes: int | None
    remarks: tuple[str, ...]

    def rounds(self) -> dict[int, int]:
        """Return when the first step of each round is taken [ns since 1970 UTC]."""
        begin: dict[int, int] = {}
        for step, time_ns in zip(self.steps, self.times_ns, strict=True):
            begin.setdefault(step.round, time_ns)
        return begin

    @property
    def duration_s(self) -> float:
        """Time from the beginning until the last frame is taken [s]."""
        return (self.times_ns[-1] - self.start_ns) / NS_PER_S

    @property
    def false_dolp(self) -> float | None:
        """DoLP that unpolarized light shows in a round if it grows by 1 % a minute."""
        return false_dolp([step for step in self.steps if step.round == self.steps[0].round])

    def planned_rounds(self) -> tuple[PlannedRound, ...]:
        """Return the rounds with their times and the sun."""
        return tuple(PlannedRound(round=number, **self._moment(time_ns)) for number, time_ns in self.rounds().items())

    def planned_steps(self) -> tuple[PlannedStep, ...]:
        """Return the steps with their times and the sun."""
        return tuple(self._step(step, time_ns) for step, time_ns in zip(self.steps, self.times_ns, strict=True))

    def content(self) -> dict[str, Json]:
        """Return the plan as JSON holds it."""
        return {
            "start_utc": utc_text(self.start_ns),
            "end_utc": utc_text(self.times_ns[-1]),
            "duration_s": self.duration_s,
            "disk_bytes": self.disk_bytes,
            "false_dolp_per_percent_a_minute": self.false_dolp,
            "rounds": [_as_json(one) for one in self.planned_rounds()],
            "steps": [_as_json(one) for one in self.planned_steps()],
            "remarks": list(self.remarks),
        }

    def _step(self, step: Step, time_ns: int) -> PlannedStep:
        return PlannedStep(
            sequence=step.sequence,
            round=step.round,
            **self._moment(time_ns),
            kind=step.kind,
            cycle=step.cycle,
            angle_deg=step.polarizer_angle_deg,
            exposure_ms=None if step.exposure_s is None else step.exposure_s * 1000.0,
        )

    def _moment(self, time_ns: int) -> _Moment:
        if self.sun is None:
            return _Moment(utc=utc_text(time_ns), sun_zenith_deg=None, sun_azimuth_deg=None, phi_deg=None)
        sun, camera_deg = self.sun.at(time_ns), self.camera_azimuth_deg
        return _Moment(
            utc=utc_text(time_ns),
            sun_zenith_deg=sun.zenith_deg,
            sun_azimuth_deg=sun.azimuth_deg,
            # In (-180, 180]: 180 is where the camera looks toward the sun's side.
            phi_deg=None if camera_deg is None else 180.0 - (180.0 - (sun.azimuth_deg - camera_deg)) % 360.0,
        )


def _as_json(row: PlannedRound | PlannedStep) -> dict[str, Json]:
    """Return a row without the angles of a sun that is not known."""
    return {name: value for name, value in asdict(row).items() if value is not None or name not in SUN_ANGLES}


def plan_session(
    rig: RigFile, session: SessionFile, *, now_ns: int, until_ns: int | None = None, pixels: int | None = None
) -> SessionPlan:
    """Return a session laid out in time.

    Parameters
    ----------
    rig : RigFile
        With the site and the camera's direction.
    session : SessionFile
        What to take.
    now_ns : int
        When it begins [ns since 1970 UTC].
    until_ns : int or None
        Steps from then on are left out.
    pixels : int or None
        Of a picture, for the disk; None: of the simulated camera, if it is one.

    Raises
    ------
    ConfigError
        The schedule has no round.
    """
    rounds = round_times_ns(session, rig.site, now_ns=now_ns, until_ns=until_ns)
    steps = plan_steps(session, rounds, cell_deg=rig.cell_deg)
    times = step_times_ns(steps, start_ns=now_ns)
    if until_ns is not None:
        steps = tuple(step for step, time in zip(steps, times, strict=True) if time < until_ns) or steps[:1]
        times = times[: len(steps)]
    geometry = rig.geometry
    azimuth = None if geometry is None or geometry.camera_azimuth_deg is None else geometry.camera_azimuth_deg.value
    return SessionPlan(
        steps=steps,
        times_ns=times,
        start_ns=now_ns,
        sun=None if rig.site is None else SunTrack(rig.site),
        camera_azimuth_deg=azimuth,
        disk_bytes=estimate(steps, rig, pixels=pixels).disk_bytes,
        remarks=tuple(_remarks(rig, session, steps, times)),
    )


def _remarks(rig: RigFile, session: SessionFile, steps: tuple[Step, ...], times: tuple[int, ...]) -> list[str]:
    found = []
    if rig.site is None:
        found.append("the rig file has no [site]: no sun angles")
    elif rig.geometry is None or rig.geometry.camera_azimuth_deg is None:
        found.append("the rig file has no camera_azimuth_deg in [geometry]: no azimuth of the sun against the camera")
    grouping = grouping_cost(session) if rig.cell_deg is None else None
    found += [doubt for doubt in (grouping, missing_axes(steps)) if doubt is not None]
    if any(step.exposure_s is None for step in steps):
        found.append("metered exposures are taken for 10 ms here")
    late = [
        s.round
        for s, t in zip(steps, times, strict=True)
        if s.due_ns is not None and _late_s(s, t) > _late_limit_s(session)
    ]
    if late:
        rounds = ", ".join(map(str, sorted(set(late))))
        found.append(f"rounds {rounds}: a round before takes so long that these begin too late and may be left out")
    return found


def _late_s(step: Step, time_ns: int) -> float:
    return (time_ns - (step.due_ns or time_ns)) / NS_PER_S


def _late_limit_s(session: SessionFile) -> float:
    return float("inf") if session.schedule is None else session.schedule.late_min * 60.0
