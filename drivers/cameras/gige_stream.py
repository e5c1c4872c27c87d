"""The stream of pictures from a GigE Vision camera: buffers lent to libaravis, and got back filled."""

import ctypes
from dataclasses import dataclass

from drivers.cameras.aravis_library import AravisError, AravisLibrary
from drivers.cameras.gige_features import device_error
from drivers.errors import NotConnectedError

_BUFFERS = 8
_NO_PACKET_SOCKET = 1
_SOCKET_BUFFER_FIXED = 0
_PICTURES_IN_SOCKET = 2
_LEAST_SOCKET_BYTES = 2**20
_SUCCESS = 0
_STATUS = {
    1: "cleared",
    2: "timeout",
    3: "missing packets",
    4: "wrong packet number",
    5: "size mismatch",
    7: "aborted",
    8: "kind of payload not supported",
}


@dataclass(frozen=True, kw_only=True)
class Received:
    """A picture as it came in.

    Attributes
    ----------
    first_packet_utc_ns : int
        When its first packet came in, by the host's clock [ns since 1970, UTC].
    damage : str or None
        What is wrong with it; None for a picture that is complete. A damaged one has nothing else.
    data : bytes
        Its bytes.
    width, height, pixel_format_code : int
        What it says of itself.
    frame_id : int
        The camera's number of it.
    """

    first_packet_utc_ns: int
    damage: str | None = None
    data: bytes = b""
    width: int = 0
    height: int = 0
    pixel_format_code: int = 0
    frame_id: int = 0


class GigeStream:
    """A stream of one camera, which is started and stopped with the camera's acquisition."""

    def __init__(self, library: AravisLibrary, camera: int, *, name: str) -> None:
        self._library, self._camera, self._name = library, camera, name
        # The ordinary socket: the packet socket is root's only, and on some interfaces it receives nothing.
        library.call("camera_gv_set_stream_options", camera, _NO_PACKET_SOCKET)
        try:
            self._stream: int | None = library.call("camera_create_stream", camera, None, None)
            payload_bytes = library.call("camera_get_payload", camera)
        except AravisError as error:
            raise device_error(error, name=name, what="stream") from error
        if not self._stream:
            raise NotConnectedError(f"{name}: no stream of pictures could be made; is another program using it?")
        # The system's own size holds half a picture, and the library's automatic one is too small for small pictures.
        # What is asked for here is granted up to net.core.rmem_max.
        size_bytes = max(_PICTURES_IN_SOCKET * payload_bytes, _LEAST_SOCKET_BYTES)
        library.set_integer_property(self._opened(), b"socket-buffer", _SOCKET_BUFFER_FIXED)
        library.set_integer_property(self._opened(), b"socket-buffer-size", size_bytes)
        for _ in range(_BUFFERS):
            library.call("stream_push_buffer", self._stream, library.call("buffer_new", payload_bytes, None))

    def start(self) -> None:
        """Start the camera's acquisition."""
        self._call("camera_start_acquisition")

    def stop(self) -> None:
        """Stop the camera's acquisition."""
        self._call("camera_stop_acquisition")

    def drain(self) -> int:
        """Give back all pictures that are waiting; return how many they were."""
        drained = 0
        while buffer := self._library.call("stream_try_pop_buffer", self._opened()):
            self._library.call("stream_push_buffer", self._opened(), buffer)
            drained += 1
        return drained

    def receive(self, *, timeout_s: float) -> Received | None:
        """Return the next picture, damaged or not; None if none came in time."""
        stream = self._opened()
        buffer = self._library.call("stream_timeout_pop_buffer", stream, int(max(0.0, timeout_s) * 1e6))
        if not buffer:
            return None
        try:
            return self._read(buffer)
        finally:
            self._library.call("stream_push_buffer", stream, buffer)

    def close(self) -> None:
        """Give up the stream. May be called twice."""
        if self._stream is not None:
            self._library.release(self._stream)
            self._stream = None

    def _read(self, buffer: int) -> Received:
        status = self._library.call("buffer_get_status", buffer)
        if status != _SUCCESS:
            return Received(
                damage=_STATUS.get(status, f"status {status}"),
                first_packet_utc_ns=self._library.call("buffer_get_system_timestamp", buffer),
            )
        size = ctypes.c_size_t()
        data = self._library.call("buffer_get_data", buffer, ctypes.byref(size))
        return Received(
            data=ctypes.string_at(data, size.value) if data else b"",
            width=self._library.call("buffer_get_image_width", buffer),
            height=self._library.call("buffer_get_image_height", buffer),
            pixel_format_code=self._library.call("buffer_get_image_pixel_format", buffer),
            frame_id=self._library.call("buffer_get_frame_id", buffer),
            first_packet_utc_ns=self._library.call("buffer_get_system_timestamp", buffer),
        )

    def _call(self, name: str) -> None:
        try:
            self._library.call(name, self._camera)
        except AravisError as error:
            raise device_error(error, name=self._name, what=name.removeprefix("camera_")) from error

    def _opened(self) -> int:
        if self._stream is None:
            raise ValueError(f"{self._name}: the stream was closed")
        return self._stream
