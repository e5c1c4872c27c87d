"""The file that flat fields are kept in: ``flat.npz``, pictures with their facts as JSON in it."""

import io
import json
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rigctl.calibrations.fitness import require_fit
from rigctl.calibrations.flat.run_flat import RunFlat
from rigctl.calibrations.made_for import MadeFor, made_for, read_made_for
from rigctl.config import describe, sha256_of
from rigctl.errors import DataError
from rigctl.runs.run_folder import MANIFEST_FILE, Run
from rigctl.utc_time import utc_text
from rigctl.version import VERSION

FloatArray = NDArray[np.float64]

SCHEMA_VERSION = 1
# Dust moves: a choice.
VALID_DAYS = 30.0
# A flat this near to an angle is of that angle.
_NEAR_DEG = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Flats:
    """Flat fields as their file holds them.

    Attributes
    ----------
    facts : dict
        What they were made for and from, and their numbers.
    angles_deg : (N,) array
        Polarizer angles [deg].
    response, std_error : (N, H, W) arrays
        Of each pixel over the mean of its angle.
    """

    facts: dict[str, Any]
    angles_deg: FloatArray
    response: FloatArray
    std_error: FloatArray

    def place(self, polarizer_deg: float) -> int:
        """Return which flat is that of a polarizer angle.

        Raises
        ------
        DataError
            There is none.
        """
        apart = np.abs((self.angles_deg - polarizer_deg + 90.0) % 180.0 - 90.0)
        nearest = int(np.argmin(apart))
        if apart[nearest] > _NEAR_DEG:
            known = ", ".join(f"{angle:g}" for angle in self.angles_deg)
            raise DataError(
                f"there is no flat field at {polarizer_deg % 180.0:.2f} deg; it was taken at {known} deg: take flat "
                "frames at the angles that are used"
            )
        return nearest


def flat_facts(
    found: RunFlat, run: Run, *, valid_days: float | None = None, utc_ns: Callable[[], int] = time.time_ns
) -> dict[str, Any]:
    """Return what the file says beside its pictures."""
    throughput, errors = found.throughput()
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": "flat",
        "created_by": f"rigctl {VERSION}",
        "created_utc": utc_text(utc_ns()),
        "source": {"path": str(run.path), "sha256": sha256_of(run.path / MANIFEST_FILE)},
        "made_for": made_for(run, found.records).as_json() | {"valid_days": valid_days},
        "exposure_s": found.exposure_s,
        "angles": [
            {
                "polarizer_angle_deg": angle,
                "frames": flat.frames,
                "mean_dn": flat.mean_dn,
                "throughput": {"value": value, "std_error": error},
                "pattern_rms": flat.pattern_rms,
                "noise_rms": flat.noise_rms,
            }
            for angle, flat, value, error in zip(
                found.angles_deg.tolist(), found.flats, throughput.tolist(), errors.tolist(), strict=True
            )
        ],
        "throughput": "over the mean of the angles; the polarizer's own only if the light is unpolarized and steady",
    }


def flat_npz(found: RunFlat, facts: dict[str, Any]) -> bytes:
    """Return the file."""
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        facts=np.frombuffer(json.dumps(facts, allow_nan=False).encode(), dtype=np.uint8),
        angles_deg=found.angles_deg,
        response=np.array([flat.response for flat in found.flats], dtype=np.float32),
        std_error=np.array([flat.std_error for flat in found.flats], dtype=np.float32),
    )
    return buffer.getvalue()


def read_fitting_flats(path: Path, run: Run) -> tuple[Flats, tuple[str, ...]]:
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
    made = read_made_for(flats.facts, valid_days=VALID_DAYS)
    return flats, require_fit("flat field", made, made_for(run, frames), stage=True)


def _read(path: Path) -> Flats:
    try:
        with np.load(path, allow_pickle=False) as kept:
            text = kept["facts"].tobytes()
            arrays = {name: kept[name].astype(np.float64) for name in ("angles_deg", "response", "std_error")}
        _Facts.model_validate_json(text)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValidationError as error:
        raise DataError(f"{describe(path, error)}\n  flat fields are made by `rigctl calibrate flat`") from error
    except (KeyError, ValueError, zipfile.BadZipFile) as error:
        raise DataError(f"{path}: holds no flat fields ({error}); they are made by `rigctl calibrate flat`") from error
    return Flats(facts=json.loads(text), **arrays)


class _Facts(BaseModel):
    # Keys that are not known are for those who put them there.
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    schema_version: Annotated[int, Field(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
    kind: Literal["flat"]
    made_for: MadeFor
