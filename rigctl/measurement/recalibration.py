"""A run as if it had been taken with other calibrations: those that are named, or that its store holds today."""

from dataclasses import replace

from rigctl.calibrations.polarizer.polarizer_file import PolarizerParameters, read_polarizer_file
from rigctl.calibrations.store import CalibrationKind
from rigctl.errors import DataError
from rigctl.measurement.picked_calibrations import PickedCalibrations, picked_for_run
from rigctl.measurement.run_calibrations import CalibrationPaths
from rigctl.runs.run_folder import Run
from rigctl.runs.session_record import PolarizerAsTaken, RigAsTaken

# What a measurement can be made with.
MEASURED_WITH: tuple[CalibrationKind, ...] = ("noise", "polarizer", "flat", "registration")


def recalibrated(run: Run, paths: CalibrationPaths) -> tuple[Run, PickedCalibrations]:
    """Return a run with the axis of its polarizer calibration, if there is one, and all calibrations for it.

    Parameters
    ----------
    run : Run
        As it was taken.
    paths : CalibrationPaths
        What is named, and whether anything is picked.

    Raises
    ------
    ConfigError, DataError
        A calibration cannot be read, is of other devices, or a frame does not say where the stage stood.
    """
    # What the rig file stated of the axis is what may be wrong: no calibration is refused for it.
    open_axis = _with_polarizer(run, replace(run.session.polarizer, sense=None, offset_deg=None))
    picked = picked_for_run(paths, open_axis, MEASURED_WITH)
    named = picked.paths.polarizer
    return (run if named is None else with_axis(run, read_polarizer_file(named))), picked


def with_axis(run: Run, polarizer: PolarizerParameters) -> Run:
    """Return a run whose polarizer angles are those of its stage angles by a calibration.

    Parameters
    ----------
    run : Run
        Its frames stay as they are.
    polarizer : PolarizerParameters
        With sense and offset.

    Raises
    ------
    DataError
        A frame of the scene has no stage angle.
    """
    frames = []
    for record in run.frames:
        if record.stage_angle_deg is not None:
            angle = polarizer.sense * record.stage_angle_deg + polarizer.offset_deg.value
            frames.append(replace(record, polarizer_angle_deg=angle))
        elif record.kind == "scene":
            raise DataError(f"{run.path}: {record.file} does not say where the stage stood: its axis stays as it was")
        else:
            frames.append(record)
    known = run.session.polarizer
    offset = polarizer.offset_deg
    taken = replace(known, sense=polarizer.sense, offset_deg=offset.value, offset_std_deg=offset.std_error)
    return replace(
        _with_polarizer(run, taken),
        frames=tuple(frames),
        written_angles_deg={record.sequence: record.polarizer_angle_deg for record in run.frames},
    )


def _with_polarizer(run: Run, polarizer: PolarizerAsTaken) -> Run:
    rig = replace(run.session.rig or RigAsTaken(), polarizer=polarizer)
    return replace(run, session=replace(run.session, rig=rig))
