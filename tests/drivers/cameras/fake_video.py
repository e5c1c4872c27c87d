"""A video device that answers the requests of V4L2 as a kernel would, picture by picture as a test wants them."""

import errno
from dataclasses import dataclass

from drivers.cameras import v4l2

WIDTH, HEIGHT = 4, 2
PICTURE = bytes(range(16))
EXPOSURE_AUTO, AUTOGAIN = 0x009A0901, 0x00980912


@dataclass(frozen=True)
class Shot:
    """A picture to come: its number, its stamp on the monotonic clock, and what is wrong with it."""

    sequence: int
    stamp_ns: int
    flags: int = v4l2.MONOTONIC
    bytesused: int = len(PICTURE)


class FakeVideo:
    """The device; `shots` come one after the other, each as soon as it is waited for, and move the clock on."""

    path = "/dev/fake"

    def __init__(self, *shots):
        self.shots = list(shots)
        self.now = 0
        self.controls = {EXPOSURE_AUTO: 0, v4l2.EXPOSURE_ABSOLUTE: 5, AUTOGAIN: 1, v4l2.GAIN: 30}
        self.limits = {v4l2.EXPOSURE_ABSOLUTE: (1, 10_000), v4l2.GAIN: (10, 50)}
        self.stubborn = set()
        self.offered = None
        self.broken = None
        self.waiting = 0
        self.streaming = False
        self.closed = False
        self._memory = {}

    def now_ns(self):
        return self.now

    def request(self, number, content):
        if self.broken is not None:
            raise OSError(self.broken, "broken")
        answers = {
            v4l2.QUERYCAP: self._describe,
            v4l2.S_FMT: self._take_format,
            v4l2.G_FMT: self._tell_format,
            v4l2.QUERYCTRL: self._describe_control,
            v4l2.G_CTRL: self._tell_control,
            v4l2.S_CTRL: self._take_control,
            v4l2.QUERYBUF: self._tell_buffer,
            v4l2.DQBUF: self._give_picture,
            v4l2.QBUF: lambda _: self._count(+1),
            v4l2.STREAMON: lambda _: self._stream(True),
            v4l2.STREAMOFF: lambda _: self._stream(False),
            v4l2.REQBUFS: lambda _: None,
        }
        answers[number](content)

    def map(self, *, length, offset):
        return memoryview(self._memory.setdefault(offset, bytearray(length)))

    def wait(self, timeout_s):
        if self.shots:
            self.now = max(self.now, self.shots[0].stamp_ns)
            return True
        self.now += round(timeout_s * 1e9)
        return False

    def close(self):
        self.closed = True

    def _describe(self, content):
        content.card, content.bus_info, content.driver = b"Fake", b"usb-1", b"fake"
        content.version, content.capabilities = 0x060105, v4l2.CAN_CAPTURE | v4l2.CAN_STREAM

    def _tell_format(self, content):
        content.fmt.pix.width, content.fmt.pix.height = WIDTH, HEIGHT

    def _take_format(self, content):
        pix = content.fmt.pix
        if self.offered:
            pix.width, pix.height = self.offered
        pix.bytesperline, pix.sizeimage = 2 * pix.width, 2 * pix.width * pix.height

    def _describe_control(self, content):
        if content.id not in self.controls:
            raise OSError(errno.EINVAL, "no such control")
        content.name = f"control {content.id:#x}".encode()
        content.minimum, content.maximum = self.limits.get(content.id, (0, 3))

    def _tell_control(self, content):
        content.value = self.controls[content.id]

    def _take_control(self, content):
        if content.id not in self.stubborn:
            self.controls[content.id] = content.value

    def _tell_buffer(self, content):
        content.length, content.m.offset = len(PICTURE), 0

    def _give_picture(self, content):
        shot = self.shots.pop(0)
        self._count(-1)
        self._memory[0][:] = bytes([shot.sequence % 16, 0] * 8)
        content.index, content.sequence, content.bytesused, content.flags = 0, shot.sequence, shot.bytesused, shot.flags
        content.timestamp.seconds, rest_ns = divmod(shot.stamp_ns, 10**9)
        content.timestamp.microseconds = rest_ns // 1000

    def _count(self, change):
        self.waiting += change

    def _stream(self, on):
        self.streaming = on
