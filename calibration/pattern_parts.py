"""The fixed pattern of a level, split into what rows, columns and single pixels have of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PatternParts:
    """Variances [DN^2] that add up to the spatial variance; each may be below 0 by its error."""

    row_dn2: float
    column_dn2: float
    pixel_dn2: float


def pattern_parts(picture_dn: FloatArray, *, spatial_variance_dn2: float, noise_dn2: float) -> PatternParts:
    """Return the parts of the spatial variance that rows, columns and pixels have.

    Parameters
    ----------
    picture_dn : (M, N) array
        Mean picture of a level [DN].
    spatial_variance_dn2 : float
        Its variance, temporal noise taken off [DN^2].
    noise_dn2 : float
        Temporal variance that is left in a pixel of the mean picture [DN^2].

    Notes
    -----
    A picture of one row, one column or 2 x 2 pixels has no parts that could be told apart; all of it counts as pixels'.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, section 8.2: the means of rows and of columns hold their own pattern
    and a share of the pixels', which three linear equations take apart.
    """
    rows, columns = picture_dn.shape
    freedom = rows * columns - rows - columns
    if freedom <= 0:
        return PatternParts(row_dn2=0.0, column_dn2=0.0, pixel_dn2=spatial_variance_dn2)
    of_columns = float(picture_dn.mean(axis=0).var()) - noise_dn2 / rows
    of_rows = float(picture_dn.mean(axis=1).var()) - noise_dn2 / columns
    n = rows * columns
    return PatternParts(
        row_dn2=((n - columns) * of_rows - rows * (spatial_variance_dn2 - of_columns)) / freedom,
        column_dn2=((n - rows) * of_columns - columns * (spatial_variance_dn2 - of_rows)) / freedom,
        pixel_dn2=n * (spatial_variance_dn2 - of_columns - of_rows) / freedom,
    )
