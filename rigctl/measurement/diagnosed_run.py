"""A run measured and diagnosed, and corrected by its own diagnosis where that is asked for."""

from collections.abc import Sequence
from dataclasses import dataclass

from rigctl.files.regions import Region
from rigctl.measurement.found_faults import found_faults
from rigctl.measurement.measurement import Measurement
from rigctl.measurement.run_calibrations import RunCalibrations
from rigctl.measurement.run_diagnosis import RunDiagnosis, diagnose_run
from rigctl.runs.run_folder import Run


@dataclass(frozen=True, kw_only=True, eq=False)
class DiagnosedRun:
    """What a run measured, and what it says of itself.

    Attributes
    ----------
    measurement, diagnosis
        After the corrections.
    remarks : tuple of str
        What was corrected.
    """

    measurement: Measurement
    diagnosis: RunDiagnosis
    remarks: tuple[str, ...]


def diagnosed(run: Run, regions: list[Region], given: RunCalibrations, *, correct: Sequence[str]) -> DiagnosedRun:
    """Return a run measured with its calibrations, diagnosed, and corrected by what was found.

    Parameters
    ----------
    run, regions, given
        The run, its regions and calibrations.
    correct : sequence of str
        "throughput", "dark-level", "shift"; nothing is corrected that is not named.
    """
    measurement = given.measure(run, regions)
    diagnosis = diagnose_run(measurement)
    if not correct:
        return DiagnosedRun(measurement=measurement, diagnosis=diagnosis, remarks=())
    found = found_faults(measurement.grid, diagnosis, correct)
    corrected = given.measure(run, regions, found)
    return DiagnosedRun(measurement=corrected, diagnosis=diagnose_run(corrected), remarks=found.remarks)
