"""The texture of a run's regions: what is left of their spread when the calibrated noise is taken off."""

import numpy as np

from model.processing.texture import Texture, estimate_texture
from rigctl.measurement.measurement import Measurement
from rigctl.measurement.temporal_noise import TemporalNoise, temporal_variance


def region_textures(measurement: Measurement, noise: TemporalNoise) -> dict[str, Texture]:
    """Return the texture of each region's Stokes parameters [grid.unit^2]; the fixed pattern stays in it.

    Parameters
    ----------
    measurement : Measurement
        With regions.
    noise : TemporalNoise
        Of the camera that took the run.

    Raises
    ------
    DataError
        The exposure is not known.
    """
    inverse = measurement.plan.inverse
    found = {}
    for name, region in measurement.regions.items():
        variance = temporal_variance(measurement, region, noise.values)
        found[name] = estimate_texture(
            region.stokes_pixels_mean,
            (inverse * variance) @ inverse.T,
            repeats=measurement.grid.cycles,
            pattern_cov=np.zeros((3, 3)),
        )
    return found
