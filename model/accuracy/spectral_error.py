"""What the number of wavelengths costs: one left out, scaled by what the optical depth says of all the others."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.lighting.band_lighting import BandLighting
from model.atmosphere.ozone import ozone_optical_depth
from model.atmosphere.profile import AtmosphereState, optical_depth
from model.atmosphere.sun import SolarBand
from model.atmosphere.wavelengths import lagrange_basis

FloatArray = NDArray[np.float64]

# Slant depths, in vertical ones, of the functions of the optical depth that stand for scattered light.
_SLANTS = (0.3, 1.0, 3.0)
# Of which the sums over the spectrum are certain.
_ROUNDING = 1e-11


@dataclass(frozen=True, kw_only=True, eq=False)
class LeftOut:
    """A band with one wavelength less.

    Attributes
    ----------
    lighting
        With one wavelength less.
    ratio
        By what the difference that this makes is to be multiplied for an estimate of the error of the full number.
    """

    lighting: BandLighting
    ratio: float


def left_out(lighting: BandLighting, *, band: SolarBand, state: AtmosphereState) -> LeftOut:
    """Return a band with one of its wavelengths left out.

    Parameters
    ----------
    lighting
        Of two wavelengths or more.
    band, state
        From which it was computed.

    Notes
    -----
    The ratio is that of functions of the optical depth, which is known at all wavelengths: 1 - exp(-m tau), light
    scattered once, and its square, light scattered twice.

    References
    ----------
    Definition.
    """
    nodes_m = np.array([column.wavelength_m for column in lighting.columns])
    kept = np.delete(np.arange(nodes_m.size), nodes_m.size // 2)
    mu0 = lighting.solutions[0].mu0
    ozone = np.exp(-ozone_optical_depth(wavelength_m=band.wavelength_m, ozone_m=state.ozone_m) / mu0)
    fewer = band.integral(ozone * lagrange_basis(nodes_m=nodes_m[kept], wavelength_m=band.wavelength_m))
    used = band.weighted > 0.0
    depth = np.zeros(used.size)
    depth[used] = optical_depth(state, wavelength_m=band.wavelength_m[used])
    at_nodes = optical_depth(state, wavelength_m=nodes_m)
    full = np.array(band.integral(ozone * _shapes(depth)))
    by_all, by_fewer = _shapes(at_nodes) @ lighting.irradiance, _shapes(at_nodes)[:, kept] @ fewer
    error, step = (by_all - full) / full, (by_fewer - by_all) / full
    ratio = float((np.linalg.norm(error) + _ROUNDING) / (np.linalg.norm(step) + _ROUNDING))
    return LeftOut(
        lighting=replace(
            lighting,
            columns=tuple(lighting.columns[k] for k in kept),
            solutions=tuple(lighting.solutions[k] for k in kept),
            irradiance=fewer,
        ),
        ratio=min(ratio, 1.0),
    )


def _shapes(depth: FloatArray) -> FloatArray:
    once = np.stack([1.0 - np.exp(-slant * depth) for slant in _SLANTS])
    return np.concatenate([once, once**2])
