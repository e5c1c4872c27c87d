"""A camera whose calls end in time even if its library or the kernel does not return.

A call to a silent camera may wait longer than a session allows: libaravis waits 2.5 s at each register, a request to a
video device may never return, and neither can be interrupted. So each call runs in the camera's own thread. If it does
not return in time, thread and camera are abandoned, and the thread closes the camera once the call returns. There is at
most one such thread per camera: the camera is opened again only after the earlier call returned.

Addresses of cameras have the form ``PLACE?key=value&key=value``.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any, Protocol, TypeVar

from drivers.caller import Caller, LeftBehindError
from drivers.errors import AddressError, DeviceError, DeviceTimeoutError, LimitError, NotConnectedError
from drivers.interfaces import Camera, CameraFacts, CameraSettings, DeviceIdentity, Frame, FrameTally, ReportingCamera

_CLOCK_STEP_NS = 2_000_000


def split_place(text: str, readers: Mapping[str, Callable[[str], Any]]) -> tuple[str, dict[str, Any]]:
    """Return the place and the values behind it."""
    place, _, tail = text.partition("?")
    values: dict[str, Any] = {}
    problems = [] if place else ["there is nothing before the '?'"]
    for item in filter(None, tail.split("&")):
        key, _, value = item.partition("=")
        if key not in readers:
            close = get_close_matches(key, readers, n=1)
            meant = f"; did you mean {close[0]}?" if close else ""
            problems.append(f"{key!r} is not a key; allowed are {', '.join(sorted(readers))}{meant}")
            continue
        try:
            values[key] = readers[key](value)
        except ValueError as error:
            problems.append(f"{key}={value!r}: {error}")
    if problems:
        raise AddressError(f"camera address {text!r}: {'; '.join(problems)}")
    return place, values


def one_of(*allowed: str) -> Callable[[str], str]:
    """Return a reader of a text that must be one of these."""

    def read(value: str) -> str:
        if value not in allowed:
            close = get_close_matches(value, allowed, n=1)
            raise ValueError(f"allowed are {', '.join(allowed)}" + (f"; did you mean {close[0]}?" if close else ""))
        return value

    return read


def whole(least: int, most: int) -> Callable[[str], int]:
    """Return a reader of a whole number within these limits."""

    def read(value: str) -> int:
        if not (value.isdecimal() and least <= int(value) <= most):
            raise ValueError(f"must be a whole number from {least} to {most}")
        return int(value)

    return read


def positive(value: str) -> float:
    """Return a number above 0."""
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise ValueError("must be a number above 0")
    return number


def yes_or_no(value: str) -> bool:
    """Return whether the text is 1; it has to be 0 or 1."""
    if value not in ("0", "1"):
        raise ValueError("allowed are 0 and 1")
    return value == "1"


Result = TypeVar("Result")

_GRACE_S = 0.3  # for a call that ends at its own deadline
_OPENING_S = 30.0
_SETTING_S = 5.0
_TELLING_S = 3.0
_CLOSING_S = 2.0
_SILENT = "It is off, unplugged, or hangs; it is opened again once that call has ended"


class OpenCamera(Camera, ReportingCamera, Protocol):
    """An open camera, called in a thread of its own."""


# Abandoned calls by the camera's name; opening it again waits for them.
_left: dict[str, Caller] = {}


class BoundedCamera:
    """An open camera whose calls end in time."""

    def __init__(
        self,
        open_camera: Callable[[], OpenCamera],
        *,
        name: str,
        now_s: Callable[[], float] = time.monotonic,
        make_caller: Callable[[str], Caller] = Caller,
    ) -> None:
        self._open_camera, self._name, self._now_s, self._make_caller = open_camera, name, now_s, make_caller
        self._caller: Caller | None = None
        self._camera: OpenCamera | None = None
        self._is_closed = False
        self._busy_until_s = 0.0
        self._before = FrameTally()
        self._first_number = self._last_number = 0
        self._asked: tuple[float, float] | None = None
        self._settings: CameraSettings | None = None
        self._open(deadline_s=self._now_s() + _OPENING_S)
        self._identity = self._opened().identify()
        self._facts = self._opened().facts()

    def __enter__(self) -> "BoundedCamera":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        """Return the camera's identity, as read when it was opened."""
        self._refuse_closed()
        return self._identity

    def facts(self) -> CameraFacts:
        """Return the facts about its counts."""
        self._refuse_closed()
        return self._facts

    def tally(self) -> FrameTally:
        """Return the fate of the pictures so far, even of a lost camera."""
        return self._before if self._camera is None else self._before + self._camera.tally()

    def features(self) -> dict[str, str]:
        """Return the camera's settings and its own measurements."""
        self._refuse_closed()
        camera = self._here(deadline_s=self._now_s() + _TELLING_S)
        return self._call(camera.features, within_s=_TELLING_S, what="reading its features")

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        """Set exposure and gain; return the settings read back."""
        self._refuse_closed()
        camera = self._here(deadline_s=self._now_s() + _SETTING_S)
        self._settings = self._call(
            lambda: camera.configure(exposure_s=exposure_s, gain_db=gain_db), within_s=_SETTING_S, what="setting it"
        )
        self._asked = (exposure_s, gain_db)
        return self._settings

    def take_frame(self, *, timeout_s: float) -> Frame:
        """Return a picture whose exposure began after this call."""
        self._refuse_closed()
        deadline_s = self._now_s() + timeout_s
        camera = self._here(deadline_s=deadline_s)
        left_s = max(0.0, deadline_s - self._now_s())
        frame = self._call(
            lambda: camera.take_frame(timeout_s=left_s), within_s=left_s + _GRACE_S, what="taking a picture"
        )
        self._last_number = self._first_number + frame.sequence
        return frame if not self._first_number else replace(frame, sequence=self._last_number)

    def close(self) -> None:
        """Release the camera. May be called twice."""
        self._is_closed = True
        caller, camera = self._caller, self._camera
        if caller is None or camera is None:
            return
        self._before = self.tally()
        self._caller = self._camera = None
        try:
            # An interrupted call is allowed to end, so that the camera is free afterwards.
            caller.call(camera.close, within_s=_CLOSING_S + max(0.0, self._busy_until_s - self._now_s()))
        except DeviceError:
            pass  # the camera was being closed
        except LeftBehindError:
            _left[self._name] = caller
        caller.end(camera.close)

    def _refuse_closed(self) -> None:
        if self._is_closed:
            raise NotConnectedError(f"{self._name}: it was closed; open it again")

    def _opened(self) -> OpenCamera:
        if self._camera is None:
            raise NotConnectedError(f"{self._name}: the connection was given up")
        return self._camera

    def _here(self, *, deadline_s: float) -> OpenCamera:
        """Return the camera, opened again with its settings if it was abandoned."""
        if self._camera is None:
            self._open(deadline_s=deadline_s)
            self._restore(deadline_s=deadline_s)
        return self._opened()

    def _open(self, *, deadline_s: float) -> None:
        earlier = _left.get(self._name)
        if earlier is not None:
            if not earlier.has_ended(within_s=max(0.0, deadline_s - self._now_s())):
                raise NotConnectedError(f"{self._name}: a call to it has not ended yet. {_SILENT}")
            _left.pop(self._name, None)
        self._caller = self._make_caller(f"calls to {self._name}")
        within_s = max(0.0, deadline_s - self._now_s()) + _GRACE_S
        opened: list[OpenCamera] = []

        def open_and_note() -> OpenCamera:
            opened.append(self._open_camera())
            return opened[0]

        try:
            self._camera = self._caller.call(open_and_note, within_s=within_s)
        except LeftBehindError as error:
            self._leave(lambda: _close_all(opened))
            raise DeviceTimeoutError(f"{self._name}: opening it took too long. {_SILENT}") from error
        except BaseException:
            self._caller.end(_do_nothing)
            self._caller = None
            raise

    def _restore(self, *, deadline_s: float) -> None:
        """Restore the camera as it was before it was abandoned."""
        camera = self._opened()
        within_s = max(0.0, deadline_s - self._now_s()) + _GRACE_S
        if camera.identify() != self._identity:
            self.close()
            raise NotConnectedError(
                f"{self._name}: after opening it again it is {camera.identify()}; it was {self._identity}"
            )
        if self._asked is not None:
            exposure_s, gain_db = self._asked
            found = self._call(
                lambda: camera.configure(exposure_s=exposure_s, gain_db=gain_db), within_s=within_s, what="setting it"
            )
            if found != self._settings:
                raise LimitError(f"{self._name}: after opening it again it has {found} instead of {self._settings}")
        self._first_number = self._last_number
        self._before += FrameTally(reopened=1)

    def _call(self, job: Callable[[], Result], *, within_s: float, what: str) -> Result:
        if self._caller is None:
            raise NotConnectedError(f"{self._name}: the connection was given up")
        start_s = self._now_s()
        self._busy_until_s = start_s + within_s
        try:
            result = self._caller.call(job, within_s=within_s)
        except LeftBehindError as error:
            camera = self._opened()
            self._before = self.tally()
            self._camera = None
            self._leave(camera.close)
            waited_s = self._now_s() - start_s
            raise DeviceTimeoutError(f"{self._name}: {what}: no answer within {waited_s:.2g} s. {_SILENT}") from error
        except DeviceError:
            self._busy_until_s = 0.0
            raise
        self._busy_until_s = 0.0
        return result

    def _leave(self, last: Callable[[], None]) -> None:
        if self._caller is not None:
            _left[self._name] = self._caller
            self._caller.end(last)
            self._caller = None


def _do_nothing() -> None:
    """Do nothing: the last task of a thread."""


def _close_all(cameras: list[OpenCamera]) -> None:
    for camera in cameras:
        camera.close()


@dataclass(frozen=True, kw_only=True)
class Asked:
    """The moment of a request, by the host's monotonic clock and its time of day; a picture must begin after it."""

    monotonic_ns: int
    utc_ns: int
    error_ns: int = 0  #: the two clocks were read within this time of each other

    def was_clock_set(self, now: "Asked") -> bool:
        """Return whether the time of day has been set since then."""
        return abs((now.utc_ns - self.utc_ns) - (now.monotonic_ns - self.monotonic_ns)) > _CLOCK_STEP_NS


def asked_now(*, now_ns: Callable[[], int] = time.monotonic_ns, utc_ns: Callable[[], int] = time.time_ns) -> Asked:
    """Return this moment."""
    before_ns, utc, after_ns = now_ns(), utc_ns(), now_ns()
    # The earlier one, so that no requested exposure counts as older.
    return Asked(utc_ns=utc, monotonic_ns=before_ns, error_ns=after_ns - before_ns)
