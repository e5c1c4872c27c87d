"""What the uncertainty of the inputs does to the rows of a comparison."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from model.prediction.prediction import RegionPrediction
from model.processing.input_propagation import Propagation, propagate
from rigctl.comparison.rows import Row, off_prediction
from rigctl.errors import ConfigError, DataError
from rigctl.scene.input_limits import largest, smallest
from rigctl.scene.scene_inputs import Inputs

FloatArray = NDArray[np.float64]


def only_uncertain(inputs: Inputs) -> Inputs:
    """Return the inputs that have an uncertainty."""
    kept = np.flatnonzero(np.diag(inputs.cov) > 0.0)
    return replace(
        inputs,
        names=tuple(inputs.names[k] for k in kept),
        values=inputs.values[kept],
        cov=inputs.cov[np.ix_(kept, kept)],
        least=inputs.least[kept],
    )


def propagate_rows(
    rows: Sequence[Row], inputs: Inputs, predicted: Callable[[FloatArray], Mapping[str, RegionPrediction]]
) -> Propagation:
    """Return what the uncertain inputs do to the predictions of rows.

    Parameters
    ----------
    rows : sequence of Row
        With their predictions.
    inputs : Inputs
        All of them.
    predicted : callable
        Values of all inputs to what the model says of each region.

    Raises
    ------
    ConfigError
        The model has no prediction on either side of an input.
    DataError
        Within the uncertainty of an input a number of a row does not exist.
    """
    uncertain = np.flatnonzero(np.diag(inputs.cov) > 0.0)

    def off(some: FloatArray) -> FloatArray:
        values = inputs.values.copy()
        values[uncertain] = some
        try:
            regions = predicted(values)
        except ConfigError as error:
            # For the propagation: here the inputs do not go together. It takes the other side, and names the input.
            raise ValueError(str(error)) from error
        return np.array([off_prediction(row, _value(row, regions)) for row in rows])

    found = only_uncertain(inputs)
    try:
        return propagate(off, found.values, found.cov, least=smallest(found), most=largest(found))
    except ValueError as error:
        raise ConfigError(f"the uncertainties of the inputs ({', '.join(found.names)}): {error}") from error


def _value(row: Row, regions: Mapping[str, RegionPrediction]) -> float:
    try:
        return regions[row.region].quantities[row.quantity][row.statistic]
    except KeyError as error:
        raise DataError(
            f"{row.region}: {row.quantity} {row.statistic} does not exist everywhere within the uncertainty of the "
            "inputs; the light may be too weak there, or the uncertainty too large"
        ) from error
