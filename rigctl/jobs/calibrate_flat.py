"""Calibrating flat fields: a run of even light in; the response of each pixel at each polarizer angle out."""

from dataclasses import dataclass
from pathlib import Path

from rigctl.calibrations.flat import FlatNumbers, RunFlat, flat_file, flat_npz, flat_of_run
from rigctl.calibrations.record import CalibrationFile, write_whole
from rigctl.console.exclusion_option import are_exclusions_ignored
from rigctl.runs.check import used_run

# A pattern of less is none.
_LEAST_PATTERN = 1e-4


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedFlat:
    """Flat fields, what their file states beside the pictures, and a doubt about them in words where there is one."""

    found: RunFlat
    file: CalibrationFile[FlatNumbers]
    doubt: str | None


def calibrate_flat(run: Path, out: Path, *, valid_days: float | None = None) -> CalibratedFlat:
    """Return the flat fields of a run, once their file is written.

    Parameters
    ----------
    run : Path
        Run folder with flat frames at each angle, and darks.
    out : Path
        File to write.
    valid_days : float or None
        For how long they hold.

    Raises
    ------
    ConfigError, DataError, CalibrationError
        The file cannot be written, or the frames are unfit.
    """
    folder = used_run(run, ignore_exclusions=are_exclusions_ignored())
    found = flat_of_run(folder)
    file = flat_file(found, folder, valid_days=valid_days)
    write_whole(out, flat_npz(found, file))
    return CalibratedFlat(found=found, file=file, doubt=_doubt(found))


def _doubt(found: RunFlat) -> str | None:
    worse = [flat for flat in found.flats if flat.noise_rms > flat.pattern_rms]
    if not worse:
        return None
    largest = max(flat.noise_rms / max(flat.pattern_rms, _LEAST_PATTERN) for flat in worse)
    return (
        f"{len(worse)} of {len(found.flats)} flats have more noise of their own than pattern: dividing by them "
        f"makes single pixels worse, and dust and vignetting alone better; take {largest**2:.0f} times as many "
        f"frames or more, or brighter ones"
    )
