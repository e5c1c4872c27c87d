"""The chain from radiance to DoLP against drawing every step of it: light, pixel, electrons, counts."""

import numpy as np
import pytest

from model.channels import channel_moments
from model.electrons import electrons_per_radiance
from model.moments import Moments
from model.processing import dolp
from model.processing.reconstruction import (
    FESSENKOV_RAD,
    MODIFIED_PICKERING_RAD,
    PICKERING_RAD,
    design,
    reconstruct,
    stokes_moments,
)
from model.stokes import analyzer_row
from tests.model.sensors import sensor

DRAWS = 100_000
ANGLES = {"P": PICKERING_RAD, "F": FESSENKOV_RAD, "MP": MODIFIED_PICKERING_RAD, "six": tuple(np.pi * np.arange(6) / 6)}


def _texture(mean, common, own):
    """Covariance of a texture that is a common factor, and one of each component's own."""
    return common**2 * np.outer(mean, mean) + np.diag(np.square(own))


SCENES = {
    "moderate": ("MP", (30.0, 9.0, 3.0), 0.02, (0.3, 0.2, 0.2), {}),
    "unpolarized": ("MP", (30.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0), {}),
    "almost unpolarized, three angles": ("P", (30.0, 0.1, -0.2), 0.02, (0.1, 0.1, 0.1), {}),
    "strong common texture": ("F", (30.0, 10.0, -5.0), 0.1, (0.0, 0.0, 0.0), {}),
    "fully polarized": ("MP", (30.0, 29.0, 0.0), 0.0, (0.0, 0.0, 0.0), {}),
    "leaking polarizer": (
        "six",
        (30.0, 15.0, 5.0),
        0.01,
        (0.1, 0.1, 0.1),
        {"tau_parallel": 0.8, "tau_perpendicular": 0.1},
    ),
    "fixed pattern": ("MP", (30.0, 9.0, 3.0), 0.02, (0.3, 0.2, 0.2), {"prnu": 0.03, "dsnu_e": 40.0}),
    "dark current": ("MP", (30.0, 9.0, 3.0), 0.0, (0.3, 0.2, 0.2), {"dark_current_e_per_s": 1e8}),
    "little light": ("MP", (3.0, 0.6, 0.2), 0.0, (0.0, 0.0, 0.0), {"gain_dn_per_e": 0.3, "read_noise_e": 30.0}),
    "noise doubled": ("six", (30.0, 5.0, 5.0), 0.01, (0.1, 0.1, 0.1), {"noise_factor": 2.0}),
}


def _draw(rng, light, angles, s):
    """Return Stokes parameters of drawn pixels, by the plain steps of a camera."""
    noise = s.noise
    radiance = rng.multivariate_normal(light.mean, light.cov, size=DRAWS, method="eigh")
    rows = analyzer_row(np.array(angles), s.tau_parallel, s.tau_perpendicular)
    response = 1.0 + noise.prnu * rng.normal(size=(DRAWS, 1))
    bright = np.maximum(electrons_per_radiance(s) * radiance @ rows.T * response, 0.0)
    electrons = rng.poisson(bright + noise.dark_current_e_per_s * s.exposure_s) + noise.dsnu_e * rng.normal(
        size=(DRAWS, 1)
    )
    counts = noise.gain_dn_per_e * (electrons + noise.read_noise_e * rng.normal(size=electrons.shape))
    if noise.noise_factor != 1.0:
        # The temporal noise is drawn that much larger, around the counts without it.
        quiet = noise.gain_dn_per_e * bright
        counts = quiet + noise.noise_factor * (counts - quiet)
        counts += noise.noise_factor * rng.uniform(-0.5, 0.5, size=counts.shape)
    else:
        counts = np.rint(counts + noise.black_level_dn) - noise.black_level_dn
    dark = noise.gain_dn_per_e * noise.dark_current_e_per_s * s.exposure_s
    rows_only = design(
        angles, s.tau_parallel / s.tau_perpendicular if s.tau_perpendicular else np.inf, tau_parallel=s.tau_parallel
    )
    return reconstruct(rows_only, (counts - dark).T).T, rows_only


@pytest.mark.parametrize("name", SCENES)
def test_moments_through_the_chain_agree_with_drawing(name):
    kind, stokes, common, own, changes = SCENES[name]
    s = sensor(**changes)
    light = Moments(mean=stokes, cov=_texture(np.array(stokes), common, np.array(own)))
    drawn, plan = _draw(np.random.default_rng(20140299), light, ANGLES[kind], s)
    channels = channel_moments(light, angles_rad=ANGLES[kind], sensor=s)
    expected = stokes_moments(plan, channels.moments_dn)
    sigma = np.sqrt(np.diag(expected.cov))
    # Five standard errors: sigma / sqrt n of a mean, sigma / sqrt 2n of a deviation (near-normal counts).
    assert np.all(np.abs(drawn.mean(axis=0) - expected.mean) < 5.0 * sigma / np.sqrt(DRAWS))
    assert np.all(np.abs(drawn.std(axis=0) / sigma - 1.0) < 5.0 / np.sqrt(2.0 * DRAWS))
    degree = np.hypot(drawn[:, 1], drawn[:, 2]) / drawn[:, 0]
    found = dolp.moments(expected.mean, expected.cov)
    kurtosis = np.mean((degree - degree.mean()) ** 4) / degree.var() ** 2
    assert abs(degree.mean() - found.mean) < 5.0 * found.std / np.sqrt(DRAWS)
    assert abs(degree.std() / found.std - 1.0) < 5.0 * np.sqrt((kurtosis - 1.0) / (4.0 * DRAWS))
    # And the law: share of pixels below the quartiles of the exact distribution.
    quartiles = dolp.quantile([0.25, 0.5, 0.75], expected.mean, expected.cov)
    shares = np.mean(degree[:, None] <= quartiles, axis=0)
    assert np.all(np.abs(shares - [0.25, 0.5, 0.75]) < 5.0 * 0.5 / np.sqrt(DRAWS))
