"""The file that a polarizer calibration is kept in: ``polarizer.json``, as a record."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from rigctl.calibrations.checked_values import Bounded, Measured, UtcText, at_least
from rigctl.calibrations.content_file import read_record
from rigctl.calibrations.fitness import require_fit
from rigctl.calibrations.made_for import MadeFor, made_for, made_for_of_file
from rigctl.errors import DataError
from rigctl.files.rig_file import PolarizerSection
from rigctl.numbers.angles import wrapped
from rigctl.runs.run_folder import Run
from rigctl.runs.session_record import PolarizerAsTaken

SCHEMA_VERSION = 2
# Version 1 has "devices" in place of "made_for".
_OLDEST_VERSION = 1
# For how long it is trusted where it does not say so itself: until the polarizer is taken out of its mount. A choice.
VALID_DAYS = 180.0
# Rounding of the lines that are copied into a rig file.
_COPIED_DEG = 1e-4
_SIGMAS = 3.0

Angle = Measured[Bounded]
# Over the mean of the angles: of a thousand angles one alone would have to pass light.
Passed = Measured[Annotated[float, Field(gt=0, le=1e3)]]


@dataclass(frozen=True, kw_only=True)
class Channel:
    """Polarizer at one angle of the stage: throughput is the response to unpolarized light over the angles' mean."""

    stage_angle_deg: Bounded
    throughput: Passed


@dataclass(frozen=True, kw_only=True)
class PolarizerParameters:
    """A polarizer calibration as its file holds it.

    Attributes
    ----------
    sense : {1, -1}
        Of the polarizer angle against the stage angle.
    offset_deg : Measured
        Polarizer angle where the stage stands at 0 [deg].
    channels : tuple of Channel or None
        Each stage angle by itself; None where fixed references were used, which do not measure throughput.
    made_for : MadeFor or None
        Devices, settings and time; files of version 1 have ``devices`` instead.
    created_utc : str or None
        When the file was written.
    """

    schema_version: Annotated[int, Field(ge=_OLDEST_VERSION, le=SCHEMA_VERSION)]
    sense: Literal[1, -1]
    offset_deg: Angle
    channels: Annotated[tuple[Channel, ...], at_least(1)] | None = None
    made_for: MadeFor | None = None
    devices: MadeFor | None = None
    created_utc: UtcText | None = None

    @property
    def origin(self) -> MadeFor:
        """What it was made for, and until when it holds."""
        return made_for_of_file(self.made_for or self.devices, created_utc=self.created_utc, valid_days=VALID_DAYS)


def read_polarizer_file(path: str | Path) -> PolarizerParameters:
    """Return a polarizer calibration.

    Raises
    ------
    DataError
        The file cannot be read, is no polarizer calibration, or is of another version: every problem at once.
    """
    return read_record(
        Path(path), PolarizerParameters, made_by="a polarizer calibration is made by `rigctl calibrate axis`"
    )


def read_fitting_polarizer(path: Path, run: Run) -> tuple[PolarizerParameters, tuple[str, ...]]:
    """Return a polarizer calibration for the scene frames of a run, and what is doubtful about it, in words.

    Raises
    ------
    DataError
        As `read_polarizer_file` and `require_polarizer_fits`.
    """
    found = read_polarizer_file(path)
    used = made_for(run, [record for record in run.frames if record.kind == "scene"])
    doubts = require_polarizer_fits(found, used, polarizer=run.session.polarizer)
    if found.channels is None:
        doubts += (
            "polarizer calibration: made with fixed references, it holds no throughput: nothing is divided by it",
        )
    return found, doubts


def require_polarizer_fits(
    calibration: PolarizerParameters, used: MadeFor, *, polarizer: PolarizerSection | PolarizerAsTaken
) -> tuple[str, ...]:
    """Return what is doubtful about frames of a rig by its polarizer calibration, in words.

    Parameters
    ----------
    calibration : PolarizerParameters
        The calibration.
    used : MadeFor
        What the frames were, or will be, taken with.
    polarizer : PolarizerSection or PolarizerAsTaken
        Sense and offset that the rig file states; where it does not, they are not compared.

    Raises
    ------
    DataError
        It is of another camera or stage, or the rig file states another sense or offset.
    """
    doubts = require_fit("polarizer calibration", calibration.origin, used, stage=True, gain=False)
    if polarizer.sense is not None and polarizer.offset_deg is not None:
        _require_same_axis(calibration, polarizer.sense, polarizer.offset_deg)
    return doubts


def _require_same_axis(calibration: PolarizerParameters, sense: int, offset_deg: float) -> None:
    offset = calibration.offset_deg
    apart = wrapped(offset_deg - offset.value, turn=180.0)
    if sense != calibration.sense or abs(apart) > _SIGMAS * offset.std_error + _COPIED_DEG:
        raise DataError(
            f"the rig file says sense = {sense}, offset_deg = {offset_deg:g}; calibrated are "
            f"{calibration.sense} and {offset.value:.4f} +- {offset.std_error:.4f}: put the calibrated ones there"
        )
