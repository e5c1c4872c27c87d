"""Effects of the detector and of what hits it."""

import numpy as np

from sim_devices.random_streams import Stream, generator
from sim_devices.rendering.effect import FloatArray, RenderingEffect, Shot, refuse_outside


def fixed_pattern(*, column_offset_e: float, width: int, pattern_seed: int) -> RenderingEffect:
    """Return an offset of each column, the same in every frame of one camera, beside its pixels' PRNU and DSNU.

    Parameters
    ----------
    column_offset_e
        Standard deviation over columns [e-], >= 0.
    width
        Columns.
    pattern_seed
        Which camera of its kind it is.
    """
    refuse_outside("fixed-pattern.column_offset_e", column_offset_e, least=0.0)
    offset_e = column_offset_e * generator(pattern_seed, Stream.COLUMN_OFFSET).standard_normal(width)

    def act(picture: FloatArray, _: Shot) -> FloatArray:
        picture += offset_e
        return picture

    return RenderingEffect(name="fixed-pattern", place="read-out", act=act)


def smear(*, row_transfer_us: float) -> RenderingEffect:
    """Return the light that a column's charge collects while it is moved past every row of a shutterless CCD.

    Parameters
    ----------
    row_transfer_us
        Time for which a charge stays at a row on its way [us], >= 0.
    """
    refuse_outside("smear.row_transfer_us", row_transfer_us, least=0.0)

    def act(picture: FloatArray, shot: Shot) -> FloatArray:
        picture += picture.sum(axis=0) * (row_transfer_us * 1e-6 / shot.exposure_s)
        return picture

    return RenderingEffect(name="smear", place="expected charge", act=act)


def cosmic_hits(*, rate_per_s: float, mean_e: float) -> RenderingEffect:
    """Return charge that particles leave in single pixels.

    Parameters
    ----------
    rate_per_s
        Hits a second over the whole detector, >= 0.
    mean_e
        Mean of the charge of one, exponentially distributed [e-], >= 0.
    """
    refuse_outside("cosmic-hits.rate_per_s", rate_per_s, least=0.0)
    refuse_outside("cosmic-hits.mean_e", mean_e, least=0.0)

    def act(picture: FloatArray, shot: Shot) -> FloatArray:
        draws = shot.draws(Stream.COSMIC_HITS)
        count = int(draws.poisson(rate_per_s * shot.exposure_s))
        hit = draws.integers(picture.size, size=count)
        # Two hits of one pixel add up, which an index on the left of += would not do.
        np.add.at(picture.reshape(-1), hit, np.rint(draws.exponential(mean_e, size=count)))
        return picture

    return RenderingEffect(name="cosmic-hits", place="charge", act=act)
