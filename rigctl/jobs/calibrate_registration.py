"""Calibrating image registration: a run of a scene with shapes in; the shift of the picture at each angle out."""

from dataclasses import dataclass
from pathlib import Path

from rigctl.calibrations.content_file import CalibrationFile, write_content
from rigctl.calibrations.registration.register_run import RunRegistration, register_run
from rigctl.calibrations.registration.registration_file import Walk, registration_file
from rigctl.runs.wholeness import used_run


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedRegistration:
    """A registration, and the content of its file."""

    found: RunRegistration
    file: CalibrationFile[Walk]


def calibrate_registration(
    run: Path, *, cycle: int | None = None, out: Path | None = None, valid_days: float | None = None
) -> CalibratedRegistration:
    """Return how the picture of a run is shifted at each angle; its file is written where one is named.

    Parameters
    ----------
    run : Path
        Run folder.
    cycle : int or None
        Repeat of the set of angles, from 0; the first where None.
    out : Path or None
        File to write.
    valid_days : float or None
        For how long it holds.

    Raises
    ------
    ConfigError, DataError, CalibrationError
        The file cannot be written, or the pictures are unfit.
    """
    folder = used_run(run)
    found = register_run(folder, cycle=cycle)
    file = registration_file(found, folder, valid_days=valid_days)
    if out is not None:
        write_content(out, file.as_json())
    return CalibratedRegistration(found=found, file=file)
