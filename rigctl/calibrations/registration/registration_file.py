"""The file that an image registration is kept in: ``registration.json``, as a record."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from calibration.polarimeter.pictures import Wander
from rigctl.calibrations.checked_values import NotNegative, UtcText, at_least
from rigctl.calibrations.content_file import CalibrationFile, header_of, read_record, source_of_run
from rigctl.calibrations.fitness import require_fit
from rigctl.calibrations.made_for import MadeFor, made_for, made_for_of_file
from rigctl.calibrations.registration.register_run import AngleShift, Pixels, RunRegistration
from rigctl.errors import DataError
from rigctl.numbers.angles import wrapped
from rigctl.runs.run_folder import Run

FloatArray = NDArray[np.float64]

SCHEMA_VERSION = 1
VALID_DAYS = 180.0
# A circle that misses its shifts by more than this does not describe them.
_CIRCLE_PIXELS = 0.05
# A frame this near to an angle of the table has its shift.
_NEAR_DEG = 1.0


@dataclass(frozen=True, kw_only=True)
class Circle:
    """The circle that the picture walks on, as `Wander` has it."""

    turning_pixels: tuple[Pixels, Pixels]
    sense: Literal[1, -1]
    residual_pixels: NotNegative


@dataclass(frozen=True, kw_only=True)
class ImageRegistration:
    """A registration as its file holds it.

    Attributes
    ----------
    angles : tuple of AngleShift
        What was measured.
    wander : Circle or None
        Through the shifts; None of two angles.
    made_for : MadeFor
        Devices, settings and time.
    created_utc : str or None
        When the file was written.
    """

    schema_version: Annotated[int, Field(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
    kind: Literal["registration"]
    made_for: MadeFor
    angles: Annotated[tuple[AngleShift, ...], at_least(2)]
    wander: Circle | None
    created_utc: UtcText | None = None

    @property
    def origin(self) -> MadeFor:
        """What it was made for, and until when it holds."""
        return made_for_of_file(self.made_for, created_utc=self.created_utc, valid_days=VALID_DAYS)

    def shift_pixels(self, angle_deg: float, *, against_deg: float) -> FloatArray:
        """Return the shift (x, y) of the picture at one angle against that at another.

        Parameters
        ----------
        angle_deg, against_deg : float
            Stage angles; polarizer angles where there is no stage [deg].

        Raises
        ------
        DataError
            No circle describes the shifts, and an angle is not among those that were measured.
        """
        circle = self.wander
        if circle is not None and circle.residual_pixels <= _CIRCLE_PIXELS:
            wander = Wander(
                centre_pixels=0j,
                turning_pixels=complex(*circle.turning_pixels),
                sense=circle.sense,
                residual_pixels=circle.residual_pixels,
            )
            return wander.shift_pixels(float(np.radians(angle_deg)), against_rad=float(np.radians(against_deg)))
        return self._looked_up(angle_deg) - self._looked_up(against_deg)

    def _looked_up(self, angle_deg: float) -> FloatArray:
        angles = np.array([row.angle_deg for row in self.angles])
        apart = np.abs(wrapped(angles - angle_deg, turn=360.0))
        nearest = int(np.argmin(apart))
        if apart[nearest] > _NEAR_DEG:
            raise DataError(
                f"the registration has no shift for {angle_deg:.2f} deg: it was measured at "
                f"{', '.join(f'{angle:.1f}' for angle in angles)} deg, and no circle goes through its shifts: measure "
                "it at the angles that are used"
            )
        return np.array(self.angles[nearest].shift_pixels)


@dataclass(frozen=True, kw_only=True)
class WalkCircle:
    """The circle of a wedged polarizer, in the order in which the file has it."""

    turning_pixels: tuple[float, float]
    sense: int
    radius_pixels: float
    residual_pixels: float


@dataclass(frozen=True, kw_only=True)
class Walk:
    """Walk of a run's picture, in the order in which the file has it."""

    angles: tuple[AngleShift, ...]
    wander: WalkCircle | None
    finding: str | None


def registration_file(found: RunRegistration, run: Run, *, valid_days: float | None = None) -> CalibrationFile[Walk]:
    """Return the file of a registration."""
    source, records = source_of_run(run), found.records
    return CalibrationFile(
        header=header_of(
            "registration", SCHEMA_VERSION, source=source, run=run, records=records, valid_days=valid_days
        ),
        body=Walk(
            angles=found.rows(),
            wander=None if found.wander is None else _circle(found.wander),
            finding=found.finding,
        ),
    )


def _circle(wander: Wander) -> WalkCircle:
    return WalkCircle(
        turning_pixels=(wander.turning_pixels.real, wander.turning_pixels.imag),
        sense=wander.sense,
        radius_pixels=abs(wander.turning_pixels),
        residual_pixels=wander.residual_pixels,
    )


def read_registration_file(path: Path) -> ImageRegistration:
    """Return a registration.

    Raises
    ------
    DataError
        The file cannot be read, is none, or is of another version: every problem at once.
    """
    return read_record(
        path, ImageRegistration, made_by="a registration is made by `rigctl calibrate registration RUN --out FILE`"
    )


def read_fitting_registration(path: Path, run: Run) -> tuple[ImageRegistration, tuple[str, ...]]:
    """Return a registration for the scene frames of a run, and what is doubtful about it, in words.

    Raises
    ------
    DataError
        As `read_registration_file`; or it is of another camera or stage.
    """
    found = read_registration_file(path)
    used = made_for(run, [record for record in run.frames if record.kind == "scene"])
    return found, require_fit("registration", found.origin, used, stage=True, gain=False)
