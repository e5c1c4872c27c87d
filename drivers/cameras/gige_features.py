"""The features of a GenICam camera by name: written, read back, and what was used written down."""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.cameras.aravis_library import AravisError, AravisLibrary
from drivers.errors import DeviceError, DeviceTimeoutError, LimitError, NotConnectedError, ProtocolError

_ON = 1
_TIMEOUT, _NOT_CONNECTED, _NOT_FOUND, _NOT_CONTROLLER = 5, 2, 6, 10
_OF_THE_LINK = (_TIMEOUT, _NOT_CONNECTED, _NOT_FOUND, _NOT_CONTROLLER)


class GigeFeatures:
    """The features of one open camera.

    Parameters
    ----------
    library : AravisLibrary
        The library.
    device : int
        Its device, which whoever opened it keeps open.
    name : str
        What messages call the camera.

    Attributes
    ----------
    used : dict
        Value as text of every feature that was written, under the camera's own name of it.
    """

    def __init__(self, library: AravisLibrary, device: int, *, name: str) -> None:
        self._library, self._device, self._name = library, device, name
        self.used: dict[str, str] = {}
        self._numbers: dict[str, bool] = {}
        # Without these, values out of range are taken, and read back as if they had been taken.
        library.call("device_set_range_check_policy", device, _ON)
        library.call("device_set_access_check_policy", device, _ON)

    def has(self, feature: str) -> bool:
        """Return whether the camera has this feature, and it can be used now."""
        with self.told(feature):
            return bool(self._library.call("device_is_feature_available", self._device, feature.encode()))

    def first_of(self, *features: str) -> str | None:
        """Return the first of these that the camera has."""
        return next((feature for feature in features if self.has(feature)), None)

    def text(self, feature: str) -> str:
        """Read a text or the entry of a list."""
        with self.told(feature):
            found = self._library.call("device_get_string_feature_value", self._device, feature.encode())
        return str(found.decode(errors="replace")) if found is not None else ""

    def number(self, feature: str) -> float:
        """Read a number that may be broken; some cameras have a whole number where the standard has this."""
        if self._is_counted(feature):
            return float(self.whole(feature))
        with self.told(feature):
            return float(self._library.call("device_get_float_feature_value", self._device, feature.encode()))

    def whole(self, feature: str) -> int:
        """Read a whole number, or the number of a list's entry."""
        with self.told(feature):
            return int(self._library.call("device_get_integer_feature_value", self._device, feature.encode()))

    def truth(self, feature: str) -> bool:
        """Read a yes or no."""
        with self.told(feature):
            return bool(self._library.call("device_get_boolean_feature_value", self._device, feature.encode()))

    def entries(self, feature: str) -> list[str]:
        """Return what a list can be set to."""
        count = ctypes.c_uint()
        with self.told(feature):
            array = self._library.call(
                "device_dup_available_enumeration_feature_values_as_strings",
                self._device,
                feature.encode(),
                ctypes.byref(count),
            )
        return self._library.texts_of(array, count.value)

    def whole_limits(self, feature: str) -> tuple[int, int]:
        """Return the smallest and largest value of a whole number."""
        low, high = ctypes.c_int64(), ctypes.c_int64()
        with self.told(feature):
            self._library.call(
                "device_get_integer_feature_bounds",
                self._device,
                feature.encode(),
                ctypes.byref(low),
                ctypes.byref(high),
            )
        return low.value, high.value

    def number_limits(self, feature: str) -> tuple[float, float]:
        """Return the smallest and largest value of a number."""
        if self._is_counted(feature):
            least, most = self.whole_limits(feature)
            return float(least), float(most)
        low, high = ctypes.c_double(), ctypes.c_double()
        with self.told(feature):
            self._library.call(
                "device_get_float_feature_bounds",
                self._device,
                feature.encode(),
                ctypes.byref(low),
                ctypes.byref(high),
            )
        return low.value, high.value

    def set_text(self, feature: str, value: str) -> None:
        """Set a list to an entry; refuse it if the camera then has another one."""
        with self.told(feature):
            self._library.call("device_set_string_feature_value", self._device, feature.encode(), value.encode())
        self._require(feature, asked=value, found=self.text(feature))

    def set_whole(self, feature: str, value: int) -> None:
        """Set a whole number; refuse it if the camera then has another one."""
        with self.told(feature):
            self._library.call("device_set_integer_feature_value", self._device, feature.encode(), value)
        self._require(feature, asked=value, found=self.whole(feature))

    def set_truth(self, feature: str, value: bool) -> None:
        """Set a yes or no; refuse it if the camera then has the other."""
        with self.told(feature):
            self._library.call("device_set_boolean_feature_value", self._device, feature.encode(), int(value))
        self._require(feature, asked=value, found=self.truth(feature))

    def set_number(self, feature: str, value: float, *, relative: float) -> float:
        """Set a number; return what the camera took, which may be this much off: cameras count in steps."""
        with self.told(feature):
            if self._is_counted(feature):
                self._library.call("device_set_integer_feature_value", self._device, feature.encode(), round(value))
            else:
                self._library.call("device_set_float_feature_value", self._device, feature.encode(), value)
        found = self.number(feature)
        if abs(found - value) > relative * abs(value):
            self._require(feature, asked=value, found=found)
        self.used[feature] = f"{found:.10g}"
        return found

    def execute(self, feature: str) -> None:
        """Run a command of the camera."""
        with self.told(feature):
            self._library.call("device_execute_command", self._device, feature.encode())

    @contextmanager
    def told(self, what: str) -> Iterator[None]:
        """Turn what the library says into an error of the drivers."""
        try:
            yield
        except AravisError as error:
            raise device_error(error, name=self._name, what=what) from error

    def _is_counted(self, feature: str) -> bool:
        """Return whether a number is a whole one: the library reads each kind by a function of its own."""
        if feature in self._numbers:
            return self._numbers[feature]
        try:
            self._library.call("device_get_float_feature_value", self._device, feature.encode())
            self._numbers[feature] = False
        except AravisError as error:
            if error.is_of_device and error.code in _OF_THE_LINK:
                raise device_error(error, name=self._name, what=feature) from error
            self._numbers[feature] = self._reads_whole(feature)
        return self._numbers[feature]

    def _reads_whole(self, feature: str) -> bool:
        try:
            self._library.call("device_get_integer_feature_value", self._device, feature.encode())
        except AravisError:
            return False
        return True

    def _require(self, feature: str, *, asked: object, found: object) -> None:
        if asked != found:
            raise LimitError(
                f"{self._name}: {feature} was set to {asked}, and it has {found} now; ask for that instead"
            )
        self.used[feature] = str(found)


def device_error(error: AravisError, *, name: str, what: str) -> DeviceError:
    """Return the error of the drivers that an error of the library stands for."""
    text = f"{name}: {what}: {error}"
    if not error.is_of_device:
        return LimitError(text)
    if error.code == _TIMEOUT:
        return DeviceTimeoutError(f"{text}. The camera is off, hangs, or another program controls it")
    if error.code == _NOT_CONTROLLER:
        return NotConnectedError(f"{text}. Another program controls the camera: close that one first")
    if error.code in (_NOT_CONNECTED, _NOT_FOUND):
        return NotConnectedError(f"{text}. Check power, cable and address; `rigctl doctor` tells about the network")
    return ProtocolError(text)
