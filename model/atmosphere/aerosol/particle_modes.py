"""Modes of particles that make up an aerosol of spheres."""

from dataclasses import dataclass

import numpy as np

from model.atmosphere.aerosol.refractive_index import RefractiveIndex
from model.atmosphere.aerosol.size_distribution import SizeDistribution


@dataclass(frozen=True, kw_only=True)
class ParticleMode:
    """Particles of one substance and one size distribution.

    Attributes
    ----------
    number_share
        Their share of all particles, above 0.
    sizes
        Size distribution.
    index
        Refractive index.
    """

    number_share: float
    sizes: SizeDistribution
    index: RefractiveIndex

    def __post_init__(self) -> None:
        if not 0.0 < self.number_share < np.inf:
            raise ValueError(f"ParticleMode: number_share = {self.number_share!r} must be finite and above 0")


@dataclass(frozen=True, kw_only=True)
class MieAerosol:
    """Aerosol of homogeneous spheres.

    Attributes
    ----------
    name
        What to call it.
    modes
        One or more; their shares count relative to each other.
    source
        Where its numbers come from.
    assumed
        What of it is assumed rather than documented; empty if nothing is.
    """

    name: str
    modes: tuple[ParticleMode, ...]
    source: str
    assumed: str = ""

    def __post_init__(self) -> None:
        if not self.modes:
            raise ValueError(f"MieAerosol {self.name!r}: give one mode or more")
