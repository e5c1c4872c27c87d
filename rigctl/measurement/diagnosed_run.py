"""A run measured and diagnosed, and corrected by its own diagnosis where that is asked for."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from rigctl.errors import DataError
from rigctl.files.regions import Region
from rigctl.measurement.corrections import FoundCorrections
from rigctl.measurement.found_faults import found_faults
from rigctl.measurement.image_registration import moved_edges
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

    Raises
    ------
    DataError
        The registration that was given makes edges no better, and was not forced.
    """
    measurement = given.measure(run, regions)
    moved = _registered(measurement, force=given.force_registration)
    diagnosis = diagnose_run(measurement)
    if not correct:
        return DiagnosedRun(measurement=measurement, diagnosis=diagnosis, remarks=moved)
    found = _helpful(measurement, found_faults(measurement.grid, diagnosis, correct), force=given.force_registration)
    corrected = given.measure(run, regions, found)
    return DiagnosedRun(measurement=corrected, diagnosis=diagnose_run(corrected), remarks=(*moved, *found.remarks))


def _registered(measurement: Measurement, *, force: bool) -> tuple[str, ...]:
    """Return what a registration that was given does to the edges of a run; it has to make them better."""
    if measurement.shifts is None:
        return ()
    edges = moved_edges(measurement.run, measurement.grid, measurement.shifts)
    if not (edges.is_better or force):
        raise DataError(
            f"--register: not a plain shift of this run: {edges.text}; not applied (--force-registration applies it)"
        )
    return (edges.text,) if edges.text else ()


def _helpful(measurement: Measurement, found: FoundCorrections, *, force: bool) -> FoundCorrections:
    """Return corrections without shifts that make edges no better, unless they are forced."""
    if found.shifts is None:
        return found
    edges = moved_edges(measurement.run, measurement.grid, found.shifts)
    if edges.is_better or force:
        return replace(found, remarks=(*found.remarks, edges.text))
    said = f"shift: not applied, it is not a plain one: {edges.text} (--force-registration applies it)"
    return replace(found, shifts=None, remarks=(*(text for text in found.remarks if ", shift:" not in text), said))
