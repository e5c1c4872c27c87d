"""The calibrations that a session is to be processed with: looked at once its devices are open, before any frame."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from rigctl.calibrations.made_for import made_for_rig
from rigctl.calibrations.noise.noise_file import NoiseParameters, require_noise_fits
from rigctl.calibrations.polarizer.polarizer_file import PolarizerParameters, require_polarizer_fits
from rigctl.devices.rig import Rig, open_rig
from rigctl.files.rig_file import RigFile
from rigctl.terminal import warn


@contextmanager
def open_calibrated_rig(
    rig_file: RigFile,
    *,
    session_name: str,
    run: Path,
    noise: NoiseParameters | None,
    polarizer: PolarizerParameters | None,
    now_utc: str,
) -> Iterator[Rig]:
    """Give the open devices of a rig, once calibrations are found to be theirs; warn of what is doubtful.

    Parameters
    ----------
    rig_file, session_name, run
        As `open_rig` takes them.
    noise, polarizer : NoiseParameters, PolarizerParameters or None
        Calibrations.
    now_utc : str
        When the session begins.

    Raises
    ------
    DataError
        A calibration is of other devices or settings, or the rig file says another axis.
    """
    with open_rig(rig_file, session_name=session_name, run=run) as rig:
        used = replace(
            made_for_rig(rig_file, now_utc=now_utc),
            camera_serial=rig.camera_identity.serial_number,
            stage_serial=rig.stage_identity.serial_number,
        )
        doubts = () if noise is None else require_noise_fits(noise, used)
        if polarizer is not None:
            doubts += require_polarizer_fits(polarizer, used, polarizer=rig_file.polarizer)
        for doubt in doubts:
            warn(doubt)
        yield rig
