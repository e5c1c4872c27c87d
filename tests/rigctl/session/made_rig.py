"""A rig of two stand-ins that live in simulated time and fail when told to, and sessions on it."""

import json
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from drivers.errors import DeviceFaultError, DeviceTimeoutError, NotConnectedError
from drivers.interfaces import CameraSettings, DeviceIdentity, Frame, Move, StagePosition, StageStatus
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import SessionFile
from rigctl.rig.rig import Rig
from rigctl.runs.check import verify_run
from rigctl.runs.folder import read_run
from rigctl.session.take import take_session
from rigctl.session.timing import SessionClock

NS = 1_000_000_000
START_NS = 1_777_900_000 * NS  # 2026-05-04T13:06:40Z
RIG_FILE = RigFile.model_validate(
    {
        "name": "stand-in",
        "stage": {"driver": "ellx", "port": "/dev/null"},
        "polarizer": {"sense": 1, "offset_deg": 10.0},
        "camera": {"address": "none:", "filter": "V"},
    }
)


class MadeTime:
    """A host whose clocks stand still until somebody sleeps, and whose UTC may be set."""

    def __init__(self, start_ns=START_NS):
        self.monotonic_ns, self.set_ns = 5 * NS, start_ns - 5 * NS
        self.wakes = []
        self.problem = None
        self.clock = SessionClock(
            utc_ns=lambda: self.monotonic_ns + self.set_ns,
            monotonic_ns=lambda: self.monotonic_ns,
            sleep=self.sleep,
            problem=lambda: self.problem,
        )

    def sleep(self, duration_s):
        self.monotonic_ns += round(duration_s * NS)
        for wake in self.wakes:
            wake()


class MadeStage:
    """Lands exactly. `faults` maps the number of a move to what happens there."""

    def __init__(self, time, faults=None):
        self._time, self._faults, self.moves = time, faults or {}, 0
        self.angle_deg = 0.0
        self.homes, self.is_homed = 0, True

    def home(self):
        self.homes += 1
        return StagePosition(angle_deg=0.0, counts=0)

    def status(self):
        return StageStatus(moving=False, homed=self.is_homed, code=0, meaning="ok")

    def move_to(self, angle_deg):
        self.moves += 1
        self._time.sleep(0.2)
        fault = self._faults.get(self.moves)
        if isinstance(fault, Exception):
            raise fault
        self.angle_deg = angle_deg + (fault if isinstance(fault, float) else 0.0)
        position = StagePosition(angle_deg=self.angle_deg, counts=round(self.angle_deg * 100))
        remarks = (fault,) if isinstance(fault, str) else ()
        return Move(target_deg=angle_deg, position=position, tries=1, duration_s=0.2, remarks=remarks)


class MadeCamera:
    """Sees partly polarized light. `faults` maps the number of a frame to an error or to what is done to its counts."""

    def __init__(self, time, stage, faults=None, *, dn_per_s=1000.0):
        self._time, self._stage, self._faults = time, stage, faults or {}
        self._dn_per_s = dn_per_s
        self.taken = 0
        self.lies_s = 0.0
        self.lost = {}  # by frame: how many numbers were used up before it
        self.temperature_c = None
        self._exposure_s = 0.01

    def features(self):
        return {} if self.temperature_c is None else {"DeviceTemperature": f"{self.temperature_c:g}"}

    def configure(self, *, exposure_s, gain_db):
        self._exposure_s = exposure_s
        return self._settings()

    def _settings(self):
        return CameraSettings(exposure_s=self._exposure_s + self.lies_s, gain_db=0.0, width=16, height=12, bit_depth=12)

    def take_frame(self, *, timeout_s):
        number, self.taken = self.taken, self.taken + 1
        start_utc_ns, start_ns = self._time.clock.utc_ns(), self._time.monotonic_ns
        self._time.sleep(self._exposure_s)
        fault = self._faults.get(number)
        if isinstance(fault, Exception):
            raise fault
        counts = self._counts(number)
        return Frame(
            counts=counts if fault is None else fault(counts),
            settings=self._settings(),
            sequence=number + sum(lost for frame, lost in self.lost.items() if frame <= number),
            start_utc_ns=start_utc_ns,
            end_utc_ns=self._time.clock.utc_ns(),
            start_monotonic_ns=start_ns,
        )

    def _counts(self, number):
        axis_rad = np.deg2rad(self._stage.angle_deg + 10.0)
        level = self._dn_per_s * self._exposure_s * 100 * (1 + 0.3 * np.cos(2 * axis_rad)) / 2
        noisy = np.random.default_rng(number).normal(100 + level, 1.0, (12, 16))
        return np.clip(np.round(noisy), 0, 4095).astype(np.uint16)


class MadeWorld:
    """Stand-ins behind an opener that can be handed to a session."""

    def __init__(self, *, stage_faults=None, camera_faults=None, start_ns=START_NS, dn_per_s=1000.0):
        self.time = MadeTime(start_ns)
        self.stage = MadeStage(self.time, stage_faults)
        self.camera = MadeCamera(self.time, self.stage, camera_faults, dn_per_s=dn_per_s)
        self.presented = []
        self.opened = 0
        self.refuses_until_ns = 0
        self.serial_numbers = ["1"]  # of the devices, by how often they were opened; the last one stays

    @contextmanager
    def open(self):
        self.opened += 1
        if self.time.monotonic_ns < self.refuses_until_ns:
            raise NotConnectedError("stand-in: there is no such port")
        serial = self.serial_numbers[min(self.opened, len(self.serial_numbers)) - 1]
        identity = DeviceIdentity(model="stand-in", serial_number=serial, firmware="0")
        yield Rig(
            stage=self.stage,
            camera=self.camera,
            stage_identity=identity,
            camera_identity=identity,
            present=self.presented.append,
            origin="device",
        )


def silent():
    return DeviceTimeoutError("stand-in: no answer")


def unplugged():
    return NotConnectedError("stand-in: it has disconnected")


def stalled():
    return DeviceFaultError("stand-in: fault 2: mechanical timeout", code=2, meaning="mechanical timeout")


def events_of(run: Path) -> list[dict]:
    return [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]


def watched_session(*, take=None, **locks):
    """Return a session of two cycles whose interlocks are quiet but for those that are given."""
    # Simulated time costs nothing: the session outruns any disk.
    quiet = {"disk_free_mb": 0, "queue": "off", "drift": "off", "low_signal": "off", "exposure": "off"}
    steps = {"kind": "scene", "exposure_ms": 10, "cycles": 2} | (take or {})
    return SessionFile.model_validate({"name": "watched", "take": [steps], "interlocks": quiet | locks})


def take_watched(world, tmp_path, *, rig_file=RIG_FILE, take=None, noise=None, **locks):
    session = watched_session(take=take, **locks)
    return take_session(
        rig_file, session, tmp_path / "run", files={}, noise=noise, clock=world.time.clock, opener=world.open
    )


def trips_of(tmp_path):
    events = events_of(tmp_path / "run")
    return [(e["facts"]["interlock"], e["facts"]["action"]) for e in events if e["event"] == "interlock"]


def assert_whole(tmp_path, frames=8):
    assert [record.sequence for record in read_run(tmp_path / "run").frames] == list(range(frames))
    assert verify_run(tmp_path / "run").ok
