"""A camera that gives what a recording of `rigctl record` has of another one: settings, frames and failures."""

import math
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

from drivers.errors import LimitError, NotConnectedError
from drivers.interfaces import CameraFacts, CameraSettings, DeviceIdentity, Frame, FrameTally
from drivers.recording import CameraCall, OpenedDevices, read_recording

# How often each file was opened in this program: devices that were opened again are recorded one after the other.
_OPENED: Counter[Path] = Counter()


class ReplayedCamera:
    """A camera out of a recording.

    Calls are answered in their order. Settings that were asked for earlier or later are found; a frame beyond the last
    one that was taken at these settings is none. Times of exposures keep their distances and begin anew.
    """

    def __init__(self, place: str, opened: OpenedDevices) -> None:
        if opened.camera is None:
            raise NotConnectedError(f"{place}: has no camera")
        self._place, self._identity, self._calls = place, opened.camera, opened.calls
        self._next = 0
        self._asked: tuple[float, float] | None = None
        self._shift_ns: int | None = None
        self._accepted = 0
        self._is_open = True

    def __enter__(self) -> "ReplayedCamera":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        """Return what the recorded camera said of itself."""
        self._require_open()
        return self._identity

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        """Return what the recorded camera took for these settings."""
        self._require_open()
        wanted = (exposure_s, gain_db)
        order = [*range(self._next, len(self._calls)), *range(self._next)]
        place = next((k for k in order if _is_same(self._calls[k].asked, wanted)), None)
        if place is None:
            raise LimitError(f"{self._place}: {exposure_s:g} s at {gain_db:g} dB were not recorded")
        call: CameraCall = self._calls[place]
        if place >= self._next:
            self._next = place + 1
        self._asked = wanted
        if call.failure is not None:
            raise call.failure.error()
        if call.settings is None:
            raise LimitError(f"{self._place}: holds no settings where it says so")
        return call.settings

    def take_frame(self, *, timeout_s: float) -> Frame:
        """Return the next frame that was recorded at these settings."""
        self._require_open()
        call = self._next_picture()
        if call.failure is not None:
            raise call.failure.error()
        frame = call.frame
        if frame is None:
            raise NotConnectedError(f"{self._place}: holds no frame where it says so")
        self._accepted += 1
        return self._as_now(frame)

    def tally(self) -> FrameTally:
        """Return how many frames were given."""
        return FrameTally(accepted=self._accepted)

    def close(self) -> None:
        """Release the camera. May be called twice."""
        self._is_open = False

    def _next_picture(self) -> CameraCall:
        for place in range(self._next, len(self._calls)):
            call = self._calls[place]
            if call.asked is None:
                self._next = place + 1
                return call
            if self._asked is not None and not _is_same(call.asked, self._asked):
                break
        raise NotConnectedError(f"{self._place}: no more pictures were recorded at these settings")

    def _as_now(self, frame: Frame) -> Frame:
        now_ns = time.monotonic_ns()
        if self._shift_ns is None:
            self._shift_ns = now_ns - frame.start_monotonic_ns
        start_ns = max(now_ns, frame.start_monotonic_ns + self._shift_ns)
        start_utc_ns = time.time_ns() + start_ns - now_ns
        return replace(
            frame,
            counts=frame.counts.copy(),
            start_utc_ns=start_utc_ns,
            end_utc_ns=start_utc_ns + frame.end_utc_ns - frame.start_utc_ns,
            start_monotonic_ns=start_ns,
        )

    def _require_open(self) -> None:
        if not self._is_open:
            raise NotConnectedError(f"{self._place}: it was closed; open it again")


class TellingReplayedCamera(ReplayedCamera):
    """A replayed camera that told facts and features."""

    def __init__(self, place: str, opened: OpenedDevices, facts: CameraFacts) -> None:
        super().__init__(place, opened)
        self._facts, self._features = facts, dict(opened.features)

    def facts(self) -> CameraFacts:
        """Return how its counts came about."""
        return self._facts

    def features(self) -> dict[str, str]:
        """Return what it told when it was opened."""
        return dict(self._features)


def _is_same(asked: tuple[float, float] | None, wanted: tuple[float, float]) -> bool:
    """Return whether the settings of a call are those that are wanted, but for the last digits of a float."""
    return asked is not None and all(math.isclose(*pair, abs_tol=1e-12) for pair in zip(asked, wanted, strict=True))


def open_replay(place: str) -> ReplayedCamera:
    """Return the camera of a recording, by the file's path; each opening is the next one that was recorded.

    Raises
    ------
    LimitError
        It is no recording.
    NotConnectedError
        It has no camera.
    """
    path = Path(place.partition("?")[0])
    opened = read_recording(path).opened
    if not opened:
        raise NotConnectedError(f"{path}: nothing was opened in this recording")
    number = _OPENED[path.resolve()]
    _OPENED[path.resolve()] += 1
    mine = opened[number % len(opened)]
    return ReplayedCamera(place, mine) if mine.facts is None else TellingReplayedCamera(place, mine, mine.facts)
