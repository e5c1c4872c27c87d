"""The functions of libaravis 0.8 that the driver of GigE and USB3 cameras calls, through ctypes: no compiler."""

import ctypes
import ctypes.util
import os
from typing import Any

from drivers.errors import NotConnectedError

_POINTER, _TEXT = ctypes.c_void_p, ctypes.c_char_p
_INT, _UINT, _FLOAT = ctypes.c_int, ctypes.c_uint, ctypes.c_double
_INT64, _UINT64, _SIZE = ctypes.c_int64, ctypes.c_uint64, ctypes.c_size_t
_MISSING = (
    "GigE and USB3 Vision cameras need libaravis 0.8: `apt install libaravis-0.8-0` (Debian, Ubuntu), or set "
    "ARAVIS_LIBRARY to its path; a camera that has software of its own can be used through `files:FOLDER`"
)


class AravisError(Exception):
    """Words of libaravis on a call that failed.

    Attributes
    ----------
    is_of_device : bool
        The error comes from the link to the device; otherwise from the camera's own list of features.
    code : int
        Number within these errors.
    """

    def __init__(self, message: str, *, is_of_device: bool, code: int) -> None:
        super().__init__(message)
        self.is_of_device = is_of_device
        self.code = code


class _GError(ctypes.Structure):
    _fields_ = (("domain", ctypes.c_uint32), ("code", _INT), ("message", _TEXT))


_ERROR = ctypes.POINTER(_GError)
_DEVICE_ERRORS = b"arv-device-error-quark"

# Name -> type of the result and types of the arguments. These tell failures through a GError.
_FALLIBLE: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "camera_new": (_POINTER, (_TEXT,)),
    "camera_create_stream": (_POINTER, (_POINTER, _POINTER, _POINTER)),
    "camera_get_payload": (_UINT, (_POINTER,)),
    "camera_start_acquisition": (None, (_POINTER,)),
    "camera_stop_acquisition": (None, (_POINTER,)),
    "camera_gv_set_packet_size": (None, (_POINTER, _INT)),
    "camera_gv_get_packet_size": (_UINT, (_POINTER,)),
    "camera_gv_set_packet_delay": (None, (_POINTER, _INT64)),
    "camera_gv_get_packet_delay": (_INT64, (_POINTER,)),
    "device_is_feature_available": (_INT, (_POINTER, _TEXT)),
    "device_execute_command": (None, (_POINTER, _TEXT)),
    "device_get_boolean_feature_value": (_INT, (_POINTER, _TEXT)),
    "device_set_boolean_feature_value": (None, (_POINTER, _TEXT, _INT)),
    "device_get_integer_feature_value": (_INT64, (_POINTER, _TEXT)),
    "device_set_integer_feature_value": (None, (_POINTER, _TEXT, _INT64)),
    "device_get_integer_feature_bounds": (
        None,
        (_POINTER, _TEXT, ctypes.POINTER(_INT64), ctypes.POINTER(_INT64)),
    ),
    "device_get_float_feature_value": (_FLOAT, (_POINTER, _TEXT)),
    "device_set_float_feature_value": (None, (_POINTER, _TEXT, _FLOAT)),
    "device_get_float_feature_bounds": (
        None,
        (_POINTER, _TEXT, ctypes.POINTER(_FLOAT), ctypes.POINTER(_FLOAT)),
    ),
    "device_get_string_feature_value": (_TEXT, (_POINTER, _TEXT)),
    "device_set_string_feature_value": (None, (_POINTER, _TEXT, _TEXT)),
    "device_dup_available_enumeration_feature_values_as_strings": (
        _POINTER,
        (_POINTER, _TEXT, ctypes.POINTER(_UINT)),
    ),
}
# These cannot fail.
_SURE: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "enable_interface": (None, (_TEXT,)),
    "update_device_list": (None, ()),
    "get_n_devices": (_UINT, ()),
    "get_device_id": (_TEXT, (_UINT,)),
    "get_device_model": (_TEXT, (_UINT,)),
    "get_device_serial_nbr": (_TEXT, (_UINT,)),
    "get_device_address": (_TEXT, (_UINT,)),
    "get_device_protocol": (_TEXT, (_UINT,)),
    "camera_get_device": (_POINTER, (_POINTER,)),
    "camera_is_gv_device": (_INT, (_POINTER,)),
    "camera_gv_set_stream_options": (None, (_POINTER, _INT)),
    "device_set_range_check_policy": (None, (_POINTER, _INT)),
    "device_set_access_check_policy": (None, (_POINTER, _INT)),
    "gv_device_is_controller": (_INT, (_POINTER,)),
    "buffer_new": (_POINTER, (_SIZE, _POINTER)),
    "buffer_get_status": (_INT, (_POINTER,)),
    "buffer_get_data": (_POINTER, (_POINTER, ctypes.POINTER(_SIZE))),
    "buffer_get_image_width": (_INT, (_POINTER,)),
    "buffer_get_image_height": (_INT, (_POINTER,)),
    "buffer_get_image_pixel_format": (ctypes.c_uint32, (_POINTER,)),
    "buffer_get_frame_id": (_UINT64, (_POINTER,)),
    "buffer_get_system_timestamp": (_UINT64, (_POINTER,)),
    "buffer_get_timestamp": (_UINT64, (_POINTER,)),
    "stream_push_buffer": (None, (_POINTER, _POINTER)),
    "stream_try_pop_buffer": (_POINTER, (_POINTER,)),
    "stream_timeout_pop_buffer": (_POINTER, (_POINTER, _UINT64)),
    "stream_get_info_uint64_by_name": (_UINT64, (_POINTER, _TEXT)),
}


class AravisLibrary:
    """The library, loaded; `load_aravis` makes one."""

    def __init__(self, aravis: ctypes.CDLL, gobject: ctypes.CDLL, glib: ctypes.CDLL) -> None:
        self._gobject, self._glib = gobject, glib
        gobject.g_object_unref.argtypes = [_POINTER]
        glib.g_error_free.argtypes = [_POINTER]
        glib.g_free.argtypes = [_POINTER]
        glib.g_quark_to_string.argtypes, glib.g_quark_to_string.restype = [ctypes.c_uint32], _TEXT
        self._functions: dict[str, Any] = {}
        for name, (result, arguments) in _SURE.items():
            self._functions[name] = _declared(aravis, name, result, arguments)
        for name, (result, arguments) in _FALLIBLE.items():
            self._functions[name] = _declared(aravis, name, result, (*arguments, ctypes.POINTER(_ERROR)))

    def call(self, name: str, *arguments: Any) -> Any:
        """Return what the function ``arv_<name>`` returns.

        Raises
        ------
        AravisError
            The library tells a failure.
        """
        if name in _SURE:
            return self._functions[name](*arguments)
        error = _ERROR()
        result = self._functions[name](*arguments, ctypes.byref(error))
        if error:
            raise self._taken(error)
        return result

    def set_integer_property(self, instance: int, name: bytes, value: int) -> None:
        """Set an integer property of an object of the library."""
        self._gobject.g_object_set(_POINTER(instance), name, _INT(value), None)

    def release(self, instance: int) -> None:
        """Give up a reference to an object of the library."""
        self._gobject.g_object_unref(instance)

    def texts_of(self, array: int, count: int) -> list[str]:
        """Return an array of texts that belong to the library, and free the array."""
        texts = ctypes.cast(array, ctypes.POINTER(_TEXT))[:count]
        self._glib.g_free(array)
        return [text.decode() for text in texts if text is not None]

    def _taken(self, error: Any) -> AravisError:
        content = error.contents
        taken = AravisError(
            (content.message or b"no message").decode(errors="replace"),
            is_of_device=self._glib.g_quark_to_string(content.domain) == _DEVICE_ERRORS,
            code=content.code,
        )
        self._glib.g_error_free(error)
        return taken


def load_aravis() -> AravisLibrary:
    """Return libaravis, from where ARAVIS_LIBRARY says or from where the system has it.

    Raises
    ------
    NotConnectedError
        The library is not installed; the text names its package.
    """
    stated = os.environ.get("ARAVIS_LIBRARY")
    name = stated or "libaravis-0.8.so.0"
    try:
        aravis = ctypes.CDLL(name)
    except OSError as error:
        found = None if stated else ctypes.util.find_library("aravis-0.8")
        if found is None:
            raise NotConnectedError(f"{_MISSING} ({error})") from error
        aravis = ctypes.CDLL(found)
    return AravisLibrary(aravis, ctypes.CDLL("libgobject-2.0.so.0"), ctypes.CDLL("libglib-2.0.so.0"))


def _declared(aravis: ctypes.CDLL, name: str, result: Any, arguments: tuple[Any, ...]) -> Any:
    function = getattr(aravis, f"arv_{name}")
    function.restype, function.argtypes = result, list(arguments)
    return function
