"""A number that lies between two limits, anywhere as likely as anywhere else."""

import math


def rectangular_std(low: float, high: float) -> float:
    """Return the standard deviation of a number that is uniform between two limits.

    Parameters
    ----------
    low, high
        The limits, low <= high, in any unit.

    References
    ----------
    JCGM 100:2008 (GUM), section 4.3.7.
    """
    return (high - low) / math.sqrt(12.0)
