"""The file that flat fields are kept in: ``flat.npz``, pictures with their facts as JSON in it."""

import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError

from rigctl.calibrations.checked_values import UtcText
from rigctl.calibrations.content_file import CalibrationFile, header_of, source_of_run
from rigctl.calibrations.fitness import require_fit
from rigctl.calibrations.flat.run_flat import FlatAngle, RunFlat
from rigctl.calibrations.made_for import MadeFor, made_for, made_for_of_file
from rigctl.errors import DataError
from rigctl.files.config import describe, newer_schema
from rigctl.numbers.angles import wrapped
from rigctl.runs.run_folder import Run
from rigctl.storage.array_archive import read_arrays

FloatArray = NDArray[np.float64]

SCHEMA_VERSION = 1
# Dust moves: a choice.
VALID_DAYS = 30.0
# A flat this near to an angle is of that angle.
_NEAR_DEG = 0.5


@dataclass(frozen=True, kw_only=True)
class FlatFacts:
    """Facts of the file beside its pictures, as far as anything is made of them."""

    schema_version: Annotated[int, Field(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
    kind: Literal["flat"]
    made_for: MadeFor
    created_utc: UtcText | None = None

    @property
    def origin(self) -> MadeFor:
        """What it was made for, and until when it holds."""
        return made_for_of_file(self.made_for, created_utc=self.created_utc, valid_days=VALID_DAYS)


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatFields:
    """Flat fields as their file holds them.

    Attributes
    ----------
    facts : FlatFacts
        What they were made for.
    angles_deg : (N,) array
        Polarizer angles [deg].
    response, std_error : (N, H, W) arrays
        Of each pixel over the mean of its angle.

    Raises
    ------
    ValueError
        Pictures and angles do not belong together, or hold what is no number.
    """

    facts: FlatFacts
    angles_deg: FloatArray
    response: FloatArray
    std_error: FloatArray

    def __post_init__(self) -> None:
        if self.angles_deg.ndim != 1 or not len(self.angles_deg):
            raise ValueError(f"angles_deg has the shape {self.angles_deg.shape}, must be a row of one or more")
        for name, pictures in (("response", self.response), ("std_error", self.std_error)):
            if pictures.ndim != 3 or pictures.shape != (len(self.angles_deg), *self.response.shape[1:]):
                raise ValueError(f"{name} has the shape {pictures.shape}, must be a picture for each of its angles")
        for name in ("angles_deg", "response", "std_error"):
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"{name} holds what is no finite number")
        if np.any(self.std_error < 0.0):
            raise ValueError("std_error is below 0 somewhere")

    def place(self, polarizer_deg: float) -> int:
        """Return which flat is that of a polarizer angle.

        Raises
        ------
        DataError
            There is none.
        """
        apart = np.abs(wrapped(self.angles_deg - polarizer_deg, turn=180.0))
        nearest = int(np.argmin(apart))
        if apart[nearest] > _NEAR_DEG:
            known = ", ".join(f"{angle:g}" for angle in self.angles_deg)
            raise DataError(
                f"there is no flat field at {polarizer_deg % 180.0:.2f} deg; it was taken at {known} deg: take flat "
                "frames at the angles that are used"
            )
        return nearest


@dataclass(frozen=True, kw_only=True)
class FlatNumbers:
    """Numbers of flat fields beside their pictures, in the order in which the file has them."""

    exposure_s: float
    angles: tuple[FlatAngle, ...]
    throughput: str = "over the mean of the angles; the polarizer's own only if the light is unpolarized and steady"


def flat_file(found: RunFlat, run: Run, *, valid_days: float | None = None) -> CalibrationFile[FlatNumbers]:
    """Return what the file says beside its pictures."""
    source, records = source_of_run(run), found.records
    return CalibrationFile(
        header=header_of("flat", SCHEMA_VERSION, source=source, run=run, records=records, valid_days=valid_days),
        body=FlatNumbers(exposure_s=found.exposure_s, angles=found.rows()),
    )


def flat_npz(found: RunFlat, file: CalibrationFile[FlatNumbers]) -> bytes:
    """Return the bytes of the file."""
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        facts=np.frombuffer(json.dumps(file.as_json(), allow_nan=False).encode(), dtype=np.uint8),
        angles_deg=found.angles_deg,
        response=np.array([flat.response for flat in found.flats], dtype=np.float32),
        std_error=np.array([flat.std_error for flat in found.flats], dtype=np.float32),
    )
    return buffer.getvalue()


def read_fitting_flats(path: Path, run: Run) -> tuple[FlatFields, tuple[str, ...]]:
    """Return flat fields for the scene frames of a run, and what is doubtful about them, in words.

    Raises
    ------
    DataError
        The file cannot be read, is none, is of another version, camera, stage, size or binning.
    """
    flats = _read(path)
    frames = [record for record in run.frames if record.kind == "scene"]
    sizes = {(record.height, record.width) for record in frames}
    if sizes != {flats.response.shape[1:]}:
        raise DataError(
            f"{path}: its pictures have (rows, columns) {flats.response.shape[1:]}, the run {sorted(sizes)}"
        )
    return flats, require_fit("flat field", flats.facts.origin, made_for(run, frames), stage=True)


def read_flat_facts(path: Path) -> FlatFacts:
    """Return what a file of flat fields says beside its pictures.

    Raises
    ------
    DataError
        The file cannot be read, is none, or is of another version.
    """
    try:
        return _facts(path, read_arrays(path, only=("facts",))["facts"].tobytes())
    except KeyError as error:
        raise DataError(f"{path}: holds no flat fields; they are made by `rigctl calibrate flat`") from error


def _read(path: Path) -> FlatFields:
    try:
        kept = read_arrays(path)
    except DataError as error:
        raise DataError(f"{error}; flat fields are made by `rigctl calibrate flat`") from error
    try:
        facts = _facts(path, kept["facts"].tobytes())
        arrays = {name: kept[name].astype(np.float64) for name in ("angles_deg", "response", "std_error")}
        return FlatFields(facts=facts, **arrays)
    except DataError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"{path}: holds no flat fields ({error}); they are made by `rigctl calibrate flat`") from error


def _facts(path: Path, text: bytes) -> FlatFacts:
    try:
        return TypeAdapter(FlatFacts).validate_json(text)
    except ValidationError as error:
        later = newer_schema(_json(text), FlatFacts)
        if later is not None:
            raise DataError(f"{path}: {later}\n  flat fields are made by `rigctl calibrate flat`") from error
        raise DataError(f"{describe(path, error)}\n  flat fields are made by `rigctl calibrate flat`") from error


def _json(text: bytes) -> object:
    try:
        return json.loads(text)
    except ValueError:
        return None
