"""The temperature of a camera that tells it."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from drivers.interfaces import Camera
from rigctl.session.session_clock import SessionClock
from rigctl.utc_time import NS_PER_S

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
