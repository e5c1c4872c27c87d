"""What the index of an archive keeps of a run, and by what it sees that the run has changed."""

from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

from rigctl.errors import DataError
from rigctl.runs.annotation_record import excluded_frames
from rigctl.runs.annotations import read_annotation_lines, sound_annotations
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_description import SESSION_FILE
from rigctl.runs.run_events import EVENTS_FILE
from rigctl.runs.run_folder import ANNOTATIONS_FILE, MANIFEST_FILE, read_contents
from rigctl.runs.session_record import DeviceAsTaken, SessionRecord
from rigctl.runs.wholeness import wholeness

Fact = str | float | None
KEPT_FILES = (SESSION_FILE, MANIFEST_FILE, EVENTS_FILE, ANNOTATIONS_FILE)
_MS_PER_S = 1000.0
_ZENITH_DEG = 90.0


def is_run(folder: Path) -> bool:
    """Return whether a folder is a run, whole or not."""
    return any((folder / name).is_file() for name in (SESSION_FILE, MANIFEST_FILE))


def fingerprint(run: Path) -> str:
    """Return what changes when a run does: size and time of its journals, and of the folder, whose frames they name."""
    facts = []
    for path in (run, *(run / name for name in KEPT_FILES)):
        try:
            stat = path.stat()
        except FileNotFoundError:
            continue
        facts.append(f"{path.name} {stat.st_size} {stat.st_mtime_ns}")
    return "\n".join(facts)


def facts_of(run: Path) -> dict[str, Fact]:
    """Return a run's columns; of a damaged one, those that can be had, and what is damaged.

    Parameters
    ----------
    run : Path
        Its folder.
    """
    try:
        contents = read_contents(run)
    except DataError as error:
        return {"state": "damaged", "problem": str(error)}
    judged = wholeness(run, contents)
    problems = [f"{file}: {text}" for file, text in judged.problems]
    problems += [f"{record.file}: missing" for record in contents.frames if not (run / record.file).is_file()][:1]
    facts: dict[str, Fact] = {
        "state": "damaged" if problems else judged.state,
        "problem": problems[0] if problems else "",
        **_of_frames(contents.frames),
        **_of_annotations(run),
    }
    if (run / MANIFEST_FILE).is_file():
        facts["manifest_sha256"] = sha256((run / MANIFEST_FILE).read_bytes()).hexdigest()
    if contents.description is not None:
        session = contents.description.record
        facts |= {"created_by": contents.description.created_by, "schema_version": contents.description.schema_version}
        facts |= _of_session(session)
    return facts


def _of_frames(frames: Sequence[FrameRecord]) -> dict[str, Fact]:
    scenes = [record for record in frames if record.kind == "scene"]
    exposures = [record.exposure_s for record in scenes if record.exposure_s is not None]
    starts = sorted(record.start_utc for record in frames if record.start_utc)
    ends = sorted(record.end_utc for record in frames if record.end_utc)
    middle = scenes[len(scenes) // 2] if scenes else None
    elevation = None if middle is None else middle.sun_elevation_deg
    return {
        "frames": len(frames),
        "scenes": len(scenes),
        "utc": starts[0] if starts else None,
        "end_utc": ends[-1] if ends else None,
        "exposure_ms": _MS_PER_S * max(exposures) if exposures else None,
        "bit_depth": frames[0].bit_depth if frames else None,
        "latitude_deg": None if middle is None else middle.site_latitude_deg,
        "longitude_deg": None if middle is None else middle.site_longitude_deg,
        "sun_zenith": None if elevation is None else _ZENITH_DEG - elevation,
        "sun_azimuth": None if middle is None else middle.sun_azimuth_deg,
    }


def _of_annotations(run: Path) -> dict[str, Fact]:
    annotations = sound_annotations(read_annotation_lines(run)) if (run / ANNOTATIONS_FILE).is_file() else ()
    notes = sum(one.kind == "note" for one in annotations)
    return {"excluded": len(excluded_frames(annotations)), "notes": notes}


def _of_session(session: SessionRecord) -> dict[str, Fact]:
    return {
        "origin": session.origin,
        "rig": None if session.rig is None else session.rig.name,
        "name": None if session.session is None else session.session.name,
        "camera": _device(session.camera),
        "stage": _device(session.stage),
        "noise": "" if session.noise is None else f"{session.noise.gain_dn_per_e:g}",
    }


def _device(device: DeviceAsTaken) -> str:
    return " ".join(text for text in (device.model, device.serial_number) if text)
