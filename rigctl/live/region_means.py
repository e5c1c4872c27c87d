"""The mean counts of regions, fast enough to be taken of every frame while the session runs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.files.regions import Region, masks
from rigctl.files.session_file import PICTURE


@dataclass(frozen=True, kw_only=True)
class PixelMean:
    """A mean count.

    Attributes
    ----------
    mean_dn : float
        [DN].
    pixels : int
        Of how many.
    """

    mean_dn: float
    pixels: int


@dataclass(frozen=True, kw_only=True, eq=False)
class _Window:
    rows: slice
    columns: slice
    inside: NDArray[np.bool_]


class RegionMeans:
    """Knows where regions lie in pictures of one size.

    Parameters
    ----------
    regions : sequence of Region
        Their names differ; none is called "picture".
    """

    def __init__(self, regions: Sequence[Region] = ()) -> None:
        self._regions = list(regions)
        self._shape: tuple[int, ...] = ()
        self._windows: dict[str, _Window] = {}

    def of(self, counts: NDArray[np.uint16], *, share: float = 1.0) -> dict[str, PixelMean]:
        """Return the mean of the whole picture, and of each region by its name.

        Parameters
        ----------
        counts : (H, W) array of uint16
            The picture.
        share : float
            Of its pixels that have a sample of their own: one where nothing was interpolated.

        Raises
        ------
        ConfigError
            A region does not fit into the picture.
        """
        if counts.shape != self._shape:
            self._windows = self._fitted(counts.shape)
            self._shape = counts.shape
        means = {PICTURE: PixelMean(mean_dn=float(counts.mean()), pixels=max(1, round(share * counts.size)))}
        for name, window in self._windows.items():
            values = counts[window.rows, window.columns][window.inside]
            means[name] = PixelMean(mean_dn=float(values.mean()), pixels=max(1, round(share * values.size)))
        return means

    def _fitted(self, shape: tuple[int, ...]) -> dict[str, _Window]:
        height, width = shape
        found = masks(self._regions, width=width, height=height) if self._regions else {}
        return {name: _window(mask) for name, mask in found.items()}


def _window(mask: NDArray[np.bool_]) -> _Window:
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    along_y, along_x = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return _Window(rows=along_y, columns=along_x, inside=mask[along_y, along_x])
