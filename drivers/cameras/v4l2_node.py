"""A video device of Linux: its file, its requests, its memory."""

import errno
import fcntl
import mmap
import os
import select
import struct
import sys
from typing import Any, Protocol

from drivers.errors import DeviceError, LimitError, NotConnectedError, ProtocolError


class VideoNode(Protocol):
    """Calls to the system that the driver needs."""

    @property
    def path(self) -> str:
        """Return what messages call it."""

    def request(self, number: int, content: Any) -> None:
        """Make a request; its content is changed in place. Raises OSError."""

    def map(self, *, length: int, offset: int) -> memoryview:
        """Return the memory of a buffer."""

    def wait(self, timeout_s: float) -> bool:
        """Return whether a picture is there, once one is or the time is over."""

    def close(self) -> None:
        """Give up the device. May be called twice."""


class LinuxVideoNode:
    """A device file such as /dev/video0."""

    def __init__(self, path: str) -> None:
        if struct.calcsize("P") != 8 or sys.byteorder != "little":
            raise NotConnectedError(f"{path}: video devices are read on 64-bit little-endian Linux only")
        self._path = path
        self._maps: list[mmap.mmap] = []
        try:
            self._file: int | None = os.open(path, os.O_RDWR | os.O_NONBLOCK)
        except OSError as error:
            raise told(error, path=path, what="opening") from error

    @property
    def path(self) -> str:
        """Return the path."""
        return self._path

    def request(self, number: int, content: Any) -> None:
        """Make a request; its content is changed in place."""
        fcntl.ioctl(self._opened(), number, content)

    def map(self, *, length: int, offset: int) -> memoryview:
        """Return the memory of a buffer."""
        self._maps.append(mmap.mmap(self._opened(), length, offset=offset))
        return memoryview(self._maps[-1])

    def wait(self, timeout_s: float) -> bool:
        """Return whether a picture is there, once one is or the time is over."""
        readable, _, _ = select.select([self._opened()], [], [], max(0.0, timeout_s))
        return bool(readable)

    def close(self) -> None:
        """Give up the device; its memory goes once nobody looks at it. May be called twice."""
        self._maps.clear()
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _opened(self) -> int:
        if self._file is None:
            raise NotConnectedError(f"{self._path}: it was closed; open it again")
        return self._file


def told(error: OSError, *, path: str, what: str) -> DeviceError:
    """Return the error of the drivers that a refusal of the system stands for."""
    text = f"video device {path}: {what}: {error.strerror}"
    if error.errno in (errno.ENODEV, errno.ENOENT, errno.ENXIO):
        return NotConnectedError(f"{text}. It is not there, or was unplugged")
    if error.errno == errno.EBUSY:
        return NotConnectedError(f"{text}. Another program has it: close that one first")
    if error.errno in (errno.EACCES, errno.EPERM):
        return NotConnectedError(f"{text}. You may not use it: join its group (`ls -l {path}`, mostly `video`)")
    if error.errno in (errno.EINVAL, errno.ERANGE):
        return LimitError(f"{text}. The device does not have this, or not with this value")
    return ProtocolError(f"{text}. Unplug it and plug it in again")
