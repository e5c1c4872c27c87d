"""Monitors: a number from a file, from a command, or over a serial line.

Each is made from the options of its table in the rig file and implements `drivers.interfaces.Monitor`.
"""

import errno
import os
import re
import signal
import subprocess
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import DeviceTimeoutError, LimitError, NotConnectedError, ProtocolError
from drivers.interfaces import MonitorOptions
from drivers.serial_port import BytePort, open_serial_port

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
# Longest line of a sensor.
_MOST_BYTES = 65536
_LOOK_S = 0.05


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Conversion of text to a number.

    Attributes
    ----------
    unit : str
        Of the number, after factor and offset.
    pattern : str
        Regular expression; the number is its first group, or the whole match.
    factor, offset : float
        The number is multiplied by the factor, then the offset is added.
    """

    unit: str
    pattern: str = _NUMBER
    factor: float = 1.0
    offset: float = 0.0

    def of(self, text: str, *, source: str) -> float:
        """Return the number, the last of several.

        Raises
        ------
        ProtocolError
            There is none.
        """
        found = re.findall(self.pattern, text)
        last = found[-1] if found else ""
        word = last[0] if isinstance(last, tuple) else last
        try:
            return self.factor * float(word) + self.offset
        except ValueError as error:
            raise ProtocolError(f"{source}: no number in {text.strip()[-80:]!r}") from error


class FileMonitor:
    """The last number in a file that another program writes.

    Parameters
    ----------
    path : Path
        The file.
    reading : Reading
        Conversion of its end.
    max_age_s : float
        Largest time since the file was last written.
    """

    def __init__(self, path: Path, reading: Reading, *, max_age_s: float) -> None:
        self._path, self._reading, self._max_age_s = path, reading, max_age_s
        self.name, self.unit = f"file {path}", reading.unit

    def read(self, deadline_s: float) -> float:
        """Return the number.

        Raises
        ------
        NotConnectedError
            The file does not exist, or is too old.
        ProtocolError
            It has no number.
        """
        try:
            if not self._path.is_file():  # a pipe would block
                raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
            with self._path.open("rb") as file:
                age_s = time.time() - os.fstat(file.fileno()).st_mtime
                size = file.seek(0, os.SEEK_END)
                file.seek(max(0, size - _MOST_BYTES))
                text = file.read(_MOST_BYTES).decode(errors="replace")
        except OSError as error:
            raise NotConnectedError(f"{self._path}: cannot be read: {error.strerror}") from error
        if age_s > self._max_age_s:
            raise NotConnectedError(
                f"{self._path}: was written {age_s:.0f} s ago; allowed is {self._max_age_s:g} s (max_age_s)"
            )
        return self._reading.of(text, source=str(self._path))


class CommandMonitor:
    """A number that a program prints.

    Parameters
    ----------
    command : list of str
        Program and arguments.
    reading : Reading
        Conversion of its output.
    """

    def __init__(self, command: list[str], reading: Reading) -> None:
        self._command, self._reading = command, reading
        self.name, self.unit = f"command {command[0]}", reading.unit

    def read(self, deadline_s: float) -> float:
        """Return the number; a program that does not end in time is killed with its children.

        Raises
        ------
        DeviceTimeoutError
            It does not end in time.
        NotConnectedError
            It cannot be started, or fails.
        ProtocolError
            It prints no number.
        """
        try:
            process = subprocess.Popen(
                self._command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                start_new_session=True,
            )
        except OSError as error:
            raise NotConnectedError(f"{self._command[0]}: cannot be started: {error.strerror}") from error
        with process:
            try:
                out, said = process.communicate(timeout=deadline_s)
            except subprocess.TimeoutExpired as error:
                os.killpg(process.pid, signal.SIGKILL)
                raise DeviceTimeoutError(f"{self._command[0]}: did not end within {deadline_s:g} s") from error
        if process.returncode:
            text = said[-200:].decode(errors="replace").strip()
            raise NotConnectedError(f"{self._command[0]}: failed with exit code {process.returncode}: {text}")
        return self._reading.of(out[-_MOST_BYTES:].decode(errors="replace"), source=self._command[0])


class SerialMonitor:
    """A number in a line over a serial port, with or without a request.

    Parameters
    ----------
    port : BytePort
        Open.
    ask : bytes
        Request for each reading; empty if the sensor sends on its own.
    reading : Reading
        Conversion of a line.
    """

    def __init__(self, port: BytePort, ask: bytes, reading: Reading) -> None:
        self._port, self._ask, self._reading = port, ask, reading
        self.name, self.unit = f"serial {port.name}", reading.unit

    def read(self, deadline_s: float) -> float:
        """Return the number of a line that began after this call.

        Raises
        ------
        DeviceTimeoutError
            No whole line came in time.
        NotConnectedError
            The port was disconnected.
        ProtocolError
            The line has no number.
        """
        end_s = time.monotonic() + deadline_s
        while time.monotonic() < end_s and self._port.read_some(timeout_s=0.0):
            pass  # older lines are outdated
        if self._ask:
            self._port.write(self._ask)
        # Without a request the first line may have begun long ago, so the next one is used.
        return self._reading.of(self._line(end_s, whole=1 if self._ask else 2), source=self._port.name)

    def close(self) -> None:
        """Release the port. May be called twice."""
        self._port.close()

    def _line(self, end_s: float, *, whole: int) -> str:
        came = b""
        while came.count(b"\n") < whole:
            left_s = end_s - time.monotonic()
            if left_s <= 0.0 or len(came) > _MOST_BYTES:
                raise DeviceTimeoutError(f"{self._port.name}: no whole line in time; received {came[-80:]!r}")
            came += self._port.read_some(timeout_s=min(left_s, _LOOK_S)).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        return came.split(b"\n")[whole - 1].decode(errors="replace")


def open_file_monitor(options: MonitorOptions) -> FileMonitor:
    """Return a monitor of a file: options path, unit, pattern, factor, offset, max_age_s (600)."""
    taken = _Taken(options, "path", "unit", "pattern", "factor", "offset", "max_age_s")
    return FileMonitor(Path(taken.text("path")), taken.reading(), max_age_s=taken.number("max_age_s", 600.0))


def open_command_monitor(options: MonitorOptions) -> CommandMonitor:
    """Return a monitor of a program: options command (a list), unit, pattern, factor, offset."""
    taken = _Taken(options, "command", "unit", "pattern", "factor", "offset")
    command = options.get("command")
    if not isinstance(command, list) or not command:
        raise LimitError('monitor option command: must be a list, such as ["sensors", "-u"]')
    return CommandMonitor([str(word) for word in command], taken.reading())


def open_serial_monitor(options: MonitorOptions) -> SerialMonitor:
    """Return a monitor of a serial line: options port, unit, baud (9600), ask, pattern, factor, offset.

    `ask` is sent unchanged; it must contain the end of line if the sensor needs one.
    """
    taken = _Taken(options, "port", "unit", "baud", "ask", "pattern", "factor", "offset")
    port = open_serial_port(taken.text("port"), baud=round(taken.number("baud", 9600.0)))
    return SerialMonitor(port, taken.text("ask", "").encode(), taken.reading())


class _Taken:
    """Options of a monitor, with checked types."""

    def __init__(self, options: Mapping[str, object], *known: str) -> None:
        unknown = sorted(set(options) - set(known))
        if unknown:
            raise LimitError(f"monitor option {', '.join(unknown)}: is unknown; allowed are {', '.join(known)}")
        self._options = options

    def text(self, name: str, default: str | None = None) -> str:
        value = self._options.get(name, default)
        if not isinstance(value, str):
            missing = "" if name in self._options else "; is missing"
            raise LimitError(f"monitor option {name}: must be text{missing}")
        return value

    def number(self, name: str, default: float) -> float:
        value = self._options.get(name, default)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise LimitError(f"monitor option {name}: must be a number")
        return float(value)

    def reading(self) -> Reading:
        try:
            pattern = re.compile(self.text("pattern", _NUMBER)).pattern
        except re.error as error:
            raise LimitError(f"monitor option pattern: is not a regular expression: {error}") from error
        return Reading(
            unit=self.text("unit"),
            pattern=pattern,
            factor=self.number("factor", 1.0),
            offset=self.number("offset", 0.0),
        )
