"""Shows how a session goes: a bar and live numbers on this terminal, and the run's status file for others."""

import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rich.console import Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from rigctl.console.console_streams import visible
from rigctl.console.terminal import progress as progress_console
from rigctl.console.terminal import warn
from rigctl.errors import RunFolderError
from rigctl.live.live_numbers import LiveNumbers
from rigctl.live.live_status import LastStep, LiveContent, LiveStatus, StepProgress, write_status
from rigctl.live.live_text import live_lines
from rigctl.numbers.utc_time import NS_PER_S, utc_text
from rigctl.session.planning.session_steps import Step, step_times_ns
from rigctl.session.session_clock import SessionClock
from rigctl.storage.disk_calls import DiskCalls

# File systems flush a file that replaces another: that costs as much as a frame, and nobody looks more often.
_TELL_EACH_S = 1.0


class Watch:
    """Told of each stored step. A context manager: the bar is there meanwhile.

    Parameters
    ----------
    run : Path
        The run folder.
    steps : sequence of Step
        All steps of the session.
    title : str
        Its name.
    clock : SessionClock
        The host's clocks.
    live : LiveNumbers
        What the frames show.
    disk : DiskCalls or None
        What writes the status file, so that a disk that hangs holds nobody.
    """

    def __init__(
        self,
        run: Path,
        steps: Sequence[Step],
        *,
        title: str,
        clock: SessionClock,
        live: LiveNumbers,
        disk: DiskCalls | None = None,
    ) -> None:
        self._disk = DiskCalls() if disk is None else disk
        self._run, self._steps, self._clock, self._live = run, steps, clock, live
        self._planned_ns = step_times_ns(steps, start_ns=clock.utc_ns())
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        self._bar = Progress(*columns)
        self._task = self._bar.add_task(title, total=len(steps))
        self._lock = threading.Lock()
        self._told_s = -_TELL_EACH_S
        self._status = LiveStatus(session=title, frames_planned=len(steps), frames=0)
        self._is_blind = False
        self._screen = Live(get_renderable=self._shown, console=progress_console(), transient=True)

    def __enter__(self) -> Self:
        self._screen.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._tell(numbers=self._numbers())
        self._screen.stop()

    def begin(self, *, left: int) -> None:
        """Begin to take so many steps."""
        done = len(self._steps) - left
        self._bar.update(self._task, completed=done)
        self._tell(frames=done)

    def stored(self, step: Step) -> None:
        """Count a step whose frame is on the disk."""
        self._bar.advance(self._task)
        frames = self._status.frames + 1
        now_s = time.monotonic()
        is_last = frames == len(self._steps)
        if now_s - self._told_s >= _TELL_EACH_S or is_last:
            self._told_s = now_s
            self._tell(frames=frames, progress=self._progress(step), numbers=self._numbers())
        else:
            self._status = replace(self._status, frames=frames)

    def _numbers(self) -> LiveContent | None:
        """Return what the frames show; None where that cannot be computed: a fault here costs no frame."""
        try:
            return self._live.content()
        except Exception as error:
            if not self._is_blind:
                warn(f"no live numbers: {type(error).__name__}: {error}; the frames are stored all the same")
            self._is_blind = True
            return None

    def _shown(self) -> Group:
        numbers = self._status.numbers
        lines = "" if numbers is None else "\n".join(live_lines(numbers))
        return Group(self._bar, Text(visible(lines)))

    def _progress(self, step: Step) -> StepProgress:
        """Return how long it still takes: what the plan has between this step and the last, or until its time."""
        now_ns = self._clock.utc_ns()
        end_ns = now_ns + self._planned_ns[-1] - self._planned_ns[step.sequence]
        if self._steps[-1].due_ns is not None:
            end_ns = max(end_ns, self._planned_ns[-1])
        last = LastStep(sequence=step.sequence, kind=step.kind, cycle=step.cycle, angle_deg=step.polarizer_angle_deg)
        return StepProgress(last=last, remaining_s=round((end_ns - now_ns) / NS_PER_S, 1), end_utc=utc_text(end_ns))

    def _tell(self, **changes: Any) -> None:
        with self._lock:
            status = self._status = replace(self._status, **changes, written_utc=utc_text(self._clock.utc_ns()))
            # Who watches gets nothing on a full disk, or one that hangs; the frames say so loudly enough.
            with suppress(OSError, RunFolderError):
                self._disk.call(lambda: write_status(self._run, status))
