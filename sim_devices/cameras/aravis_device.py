"""libaravis's own GigE Vision device: it answers on the network, and asks Python for every picture."""

import ctypes
import socket
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from drivers.errors import NotConnectedError

_POINTER, _TEXT = ctypes.c_void_p, ctypes.c_char_p
_FILL = ctypes.CFUNCTYPE(None, _POINTER, _POINTER, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32)
_FUNCTIONS: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "arv_fake_camera_new": (_POINTER, (_TEXT,)),
    "arv_fake_camera_get_genicam_xml": (_POINTER, (_POINTER, ctypes.POINTER(ctypes.c_size_t))),
    "arv_fake_camera_write_register": (ctypes.c_int, (_POINTER, ctypes.c_uint32, ctypes.c_uint32)),
    "arv_fake_camera_read_register": (
        ctypes.c_int,
        (_POINTER, ctypes.c_uint32, ctypes.POINTER(ctypes.c_uint32)),
    ),
    "arv_fake_camera_set_trigger_frequency": (None, (_POINTER, ctypes.c_double)),
    "arv_fake_camera_set_fill_pattern": (None, (_POINTER, _FILL, _POINTER, _POINTER)),
    "arv_gv_fake_camera_new_full": (_POINTER, (_TEXT, _TEXT, _TEXT)),
    "arv_gv_fake_camera_is_running": (ctypes.c_int, (_POINTER,)),
    "arv_gv_fake_camera_get_fake_camera": (_POINTER, (_POINTER,)),
    "arv_buffer_get_data": (_POINTER, (_POINTER, ctypes.POINTER(ctypes.c_size_t))),
    "arv_buffer_get_image_width": (ctypes.c_int, (_POINTER,)),
    "arv_buffer_get_image_height": (ctypes.c_int, (_POINTER,)),
}

# How often the device looks whether it was triggered; its own 25 would make every picture wait 20 ms in the mean.
_TRIGGER_LOOKS_HZ = 1000.0
_CONTROL_PORT = 3956
_CAPABILITY, _RESEND_CAPABILITY = 0x0934, 0x4  # what it can beyond the standard's least

Fill = Callable[[int, int, int, int, int], bytes]
"""Width, height, exposure [us], gain [dB] and pixel format in; the bytes of a picture out."""


class AravisDevice:
    """A device on the network, off at first.

    Parameters
    ----------
    address : str
        Of one of this machine's interfaces. One device an address: the standard fixes the port, 3956.
    serial_number : str
        At most 15 letters.
    edit_features : callable
        Makes the device's list of features (GenICam XML) out of the library's own.
    fill : callable
        Makes a picture. It is called in a thread of the library. What it raises is kept in `failures`, and such
        pictures are what their buffer held before.

    Raises
    ------
    NotConnectedError
        libaravis is not installed.
    """

    def __init__(self, *, address: str, serial_number: str, edit_features: Callable[[str], str], fill: Fill) -> None:
        self._library, self._gobject = _load()
        self.address, self._serial_number = address, serial_number
        self._resends = False
        self._features = edit_features(_own_features(self._library))
        self.failures: list[Exception] = []
        self._callback = _callback(self._library, fill, self.failures)
        self._camera: int | None = None
        # Power comes and goes in one thread while another one asks.
        self._lock = threading.RLock()

    def power_up(self) -> None:
        """Answer on the network, with every register as the library has it.

        Raises
        ------
        NotConnectedError
            The address is not this machine's or in use.
        """
        with self._lock:
            _refuse_taken(self.address)
            self._camera = self._new_camera()
            registers = self._registers()
            self._library.arv_fake_camera_set_trigger_frequency(registers, _TRIGGER_LOOKS_HZ)
            self._library.arv_fake_camera_set_fill_pattern(registers, self._callback, None, None)
            self.promise_resends(self._resends)

    def power_down(self) -> None:
        """Answer no more; not to be called from within `fill`, whose thread ends first. May be called twice."""
        with self._lock:
            camera, self._camera = self._camera, None
        if camera is not None:
            self._gobject.g_object_unref(camera)

    def write_register(self, address: int, value: int) -> None:
        """Set a register behind the back of whoever controls the device."""
        with self._lock:
            self._library.arv_fake_camera_write_register(self._registers(), address, value)

    def read_register(self, address: int) -> int:
        """Return what a register holds; 0 of a device without power."""
        with self._lock:
            if self._camera is None:
                return 0
            value = ctypes.c_uint32()
            self._library.arv_fake_camera_read_register(self._registers(), address, ctypes.byref(value))
            return value.value

    def promise_resends(self, resends: bool) -> None:
        """Say from now on whether lost packets are sent again; whoever stands before the device sees to it."""
        self._resends = resends
        self.write_register(_CAPABILITY, _RESEND_CAPABILITY if resends else 0)

    def lose_packets(self, share: float) -> None:
        """Leave out this share of the packets of pictures until the power goes."""
        with self._lock:
            if self._camera is not None:
                self._gobject.g_object_set(_POINTER(self._camera), b"gvsp-lost-ratio", ctypes.c_double(share), None)

    def _registers(self) -> int:
        if self._camera is None:
            raise NotConnectedError(f"the simulated GigE camera on {self.address} has no power")
        registers: int = self._library.arv_gv_fake_camera_get_fake_camera(self._camera)
        return registers

    def _new_camera(self) -> int:
        with tempfile.TemporaryDirectory(prefix="rigctl-") as folder:
            features = Path(folder) / "features.xml"
            features.write_text(self._features, encoding="utf-8")
            camera: int = self._library.arv_gv_fake_camera_new_full(
                self.address.encode(), self._serial_number.encode(), str(features).encode()
            )
        if not self._library.arv_gv_fake_camera_is_running(camera):
            self._gobject.g_object_unref(camera)
            raise NotConnectedError(f"no GigE camera can be served on {self.address}: the library does not say why")
        return camera


def _refuse_taken(address: str) -> None:
    """Refuse an address that somebody listens on: the library would listen there too, and both would answer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((address, _CONTROL_PORT))
        except OSError as error:
            raise NotConnectedError(
                f"no GigE camera can be served on {address}, port {_CONTROL_PORT}: {error.strerror}. It has to be an "
                "address of this machine, with no other camera on it"
            ) from error


def _callback(library: ctypes.CDLL, fill: Fill, failures: list[Exception]) -> Any:
    def fill_buffer(buffer: int, _: int, exposure_us: int, gain: int, pixel_format: int) -> None:
        width = library.arv_buffer_get_image_width(buffer)
        height = library.arv_buffer_get_image_height(buffer)
        try:
            picture = fill(width, height, exposure_us, gain, pixel_format)
        except Exception as error:  # must not get into the library, which would end the program
            failures.append(error)
            return
        room = width * height * (pixel_format >> 16 & 0xFF) // 8
        ctypes.memmove(library.arv_buffer_get_data(buffer, None), picture, min(len(picture), room))

    return _FILL(fill_buffer)


def _load() -> tuple[ctypes.CDLL, ctypes.CDLL]:
    try:
        library, gobject = ctypes.CDLL("libaravis-0.8.so.0"), ctypes.CDLL("libgobject-2.0.so.0")
    except OSError as error:
        raise NotConnectedError(
            f"a simulated GigE camera needs libaravis 0.8: `apt install libaravis-0.8-0` ({error})"
        ) from error
    for name, (result, arguments) in _FUNCTIONS.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, list(arguments)
    gobject.g_object_unref.argtypes = [_POINTER]
    return library, gobject


def _own_features(library: ctypes.CDLL) -> str:
    size = ctypes.c_size_t()
    probe = library.arv_fake_camera_new(b"probe")
    xml = ctypes.string_at(library.arv_fake_camera_get_genicam_xml(probe, ctypes.byref(size)), size.value)
    return xml.rstrip(b"\0").decode()
