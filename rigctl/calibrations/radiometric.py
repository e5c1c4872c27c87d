"""The file that a radiometric calibration is kept in: ``radiometric.json``, as a record."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from rigctl.calibrations.made_for import (
    MadeFor,
    MeasuredOverFrames,
    Positive,
    UtcText,
    made_for,
    made_for_of_file,
    require_fit,
)
from rigctl.calibrations.record import read_record
from rigctl.runs.folder import Run

SCHEMA_VERSION = 1
# For how long it is trusted where it does not say so itself: lenses and filters gather dust. A choice.
VALID_DAYS = 90.0

Response = MeasuredOverFrames[Positive]


@dataclass(frozen=True, kw_only=True)
class Panel:
    """The panel of a calibration."""

    name: str = "a panel"


@dataclass(frozen=True, kw_only=True)
class RadiometricResponse:
    """A radiometric calibration as its file holds it."""

    schema_version: Annotated[int, Field(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
    kind: Literal["radiometric"]
    made_for: MadeFor  #: Devices, settings and time.
    exposure_s: Positive  #: Of its frames [s].
    f_number: Positive  #: Of its lens.
    #: Counts of a frame per unit of unpolarized radiance in band [DN per W m-2 sr-1].
    response_dn_per_radiance: Response
    panel: Panel = Panel()  #: What it was made on.
    created_utc: UtcText | None = None  #: When the file was written.

    @property
    def origin(self) -> MadeFor:
        """What it was made for, and until when it holds."""
        return made_for_of_file(self.made_for, created_utc=self.created_utc, valid_days=VALID_DAYS)


def read_radiometric_file(path: Path) -> RadiometricResponse:
    """Return a radiometric calibration."""
    return read_record(
        path, RadiometricResponse, made_by="a radiometric calibration is made by `rigctl calibrate radiometric`"
    )


def require_radiometric_fits(calibration: RadiometricResponse, used: MadeFor) -> tuple[str, ...]:
    """Return what is doubtful about using a radiometric calibration for frames, in words."""
    return require_fit("radiometric calibration", calibration.origin, used)


def read_fitting_radiometric(path: Path, run: Run) -> tuple[RadiometricResponse, tuple[str, ...]]:
    """Return a radiometric calibration for the scene frames of a run, and what is doubtful about it, in words."""
    found = read_radiometric_file(path)
    return found, require_radiometric_fits(found, made_for(run, [one for one in run.frames if one.kind == "scene"]))
