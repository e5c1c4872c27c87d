"""A camera behind Linux's video interface (V4L2), straight through its requests: nothing is hidden on the way."""

import ctypes
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.cameras import v4l2_structs as v4l2
from drivers.cameras.bayer import counts_of_picture, size_of_counts
from drivers.cameras.bounded_camera import BoundedCamera
from drivers.cameras.pixel_format import needed_bytes, unpack
from drivers.cameras.v4l2_controls import V4l2Controls
from drivers.cameras.v4l2_node import LinuxVideoNode, VideoNode, told
from drivers.cameras.v4l2_options import V4l2Options, read_v4l2_place, sample_format
from drivers.cameras.v4l2_stamps import Asked, V4l2Stamps
from drivers.errors import DeviceTimeoutError, LimitError, NotConnectedError, ProtocolError
from drivers.interfaces import CameraFacts, CameraSettings, DeviceIdentity, Frame, FrameTally

_BUFFERS = 4
_FIRST_EXPOSURE_S = 0.01


@dataclass(frozen=True, kw_only=True)
class _Picture:
    counts: NDArray[np.uint16]
    sequence: int
    start_monotonic_ns: int
    error_ns: int | None


class V4l2Camera:
    """A video device that is open and streams; `open_v4l2` makes one.

    Notes
    -----
    The device runs by itself. A picture is accepted if the driver's own time stamp, of the monotonic clock or of the
    time of day, says that its exposure began after the call: the stamp itself where it marks the start of the exposure,
    else the stamp minus the exposure; then the exposure may have begun earlier by as long as the picture took to come,
    which is not longer than from one picture to the next. Pictures that are marked as damaged or too short are passed
    over and counted, and so are gaps in the device's numbers.
    """

    def __init__(
        self,
        node: VideoNode,
        options: V4l2Options,
        *,
        now_ns: Callable[[], int] = time.monotonic_ns,
        utc_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._node, self._options = node, options
        self._now_ns = now_ns
        self._pixel_format = sample_format(options)
        self._identity = self._identified()
        self._controls = V4l2Controls(node, options)
        self._controls.set(exposure_s=_FIRST_EXPOSURE_S, gain_db=0.0)
        self._format = self._set_format()
        self._settings = self._read_settings()
        self._tally = FrameTally()
        self._last_sequence: int | None = None
        self._stamps = V4l2Stamps(self._name, now_ns=now_ns, utc_ns=utc_ns)
        self._memory = self._start()
        self._open = True

    def __enter__(self) -> "V4l2Camera":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        """Return card, place on its bus (a serial number there is none) and version of the kernel's driver."""
        self._refuse_closed()
        return self._identity

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        """Set exposure and gain; return what was read back.

        Raises
        ------
        LimitError
            A value is outside of what the device allows; then nothing is changed.
        """
        self._refuse_closed()
        self._controls.set(exposure_s=exposure_s, gain_db=gain_db)
        self._settings = self._read_settings()
        return self._settings

    def tally(self) -> FrameTally:
        """Return what became of the pictures so far."""
        return self._tally

    def facts(self) -> CameraFacts:
        """Return how its samples come; nothing is known of their linearity."""
        fmt = self._pixel_format
        return CameraFacts(sample_format=fmt.name, justified=fmt.justified, linear=None)

    def features(self) -> dict[str, str]:
        """Return controls that were set and those that were found, under the device's own names."""
        self._refuse_closed()
        plane = {} if self._options.plane is None else {"plane": self._options.plane}
        return plane | self._controls.used | self._controls.found()

    def take_frame(self, *, timeout_s: float) -> Frame:
        """Return a complete picture whose exposure began after this call.

        Raises
        ------
        DeviceTimeoutError
            None came in time.
        ProtocolError
            Picture after picture is damaged, or the device does not say when they are taken.
        NotConnectedError
            The device was unplugged.
        LimitError
            Something automatic was switched on meanwhile, or a setting changed.
        """
        self._refuse_closed()
        asked = self._stamps.asked_now()
        deadline_ns = asked.monotonic_ns + round(timeout_s * 1e9)
        damaged = 0
        while (left_ns := deadline_ns - self._now_ns()) > 0 and self._node.wait(left_ns / 1e9):
            picture = self._next_picture(asked)
            if isinstance(picture, _Picture):
                self._require_settings()
                return self._frame(picture, asked)
            damaged = damaged + 1 if picture == "damaged" else 0
            if damaged > self._options.retakes:
                raise ProtocolError(f"{self._name}: {damaged} damaged pictures in a row; check cable and USB hub")
        raise DeviceTimeoutError(
            f"{self._name}: no picture of after the call within {timeout_s} s, at an exposure of "
            f"{self._settings.exposure_s} s; allow more time or expose shorter"
        )

    def close(self) -> None:
        """Stop the stream and release the device. May be called twice."""
        if not self._open:
            return
        self._open = False
        self._memory = []
        try:
            self._node.request(v4l2.STREAMOFF, ctypes.c_int(v4l2.CAPTURE))
        except OSError:
            pass  # unplugged: there is nothing left to stop
        finally:
            self._node.close()

    @property
    def _name(self) -> str:
        return f"video device {self._node.path}"

    def _refuse_closed(self) -> None:
        if not self._open:
            raise NotConnectedError(f"{self._name}: it was closed; open it again")

    def _ask(self, number: int, content: object, what: str) -> None:
        try:
            self._node.request(number, content)
        except OSError as error:
            raise told(error, path=self._node.path, what=what) from error

    def _identified(self) -> DeviceIdentity:
        found = v4l2.Capability()
        self._ask(v4l2.QUERYCAP, found, "asking what it is")
        if not v4l2.can_take_pictures(found):
            raise NotConnectedError(f"{self._name}: it is no camera that streams; try the next /dev/video*")
        version = (found.version >> 16, found.version >> 8 & 0xFF, found.version & 0xFF)
        return DeviceIdentity(
            model=found.card.decode(errors="replace"),
            serial_number=found.bus_info.decode(errors="replace"),
            firmware=f"{found.driver.decode(errors='replace')} {'.'.join(map(str, version))}",
        )

    def _set_format(self) -> v4l2.PixFormat:
        """Set size and format; refuse what the device has made of it."""
        content = v4l2.Format(type=v4l2.CAPTURE)
        self._ask(v4l2.G_FMT, content, "asking for its format")
        pix, letters = content.fmt.pix, self._options.pixel_format.ljust(4)
        asked = (self._options.width or pix.width, self._options.height or pix.height, v4l2.fourcc(letters))
        pix.width, pix.height, pix.pixelformat = asked
        pix.field, pix.bytesperline, pix.sizeimage = v4l2.NO_FIELDS, 0, 0
        self._ask(v4l2.S_FMT, content, "setting its format")
        if (pix.width, pix.height, pix.pixelformat) != asked:
            got = v4l2.letters_of(pix.pixelformat)
            raise LimitError(
                f"{self._name}: asked for {asked[0]} x {asked[1]} in {letters.strip()}, it offers {pix.width} x "
                f"{pix.height} in {got.strip()}"
            )
        return v4l2.PixFormat.from_buffer_copy(pix)

    def _start(self) -> list[memoryview]:
        request = v4l2.RequestBuffers(count=_BUFFERS, type=v4l2.CAPTURE, memory=v4l2.MMAP)
        self._ask(v4l2.REQBUFS, request, "asking for buffers")
        memory = []
        for index in range(request.count):
            buffer = self._buffer(index)
            self._ask(v4l2.QUERYBUF, buffer, "asking for a buffer")
            memory.append(self._node.map(length=buffer.length, offset=buffer.m.offset))
            self._ask(v4l2.QBUF, buffer, "queueing a buffer")
        self._ask(v4l2.STREAMON, ctypes.c_int(v4l2.CAPTURE), "starting the stream")
        return memory

    def _next_picture(self, asked: Asked) -> _Picture | str:
        """Return the picture that is waiting, or "damaged" or "too old"."""
        buffer = self._buffer(0)
        self._ask(v4l2.DQBUF, buffer, "taking a picture")
        try:
            return self._judged(buffer, asked)
        finally:
            self._ask(v4l2.QBUF, buffer, "queueing a buffer")

    def _judged(self, buffer: v4l2.Buffer, asked: Asked) -> _Picture | str:
        self._count_gap(buffer.sequence)
        start_ns, error_ns = self._stamps.start_of(buffer, asked, exposure_ns=round(self._settings.exposure_s * 1e9))
        if start_ns < asked.monotonic_ns:
            self._tally = replace(self._tally, too_old=self._tally.too_old + 1)
            return "too old"
        if buffer.flags & v4l2.DAMAGED or buffer.bytesused < self._needed_bytes():
            self._tally = replace(self._tally, damaged=self._tally.damaged + 1)
            return "damaged"
        counts = unpack(
            self._memory[buffer.index][: buffer.bytesused],
            pixel_format=self._pixel_format,
            width=self._format.width,
            height=self._format.height,
            row_bytes=self._format.bytesperline,
        )
        return _Picture(
            counts=counts_of_picture(counts, pixel_format=self._pixel_format, plane=self._options.plane),
            sequence=buffer.sequence,
            start_monotonic_ns=start_ns,
            error_ns=error_ns,
        )

    def _count_gap(self, sequence: int) -> None:
        last, self._last_sequence = self._last_sequence, sequence
        if last is not None and (gap := (sequence - last - 1) % 2**32) > 0:
            self._tally = replace(self._tally, never_came=self._tally.never_came + gap)

    def _needed_bytes(self) -> int:
        last_row = needed_bytes(self._pixel_format, samples=int(self._format.width))
        return int(self._format.bytesperline) * (int(self._format.height) - 1) + last_row

    def _require_settings(self) -> None:
        self._controls.require_manual()
        found = self._read_settings()
        if found != self._settings:
            raise LimitError(
                f"{self._name}: it is set to {found}, and was set to {self._settings}: who has changed it?"
            )

    def _read_settings(self) -> CameraSettings:
        width, height, bit_depth = size_of_counts(
            self._pixel_format,
            plane=self._options.plane,
            width=int(self._format.width),
            height=int(self._format.height),
        )
        return CameraSettings(
            exposure_s=self._controls.exposure_s(),
            gain_db=self._controls.gain_db(),
            width=width,
            height=height,
            bit_depth=bit_depth,
        )

    def _frame(self, picture: _Picture, asked: Asked) -> Frame:
        self._tally = replace(self._tally, accepted=self._tally.accepted + 1)
        start_utc_ns = picture.start_monotonic_ns + asked.to_utc_ns
        return Frame(
            counts=picture.counts,
            settings=self._settings,
            sequence=picture.sequence,
            start_utc_ns=start_utc_ns,
            end_utc_ns=start_utc_ns + round(self._settings.exposure_s * 1e9),
            start_monotonic_ns=picture.start_monotonic_ns,
            start_uncertainty_s=None if picture.error_ns is None else picture.error_ns / 1e9,
            start_source="driver",
        )

    def _buffer(self, index: int) -> v4l2.Buffer:
        return v4l2.Buffer(index=index, type=v4l2.CAPTURE, memory=v4l2.MMAP)


def open_v4l2(place: str) -> BoundedCamera:
    """Return a video device by ``/dev/video0?pixel_format=Y12&...``.

    See `drivers.cameras.v4l2_options.V4l2Options` for the keys.

    Raises
    ------
    NotConnectedError
        It is not there, in use, or no camera.
    LimitError
        It cannot be set to what the address says.
    """
    options = read_v4l2_place(place)
    return BoundedCamera(lambda: _open(options), name=f"video device {options.path}")


def _open(options: V4l2Options) -> V4l2Camera:
    node = LinuxVideoNode(options.path)
    try:
        return V4l2Camera(node, options)
    except BaseException:
        node.close()
        raise
