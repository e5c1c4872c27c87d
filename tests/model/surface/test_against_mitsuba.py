"""The specular lobe against Mitsuba 3 (variant scalar_spectral_polarized), another renderer with code of its own.

What differs by convention, and how it is undone here:

- Mitsuba counts `wi` as the way to the camera and `wo` as the way to the light, both away from the surface.
- Its Mueller matrix stands in axes that follow from the directions alone (`stokes_basis`); `rotate_mueller_basis` turns
  them to ours: horizontal, to the right of who looks along the ray back to its source. The sign of S2 is the same.
- `eval` holds the cosine of the incident light, in single precision.
- `alpha` of its Beckmann distribution is the root of 2 times the deviation of the slope along one axis.
- Its shadowing is a rational fit to Smith's; it scales the matrix and leaves the normalised one alone.
- Its `roughdielectric` is not polarised: a dielectric is a `roughconductor` with k = 0.
"""

import importlib.util

import numpy as np
import pytest

from model.stokes import direction, horizontal_axis
from model.surface.pbrdf import Surface, mueller

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None, reason="mitsuba is not installed: pip install mitsuba"
)


@pytest.fixture(scope="module")
def mi():
    import mitsuba

    mitsuba.set_variant("scalar_spectral_polarized")
    return mitsuba


def _of_mitsuba(mi, lobe, *, theta_i, theta_r, phi):
    """Return the matrix of light from the azimuth phi to a camera at the azimuth 0, cosine of incidence divided out."""

    def _vector(values):
        return mi.Vector3f(*(float(value) for value in values))

    sun = direction(zenith_rad=theta_i, azimuth_rad=phi)
    camera = direction(zenith_rad=theta_r, azimuth_rad=0.0)
    at = mi.SurfaceInteraction3f()
    at.wi, at.wavelengths = _vector(camera), [550.0] * 4
    matrix = mi.mueller.rotate_mueller_basis(
        lobe.eval(mi.BSDFContext(), at, _vector(sun)),
        _vector(-sun),
        mi.mueller.stokes_basis(_vector(-sun)),
        _vector(horizontal_axis(phi, travels_to_target=True)),
        _vector(camera),
        mi.mueller.stokes_basis(_vector(camera)),
        _vector(horizontal_axis(0.0, travels_to_target=False)),
    )
    return np.array(matrix)[:3, :3, 0] / np.cos(theta_i)


@pytest.mark.parametrize("slope_rms", [0.1, 0.35])
@pytest.mark.parametrize(("n", "k"), [(1.5, 0.0), (1.4, 0.4), (0.97, 6.0)])
def test_the_lobe_is_that_of_a_rough_conductor(mi, n, k, slope_rms):
    index = {"eta": {"type": "uniform", "value": n}, "k": {"type": "uniform", "value": k}}
    lobe = mi.load_dict({"type": "roughconductor", "alpha": 2**0.5 * slope_rms, "distribution": "beckmann", **index})
    surface = Surface(n=n, k=k, slope_rms=slope_rms, shadowing="smith")
    rng = np.random.default_rng(1)
    compared = 0
    for theta_i, theta_r, phi in rng.uniform([0.05, 0.05, -3.1], [1.3, 1.3, 3.1], (60, 3)):
        ours = mueller(theta_i, theta_r, phi, surface=surface)
        if ours[0, 0] < 1e-4:
            continue
        theirs = _of_mitsuba(mi, lobe, theta_i=theta_i, theta_r=theta_r, phi=phi)
        # Single precision: some 1e-7 of each direction, and again of each rotation.
        np.testing.assert_allclose(theirs / theirs[0, 0], ours / ours[0, 0], atol=5e-6)
        # The rational fit of Smith's shadowing is good to a fraction of a percent of each factor.
        assert theirs[0, 0] == pytest.approx(ours[0, 0], rel=0.01)
        compared += 1
    assert compared > 10
