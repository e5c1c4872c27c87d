"""The parameters of a surface that can be fitted: their limits, and what a caller may ask of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from model.surface.lobe import INDEX_MAX, SLOPE_RMS_MIN
from model.surface.pbrdf import Surface


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """Limits and scale of one parameter of a surface.

    Parameters
    ----------
    lowest, highest
        What the value may be at all.
    bounds
        Where it is looked for unless the caller says otherwise.
    step
        Step of difference quotients: far above the error of the series for E (1e-7), far below the scale on which
        the model bends.
    """

    lowest: float
    highest: float
    bounds: tuple[float, float]
    step: float


PARAMETERS: Mapping[str, Parameter] = {
    "n": Parameter(lowest=1e-3, highest=INDEX_MAX, bounds=(1.0, 3.0), step=1e-4),
    "k": Parameter(lowest=0.0, highest=INDEX_MAX, bounds=(0.0, 10.0), step=1e-4),
    "slope_rms": Parameter(lowest=SLOPE_RMS_MIN, highest=10.0, bounds=(0.005, 1.0), step=2e-5),
    "dhr": Parameter(lowest=0.0, highest=1.0, bounds=(0.0, 1.0), step=1e-5),
    "specular_weight": Parameter(lowest=0.0, highest=1.0, bounds=(0.0, 1.0), step=1e-4),
}


def checked_names(free: Sequence[str], *, start: Surface, bounds: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
    """Return the names of the parameters to fit in the order of `PARAMETERS`.

    Parameters
    ----------
    free
        Names, in any order.
    start
        The surface to begin with.
    bounds
        Where to look, by name.

    Returns
    -------
    tuple of str
        Names.

    Raises
    ------
    ValueError
        If a name is not known, none is free, or the DHR is free where the start has none or bounded.
    """
    unknown = sorted({*free, *bounds} - set(PARAMETERS))
    if unknown or not free:
        raise ValueError(f"free = {tuple(free)}, bounds for {tuple(bounds)}; allowed are {', '.join(PARAMETERS)}")
    if "dhr" in free and start.dhr is None:
        raise ValueError("dhr is to be fitted, but the start has none; give the start a dhr")
    if "dhr" in bounds:
        raise ValueError("dhr takes no bounds: it lies between what the specular lobe alone reflects and 1")
    return tuple(name for name in PARAMETERS if name in free)


def checked_bounds(name: str, bounds: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
    """Return where to look for a parameter.

    Parameters
    ----------
    name
        Of the parameter.
    bounds
        What the caller says, by name; for a name that is not in it the parameter's own bounds hold.

    Returns
    -------
    tuple of float
        Lower and upper bound.

    Raises
    ------
    ValueError
        If the bounds are not in order, too close to each other, or outside of what the value may be.
    """
    parameter = PARAMETERS[name]
    low, high = bounds.get(name, parameter.bounds)
    if not parameter.lowest <= low < high <= parameter.highest or high - low < 4.0 * parameter.step:
        raise ValueError(
            f"bounds of {name} = ({low}, {high}); allowed is low < high within "
            f"{parameter.lowest:g} to {parameter.highest:g}"
        )
    return low, high
