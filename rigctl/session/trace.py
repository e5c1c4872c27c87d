"""Trace of a session's devices as plain text: each byte of serial lines, and what the camera was set to and gave.

One event a line: seconds since the trace began, who spoke, and what::

    0.001204 /dev/ttyUSB0 > 30 69 6e                     sent, in hexadecimal
    0.014117 /dev/ttyUSB0 < 30 49 4e 30 45               received
    0.020000 /dev/ttyUSB0 gone
    0.120332 camera set exposure_s=0.01 gain_db=0: exposure_s=0.0100012 gain_db=0 width=1280 height=1024 bit_depth=12
    0.230541 camera frame 12: exposure_s=0.0100012 gain_db=0 width=1280 height=1024 bit_depth=12
    0.250000 camera failed: DeviceTimeoutError: no frame within 2 s
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TextIO

from drivers.interfaces import CameraWithFacts
from drivers.serial_port import heard_by
from rigctl.console import warn
from rigctl.errors import ConfigError
from rigctl.rig.rig import Rig
from rigctl.version import VERSION

SCHEMA_VERSION = 1


class Trace:
    """Writes down what devices say, from several threads; a full disk ends the trace, not the session."""

    def __init__(self, file: TextIO, *, now_s: Callable[[], float] = time.monotonic) -> None:
        self._file: TextIO | None = file
        self._now_s, self._began_s = now_s, now_s()
        self._lock = threading.Lock()
        self.line(f"trace of rigctl {VERSION}, schema {SCHEMA_VERSION}")

    def line(self, text: str) -> None:
        """Write one event with its time."""
        with self._lock:
            if self._file is None:
                return
            try:
                self._file.write(f"{self._now_s() - self._began_s:.6f} {' '.join(text.split())}\n")
            except OSError as error:
                self._file = None
                warn(f"--trace: nothing more is written: {error.strerror}")

    def hear(self, data: bytes, *, port: str, from_host: bool) -> None:
        """Take in bytes on a serial line; none from the device: its port has gone away."""
        self.line(f"{port} {'>' if from_host else '<'} {data.hex(' ')}" if data or from_host else f"{port} gone")

    @contextmanager
    def of(self, opened: AbstractContextManager[Rig]) -> Iterator[Rig]:
        """Give the rig that a context opens, with its devices traced."""
        with heard_by(self.hear), opened as rig:
            for what, identity in (("stage", rig.stage_identity), ("camera", rig.camera_identity)):
                if identity is not None:
                    self.line(f"{what} is {fields_text(identity)}")
            if isinstance(rig.camera, CameraWithFacts):
                self.line(f"camera has {fields_text(rig.camera.facts())}")
            yield replace(rig, trace=self.line)


@contextmanager
def trace_into(path: Path | None) -> Iterator[Trace | None]:
    """Give a trace that is written line by line into a new file; None without a path."""
    if path is None:
        yield None
        return
    try:
        file = path.open("x", encoding="utf-8", buffering=1)
    except OSError as error:
        raise ConfigError(f"--trace: {path} cannot be written: {error.strerror}") from error
    with file:
        yield Trace(file)


def fields_text(record: Any) -> str:
    """Return the fields of a record as ``name=value``, in one line."""
    return " ".join(
        f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}" for name, value in asdict(record).items()
    )
