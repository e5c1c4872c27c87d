"""How a run was read out, as the model takes it."""

from model.scene.scenario import Readout
from rigctl.errors import DataError
from rigctl.measurement.measurement import Measurement


def run_readout(measurement: Measurement) -> Readout:
    """Return angles and cycles of a run."""
    grid = measurement.grid
    return Readout(
        angles_rad=grid.polarizer_angles_rad,
        channel_names=grid.channel_names,
        cycles=grid.cycles,
        extinction_ratio=measurement.extinction_ratio,
        noise_factor=measurement.noise_factor if measurement.corrections.is_any else None,
        flat_error=None if measurement.flat is None else measurement.flat.error,
    )


def one_exposure_s(measurement: Measurement) -> float:
    """Return the exposure of a run's frames [s].

    Raises
    ------
    DataError
        It is not known, or differs between angles.
    """
    exposures = measurement.grid.exposures_s
    if exposures is None:
        raise DataError(f"{measurement.run.path}: its exposure is not known, and a scene cannot be predicted without")
    if not measurement.grid.is_one_exposure:
        raise DataError(f"{measurement.run.path}: its angles have different exposures; a scene needs one for all")
    return float(exposures[0])
