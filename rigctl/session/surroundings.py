"""Looks between two frames at the host's clock and disk and at the camera's temperature."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol, runtime_checkable

from drivers.interfaces import Camera
from rigctl.console.terminal import warn
from rigctl.numbers.utc_time import NS_PER_S
from rigctl.runs.run_events import HOST_CLOCK_EVENT
from rigctl.session.guard import Guard
from rigctl.session.interlocks import (
    InterlockViolation,
    clock_violation,
    disk_shortage,
    disk_violation,
    synchronised_violation,
    temperature_violation,
)
from rigctl.session.session_clock import SessionClock, SteadyUtc

# As GenICam names them; that of the sensor itself first.
_FEATURES = ("SensorTemperature", "DeviceTemperature")
# A camera warms up within minutes, and each reading is a question over the network.
_EACH_S = 10.0


@runtime_checkable
class TellsFeatures(Protocol):
    """A camera that tells more of itself than every camera has to."""

    def features(self) -> Mapping[str, str]:
        """Return what it is set to and what it measures, under its own names."""


class Thermometer:
    """Asks a camera for its temperature now and then.

    Parameters
    ----------
    camera : Camera
        Any.
    clock : SessionClock
        For "now and then".
    """

    def __init__(self, camera: Camera, clock: SessionClock) -> None:
        self._camera, self._clock = camera, clock
        self._read_ns: int | None = None
        self._temperature_c: float | None = None

    def temperature_c(self) -> float | None:
        """Return the temperature by the last reading, ten seconds old at most [deg C]; None if it tells none.

        Raises
        ------
        DeviceError
            The camera does not answer.
        """
        now_ns = self._clock.monotonic_ns()
        if self._read_ns is None or now_ns - self._read_ns >= _EACH_S * NS_PER_S:
            self._read_ns, self._temperature_c = now_ns, self._read_c()
        return self._temperature_c

    def _read_c(self) -> float | None:
        if not isinstance(self._camera, TellsFeatures):
            return None
        told = self._camera.features()
        return next((float(told[name]) for name in _FEATURES if name in told), None)


# A frame has room for some remarks only; the events have all of them.
_MOST_REMARKS = 5


class Surroundings:
    """Looks around, and remembers what frames have to say of it.

    Parameters
    ----------
    run : Path
        The run folder.
    guard : Guard
        Does something about what is found.
    utc : SteadyUtc
        Finds out when the host's clock is set.
    thermometer : Thermometer
        Of the camera.
    note : callable
        Notes an event: its name, and facts by keyword.

    Attributes
    ----------
    remarks : tuple of str
        For every frame from here on.
    """

    def __init__(
        self, run: Path, guard: Guard, utc: SteadyUtc, thermometer: Thermometer, *, note: Callable[..., None]
    ) -> None:
        self._note = note
        self._run, self._guard, self._utc, self._thermometer = run, guard, utc, thermometer
        self._is_temperature_off = False
        self.remarks: tuple[str, ...] = ()

    def look_first(self, clock: SessionClock) -> None:
        """Look at what does not change in the middle of a session."""
        self._note(HOST_CLOCK_EVENT, utc_error_s=clock.utc_error_s())
        for violation in self._guard.watched(filter(None, [synchronised_violation(clock.problem())])):
            self._guard.react(violation, cleared=lambda: clock.problem() is None)

    def look_ahead(self, frames: int, *, frame_bytes: int) -> None:
        """Tell of a disk that will be full before so many frames are on it; they are taken as long as there is room."""
        short = disk_shortage(self._run, frames=frames, frame_bytes=frame_bytes, section=self._guard.locks)
        if short is not None:
            warn(short)
            self._note("disk is short", found=short)

    def look(self) -> None:
        """Look around.

        Raises
        ------
        DeviceError, DataError
            An interlock stops the session, or the camera does not answer.
        StopAskedError
            Somebody asked to stop while it held.
        """
        locks = self._guard.locks
        jump = clock_violation(self._utc.jump_s(), locks)
        for violation in self._guard.watched(filter(None, [jump])):
            self.remarks = (*self.remarks, violation.message)[-_MOST_REMARKS:]
            self._guard.react(violation, cleared=lambda: False)
        self._react_while(lambda: disk_violation(self._run, locks))
        self._look_at_temperature()

    def _look_at_temperature(self) -> None:
        def now() -> InterlockViolation | None:
            return temperature_violation(self._thermometer.temperature_c(), self._guard.locks)

        was_off, self._is_temperature_off = self._is_temperature_off, now() is not None
        if self._is_temperature_off and not was_off:
            self._react_while(now)

    def _react_while(self, find: Callable[[], InterlockViolation | None]) -> None:
        for violation in self._guard.watched(filter(None, [find()])):
            self._guard.react(violation, cleared=lambda: find() is None)
