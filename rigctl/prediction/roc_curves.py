"""Whole ROC curves of a pair of regions, on Stokes parameters and on the counts behind the polarizer."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from model.prediction import PairDetection, rocs_of_pair
from rigctl.errors import ConfigError
from rigctl.files.choices import ROC_KINDS, RocKind

if TYPE_CHECKING:
    from model.prediction import RegionPrediction

# Six decades on a logarithmic axis, and the rest of the curve on an even one.
ROC_RATES = np.concatenate([np.logspace(-6.0, -1.0, 51), np.linspace(0.1, 1.0, 19)[1:]])


@dataclass(frozen=True, kw_only=True)
class RocPair:
    """Region that is sought, and region on which."""

    target: str
    background: str


def parse_roc(request: str, regions: tuple[str, ...]) -> RocPair:
    """Return the pair of a request ``TARGET,BACKGROUND``.

    Raises
    ------
    ConfigError
        It cannot be read, or there is no such region.
    """
    names = [name.strip() for name in request.split(",")]
    if len(names) != 2 or names[0] == names[1] or not set(names) <= set(regions):
        raise ConfigError(
            f"--roc: is {request!r}, must be TARGET,BACKGROUND, two of the scene's regions: {', '.join(regions)}"
        )
    return RocPair(target=names[0], background=names[1])


def roc_curves(found: Mapping[str, "RegionPrediction"], pair: RocPair) -> dict[RocKind, PairDetection]:
    """Return the whole ROC of a pair for each kind of vector.

    Parameters
    ----------
    found : mapping
        Region to prediction.
    pair : RocPair
        Two of them.
    """
    return {kind: curves[0] for kind, curves in roc_curves_of_sweep((found,), pair).items()}


def roc_curves_of_sweep(
    found: Sequence[Mapping[str, "RegionPrediction"]], pair: RocPair
) -> dict[RocKind, tuple[PairDetection, ...]]:
    """Return the whole ROC of a pair at each point of a sweep, for each kind of vector.

    Parameters
    ----------
    found : sequence of mapping
        Region to prediction, of each point.
    pair : RocPair
        Two of them.
    """
    return {kind: rocs_of_pair(pair.target, pair.background, found, ROC_RATES, kind=kind) for kind in ROC_KINDS}
