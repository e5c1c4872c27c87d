"""Check-up of this machine: network buffers, disk, clock."""

import ctypes
import os
import shutil
import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from rigctl.errors import DataError

_RMEM_MAX = Path("/proc/sys/net/core/rmem_max")
_WRITES = 20
_UNSYNCHRONISED = 0x40  # STA_UNSYNC
_MAX_ERROR_PLACE, _STATUS_PLACE, _TIMEX_BYTES = 24, 40, 208  # in struct timex of 64-bit Linux


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One line of a check-up: what was looked at, what was found, and what to change.

    Attributes
    ----------
    what : str
        What was looked at.
    found : str
        What was found, with its unit.
    advice : str or None
        What to change; None where all is well.
    hint : str or None
        What may be changed, or left as it is.
    """

    what: str
    found: str
    advice: str | None = None
    hint: str | None = None


def receive_buffer(*, frame_bytes: int, largest_bytes: int | None = None) -> Finding:
    """Return whether the system lets a socket hold two pictures.

    Parameters
    ----------
    frame_bytes : int
        Bytes of a picture.
    largest_bytes : int or None
        What the system allows; None: as it says.
    """
    allowed = int(_RMEM_MAX.read_text()) if largest_bytes is None else largest_bytes
    wanted = 2 * frame_bytes
    advice = None
    if allowed < wanted:
        advice = f"packets will be lost: sysctl -w net.core.rmem_max={wanted}, and the same in /etc/sysctl.d/"
    return Finding(what="receive buffer", found=f"{allowed} bytes at most, {wanted} wanted", advice=advice)


def disk(folder: Path, *, frame_bytes: int, period_s: float) -> Finding:
    """Return whether a folder takes a durable file of this size as often as the session makes one.

    Parameters
    ----------
    folder : Path
        Where runs will be.
    frame_bytes : int
        Of a file.
    period_s : float
        From one file to the next, in the fastest stretch of a session [s].

    Raises
    ------
    DataError
        The folder cannot be written.
    """
    content = os.urandom(frame_bytes)
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=".rigctl-doctor-") as scratch:
            times_s = [_durable_write_s(Path(scratch) / str(index), content) for index in range(_WRITES)]
    except OSError as error:
        raise DataError(f"{folder}: cannot be written: {error.strerror}") from error
    typical_s, longest_s = statistics.median(times_s), max(times_s)
    advice = None
    if typical_s > period_s:
        advice = (
            f"slower than a frame every {period_s * 1e3:.3g} ms: the session will wait for the disk. Use a local one, "
            "best an SSD, or longer exposures"
        )
    rate = frame_bytes / typical_s / 1e6
    found = (
        f"{typical_s * 1e3:.1f} ms a durable frame of {frame_bytes / 1e6:.2g} MB ({rate:.0f} MB/s with fsync), longest "
        f"{longest_s * 1e3:.1f} ms; a frame comes every {period_s * 1e3:.3g} ms where they come fastest"
    )
    return Finding(what=f"disk of {folder}", found=found, advice=advice)


def room(folder: Path, *, total_bytes: int, free_bytes: int | None = None) -> Finding:
    """Return whether all frames of a session fit a folder's disk.

    Parameters
    ----------
    folder : Path
        Where runs will be.
    total_bytes : int
        Of all frames.
    free_bytes : int or None
        Room that there is; None: as the system says.
    """
    free = shutil.disk_usage(folder).free if free_bytes is None else free_bytes
    advice = None
    if free < total_bytes:
        advice = "it ends before the session does: make room, name another folder, or take fewer cycles"
    found = f"{free / 1e9:.3g} GB are free, the session takes {total_bytes / 1e9:.3g} GB"
    return Finding(what=f"room in {folder}", found=found, advice=advice)


def utc_error_s() -> float | None:
    """Return how far the system's clock may be off UTC, as its time service says [s]; None: nothing synchronises it."""
    content = ctypes.create_string_buffer(_TIMEX_BYTES)
    ctypes.CDLL(None).ntp_adjtime(content)
    status = int.from_bytes(content.raw[_STATUS_PLACE : _STATUS_PLACE + 4], "little")
    error_us = int.from_bytes(content.raw[_MAX_ERROR_PLACE : _MAX_ERROR_PLACE + 8], "little")
    return None if status & _UNSYNCHRONISED else error_us / 1e6


def clock() -> Finding:
    """Return whether the system's clock follows a time server, and how far off it may be."""
    error_s = utc_error_s()
    if error_s is None:
        return Finding(
            what="clock",
            found="not synchronised",
            advice="the sun's place comes from it, 15 arc seconds a second: apt install chrony, or set it by hand",
        )
    return Finding(what="clock", found=f"synchronised, off by {error_s * 1e3:.0f} ms at most")


def _durable_write_s(path: Path, content: bytes) -> float:
    start_s = time.perf_counter()
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    return time.perf_counter() - start_s
