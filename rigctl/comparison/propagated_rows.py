"""What the uncertainty of the inputs does to the rows of a comparison."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from model.prediction.prediction import RegionPrediction
from model.processing.input_propagation import Propagation, propagate
from rigctl.comparison.rows import Row, off_prediction
from rigctl.errors import ConfigError, DataError
from rigctl.scene.scene_inputs import Inputs, only_uncertain

FloatArray = NDArray[np.float64]


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
        return propagate(off, found.values, found.cov, least=found.least, most=found.most)
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
