"""The file that the walk of the picture is kept in: ``registration.json``."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from calibration.polarimeter.registration import Wander
from rigctl.calibrations.content_file import read_content
from rigctl.calibrations.fitness import require_fit
from rigctl.calibrations.made_for import MadeFor, made_for, read_made_for
from rigctl.calibrations.registration.run_registration import RunRegistration
from rigctl.config import sha256_of
from rigctl.errors import DataError
from rigctl.runs.run_folder import MANIFEST_FILE, Run
from rigctl.utc_time import utc_text
from rigctl.version import VERSION

FloatArray = NDArray[np.float64]

SCHEMA_VERSION = 1
VALID_DAYS = 180.0
# A circle that misses its shifts by more than this does not describe them.
_CIRCLE_PIXELS = 0.05
# A frame this near to an angle of the table has its shift.
_NEAR_DEG = 1.0


def registration_json(
    found: RunRegistration, run: Run, *, valid_days: float | None = None, utc_ns: Callable[[], int] = time.time_ns
) -> dict[str, Any]:
    """Return the content of the file."""
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": "registration",
        "created_by": f"rigctl {VERSION}",
        "created_utc": utc_text(utc_ns()),
        "source": {"path": str(run.path), "sha256": sha256_of(run.path / MANIFEST_FILE)},
        "made_for": made_for(run, found.records).as_json() | {"valid_days": valid_days},
        **found.as_json(),
    }


def read_registration_file(path: Path) -> dict[str, Any]:
    """Return the content of the file, once all that the program uses has been found right.

    Raises
    ------
    DataError
        The file cannot be read, is none, or is of another version: every problem at once.
    """
    return read_content(
        path, _Content, made_by="a registration is made by `rigctl calibrate registration RUN --out FILE`"
    )


def require_registration_fits(content: Mapping[str, Any], used: MadeFor) -> tuple[str, ...]:
    """Return what is doubtful about using a registration for frames, in words.

    Raises
    ------
    DataError
        It is of another camera or stage.
    """
    calibration = read_made_for(content, valid_days=VALID_DAYS)
    return require_fit("registration", calibration, used, stage=True, gain=False)


def read_fitting_registration(path: Path, run: Run) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return a registration for the scene frames of a run, and what is doubtful about it, in words.

    Raises
    ------
    DataError
        As `read_registration_file` and `require_registration_fits`.
    """
    content = read_registration_file(path)
    used = made_for(run, [record for record in run.frames if record.kind == "scene"])
    return content, require_registration_fits(content, used)


def shift_pixels(content: Mapping[str, Any], angle_deg: float, *, against_deg: float) -> FloatArray:
    """Return the shift (x, y) of the picture at one angle against that at another, by a registration.

    Parameters
    ----------
    content : mapping
        Of its file. Where a circle describes the shifts it is taken; else they are looked up by angle.
    angle_deg, against_deg : float
        Stage angles; polarizer angles where there is no stage [deg].

    Raises
    ------
    DataError
        No circle describes the shifts, and an angle is not among those that were measured.
    """
    circle = content["wander"]
    if circle is not None and circle["residual_pixels"] <= _CIRCLE_PIXELS:
        wander = Wander(
            centre_pixels=0j,
            turning_pixels=complex(*circle["turning_pixels"]),
            sense=circle["sense"],
            residual_pixels=circle["residual_pixels"],
        )
        return wander.shift_pixels(float(np.radians(angle_deg)), against_rad=float(np.radians(against_deg)))
    return _looked_up(content, angle_deg) - _looked_up(content, against_deg)


def _looked_up(content: Mapping[str, Any], angle_deg: float) -> FloatArray:
    angles = np.array([row["angle_deg"] for row in content["angles"]])
    apart = np.abs((angles - angle_deg + 180.0) % 360.0 - 180.0)
    nearest = int(np.argmin(apart))
    if apart[nearest] > _NEAR_DEG:
        raise DataError(
            f"the registration has no shift for {angle_deg:.2f} deg: it was measured at "
            f"{', '.join(f'{angle:.1f}' for angle in angles)} deg, and no circle goes through its shifts: measure it "
            "at the angles that are used"
        )
    return np.array(content["angles"][nearest]["shift_pixels"])


class _Part(BaseModel):
    # Keys that are not known are for those who put them there.
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)


class _Angle(_Part):
    angle_deg: float
    shift_pixels: tuple[float, float]


class _Circle(_Part):
    turning_pixels: tuple[float, float]
    sense: Literal[1, -1]
    residual_pixels: Annotated[float, Field(ge=0)]


class _Content(_Part):
    schema_version: Annotated[int, Field(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
    kind: Literal["registration"]
    made_for: MadeFor
    angles: Annotated[list[_Angle], Field(min_length=2)]
    wander: _Circle | None
