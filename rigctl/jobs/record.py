"""Recording a session's devices: rig and session file in, a file out that a rig without hardware replays."""

import re
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from drivers.errors import DeviceError
from drivers.interfaces import (
    Camera,
    CameraFacts,
    CameraSettings,
    DeviceIdentity,
    Frame,
    FrameTally,
    ReportingCamera,
)
from drivers.recording import (
    CameraCall,
    Failure,
    LineEvent,
    OpenedDevices,
    Recording,
    failure_of,
    write_recording,
)
from drivers.serial_port import heard_by
from rigctl.calibrations.store import NONE
from rigctl.console.scrubbing import Scrubber
from rigctl.errors import ConfigError, DataError
from rigctl.files.rig_file import REPLAY, load_rig
from rigctl.files.session_file import load_session
from rigctl.rig.rig import Rig, open_rig
from rigctl.session.preparation import prepare_session, require_takeable
from rigctl.session.take import take_session
from rigctl.session.timing import clock_of
from rigctl.version import VERSION

_HEADER = re.compile(r"^\s*\[{1,2}\s*([\w.-]+)\s*\]{1,2}")
_NOT_REPLAYED = ("simulation", "notify", "monitors")


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """What was recorded: bytes on the stage's line, frames, and the failure that ended the session, if one did."""

    path: Path
    line_bytes: int
    frames: int
    failure: str | None


def record(rig: Path, session: Path, *, out: Path) -> Recorded:
    """Take a session, and write down what its devices said; its run is not kept.

    Parameters
    ----------
    rig, session : Path
        Files.
    out : Path
        File to make; written too where a device fails, which is what one wants to pass on.

    Raises
    ------
    ConfigError
        A file is wrong, or `out` cannot be written.
    """
    rig_file, session_file = load_rig(rig), load_session(session)
    recorder = Recorder()

    with tempfile.TemporaryDirectory(prefix="rigctl-record-") as folder:
        run = Path(folder) / "run"
        require_takeable(prepare_session(rig, session, store=NONE), run)
        clock = clock_of(rig_file)

        @contextmanager
        def opener() -> Iterator[Rig]:
            recorder.begin()
            with (
                heard_by(recorder.hear),
                open_rig(rig_file, session_name=session_file.name, run=run, clock=clock.simulated) as opened,
            ):
                yield replace(opened, camera=recorder.camera(opened))

        failure: str | None = None
        try:
            take_session(rig_file, session_file, run, files={}, clock=clock, opener=opener)
        except (DeviceError, DataError) as error:
            failure = str(error)
    opened = recorder.opened()
    files = {
        "rig.toml": replay_rig(rig.read_text(), out.name),
        "session.toml": Scrubber.of_this_machine().toml(session.read_text()),
    }
    try:
        write_recording(out, Recording(made_by=f"rigctl {VERSION}", opened=opened, files=files))
    except OSError as error:
        raise ConfigError(f"--out: {out} cannot be written: {error.strerror}") from error
    return Recorded(
        path=out,
        line_bytes=sum(len(event.data) for one in opened for event in one.line),
        frames=sum(call.frame is not None for one in opened for call in one.calls),
        failure=failure,
    )


def replay_rig(text: str, name: str) -> str:
    """Return a rig file that replays a recording: its addresses are the file, and only devices are left."""
    lines, table = [], ""
    for line in text.splitlines():
        header = _HEADER.match(line)
        table = header[1] if header is not None else table
        if table.partition(".")[0] in _NOT_REPLAYED:
            continue
        if table == "stage":
            line = re.sub(r"^(\s*port\s*=\s*).*$", rf'\g<1>"{REPLAY}{name}"', line)
        elif table == "camera":
            line = re.sub(r"^(\s*address\s*=\s*).*$", rf'\g<1>"{REPLAY}{name}"', line)
        lines.append(line)
    return Scrubber.of_this_machine().toml("\n".join(lines))


class Recorder:
    """Collects what devices say, from several threads, opening by opening."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._began_s = time.monotonic()
        self._lines: list[list[LineEvent]] = []
        self._port: str | None = None
        self._cameras: list[_RecordedCamera | None] = []

    def begin(self) -> None:
        """Begin anew: the devices are opened."""
        with self._lock:
            self._port = None
            self._lines.append([])
            self._cameras.append(None)

    def hear(self, data: bytes, *, port: str, from_host: bool) -> None:
        """Take in bytes on the stage's line; none from the device: the port has gone away.

        The stage's port is the first that speaks: sensors beside the frames have ports of their own.
        """
        heard = LineEvent(
            time_s=time.monotonic() - self._began_s,
            heard="host" if from_host else "device" if data else "gone",
            data=data,
        )
        with self._lock:
            if self._port is None:
                self._port = port
            if port == self._port:
                self._lines[-1].append(heard)

    def camera(self, rig: Rig) -> Camera:
        """Return a camera that writes down what is asked of it and what it gives."""
        made = _RecordedCamera(rig.camera, rig.camera_identity)
        if isinstance(rig.camera, ReportingCamera):
            made = _ReportingRecordedCamera(rig.camera, rig.camera, rig.camera_identity)
        with self._lock:
            self._cameras[-1] = made
        return made

    def opened(self) -> tuple[OpenedDevices, ...]:
        """Return all that was written down."""
        with self._lock:
            return tuple(
                OpenedDevices(line=tuple(line))
                if camera is None
                else OpenedDevices(
                    line=tuple(line),
                    camera=camera.identity,
                    facts=camera.told_facts,
                    features=camera.told_features,
                    calls=tuple(camera.calls),
                )
                for line, camera in zip(self._lines, self._cameras, strict=True)
            )


class _RecordedCamera:
    """Another camera, with everything that it was asked for."""

    def __init__(self, camera: Camera, identity: DeviceIdentity) -> None:
        self._camera, self.identity = camera, identity
        self.calls: list[CameraCall] = []
        self.told_facts: CameraFacts | None = None
        self.told_features: dict[str, str] = {}

    def __enter__(self) -> "_RecordedCamera":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        """Return what the device says of itself."""
        return self._camera.identify()

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        """Set exposure and gain. Raises what the camera raises."""
        asked = (exposure_s, gain_db)
        try:
            settings = self._camera.configure(exposure_s=exposure_s, gain_db=gain_db)
        except DeviceError as error:
            self._note(asked, failure_of(error))
            raise
        self.calls.append(CameraCall(asked=asked, settings=settings))
        return settings

    def take_frame(self, *, timeout_s: float) -> Frame:
        """Return a picture. Raises what the camera raises."""
        try:
            frame = self._camera.take_frame(timeout_s=timeout_s)
        except DeviceError as error:
            self._note(None, failure_of(error))
            raise
        self.calls.append(CameraCall(frame=frame))
        return frame

    def close(self) -> None:
        """Release the camera. May be called twice."""
        self._camera.close()

    def _note(self, asked: tuple[float, float] | None, failure: Failure) -> None:
        self.calls.append(CameraCall(asked=asked, failure=failure))


class _ReportingRecordedCamera(_RecordedCamera):
    """The same of a camera that tells facts and features."""

    def __init__(self, camera: Camera, told: ReportingCamera, identity: DeviceIdentity) -> None:
        super().__init__(camera, identity)
        self._told = told
        self.told_facts = told.facts()

    def facts(self) -> CameraFacts:
        """Return how its counts come about."""
        return self._told.facts()

    def features(self) -> dict[str, str]:
        """Return what it tells; the last of it is kept."""
        self.told_features = dict(self._told.features())
        return dict(self.told_features)

    def tally(self) -> FrameTally:
        """Return what became of the pictures so far."""
        return self._told.tally()
