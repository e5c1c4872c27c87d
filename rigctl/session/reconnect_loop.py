"""Takes what is left of a session at open devices, and opens them again where one goes away meanwhile."""

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace

from drivers.errors import DeviceTimeoutError, NotConnectedError
from drivers.interfaces import DeviceIdentity
from rigctl.devices.rig import Rig
from rigctl.files.rig_file import RigFile
from rigctl.numbers.utc_time import NS_PER_S
from rigctl.runs.repair import Repair
from rigctl.runs.run_folder import Run, read_run
from rigctl.runs.run_writer import RunWriter
from rigctl.session.acquisition import acquire
from rigctl.session.continuation import continuation
from rigctl.session.planning.session_steps import Step
from rigctl.session.session_context import SessionContext
from rigctl.session.watch import Watch

_RECONNECT_PAUSE_S = 2.0

Opener = Callable[[], AbstractContextManager[Rig]]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """End of a session.

    Attributes
    ----------
    frames, planned : int
        How many frames the run has now, and how many the session asks for.
    is_finished : bool
        It went to its end; False where somebody asked it to stop.
    repair : Repair or None
        What was done to the run before it was gone on with.
    was_finished : bool
        There was nothing left to take.
    """

    frames: int
    planned: int
    is_finished: bool
    repair: Repair | None = None
    was_finished: bool = False


class ReconnectLoop:
    """Takes what is left of a session, and opens the devices again where one goes away meanwhile.

    Parameters
    ----------
    rig_file : RigFile
        The devices.
    steps : tuple of Step
        The whole session.
    writer : RunWriter
        Where the frames go.
    context : SessionContext
        How the session is conducted.
    opener : callable
        Gives the open rig.
    """

    def __init__(
        self, rig_file: RigFile, steps: tuple[Step, ...], writer: RunWriter, context: SessionContext, opener: Opener
    ) -> None:
        self._rig_file, self._steps, self._writer = rig_file, steps, writer
        self._context, self._opener = context, opener
        self._disconnected_since_s: float | None = None
        self._frames = 0

    def take(self, rig: Rig, devices: ExitStack, *, title: str) -> Outcome:
        """Take what is left; return how it went.

        Parameters
        ----------
        rig : Rig
            Open devices.
        devices : ExitStack
            What closes them, and the ones that are opened later.
        title : str
            The session's name, for whoever watches.

        Raises
        ------
        DeviceError, RunFolderError, KeyboardInterrupt
            As `acquire`; a device that went away and did not come back.
        """
        opened: Rig | None = rig
        context = self._context
        show = Watch(
            self._writer.path,
            self._steps,
            title=title,
            clock=context.clock,
            live=context.live,
            disk=self._writer.disk,
        )
        with show as watch, self._context.control.listening():
            while True:
                try:
                    opened = opened or self._opened_again(devices)
                    finished = self._take_rest(opened, watch)
                    frames = len(read_run(self._writer.path).frames)
                    return Outcome(frames=frames, planned=len(self._steps), is_finished=finished)
                except (NotConnectedError, DeviceTimeoutError) as error:
                    devices.close()
                    opened = None
                    self._wait_or_give_up(error)

    def _take_rest(self, rig: Rig, watch: Watch) -> bool:
        rest = continuation(read_run(self._writer.path), self._steps)
        watch.begin(left=len(rest.steps))
        context = replace(self._context, metered_s=rest.metered_s)
        return acquire(rig, self._rig_file, rest.steps, self._writer, progress=watch.stored, context=context)

    def _opened_again(self, devices: ExitStack) -> Rig:
        rig = devices.enter_context(self._opener())
        require_same_devices(rig, read_run(self._writer.path))
        self._writer.event("devices opened again")
        return rig

    def _wait_or_give_up(self, error: Exception) -> None:
        """Note that a device is gone; raise the error where it stays so for too long."""
        clock, locks = self._context.clock, self._context.interlocks
        now_s = clock.monotonic_ns() / NS_PER_S
        frames = len(read_run(self._writer.path).frames)
        if self._disconnected_since_s is None or frames > self._frames:
            self._disconnected_since_s, self._frames = now_s, frames
            self._writer.event("interlock", interlock="gone", action=locks.gone, message=str(error))
            if locks.gone == "hold":
                self._writer.event("hold", reason="until the device is back")
        is_too_long = locks.gone == "retry" and now_s - self._disconnected_since_s > locks.reconnect_s
        if locks.gone == "stop" or is_too_long:
            raise error
        if self._context.control.is_stop_asked():
            raise error
        clock.sleep(_RECONNECT_PAUSE_S)


def require_same_devices(rig: Rig, run: Run) -> None:
    """Raise NotConnectedError unless the devices are those with which a run began."""
    found: dict[str, DeviceIdentity | None] = {"stage": rig.stage_identity, "camera": rig.camera_identity}
    for what, identity in found.items():
        if identity is None:
            continue
        before = run.session.stage if what == "stage" else run.session.camera
        if before.serial_number != identity.serial_number:
            raise NotConnectedError(
                f"the {what} is {identity.model} with serial number {identity.serial_number}, and this run began with "
                f"{before.model}, {before.serial_number}: connect that one"
            )
