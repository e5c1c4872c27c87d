"""Check of this machine (network buffers, disk, clock) and of a rig's devices (speed, losses)."""

import ctypes
import os
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np

from drivers.errors import LimitError
from drivers.interfaces import Camera, CameraWithFacts, Frame, ReportingCamera, RotationStage
from drivers.network_path import interface_of, path_mtu
from drivers.serial_port import resolve_port
from rigctl.base.durable import read_bounded
from rigctl.console import warn
from rigctl.errors import DataError
from rigctl.files.rig_file import RigFile
from rigctl.rig.rig import SIMULATED, cell_problem, find_driver, open_rig
from rigctl.rig.simulated_parts import ON_NETWORK, THIS_MACHINE
from rigctl.runs.records import START_SOURCES, start_error_text

_MOST_SETTING_BYTES = 4096  # the kernel allows as much as is requested
_RMEM_MAX = Path("/proc/sys/net/core/rmem_max")
_WRITES = 20
_UNSYNCHRONISED = 0x40  # STA_UNSYNC
_MAX_ERROR_PLACE, _STATUS_PLACE, _TIMEX_BYTES = 24, 40, 208  # in struct timex of 64-bit Linux
_EXPOSURE_S = 0.01
# For the check of a mosaic: harmless share of saturated pixels, and the shortest exposure.
_SATURATED, _SHORTEST_S = 0.1, 1e-5
_READINGS = 20
_SLOW_ANSWER_S = 0.05
_SERIAL_DEVICES = Path("/sys/bus/usb-serial/devices")
_ETHERNET_MTU, _JUMBO_MTU = 1500, 9000
_USUAL_LOSS = 1e-4  # of packets; a good cable and switch lose none


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One line of the check."""

    what: str  #: What was checked.
    found: str  #: The result with its unit.
    advice: str | None = None  #: A necessary change; None if all is well.
    hint: str | None = None  #: A possible improvement.


def receive_buffer(*, frame_bytes: int, largest_bytes: int | None = None) -> Finding:
    """Check that a socket may hold two pictures."""
    allowed = int(read_bounded(_RMEM_MAX, _MOST_SETTING_BYTES)) if largest_bytes is None else largest_bytes
    wanted = 2 * frame_bytes
    advice = None
    if allowed < wanted:
        advice = f"packets will be lost: sysctl -w net.core.rmem_max={wanted}, and the same in /etc/sysctl.d/"
    return Finding(what="receive buffer", found=f"{allowed} bytes at most, {wanted} wanted", advice=advice)


def disk(folder: Path, *, frame_bytes: int, period_s: float) -> Finding:
    """Check that a folder's disk is fast enough for a session."""
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
    """Check that all frames of a session fit on a folder's disk."""
    free = shutil.disk_usage(folder).free if free_bytes is None else free_bytes
    advice = None
    if free < total_bytes:
        advice = "the disk is full before the session ends: free space, choose another folder, or take fewer cycles"
    found = f"{free / 1e9:.3g} GB are free, the session needs {total_bytes / 1e9:.3g} GB"
    return Finding(what=f"room in {folder}", found=found, advice=advice)


def clock() -> Finding:
    """Check that the system's clock follows a time server."""
    error_s = utc_error_s()
    if error_s is None:
        return Finding(
            what="clock",
            found="not synchronised",
            advice="the sun's place comes from it, 15 arc seconds a second: apt install chrony, or set it by hand",
        )
    return Finding(what="clock", found=f"synchronised, off by {error_s * 1e3:.0f} ms at most")


def utc_error_s() -> float | None:
    """Return the largest error of the system's clock by its time service [s]; None if nothing synchronises it."""
    content = ctypes.create_string_buffer(_TIMEX_BYTES)
    ctypes.CDLL(None).ntp_adjtime(content)
    status = int.from_bytes(content.raw[_STATUS_PLACE : _STATUS_PLACE + 4], "little")
    error_us = int.from_bytes(content.raw[_MAX_ERROR_PLACE : _MAX_ERROR_PLACE + 8], "little")
    return None if status & _UNSYNCHRONISED else error_us / 1e6


class RigCheckup:
    """Opens a rig and checks its devices."""

    def __init__(self, rig: RigFile, *, frames: int) -> None:
        self._rig, self._frames = rig, frames
        self.pixels: int | None = None
        self.camera_s: float | None = None

    def findings(self) -> Iterator[Finding]:
        """Yield the findings."""
        yield from self._ways()
        with open_rig(self._rig, session_name="doctor") as rig:
            if rig.stage is not None and rig.stage_identity is not None:
                model, serial = rig.stage_identity.model, rig.stage_identity.serial_number
                yield Finding(what="stage", found=f"{model}, serial {serial}")
                yield stage_latency(rig.stage)
            identity = rig.camera_identity
            yield Finding(what="camera", found=f"{identity.model}, serial {identity.serial_number}")
            settings = rig.camera.configure(exposure_s=_EXPOSURE_S, gain_db=self._rig.camera.gain_db)
            self.pixels = settings.width * settings.height
            timeout_s = self._rig.camera.timeout_s + _EXPOSURE_S
            times_s, last = timed_frames(rig.camera, frames=self._frames, timeout_s=timeout_s)
            self.camera_s = max(0.0, statistics.median(times_s) - settings.exposure_s)
            yield from camera_frames(rig.camera, times_s, last)
            if self._rig.camera.mosaic_deg is not None:
                yield cell_finding(rig.camera, self._rig, timeout_s=timeout_s)

    def _ways(self) -> Iterator[Finding]:
        """Yield the findings about serial adapter and network."""
        stage = self._rig.stage
        if stage is not None and not stage.port.startswith(SIMULATED):
            adapter = adapter_wait(resolve_port(stage.port, warn=warn))
            if adapter is not None:
                yield adapter
        network_address = _network_address(self._rig.camera.address)
        if network_address is not None:
            yield interface_mtu(network_address)


def cell_finding(camera: Camera, rig: RigFile, *, timeout_s: float) -> Finding:
    """Check the stated cell of a camera with polarizers on its pixels against the light."""
    stated = tuple(rig.camera.mosaic_deg or ())
    frame = _unsaturated(camera, gain_db=rig.camera.gain_db, timeout_s=timeout_s)
    text = ", ".join(f"{angle:g}" for angle in stated)
    own = camera.facts().mosaic_deg if isinstance(camera, CameraWithFacts) else None
    source = "as the camera says" if own is not None else "as the rig file says; the camera does not tell"
    advice = cell_problem(frame.counts, stated, bit_depth=frame.settings.bit_depth)
    return Finding(what="cell", found=f"{text} deg row by row, {source}", advice=advice)


def stage_latency(stage: RotationStage) -> Finding:
    """Measure the time that the stage takes to report its position."""
    times_s = [_timed(stage.position) for _ in range(_READINGS)]
    typical_s, longest_s = statistics.median(times_s), max(times_s)
    advice = None
    if typical_s > _SLOW_ANSWER_S:
        advice = "it answers slowly: is its adapter behind a hub, or does another program use it?"
    found = f"{typical_s * 1e3:.1f} ms a reading, longest {longest_s * 1e3:.1f} ms"
    return Finding(what="stage", found=found, advice=advice)


def adapter_wait(port: str, *, devices: Path = _SERIAL_DEVICES) -> Finding | None:
    """Return the time that a USB adapter waits before it passes on bytes; None if the system does not know it."""
    file = devices / Path(port).resolve().name / "latency_timer"
    try:
        wait_ms = int(read_bounded(file, _MOST_SETTING_BYTES))
    except (OSError, ValueError):
        return None
    advice = None
    if wait_ms > 1:
        advice = f"each answer takes so much longer: echo 1 > {file} (docs/plug-ins.md has a rule that lasts)"
    return Finding(what="serial adapter", found=f"waits {wait_ms} ms before it passes bytes on", advice=advice)


def timed_frames(camera: Camera, *, frames: int, timeout_s: float) -> tuple[list[float], Frame]:
    """Take a number of pictures; return the time of each, exposure included [s], and the last picture."""
    times_s = []
    for _ in range(frames):
        start_s = time.perf_counter()
        frame = camera.take_frame(timeout_s=timeout_s)
        times_s.append(time.perf_counter() - start_s)
    return times_s, frame


def camera_frames(camera: Camera, times_s: Sequence[float], last: Frame) -> Iterator[Finding]:
    """Yield findings on speed, time stamps and, if the camera counts them, losses of pictures."""
    found = (
        f"{len(times_s)} frames, {statistics.median(times_s) * 1e3:.0f} ms each, longest {max(times_s) * 1e3:.0f} ms"
    )
    yield Finding(what="camera", found=found)
    yield from _time_stamps(last)  # by now the camera's clock is known, if it has a readable one
    if not isinstance(camera, ReportingCamera):
        return
    facts, tally = camera.facts(), camera.tally()
    bent = {True: "linear: what bends counts is off", None: "linear: it does not tell", False: "its counts are bent"}
    yield Finding(what="samples", found=f"{facts.sample_format}, {facts.justified}-justified; {bent[facts.linear]}")
    lost = tally.damaged + tally.never_came
    share = tally.packets_lost / tally.packets if tally.packets else 0.0
    advice = None
    # The first one after a start is often damaged.
    if lost > 1 or share > _USUAL_LOSS:
        advice = (
            "packets are lost: raise the receive buffer, connect the camera without a switch or with jumbo packets, "
            "use a shorter or better cable, and let nothing else use this interface"
        )
    found = f"{tally.damaged} damaged, {tally.never_came} never came"
    if tally.packets:
        again = f"{tally.packets_resent} of them came when asked for again"
        found += f"; {100 * share:.2g} % of {tally.packets} packets lost, {again}"
    yield Finding(what="loss", found=found, advice=advice)
    for name, value in camera.features().items():
        yield Finding(what=f"  {name}", found=value)


def interface_mtu(address: str) -> Finding:
    """Check the largest packet size on the way to a camera."""
    mtu = path_mtu(address)
    advice = hint = None
    if mtu < _ETHERNET_MTU:
        advice = f"smaller than Ethernet's {_ETHERNET_MTU}: ip link set IFACE mtu {_ETHERNET_MTU}"
    elif mtu < _JUMBO_MTU:
        hint = (
            f"if camera and switch can: ip link set IFACE mtu {_JUMBO_MTU}, and packet_size={_JUMBO_MTU}, load it less"
        )
    return Finding(what="MTU", found=f"{mtu} bytes on interface {interface_of(address)}", advice=advice, hint=hint)


def _durable_write_s(path: Path, content: bytes) -> float:
    start_s = time.perf_counter()
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    return time.perf_counter() - start_s


def _unsaturated(camera: Camera, *, gain_db: float, timeout_s: float) -> Frame:
    """Return a picture with few saturated pixels, shortening the exposure as far as the camera allows."""
    frame, exposure_s = camera.take_frame(timeout_s=timeout_s), _EXPOSURE_S
    while np.mean(frame.counts >= 2**frame.settings.bit_depth - 1) > _SATURATED and exposure_s > _SHORTEST_S:
        exposure_s /= 4.0
        try:
            camera.configure(exposure_s=exposure_s, gain_db=gain_db)
        except LimitError:
            break
        frame = camera.take_frame(timeout_s=timeout_s)
    return frame


def _time_stamps(frame: Frame) -> Iterator[Finding]:
    """Yield the accuracy of the start of an exposure, if the camera states it."""
    source = frame.start_source
    if source is not None:
        text = f"{START_SOURCES.get(source, source)}, {start_error_text(frame.start_uncertainty_s)}"
        hint = "docs/cameras.md has what makes it known better" if source in ("trigger", "arrival") else None
        yield Finding(what="time stamps", found=f"start of an exposure {text}", hint=hint)


def _timed(ask: Callable[[], object]) -> float:
    start_s = time.perf_counter()
    ask()
    return time.perf_counter() - start_s


def _network_address(address: str) -> str | None:
    """Return the network address of a camera that is not open yet; None if its driver does not tell."""
    scheme, _, place = address.partition(":")
    if address.startswith(SIMULATED):
        return THIS_MACHINE if address.partition("?")[0] == ON_NETWORK else None
    driver = find_driver("rigctl.cameras", scheme, key="camera.address")
    tell: Callable[[str], str] | None = getattr(import_module(driver.module), "network_address", None)
    return None if tell is None else tell(place)
