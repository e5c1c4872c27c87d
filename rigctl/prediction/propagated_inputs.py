"""Propagation of the uncertainty of the inputs to predicted numbers."""

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.processing.agreement import Propagation, propagate
from model.quantities import difference
from rigctl.errors import ConfigError, DataError

if TYPE_CHECKING:
    from model.prediction import RegionPrediction
    from rigctl.scene.scene_inputs import Inputs

FloatArray = NDArray[np.float64]


class NumberKey(NamedTuple):
    """Which number of a prediction, or of a measurement."""

    region: str
    quantity: str
    statistic: str


def propagate_numbers(
    numbers: Mapping[NumberKey, float],
    inputs: "Inputs",
    predicted: Callable[[FloatArray], Mapping[str, "RegionPrediction"]],
) -> Propagation:
    """Return what the uncertain inputs do to predicted numbers, in their order.

    Parameters
    ----------
    numbers : mapping
        With the inputs at their values.
    inputs : Inputs
        All of them.
    predicted : callable
        Values of all inputs to what the model says of each region.

    Raises
    ------
    ConfigError
        The model has no prediction on either side of an input.
    DataError
        Within the uncertainty of an input one of the numbers does not exist.
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
        return np.array([difference(key.quantity, _value(key, regions), number) for key, number in numbers.items()])

    from rigctl.scene.scene_inputs import only_uncertain

    found = only_uncertain(inputs)
    try:
        fitted = [k for k, name in enumerate(found.names) if name in found.fitted]
        return propagate(off, found.values, found.cov, least=found.least, most=found.most, fitted=fitted)
    except ValueError as error:
        raise ConfigError(f"the uncertainties of the inputs ({', '.join(found.names)}): {error}") from error


def curved_inputs(propagation: Propagation, uncertain: "Inputs") -> Iterable[str]:
    """Return which inputs were taken by quadrature, and for which slopes had to do."""
    if propagation.curved:
        names = ", ".join(uncertain.names[k] for k in propagation.curved)
        yield f"curved within its uncertainty, hence propagated by quadrature: {names}"
    if propagation.limited:
        names = ", ".join(uncertain.names[k] for k in propagation.limited)
        yield f"so near to what is possible, for its uncertainty, that a slope had to do: {names}"


def correlated_pairs(uncertain: "Inputs") -> list[tuple[str, str, float]]:
    """Return the inputs whose errors go together, two and two with their correlation, the closest first."""
    std = np.sqrt(np.diag(uncertain.cov))
    correlation = uncertain.cov / np.outer(std, std)
    pairs = [(i, k) for k in range(len(std)) for i in range(k) if correlation[i, k] != 0.0]
    rows = [(uncertain.names[i], uncertain.names[k], float(correlation[i, k])) for i, k in pairs]
    return sorted(rows, key=lambda row: -abs(row[2]))


def _value(key: NumberKey, regions: Mapping[str, "RegionPrediction"]) -> float:
    try:
        return regions[key.region].quantities[key.quantity][key.statistic]
    except KeyError as error:
        raise DataError(
            f"{key.region}: {key.quantity} {key.statistic} does not exist everywhere within the uncertainty of the "
            "inputs; the light may be too weak there, or the uncertainty too large"
        ) from error
