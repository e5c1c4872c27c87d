"""A camera whose every picture is known to the last bit: its number, exposure and a mark of the tester's are in it."""

import threading
import time
from contextlib import contextmanager

import numpy as np

from drivers.errors import LimitError
from drivers.interfaces import CameraSettings, DeviceIdentity, Frame, Move, StagePosition, StageStatus
from rigctl.rig.rig import Rig

BIT_DEPTH = 12
_TOP = 2**BIT_DEPTH
NUMBER, MARK, EXPOSURE = (0, 0), (0, 1), (0, 2)


class KnownPictures:
    """Pictures of noise that moves on by a step with every number.

    Attributes
    ----------
    mark : int
        Put into every picture from now on, 0 to 4095.
    last_counts : array
        The picture that was made last.
    made_utc_ns : dict
        Number of a picture to when it was made.
    """

    def __init__(self, *, width=782, height=582):
        self._noise = np.random.default_rng(9).integers(0, _TOP, (height, width), dtype=np.uint16)
        self._taken = 0
        self._changed = threading.Condition()
        self.mark = 0
        self.made_utc_ns = {}
        self.configure(exposure_s=0.01, gain_db=0.0)

    def __enter__(self):
        return self

    def __exit__(self, *exc_info):
        self.close()

    def identify(self):
        return DeviceIdentity(model="known pictures", serial_number="1", firmware="none")

    def configure(self, *, exposure_s, gain_db):
        if not 0 < exposure_s < 100:
            raise LimitError(f"exposure {exposure_s} s")
        height, width = self._noise.shape
        self._settings = CameraSettings(
            exposure_s=exposure_s, gain_db=gain_db, width=width, height=height, bit_depth=BIT_DEPTH
        )
        return self._settings

    def take_frame(self, *, timeout_s):
        with self._changed:
            self._taken += 1
            number = self._taken
            self.made_utc_ns[number % _TOP] = time.time_ns()
            self._changed.notify_all()
        counts = known_counts(self._noise, number, mark=self.mark, exposure_s=self._settings.exposure_s)
        self.last_counts = counts
        return Frame(
            counts=counts,
            settings=self._settings,
            sequence=number,
            start_utc_ns=time.time_ns(),
            end_utc_ns=time.time_ns(),
            start_monotonic_ns=time.monotonic_ns(),
        )

    def close(self):
        pass

    def await_pictures(self, more):
        """Return once this many more pictures have been made."""
        with self._changed:
            wanted = self._taken + more
            assert self._changed.wait_for(lambda: self._taken >= wanted, timeout=60.0)


def known_counts(noise, number, *, mark, exposure_s):
    counts = (noise + np.uint16(7 * number % _TOP)) % np.uint16(_TOP)
    counts[NUMBER], counts[MARK], counts[EXPOSURE] = number % _TOP, mark, round(exposure_s * 1e5) % _TOP
    return counts


def is_known(counts):
    """Return whether a picture is one of these, bit for bit."""
    height, width = counts.shape
    noise = np.random.default_rng(9).integers(0, _TOP, (height, width), dtype=np.uint16)
    number, mark, exposure_s = int(counts[NUMBER]), int(counts[MARK]), int(counts[EXPOSURE]) / 1e5
    return np.array_equal(counts, known_counts(noise, number, mark=mark, exposure_s=exposure_s))


def assert_known(counts):
    assert is_known(counts)


class MarkingStage:
    """Turns at once, and marks from then on every picture with its angle."""

    def __init__(self, source):
        self._source = source

    def identify(self):
        return DeviceIdentity(model="marking", serial_number="1", firmware="0")

    def home(self):
        return StagePosition(angle_deg=0.0, counts=0)

    def status(self):
        return StageStatus(moving=False, homed=True, code=0, meaning="ok")

    def move_to(self, angle_deg):
        self._source.mark = round(angle_deg % 360.0)
        position = StagePosition(angle_deg=angle_deg, counts=self._source.mark)
        return Move(target_deg=angle_deg, position=position, tries=1, duration_s=0.0)


@contextmanager
def marking_rig(source, camera):
    """Give a rig of a stage that marks the pictures of a source, and of a camera that takes them."""
    stage = MarkingStage(source)
    yield Rig(
        stage=stage,
        camera=camera,
        stage_identity=stage.identify(),
        camera_identity=camera.identify(),
        present=lambda _: None,
        origin="device",
    )
