"""The blocks of azimuth modes of one run: their orders summed, and the error of all estimated."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.transfer.residual import refined, residual
from model.atmosphere.transfer.scattering import scattering_of
from model.atmosphere.transfer.successive_orders import OrderSum, Setting, mean_radiance_of, sum_orders
from model.atmosphere.transfer.transport import transport_of

_LARGEST_RATIO = 0.99  # of successive orders, where an error is taken to grow a hundredfold


@dataclass(frozen=True, kw_only=True)
class SolvedBlock:
    """A block of azimuth modes and the sum of its orders.

    Attributes
    ----------
    modes
        The azimuth modes; the first block begins with 0.
    polarized
        Whether Q and U were carried.
    result
        The sum of orders.
    """

    modes: range
    polarized: bool
    result: OrderSum


def solve_blocks(
    setting: Setting, coefficients: NDArray[np.float64], blocks: Sequence[tuple[range, bool]]
) -> list[SolvedBlock]:
    """Orders of scattering summed for each block; all are measured by the mean radiance, which the first one has."""
    solved: list[SolvedBlock] = []
    for modes, polarized in blocks:
        scattering = scattering_of(setting.grid, coefficients, modes=modes, polarized=polarized)
        mean = mean_radiance_of(solved[0].result.moments) if solved else None
        result = sum_orders(setting, scattering, mean_radiance=mean)
        solved.append(SolvedBlock(modes=modes, polarized=polarized, result=result))
    return solved


def estimate_error(setting: Setting, coefficients: NDArray[np.float64], blocks: Sequence[SolvedBlock]) -> float:
    """Estimated error of quadrature and of the orders left out, as a share of the mean radiance that leaves.

    Notes
    -----
    The larger share of the light that leaves at the top and at the ground; the errors of the blocks are added.

    References
    ----------
    definition: see `model.atmosphere.transfer.residual.residual`
    """
    grid = refined(setting.grid)
    fine = replace(setting, grid=grid, transport=transport_of(grid))
    residuals = [
        residual(fine, coefficients, block.result, modes=block.modes, polarized=block.polarized) for block in blocks
    ]
    change = np.zeros(2)
    for block, missed in zip(blocks, residuals, strict=True):
        change += missed.change / (1.0 - min(block.result.ratio, _LARGEST_RATIO))
    mean = residuals[0].mean
    share = np.divide(change, mean, out=np.zeros(2), where=mean > 0.0)
    return float(np.max(share)) + sum(block.result.tail for block in blocks)
