"""What an archive knows of its runs: one table of columns, of runs and of their regions."""

from dataclasses import dataclass
from typing import Literal

Kind = Literal["text", "number"]
Level = Literal["run", "comparison", "region"]


@dataclass(frozen=True, kw_only=True)
class IndexColumn:
    """A column that can be asked for.

    Attributes
    ----------
    name : str
        As in expressions, CSV and JSON.
    kind : {"text", "number"}
        With what it can be compared.
    level : {"run", "comparison", "region"}
        Of what it is.
    meaning : str
        One line, with the unit.
    """

    name: str
    kind: Kind
    level: Level
    meaning: str


def _run(name: str, kind: Kind, meaning: str) -> IndexColumn:
    return IndexColumn(name=name, kind=kind, level="run", meaning=meaning)


def _compared(name: str, kind: Kind, meaning: str) -> IndexColumn:
    return IndexColumn(name=name, kind=kind, level="comparison", meaning=meaning)


def _region(name: str, kind: Kind, meaning: str) -> IndexColumn:
    return IndexColumn(name=name, kind=kind, level="region", meaning=meaning)


COLUMNS = (
    _run("run", "text", "folder of the run, from the archive's root"),
    _run("state", "text", "whole, unfinished, damaged: session file, manifest and events held against each other"),
    _run("problem", "text", "what is damaged, the first of it"),
    _run("name", "text", "name of the session"),
    _run("origin", "text", "device, simulated, import"),
    _run("utc", "text", "start of the first frame, ISO 8601; compares as text"),
    _run("end_utc", "text", "end of the last frame"),
    _run("frames", "number", "frames in the manifest"),
    _run("scenes", "number", "of them frames of the scene"),
    _run("excluded", "number", "frames that people excluded"),
    _run("notes", "number", "notes of people"),
    _run("exposure_ms", "number", "longest exposure of the scene [ms]"),
    _run("latitude_deg", "number", "latitude of the site, north is positive [deg]"),
    _run("longitude_deg", "number", "longitude of the site, east is positive [deg]"),
    _run("sun_zenith", "number", "angle of the sun from the zenith at the middle frame, without refraction [deg]"),
    _run("sun_azimuth", "number", "azimuth of the sun there, clockwise from north [deg]"),
    _run("rig", "text", "name of the rig file"),
    _run("camera", "text", "model and serial number of the camera"),
    _run("stage", "text", "model and serial number of the stage"),
    _run("bit_depth", "number", "bits of the camera"),
    _run("noise", "text", "noise calibration that the session was watched with: its gain [DN/e], empty for none"),
    _run("created_by", "text", "program and version that made the run"),
    _run("schema_version", "number", "layout of the run"),
    _run("manifest_sha256", "text", "hash of the manifest, by which results know their run"),
    _compared(
        "verdict", "text", "of the newest comparison: agrees, agrees_with_reservations, disagrees, cannot_be_judged"
    ),
    _compared("flags", "number", "reservations of that comparison"),
    _compared("unsound", "number", "checks of that comparison that were not sound"),
    _compared("scene", "text", "hash of its scene file"),
    _compared("report", "text", "its folder, from the archive's root"),
    _region("region", "text", "name of a region of that comparison"),
    _region("region_verdict", "text", "verdict on the region alone"),
    _region("dolp", "number", "its measured DoLP"),
    _region("dolp_sigma", "number", "standard error of that"),
    _region("aolp_deg", "number", "its measured AoLP [deg]"),
    _region("aolp_sigma_deg", "number", "standard error of that [deg]"),
    _region("dolp_predicted", "number", "DoLP that the model predicts"),
    _region("dolp_z", "number", "measured less predicted DoLP in its standard errors"),
)
BY_NAME = {column.name: column for column in COLUMNS}
# Verdicts as people say them.
VERDICTS = {"agree": "agrees", "disagree": "disagrees", "reservations": "agrees_with_reservations"}


def of_level(level: Level) -> tuple[str, ...]:
    """Return the names of a level's columns."""
    return tuple(column.name for column in COLUMNS if column.level == level)
