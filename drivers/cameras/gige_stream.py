"""The stream of pictures from a GigE or USB3 Vision camera: buffers lent to libaravis, and got back filled."""

import ctypes
from dataclasses import dataclass

from drivers.cameras.aravis_library import AravisError, AravisLibrary
from drivers.cameras.gige_features import device_error
from drivers.errors import NotConnectedError
from drivers.network_path import interface_of, largest_receive_buffer, path_mtu

_BUFFERS = 8
_NO_PACKET_SOCKET = 1
_SOCKET_BUFFER_FIXED = 0
_PICTURES_IN_SOCKET = 2
_LEAST_SOCKET_BYTES = 2**20
_HEADER_BYTES, _FIRST_AND_LAST = 36, 2  # of a packet: IP, UDP, GVSP; packets of a picture without pixels
_COUNTED = (b"n_completed_buffers", b"n_failures", b"n_missing_packets", b"n_resent_packets")
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
    stamp_ns : int or None
        Its time by the camera's own clock; None where it bears none [ns].
    """

    first_packet_utc_ns: int
    damage: str | None = None
    data: bytes = b""
    width: int = 0
    height: int = 0
    pixel_format_code: int = 0
    frame_id: int = 0
    stamp_ns: int | None = None


@dataclass(frozen=True, kw_only=True)
class PacketCounts:
    """Packets of pictures that were looked at, how many of them were lost, and how many came when asked for again."""

    seen: int = 0
    lost: int = 0
    resent: int = 0

    def __add__(self, other: "PacketCounts") -> "PacketCounts":
        return PacketCounts(seen=self.seen + other.seen, lost=self.lost + other.lost, resent=self.resent + other.resent)


class GigeStream:
    """A stream of one camera, which is started and stopped with the camera's acquisition.

    Parameters
    ----------
    library : AravisLibrary
        The library.
    camera : int
        Its camera.
    name : str
        What messages call the camera.
    packet_size : int or None
        Bytes of a packet with all its headers, of a camera on the network; None: of another one.
    """

    def __init__(self, library: AravisLibrary, camera: int, *, name: str, packet_size: int | None) -> None:
        self._library, self._camera, self._name = library, camera, name
        if packet_size is not None:
            # The ordinary socket: the packet socket is root's only, and on some interfaces it receives nothing.
            library.call("camera_gv_set_stream_options", camera, _NO_PACKET_SOCKET)
        try:
            self._stream: int | None = library.call("camera_create_stream", camera, None, None)
            payload_bytes = library.call("camera_get_payload", camera)
        except AravisError as error:
            raise device_error(error, name=name, what="stream") from error
        if not self._stream:
            raise NotConnectedError(f"{name}: no stream of pictures could be made; is another program using it?")
        self._packets_a_picture = 0
        if packet_size is not None:
            # The system's own size holds half a picture, and the library's automatic one is too small for small
            # pictures. What is asked for here is granted up to net.core.rmem_max.
            size_bytes = max(_PICTURES_IN_SOCKET * payload_bytes, _LEAST_SOCKET_BYTES)
            library.set_integer_property(self._opened(), b"socket-buffer", _SOCKET_BUFFER_FIXED)
            library.set_integer_property(self._opened(), b"socket-buffer-size", size_bytes)
            self._packets_a_picture = -(-payload_bytes // (packet_size - _HEADER_BYTES)) + _FIRST_AND_LAST
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

    def packets(self) -> PacketCounts:
        """Return what became of the packets since the stream was made; nothing of a camera that sends none.

        Notes
        -----
        Of a picture that stays incomplete, libaravis calls everything missing that stands behind the first gap: so
        each such picture is looked at up to its gap, and shows one loss.
        """
        if not self._packets_a_picture or self._stream is None:
            return PacketCounts()
        complete, incomplete, behind_gap, resent = (
            int(self._library.call("stream_get_info_uint64_by_name", self._stream, name)) for name in _COUNTED
        )
        seen = (complete + incomplete) * self._packets_a_picture - behind_gap + incomplete
        return PacketCounts(seen=max(0, seen), lost=incomplete + resent, resent=resent)

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
        arrived_ns = self._library.call("buffer_get_system_timestamp", buffer)
        stamp_ns = self._library.call("buffer_get_timestamp", buffer)
        return Received(
            data=ctypes.string_at(data, size.value) if data else b"",
            width=self._library.call("buffer_get_image_width", buffer),
            height=self._library.call("buffer_get_image_height", buffer),
            pixel_format_code=self._library.call("buffer_get_image_pixel_format", buffer),
            frame_id=self._library.call("buffer_get_frame_id", buffer),
            first_packet_utc_ns=arrived_ns,
            # Where the camera tells no frequency of its clock, the library gives the time of arrival for both.
            stamp_ns=None if stamp_ns in (0, arrived_ns) else stamp_ns,
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


def loss_told(counts: PacketCounts, *, address: str, packet_size: int) -> str:
    """Return what was measured of the way to a camera, and what to try, as one sentence or two."""
    share = counts.lost / counts.seen if counts.seen else 0.0
    again = (
        f"{counts.resent} of them came when asked for again" if counts.resent else "the camera sends none of them again"
    )
    facts = (
        f"packets of {packet_size} bytes, MTU {path_mtu(address)}, interface {interface_of(address)}, receive buffers "
        f"up to {largest_receive_buffer()} bytes"
    )
    return (
        f"The network loses {100 * share:.2g} %: {counts.lost} of {counts.seen} packets, {again} ({facts}). Raise the "
        "receive buffer, check cable and switch, let nothing else use the interface; `rigctl doctor` measures it"
    )
