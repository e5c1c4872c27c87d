"""A run as it stands now, for a page that asks each second: only what is new is read, and nothing is written."""

import shutil
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from rigctl.errors import DataError
from rigctl.live.live_status import STATUS_FILE, read_status
from rigctl.live.run_state import State, session_state
from rigctl.numbers.utc_time import NS_PER_S, utc_text
from rigctl.runs.annotation_record import Annotation
from rigctl.runs.annotations import annotated
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.monitor_readings import READINGS_EVENT
from rigctl.runs.run_events import EVENTS_FILE, RunEvent, event_facts, read_events
from rigctl.runs.run_folder import MANIFEST_FILE, Run
from rigctl.runs.run_lock import writing_process
from rigctl.web.calibrations_beside import CalibrationsBeside
from rigctl.web.history_reader import HistoryReader
from rigctl.web.pictures import Picture
from rigctl.web.run_look import CalibrationLook, Curves, Happening, Liveliness, NewestFrame, RunLook, RunRow
from rigctl.web.run_pictures import MAPS, RunPictures, last_cycle, newest_by_name
from rigctl.web.run_tail import RunTail

T = TypeVar("T")
_EVENTS = 30
_BYTES_PER_MB = 1e6
_MS_PER_S = 1e3
_STALE_S = 30.0
_LIVELINESS: dict[State, Liveliness] = {
    "running": "live",
    "holding": "holding",
    "waiting": "waiting",
    "finished": "finished",
    "stopped": "stopped",
    "interrupted": "interrupted",
}
_ADVICE: dict[Liveliness, str] = {
    "stale": "a process holds the run and has written nothing since: look at its terminal",
    "stopped": "stopped: resume with rigctl resume {run}",
    "interrupted": "interrupted: resume with rigctl resume {run}",
}


class RunReader:
    """Reads one run for all who look at it. May be asked from several threads.

    Parameters
    ----------
    path : Path
        The run folder; it may come later.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._reading = threading.Lock()
        self._tail, self._history, self._pictures = RunTail(path), HistoryReader(), RunPictures()
        self._calibrations = CalibrationsBeside(path)

    def look(self) -> RunLook:
        """Return how the run stands; what cannot be read of it stands among its problems."""
        if not self._path.is_dir():
            return RunLook(run=self._path.name, state="waiting", advice="there is no such folder yet")
        problems: list[str] = []
        run = _or_problem(self._run, problems)
        events = _or_problem(lambda: read_events(self._path), problems) or []
        used = None if run is None else _or_problem(lambda: annotated(run), problems)
        noted = () if used is None else used.annotations
        process = _or_problem(lambda: writing_process(self._path), problems)
        state = session_state(process, [event.event for event in events])
        liveliness = _LIVELINESS[state] if run is not None else "waiting"
        look = RunLook(
            run=self._path.name,
            state=self._stale_or(liveliness),
            disk_free_mb=shutil.disk_usage(self._path).free / _BYTES_PER_MB,
            events=_happenings(events, noted),
        )
        look = replace(look, since_utc=self._since(look.state, events), advice=self._advice(look.state, events))
        look = look if run is None else _with_frames(look, run, used)
        look = self._with_plan(look, problems)
        return replace(look, problems=(*problems, *self._tail.problems, *filter(None, [self._history.problem])))

    def curves(self) -> Curves:
        """Return the numbers of its cycles, as far as its frames have been read, without those that are excluded.

        Raises
        ------
        DataError
            The run cannot be read, or nobody knows which frames are excluded.
        """
        run = self._used_run()
        return Curves() if run is None else self._history.curves(run)

    def calibrations(self) -> tuple[CalibrationLook, ...]:
        """Return the calibrations that lie beside it, and whether they hold for it."""
        run = _or_problem(self._run, [])
        return () if run is None else self._calibrations.of(run)

    def newest_sequence(self, name: str) -> int | None:
        """Return by which number a picture is told from a later one of that name; None where there is none.

        Raises
        ------
        DataError
            The run cannot be read.
        """
        run = self._used_run() if name in MAPS else self._run()
        return None if run is None else self._pictures.newest_sequence(run, name)

    def picture(self, name: str, *, zebra: bool = True, dolp_top: float = 1.0) -> Picture | None:
        """Return the newest picture of an angle, or a map without excluded frames; None where there is none.

        Parameters
        ----------
        name : str
            "45" and so on, "dark", "flat", "s0", "dolp" or "aolp"; "thumb" is a small one of any angle.
        zebra : bool
            Whether saturated pixels are striped.
        dolp_top : float
            DoLP at the upper end of its colours, above 0.

        Raises
        ------
        DataError
            A frame is damaged, or of a map: nobody knows which frames are excluded.
        """
        run = self._used_run() if name in MAPS else self._run()
        return None if run is None else self._pictures.picture(run, name, zebra=zebra, dolp_top=dolp_top)

    def begun_utc(self) -> str:
        """Return when its folder was made; empty where it does not say."""
        run = _or_problem(self._run, [])
        return "" if run is None else run.created_utc

    def first_frame(self) -> FrameRecord | None:
        """Return its first frame; None where there is none."""
        run = _or_problem(self._run, [])
        return run.frames[0] if run is not None and run.frames else None

    def _run(self) -> Run | None:
        with self._reading:
            return self._tail.run(self._tail.read())

    def _used_run(self) -> Run | None:
        run = self._run()
        return None if run is None else annotated(run)

    def _stale_or(self, state: Liveliness) -> Liveliness:
        return "stale" if state == "live" and time.time() - self._written_s() > _STALE_S else state

    def _written_s(self) -> float:
        """Return when the session last wrote anything, by this machine's clock."""
        files = (self._path / name for name in (MANIFEST_FILE, EVENTS_FILE, STATUS_FILE))
        return max((file.stat().st_mtime for file in files if file.exists()), default=0.0)

    def _since(self, state: Liveliness, events: Sequence[RunEvent]) -> str:
        if state in ("stale", "interrupted"):
            return utc_text(int(self._written_s() * NS_PER_S)) if self._written_s() else ""
        ends = [event.utc for event in events if event.event in ("hold", "waiting", "finished", "stopped")]
        begins = [event.utc for event in events[:1]]
        return (ends if ends and state != "live" else [*begins, ""])[-1 if state != "live" else 0]

    def _advice(self, state: Liveliness, events: Sequence[RunEvent]) -> str:
        reasons = [str(event.facts.get("reason", "")) for event in events if event.event == "hold"]
        if state == "holding" and reasons:
            return f"{reasons[-1]}; then go on: rigctl resume {self._path}"
        return _ADVICE.get(state, "").format(run=self._path)

    def _with_plan(self, look: RunLook, problems: list[str]) -> RunLook:
        status = _or_problem(lambda: read_status(self._path), problems)
        if status is None:
            return look
        is_going = look.state in ("live", "holding", "waiting", "stale")
        return replace(
            look,
            session=status.session,
            frames_planned=status.frames_planned,
            remaining_s=status.progress.remaining_s if status.progress is not None and is_going else None,
            end_utc=status.progress.end_utc if status.progress is not None and is_going else "",
        )


def run_row(path: Path) -> RunRow:
    """Return a run as a row of a list, without what lies beside it."""
    reader = RunReader(path)
    look, begun_utc, first = reader.look(), reader.begun_utc(), reader.first_frame()
    elevation_deg = None if first is None else first.sun_elevation_deg
    return RunRow(
        run=path.name,
        state=look.state,
        begun_utc=begun_utc,
        frames=look.frames,
        sun_zenith_deg=None if elevation_deg is None else 90.0 - elevation_deg,
    )


def _or_problem(read: Callable[[], T], problems: list[str]) -> T | None:
    try:
        return read()
    except (DataError, OSError) as error:
        problems.append(str(error))
        return None


def _with_frames(look: RunLook, run: Run, used: Run | None) -> RunLook:
    frames = run.frames
    last = frames[-1] if frames else None
    cycle = () if used is None else last_cycle(used.frames)
    return replace(
        look,
        is_simulated=run.session.origin == "simulated",
        frames=len(frames),
        step="" if last is None else _step(last),
        sun_zenith_deg=None if last is None or last.sun_elevation_deg is None else 90.0 - last.sun_elevation_deg,
        sun_azimuth_deg=None if last is None else last.sun_azimuth_deg,
        camera_temperature_c=None if last is None else last.camera_temperature_c,
        newest=tuple(_newest_frame(name, frame) for name, frame in sorted(newest_by_name(frames).items(), key=_place)),
        maps_of=_step(cycle[-1]) if cycle else "",
    )


def _place(named: tuple[str, FrameRecord]) -> tuple[int, float, str]:
    name, frame = named
    angle_deg = frame.polarizer_angle_target_deg
    return (0 if frame.kind == "scene" else 1, 0.0 if angle_deg is None else angle_deg, name)


def _newest_frame(name: str, frame: FrameRecord) -> NewestFrame:
    return NewestFrame(
        name=name,
        sequence=frame.sequence,
        utc=frame.start_utc or "",
        exposure_ms=None if frame.exposure_s is None else frame.exposure_s * _MS_PER_S,
        clipped=frame.saturated_fraction,
    )


def _step(frame: FrameRecord) -> str:
    words: list[str] = [frame.kind]
    words += [] if frame.round is None else [f"round {frame.round + 1}"]
    words += [] if frame.cycle is None else [f"cycle {frame.cycle + 1}"]
    words += [] if frame.polarizer_angle_deg is None else [f"{frame.polarizer_angle_deg:.2f} deg"]
    return ", ".join(words)


def _happenings(events: Sequence[RunEvent], noted: Sequence[Annotation]) -> tuple[Happening, ...]:
    """Return the last things that happened or were noted, the newest first."""
    happened = [event for event in events if event.event != READINGS_EVENT][-_EVENTS:]
    told = [Happening(utc=event.utc, event=event.event, facts=event_facts(event)) for event in happened]
    if noted:
        told += [Happening(utc=one.utc, event=one.kind, facts=one.facts) for one in noted[-_EVENTS:]]
        told.sort(key=lambda one: one.utc)
    return tuple(reversed(told[-_EVENTS:]))
