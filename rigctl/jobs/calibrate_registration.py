"""Calibrating image registration: a run of a scene with shapes in; the shift of the picture at each angle out."""

from dataclasses import dataclass
from pathlib import Path

from rigctl.calibrations.record import CalibrationFile, write_content
from rigctl.calibrations.registration import RunRegistration, Walk, register_run, registration_file
from rigctl.console.exclusion_option import are_exclusions_ignored
from rigctl.runs.check import used_run


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedRegistration:
    """A registration, the content of its file, and whether it was refused for being no plain shift."""

    found: RunRegistration
    file: CalibrationFile[Walk]
    is_refused: bool


def calibrate_registration(
    run: Path,
    *,
    cycle: int | None = None,
    out: Path | None = None,
    valid_days: float | None = None,
    force: bool = False,
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
    force : bool
        The file is written where pictures are not plainly shifted, too.

    Raises
    ------
    ConfigError, DataError, CalibrationError
        The file cannot be written, or the pictures are unfit.
    """
    folder = used_run(run, ignore_exclusions=are_exclusions_ignored())
    found = register_run(folder, cycle=cycle)
    file = registration_file(found, folder, valid_days=valid_days)
    is_refused = found.doubt is not None and not force
    if out is not None and not is_refused:
        write_content(out, file.as_json())
    return CalibratedRegistration(found=found, file=file, is_refused=is_refused)
