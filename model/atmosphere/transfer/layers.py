"""Homogeneous layers: what a user says of them, and what the solver makes of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from math import isfinite

from model.atmosphere.transfer.scattering_matrix import ScatteringMatrix

_NEGLIGIBLE = 1e-13  # of the whole depth: faces so close cannot be told apart in double precision


@dataclass(frozen=True)
class Layer:
    """A homogeneous layer of molecules and one aerosol.

    Attributes
    ----------
    tau_rayleigh
        Optical depth of molecular scattering, 0 or more.
    tau_aerosol
        Optical depth of aerosol extinction, 0 or more.
    ssa_aerosol
        Single-scattering albedo of the aerosol, 0 to 1. A pure absorber (ozone) is an aerosol of albedo 0.
    g_aerosol
        Asymmetry of the aerosol's Henyey-Greenstein function, -1 < g < 1; a matrix brings its own.
    delta
        Rayleigh anisotropy (1 - rho)/(1 + rho/2), rho the depolarization factor, 0 to 1; about 0.958 for air.
    matrix
        Scattering matrix of the aerosol, which spheres have; None for a Henyey-Greenstein function.
    forward_share
        Share of the aerosol's scattering that counts as not scattered at all, 0 to below 1; the solver sets it.
    """

    tau_rayleigh: float
    tau_aerosol: float
    ssa_aerosol: float
    g_aerosol: float
    delta: float
    matrix: ScatteringMatrix | None = None
    forward_share: float = 0.0

    def __post_init__(self) -> None:
        for name in ("tau_rayleigh", "tau_aerosol"):
            _require(name, getattr(self, name), getattr(self, name) >= 0.0, "0 or more")
        for name in ("ssa_aerosol", "delta"):
            _require(name, getattr(self, name), 0.0 <= getattr(self, name) <= 1.0, "0 to 1")
        _require("forward_share", self.forward_share, 0.0 <= self.forward_share < 1.0, "0 to below 1")
        _require("g_aerosol", self.g_aerosol, -1.0 < self.g_aerosol < 1.0, "strictly between -1 and 1")

    @property
    def depth(self) -> float:
        """Optical depth of the layer without what counts as not scattered."""
        return self.full_depth - self.tau_aerosol * self.ssa_aerosol * self.forward_share

    @property
    def full_depth(self) -> float:
        """Extinction optical depth of the layer."""
        return self.tau_rayleigh + self.tau_aerosol


def _require(name: str, value: float, allowed: bool, wanted: str) -> None:
    """Refuse a number outside its range."""
    if not (allowed and isfinite(value)):
        raise ValueError(f"Layer: {name} = {value!r}, but it must be finite and {wanted}")


def merge_alike(layers: Sequence[Layer]) -> list[Layer]:
    """Layers with neighbours of the same composition joined, and those of no depth left out.

    Parameters
    ----------
    layers
        Top to bottom.

    Returns
    -------
    list of Layer
        May be empty. What the solver answers thus does not depend on how a homogeneous layer was cut.
    """
    least = _NEGLIGIBLE * sum(layer.depth for layer in layers)
    filled = (layer for layer in layers if layer.depth > least)
    return [_joined(list(alike)) for _, alike in groupby(filled, key=_composition)]


def _composition(layer: Layer) -> tuple[object, ...]:
    """Return what two layers must share to be one; rounded, since cutting a layer in parts rounds its depths."""
    aerosol_share = float(f"{layer.tau_aerosol / layer.depth:.10g}")
    return (aerosol_share, layer.ssa_aerosol, layer.g_aerosol, layer.delta, layer.matrix, layer.forward_share)


def _joined(alike: list[Layer]) -> Layer:
    """One layer of the depth of all."""
    return replace(
        alike[0],
        tau_rayleigh=sum(layer.tau_rayleigh for layer in alike),
        tau_aerosol=sum(layer.tau_aerosol for layer in alike),
    )
