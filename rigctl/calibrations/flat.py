"""Flat fields, one for each polarizer angle: measured from the frames of a run, and read from ``flat.npz``.

For each angle the file has a picture of the response and of its error; everything else is JSON.
"""

import io
import json
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from calibration.polarimeter.pictures import FlatField, flat_field
from calibration.results import CalibrationError
from rigctl.base.durable import read_arrays
from rigctl.base.numbers import wrapped
from rigctl.calibrations.kinds import MadeFor
from rigctl.calibrations.record import CalibrationRecord, checked_record, header_of, made_for_scene, source_of_run
from rigctl.errors import DataError
from rigctl.runs.folder import Run
from rigctl.runs.records import FrameRecord

FloatArray = NDArray[np.float64]

SCHEMA_VERSION = 1
# A flat has at most this share of saturated pixels.
_MOST_SATURATED = 1e-3
# Largest difference between the angle of a frame and that of its flat.
_NEAR_DEG = 0.5


def flat_of_run(run: Run, *, valid_days: float | None = None) -> tuple[dict[str, Any], tuple[FlatField, ...]]:
    """Return the flat fields of a run from its longest exposure that does not saturate, one for each angle.

    First comes the content of their file without the pictures.
    """
    flats = [one for one in run.frames if one.kind == "flat" and one.polarizer_angle_deg is not None]
    usable = [one for one in flats if one.saturated_fraction <= _MOST_SATURATED and one.exposure_s is not None]
    if not usable:
        raise DataError(
            f"{run.path}: has {len(flats)} flat frames with a polarizer angle, and none of known exposure below "
            'saturation: take kind = "flat" with angles_deg in a session'
        )
    exposure_s = max(one.exposure_s or 0.0 for one in usable)
    chosen = [one for one in usable if one.exposure_s == exposure_s]
    groups: dict[float, list[FrameRecord]] = defaultdict(list)
    for record in chosen:
        groups[_angle_deg(record)].append(record)
    dark_dn = _dark_dn(run, chosen[0])
    found = tuple(_flat(run, angle, groups[angle], dark_dn) for angle in sorted(groups))
    mean_dn = float(np.mean([flat.mean_dn for flat in found]))
    header = header_of(
        "flat", SCHEMA_VERSION, source=source_of_run(run), run=run, records=chosen, valid_days=valid_days
    )
    return header | {
        "exposure_s": exposure_s,
        "angles": [
            {
                "polarizer_angle_deg": angle,
                "frames": flat.frames,
                "mean_dn": flat.mean_dn,
                "throughput": {"value": flat.mean_dn / mean_dn, "std_error": flat.mean_error_dn / mean_dn},
                "pattern_rms": flat.pattern_rms,
                "noise_rms": flat.noise_rms,
            }
            for angle, flat in zip(sorted(groups), found, strict=True)
        ],
        "throughput": "over the mean of the angles; that of the polarizer only if the light is unpolarized and steady",
    }, found


def flat_bytes(content: Mapping[str, Any], flats: Iterable[FlatField]) -> bytes:
    """Return the bytes of the file of flat fields."""
    buffer, found = io.BytesIO(), tuple(flats)
    np.savez_compressed(
        buffer,
        facts=np.frombuffer(json.dumps(content, allow_nan=False).encode(), dtype=np.uint8),
        angles_deg=np.array([row["polarizer_angle_deg"] for row in content["angles"]]),
        response=np.array([flat.response for flat in found], dtype=np.float32),
        std_error=np.array([flat.std_error for flat in found], dtype=np.float32),
    )
    return buffer.getvalue()


def _angle_deg(record: FrameRecord) -> float:
    target = record.polarizer_angle_target_deg
    angle = record.polarizer_angle_deg if target is None else target
    return round(angle or 0.0, 1) % 180.0


def _flat(run: Run, angle_deg: float, records: Iterable[FrameRecord], dark_dn: FloatArray) -> FlatField:
    try:
        return flat_field((run.counts(record) for record in records), dark_dn)
    except CalibrationError as error:
        raise DataError(f"{run.path}: flat frames at {angle_deg:g} deg: {error}") from error


def _dark_dn(run: Run, flat: FrameRecord) -> FloatArray:
    darks = [one for one in run.frames if one.kind == "dark" and one.exposure_s == flat.exposure_s]
    if darks:
        total = np.zeros((flat.height, flat.width))
        for record in darks:
            total += run.counts(record)
        return total / len(darks)
    if flat.black_level_dn is None:
        raise DataError(
            f"{run.path}: has no dark frames at the exposure of its flat frames, and no black level: "
            'take some in the same session (kind = "dark", the same exposure_ms)'
        )
    return np.full((flat.height, flat.width), flat.black_level_dn)


@dataclass(frozen=True, kw_only=True)
class FlatFacts(CalibrationRecord):
    """Content of the file without its pictures, as far as the program uses it."""

    KIND = "flat"
    MADE_BY = "a flat field is made by `rigctl calibrate flat`"

    schema_version: Annotated[int, Field(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
    kind: Literal["flat"]
    made_for: MadeFor

    @property
    def parts(self) -> tuple[str, ...]:
        """Flat fields."""
        return ("flats",)

    @classmethod
    def read(cls, path: Path) -> Self:
        """Return the content of a file without its pictures."""
        try:
            return checked_record(path, read_arrays(path, only=("facts",))["facts"].tobytes(), cls, made_by=cls.MADE_BY)
        except KeyError as error:
            raise DataError(f"{path}: is not a file of flat fields from `rigctl calibrate flat`") from error


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatFields:
    """Flat fields as their file holds them."""

    read = FlatFacts.read  # without the pictures

    facts: FlatFacts  #: devices, settings and time
    angles_deg: FloatArray  #: Polarizer angles [deg].
    response: FloatArray  #: Response of each pixel over the mean at its angle.
    std_error: FloatArray

    def __post_init__(self) -> None:
        if self.angles_deg.ndim != 1 or not len(self.angles_deg):
            raise ValueError(f"angles_deg has the shape {self.angles_deg.shape}, must be a row of one or more")
        for name, pictures in (("response", self.response), ("std_error", self.std_error)):
            if pictures.ndim != 3 or pictures.shape != (len(self.angles_deg), *self.response.shape[1:]):
                raise ValueError(f"{name} has the shape {pictures.shape}, must have a picture for each of its angles")
        for name in ("angles_deg", "response", "std_error"):
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"{name} holds a number that is not finite")
        if np.any(self.std_error < 0.0):
            raise ValueError("std_error is below 0 somewhere")

    @classmethod
    def read_fitting(cls, path: Path, run: Run) -> tuple["FlatFields", tuple[str, ...]]:
        """Return flat fields for the scene frames of a run, and doubts about them as text."""
        flats = _read(path)
        sizes = {(record.height, record.width) for record in run.frames if record.kind == "scene"}
        if sizes != {flats.response.shape[1:]}:
            raise DataError(
                f"{path}: its pictures have (rows, columns) {flats.response.shape[1:]}, the run {sorted(sizes)}"
            )
        return flats, flats.facts.doubts(made_for_scene(run))

    def place(self, polarizer_deg: float) -> int:
        """Return the index of the flat for a polarizer angle."""
        apart = np.abs(wrapped(self.angles_deg - polarizer_deg, turn=180.0))
        nearest = int(np.argmin(apart))
        if apart[nearest] > _NEAR_DEG:
            known = ", ".join(f"{angle:g}" for angle in self.angles_deg)
            raise DataError(
                f"there is no flat field at {polarizer_deg % 180.0:.2f} deg; it was taken at {known} deg: take flat "
                "frames at the angles that are used"
            )
        return nearest


def _read(path: Path) -> FlatFields:
    try:
        kept = read_arrays(path)
    except DataError as error:
        raise DataError(f"{error}; flat fields are made by `rigctl calibrate flat`") from error
    try:
        facts = checked_record(path, kept["facts"].tobytes(), FlatFacts, made_by=FlatFacts.MADE_BY)
        arrays = {name: kept[name].astype(np.float64) for name in ("angles_deg", "response", "std_error")}
        return FlatFields(facts=facts, **arrays)
    except DataError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"{path}: holds no flat fields ({error}); they are made by `rigctl calibrate flat`") from error
