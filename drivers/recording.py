"""Recording of a session's devices: what went over the stage's line, and what the camera was asked and gave.

A file is a ZIP archive: ``recording.json``, the frames as ``frames/000000.npy``, and rig and session file for a replay.
"""

import io
import json
import zipfile
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drivers import errors
from drivers.errors import DeviceError, DeviceFaultError, LimitError
from drivers.interfaces import CameraFacts, CameraSettings, DeviceIdentity, Frame

SCHEMA_VERSION = 1
_CONTENT = "recording.json"
# Beyond any recording of a session that somebody would pass on.
_MOST_BYTES, _MOST_FRAME_BYTES = 200_000_000, 400_000_000
Heard = Literal["host", "device", "gone"]


@dataclass(frozen=True, kw_only=True)
class LineEvent:
    """Bytes on the stage's line, or its end.

    Attributes
    ----------
    time_s : float
        Since the recording began.
    heard : {"host", "device", "gone"}
        Who sent them; "gone": the port went away.
    data : bytes
        What was sent.
    """

    time_s: float
    heard: Heard
    data: bytes = b""


@dataclass(frozen=True, kw_only=True)
class Failure:
    """An error that a device raised: its kind in `drivers.errors`, and its words."""

    kind: str
    message: str
    code: int | str = ""
    meaning: str = ""

    def error(self) -> DeviceError:
        """Return the error, to be raised again."""
        if self.kind == "DeviceFaultError":
            return DeviceFaultError(self.message, code=self.code, meaning=self.meaning)
        known = getattr(errors, self.kind, DeviceError)
        made: DeviceError = known(self.message)
        return made


def failure_of(error: DeviceError) -> Failure:
    """Return what is kept of an error."""
    if isinstance(error, DeviceFaultError):
        return Failure(kind="DeviceFaultError", message=str(error), code=error.code, meaning=error.meaning)
    return Failure(kind=type(error).__name__, message=str(error))


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraCall:
    """One call of a camera: settings that were asked for, or a frame; what came of it, or its failure.

    Attributes
    ----------
    asked : (float, float) or None
        Exposure [s] and gain [dB] of `configure`; None is `take_frame`.
    settings : CameraSettings or None
        What it said that it took.
    frame : Frame or None
        What it gave.
    failure : Failure or None
        What it raised.
    """

    asked: tuple[float, float] | None = None
    settings: CameraSettings | None = None
    frame: Frame | None = None
    failure: Failure | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenedDevices:
    """Devices from their opening until they were closed, or went away; several where they were opened again."""

    line: tuple[LineEvent, ...] = ()
    camera: DeviceIdentity | None = None
    facts: CameraFacts | None = None
    features: dict[str, str] = field(default_factory=dict)
    calls: tuple[CameraCall, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """All that was recorded, and the files for a replay by their names."""

    made_by: str
    opened: tuple[OpenedDevices, ...]
    files: dict[str, str] = field(default_factory=dict)


def write_recording(path: Path, recording: Recording) -> None:
    """Write a recording; the file is whole, or not there.

    Raises
    ------
    OSError
        It cannot be written.
    """
    part = path.with_name(f".{path.name}.part")
    frames: list[NDArray[np.uint16]] = []
    content = {
        "schema_version": SCHEMA_VERSION,
        "made_by": recording.made_by,
        "opened": [_opened_json(one, frames) for one in recording.opened],
    }
    try:
        with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(_CONTENT, json.dumps(content))
            for name, text in recording.files.items():
                archive.writestr(name, text)
            for number, counts in enumerate(frames):
                memory = io.BytesIO()
                np.save(memory, counts, allow_pickle=False)
                archive.writestr(_frame_name(number), memory.getvalue())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def read_recording(path: Path) -> Recording:
    """Return a recording.

    Raises
    ------
    LimitError
        There is no such file, or it is no recording.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            content = json.loads(_bounded(archive, _CONTENT, _MOST_BYTES))
            if content["schema_version"] != SCHEMA_VERSION:
                raise LimitError(f"{path}: is a recording of version {content['schema_version']}, not {SCHEMA_VERSION}")
            opened = tuple(_opened(one, archive) for one in content["opened"])
            return Recording(made_by=str(content["made_by"]), opened=opened)
    except (OSError, zipfile.BadZipFile, KeyError, TypeError, ValueError, RecursionError, AttributeError) as error:
        raise LimitError(f"{path}: is no recording of `rigctl record`: {error}") from error


def _bounded(archive: zipfile.ZipFile, name: str, most_bytes: int) -> bytes:
    if archive.getinfo(name).file_size > most_bytes:
        raise ValueError(f"{name} is larger than {most_bytes} bytes")
    return archive.read(name)


def _frame_name(number: int) -> str:
    return f"frames/{number:06d}.npy"


def _opened_json(opened: OpenedDevices, frames: list[NDArray[np.uint16]]) -> dict[str, Any]:
    return {
        "line": [[round(event.time_s, 6), event.heard, event.data.hex()] for event in opened.line],
        "camera": None if opened.camera is None else asdict(opened.camera),
        "facts": None if opened.facts is None else asdict(opened.facts),
        "features": opened.features,
        "calls": [_call_json(call, frames) for call in opened.calls],
    }


def _call_json(call: CameraCall, frames: list[NDArray[np.uint16]]) -> dict[str, Any]:
    told: dict[str, Any] = {"asked": call.asked}
    told["settings"] = None if call.settings is None else asdict(call.settings)
    told["failure"] = None if call.failure is None else asdict(call.failure)
    if call.frame is not None:
        frame = {name: value for name, value in vars(call.frame).items() if name != "counts"}
        told["frame"] = frame | {"settings": asdict(call.frame.settings), "counts": len(frames)}
        frames.append(call.frame.counts)
    return told


def _opened(content: dict[str, Any], archive: zipfile.ZipFile) -> OpenedDevices:
    facts = content["facts"]
    if facts is not None and facts.get("mosaic_deg") is not None:
        facts = facts | {"mosaic_deg": tuple(facts["mosaic_deg"])}
    return OpenedDevices(
        line=tuple(
            LineEvent(time_s=float(time_s), heard=heard, data=bytes.fromhex(data))
            for time_s, heard, data in content["line"]
        ),
        camera=None if content["camera"] is None else DeviceIdentity(**content["camera"]),
        facts=None if facts is None else CameraFacts(**facts),
        features={str(name): str(value) for name, value in content["features"].items()},
        calls=tuple(_call(one, archive) for one in content["calls"]),
    )


def _call(content: dict[str, Any], archive: zipfile.ZipFile) -> CameraCall:
    asked, settings, failure = content["asked"], content["settings"], content["failure"]
    return CameraCall(
        asked=None if asked is None else (float(asked[0]), float(asked[1])),
        settings=None if settings is None else CameraSettings(**settings),
        failure=None if failure is None else Failure(**failure),
        frame=None if content.get("frame") is None else _frame(content["frame"], archive),
    )


def _frame(content: dict[str, Any], archive: zipfile.ZipFile) -> Frame:
    data = _bounded(archive, _frame_name(content["counts"]), _MOST_FRAME_BYTES)
    counts = np.load(io.BytesIO(data), allow_pickle=False)
    if counts.dtype != np.uint16 or counts.ndim != 2:
        raise ValueError(f"frame {content['counts']}: is no picture of 16-bit counts")
    return Frame(**(content | {"settings": CameraSettings(**content["settings"]), "counts": counts}))
