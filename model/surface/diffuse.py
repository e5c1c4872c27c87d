"""Diffusely scattered light, of the amount that a directional-hemispherical reflectance (DHR) leaves for it."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from model.quadrature import gauss_legendre
from model.surface import fresnel
from model.surface.lobe import Lobe
from model.surface.reflectance import lobe_reflectance
from model.surface.reflectance_table import reflectance_table

FloatArray = NDArray[np.float64]
DiffuseKind = Literal["lambert", "balance", "coupled", "polarised"]
DIFFUSE: tuple[DiffuseKind, ...] = get_args(DiffuseKind)

_MEAN_NODES = 96
# E is known to this; a perfect mirror leaves less than that, and 0 / 0 must not be asked.
_NOTHING = 1e-8
# A transmittance is known to 1e-16; below this too few of its digits are left to divide by.
_OPAQUE = 1e-12


@dataclass(frozen=True, kw_only=True)
class Diffuse:
    """Parameters of the diffuse term of a surface.

    Parameters
    ----------
    kind
        "lambert", "balance", "coupled" or "polarised"; see `add_diffuse`.
    lobe
        The specular lobe.
    specular_weight
        B, the lobe's weight.
    excess
        DHR - B E(theta_m), what is left for the diffuse term at the angle of measurement.
    dhr_angle_rad
        theta_m [rad].
    """

    kind: DiffuseKind
    lobe: Lobe
    specular_weight: float
    excess: float
    dhr_angle_rad: float


@lru_cache(maxsize=256)
def reflectance_at(lobe: Lobe, theta_rad: float) -> float:
    """Return the lobe's reflectance E of unpolarised light at one angle; kept for each lobe and angle.

    Parameters
    ----------
    theta_rad
        Zenith angle [rad], 0 to pi/2.

    Returns
    -------
    float
        E, to 1e-8.
    """
    return float(lobe_reflectance(theta_rad, lobe=lobe).s0)


def add_diffuse(out: FloatArray, theta_i_rad: FloatArray, theta_r_rad: FloatArray, *, diffuse: Diffuse) -> None:
    """Add the diffuse term to Mueller matrices.

    Parameters
    ----------
    out
        Shape (N, 3, 3) [sr^-1]; added to.
    theta_i_rad, theta_r_rad
        Zenith angles of sun and sensor [rad], shape (N,), in [0, pi/2).
    diffuse
        The term.

    Notes
    -----
    With E the reflectance of the lobe, B its weight and x = DHR - B E(theta_m):

    - "lambert": f00 = x / pi. Reciprocal; a bright glossy surface reflects more than it receives near grazing.
    - "balance": f00 = max(0, DHR - B E(theta_i)) / pi, so that the total is DHR at all angles of incidence up to the
      one where the lobe alone exceeds it. Conserves energy; not reciprocal.
    - "coupled": f00 = rho (1 - B E(theta_i)) (1 - B E(theta_r)) / (pi mean(1 - B E)), rho = x / (1 - B E(theta_m)).
      Reciprocal, total B E + rho (1 - B E) <= 1. Without shadowing E passes 1 near grazing; there 1 - B E counts as 0.
    - "polarised": f = rho t(theta_r) t(theta_i)^T / pi, t = ((T_s + T_p) / 2, (T_s - T_p) / 2, 0),
      T = 1 - B |r|^2 of the mean plane: light enters, loses its polarization and leaves. Reciprocal; conserves
      energy for every polarization of the light that comes in.

    References
    ----------
    "balance": Hyde, Schmidt and Havrilla (2009), doi:10.1364/OE.17.022138, with the measured DHR in place of
    a perfect reflector's. "coupled": Kelemen and Szirmay-Kalos (2001), Eurographics short presentations. "polarised":
    Baek et al. (2018), doi:10.1145/3272127.3275018.
    """
    if diffuse.kind == "lambert":
        out[:, 0, 0] += diffuse.excess / np.pi
    elif diffuse.kind == "balance":
        out[:, 0, 0] += _balance(theta_i_rad, diffuse) / np.pi
    elif diffuse.kind == "coupled":
        escape = _unreflected(theta_i_rad, diffuse) * _unreflected(theta_r_rad, diffuse)
        out[:, 0, 0] += _scale(diffuse) / np.pi * escape
    else:
        entering = _scale(diffuse) / np.pi * _transmitted(theta_i_rad, diffuse)
        leaving = _transmitted(theta_r_rad, diffuse)
        out[:, :2, :2] += leaving.T[:, :, None] * entering.T[:, None, :]


def diffuse_row(theta_i_rad: FloatArray, *, diffuse: Diffuse) -> FloatArray:
    """Return what the diffuse term adds to the directional-hemispherical reflectance.

    Parameters
    ----------
    theta_i_rad
        Zenith angle of the incident light [rad], shape (N,), in [0, pi/2).
    diffuse
        The term.

    Returns
    -------
    ndarray
        Shape (2, N): factors of the incident S0 and S1.

    References
    ----------
    Definition: pi times the cosine-weighted mean of the first row over the hemisphere.
    """
    row = np.zeros((2, theta_i_rad.size))
    if diffuse.kind == "lambert":
        row[0] = diffuse.excess
    elif diffuse.kind == "balance":
        row[0] = _balance(theta_i_rad, diffuse)
    elif diffuse.kind == "coupled":
        row[0] = _scale(diffuse) * _mean_unreflected(diffuse) * _unreflected(theta_i_rad, diffuse)
    else:
        row[:] = _scale(diffuse) * _mean_transmitted(diffuse) * _transmitted(theta_i_rad, diffuse)
    return row


@lru_cache(maxsize=64)
def _scale(diffuse: Diffuse) -> float:
    """Return the factor by which a product of two angles' functions has the total DHR that was measured."""
    if abs(diffuse.excess) < _NOTHING:
        return 0.0
    if diffuse.kind == "coupled":
        there = 1.0 - diffuse.specular_weight * reflectance_at(diffuse.lobe, diffuse.dhr_angle_rad)
        return diffuse.excess / (there * _mean_unreflected(diffuse))
    there = float(_transmitted(np.array([diffuse.dhr_angle_rad]), diffuse)[0, 0])
    if there < _OPAQUE:
        raise ValueError(
            f"diffuse = 'polarised': no light enters a surface of n = {diffuse.lobe.n:g}, k = {diffuse.lobe.k:g} "
            f"(a share of {there:.1g}), so that none can leave; choose 'coupled', or leave out dhr"
        )
    return diffuse.excess / (there * _mean_transmitted(diffuse))


def _balance(theta_i_rad: FloatArray, diffuse: Diffuse) -> FloatArray:
    """Return what DHR leaves at the angle of incidence, not below zero; shape (N,)."""
    at_measurement = reflectance_at(diffuse.lobe, diffuse.dhr_angle_rad)
    dhr = diffuse.excess + diffuse.specular_weight * at_measurement
    lobe = diffuse.specular_weight * reflectance_table(diffuse.lobe).at(theta_i_rad)
    return np.asarray(np.maximum(dhr - lobe, 0.0))


def _unreflected(theta_rad: FloatArray, diffuse: Diffuse) -> FloatArray:
    """Return 1 - B E(theta), the share of light that the lobe does not take; shape (N,)."""
    lobe = diffuse.specular_weight * reflectance_table(diffuse.lobe).at(theta_rad)
    return np.asarray(np.maximum(1.0 - lobe, 0.0))


def _mean_unreflected(diffuse: Diffuse) -> float:
    """Return the cosine-weighted mean of 1 - B E over the hemisphere."""
    theta, weight = reflectance_table(diffuse.lobe).mean_nodes()
    return float(weight @ _unreflected(theta, diffuse))


def _transmitted(theta_rad: FloatArray, diffuse: Diffuse) -> FloatArray:
    """Return transmittance for S0 and for S1 through the mean plane, 1 - B R and -B (Rs - Rp) / 2; shape (2, N)."""
    lobe = diffuse.lobe
    mean, difference, _ = fresnel.mueller_elements(cos2_psi=np.cos(theta_rad) ** 2, n=lobe.n, k=lobe.k)
    return np.stack([1.0 - diffuse.specular_weight * mean, -diffuse.specular_weight * difference])


def _mean_transmitted(diffuse: Diffuse) -> float:
    """Return the cosine-weighted mean transmittance of unpolarised light over the hemisphere."""
    theta, weight = _mean_nodes(diffuse.lobe)
    return float(weight @ _transmitted(theta, diffuse)[0])


def _mean_nodes(lobe: Lobe) -> tuple[FloatArray, FloatArray]:
    """Angles and weights for the cosine-weighted mean, with a panel end at the critical angle of n below 1."""
    node, weight = gauss_legendre(_MEAN_NODES)
    critical = float(np.arcsin(lobe.n)) if lobe.n < 1.0 else 0.5 * np.pi
    spans = [(0.0, critical), (critical, 0.5 * np.pi)]
    # Squeezed towards both ends of each panel: the root at the critical angle becomes smooth.
    spaced, stretch = np.sin(0.5 * np.pi * node) ** 2, 0.5 * np.pi * np.sin(np.pi * node) * weight
    theta = np.concatenate([low + (high - low) * spaced for low, high in spans])
    lengths = np.concatenate([(high - low) * stretch for low, high in spans])
    return theta, lengths * np.sin(2.0 * theta)
