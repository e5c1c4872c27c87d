"""How well the Stokes parameters, DoLP and AoLP of single pixels are known, and which pixels to distrust.

The errors are those of noise: by how much a pixel would differ if the same session were taken again. The variance of
noise behind each polarizer angle comes from the best source there is:

1. a noise calibration, at the signal of each pixel;
2. the scatter of the pixels over the cycles, as a line over the signal (read noise and shot noise);
3. what is left of the fit, where one cycle has more angles than three. That holds what single angles get wrong, too.

With one cycle of three angles nothing shows the noise: all errors are NaN. Errors of the dark level, the throughput and
the axis of the polarizer are shared by all pixels and are kept apart (`PixelErrors.calibration`).
"""

from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from model.numerics import chdtri, fit_above_zero, gammainc, gammaincinv
from model.processing.maps import Float32Array, polarization_maps
from model.sensor import temporal_variance_dn2
from rigctl.calibrations.noise import NoiseParameters
from rigctl.measure.measure import FloatArray, Measurement, signal_of_cycle

# A line is fitted through at most so many groups of at least so many pixels of like signal, without the largest share.
_MOST_GROUPS, _LEAST_PIXELS, _KEPT_SHARE, _MOST_PIXELS = 64, 100, 0.99, 200_000
_ROUNDS = 4
# False alarms among all pixels of a run; where more pixels than this vary, the scene changed and nothing hit them.
_FALSE_HITS, _MOST_HITS = 0.01, 0.01
# Correlations below this are 0.
_ROUNDING = 1e-12
# Standard deviation of an angle of which nothing is known but that it is one of 180 deg.
_ANY_ANGLE_DEG = np.float32(180.0 / np.sqrt(12.0))


class Doubt(IntFlag):
    """Bits of the mask of pixels to distrust."""

    SATURATED = 1  #: in one frame or more
    AT_ZERO = 2  #: clipped at the lower end of the range
    MISSING = 4  #: not received, or dead
    HIT = 8  #: varies from cycle to cycle as noise does not: a particle, or something that moved
    OUTSIDE = 16  #: not in every frame, once frames were moved to lie on one another


@dataclass(frozen=True, kw_only=True, eq=False)
class PixelErrors:
    """Errors of single pixels by noise, NaN where nothing shows it."""

    cov: Float32Array  #: of S0, S1, S2, shape (3, 3, H, W)
    dolp: Float32Array  #: to first order, shape (H, W)
    aolp_deg: Float32Array  #: to first order, and at most 52 deg, where any angle may be
    doubts: NDArray[np.uint8]  #: bits of `Doubt`
    source: str  #: where the noise is known from, in words
    calibration: Float32Array  #: standard errors of S0, S1, S2 by dark level, throughput and axis, shape (3, H, W)


def pixel_errors(measurement: Measurement, noise: NoiseParameters | None) -> PixelErrors:
    """Return the errors of every pixel of a run."""
    grid, plan = measurement.grid, measurement.plan
    scatter = _scatter(measurement) if grid.cycles > 1 else None
    good = measurement.frames.usable
    if noise is not None and noise.read_noise_e is not None and grid.exposures_s is not None:
        variance, source = _by_calibration(measurement, noise), "the noise calibration"
    elif scatter is not None:
        variance = _along_signal(scatter, measurement.channels, good, grid.cycles - 1, measurement.channels)
        source = f"the scatter over {grid.cycles} cycles"
    elif plan.redundancy:
        squares = np.square(np.tensordot(plan.null_basis.T, measurement.channels, axes=1))
        signal = np.tensordot(np.square(plan.null_basis.T), measurement.channels, axes=1)
        variance, source = _along_signal(squares, signal, good, 1, measurement.channels), "how well the angles agree"
    else:
        variance, source = np.full_like(measurement.channels, np.nan), "not determined: one cycle of three angles"
    of_mean = variance / grid.cycles
    maps = polarization_maps(measurement.channels.astype(np.float32), plan, deviations=np.sqrt(np.nan_to_num(of_mean)))
    if maps.dolp_std is None or maps.aolp_std_rad is None:
        raise AssertionError("deviations were given")
    unknown = np.isnan(of_mean.sum(axis=0))
    return PixelErrors(
        cov=_cov_of_stokes(plan.inverse, of_mean),
        dolp=np.where(unknown, np.float32(np.nan), maps.dolp_std),
        aolp_deg=np.where(unknown, np.float32(np.nan), np.minimum(np.rad2deg(maps.aolp_std_rad), _ANY_ANGLE_DEG)),
        doubts=_doubts(measurement, scatter, variance),
        source=source,
        calibration=_by_shared_errors(measurement),
    )


def _cov_of_stokes(inverse: FloatArray, variance: FloatArray) -> Float32Array:
    """Return the covariance of S0, S1, S2; what cancels to rounding is 0."""
    cov = np.tensordot(inverse[:, None] * inverse, variance, axes=1)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        rounding = _ROUNDING * np.sqrt(cov[i, i] * cov[j, j])
        cov[i, j] = cov[j, i] = np.where(np.abs(cov[i, j]) < rounding, 0.0, cov[i, j])
    return np.asarray(cov, dtype=np.float32)


def _by_shared_errors(measurement: Measurement) -> Float32Array:
    """Return the standard errors of S0, S1, S2 by dark level and axis, one for all angles, and throughput of each."""
    grid, inverse = measurement.grid, measurement.plan.inverse
    of_level = measurement.frames.dark_level.std_error_dn * grid.to_unit
    off = inverse @ of_level
    level = np.square(np.where(np.abs(off) < _ROUNDING * (np.abs(inverse) @ of_level), 0.0, off))
    relative = np.square(inverse * measurement.frames.corrections.relative_error(grid.angles))
    found = np.broadcast_to(level[:, None, None], (3, *measurement.frames.saturated.shape))
    if relative.any():
        found = found + np.tensordot(relative, np.square(measurement.channels), axes=1)
    if axis_deg := measurement.run.session.polarizer.offset_std_deg:
        _, s1, s2 = measurement.images.stokes
        found = found + np.square(2.0 * np.radians(axis_deg) * np.stack([np.zeros_like(s1), s2, s1]))
    return np.asarray(np.sqrt(found), dtype=np.float32)


def _by_calibration(measurement: Measurement, noise: NoiseParameters) -> FloatArray:
    """Return the variance of one frame of each angle at the signal of each pixel [grid.unit^2]."""
    grid, corrections = measurement.grid, measurement.frames.corrections
    unit = grid.to_unit[:, None, None]
    # What the sensor saw, before frames were divided by flat fields and throughput.
    response = np.ones_like(measurement.channels)
    if corrections.throughput is not None:
        response *= corrections.throughput.value[:, None, None]
    if corrections.flat is not None:
        response *= corrections.flat.response
    signal_dn = np.maximum(measurement.channels * response / unit, 0.0)
    exposure_s = np.zeros(grid.angles) if grid.exposures_s is None else grid.exposures_s
    variance = temporal_variance_dn2(signal_dn, noise=noise.sensor_noise(), exposure_s=exposure_s[:, None, None])
    variance = variance / grid.reads[:, None, None] + grid.rounding_dn2[:, None, None]
    variance *= np.square(unit / response) * corrections.interpolated
    if corrections.shifts is not None:
        variance *= corrections.shifts.variance_factor[:, None, None]
    return np.asarray(variance)


def _scatter(measurement: Measurement) -> FloatArray:
    """Return the variance of each pixel over the cycles, (N, H, W), without changes of all the light together."""
    cycles, light = measurement.grid.cycles, measurement.frames.light
    scale = light.mean() / light if np.all(light > 0.0) else np.ones(cycles)
    total, squares = np.zeros_like(measurement.channels), np.zeros_like(measurement.channels)
    for cycle in range(cycles):
        apart = signal_of_cycle(measurement, cycle)
        apart *= scale[cycle]
        apart -= measurement.channels
        total += apart
        apart *= apart
        squares += apart
    total *= total
    squares -= total / cycles
    return np.asarray(np.maximum(squares, 0.0) / (cycles - 1))


def _along_signal(
    squares: FloatArray, signal: FloatArray, good: NDArray[np.bool_], freedom: int, wanted: FloatArray
) -> FloatArray:
    """Return the variance at the signal `wanted`, by a line through squares of so many degrees of freedom.

    The largest squares of each group are left out, so that a particle's hit does not count; what that takes from a mean
    is known of the chi-square distribution.
    """
    chosen = np.flatnonzero(good)
    if chosen.size == 0:
        return np.full_like(wanted, np.nan)
    chosen = chosen[:: -(-chosen.size * len(signal) // _MOST_PIXELS)]
    x, y = (values.reshape(len(values), -1)[:, chosen].ravel() for values in (signal, squares))
    order = np.argsort(x, kind="stable")  # the same groups on every machine
    x, y = x[order], y[order]
    groups = min(max(x.size // _LEAST_PIXELS, 1), _MOST_GROUPS)
    means = []
    for xs, ys in zip(np.array_split(x, groups), np.array_split(y, groups), strict=True):
        small = np.sort(ys)[: max(int(_KEPT_SHARE * ys.size), 1)]
        share = small.size / ys.size
        # E[X | X < c] of a chi-square variable over its mean.
        kept = gammainc(freedom / 2 + 1, gammaincinv(freedom / 2, share)) / share
        means.append((max(float(xs.mean()), 0.0), float(small.mean()) / kept, np.sqrt(xs.size)))
    light, level, number = np.array(means).T
    scale = max(float(light.max()), 1e-12)
    line = np.array([float(level.mean()), 0.0])
    for _ in range(_ROUNDS):
        # Weights by the line, not by the groups themselves: those that are small by chance would count too much.
        fitted = line[0] + line[1] * light / scale
        weight = number / np.maximum(fitted, 1e-12 + 1e-6 * fitted.max())
        line = fit_above_zero(np.column_stack([weight, weight * light / scale]), weight * level)
    return np.asarray(line[0] + line[1] / scale * np.maximum(wanted, light.min()))


def _doubts(measurement: Measurement, scatter: FloatArray | None, variance: FloatArray) -> NDArray[np.uint8]:
    shape = measurement.frames.saturated.shape
    found = np.zeros(shape, np.uint8)
    outside = np.zeros(shape, np.bool_) if measurement.shifts is None else measurement.shifts.beyond(shape)
    hit = np.zeros(shape, np.bool_)
    if scatter is not None and np.isfinite(variance).all():
        freedom = measurement.grid.cycles - 1
        limit = chdtri(freedom, _FALSE_HITS / variance.size) / freedom
        hit = np.any(scatter > limit * np.maximum(variance, 1e-12), axis=0)
        hit &= hit.mean() <= _MOST_HITS
    for bit, pixels in (
        (Doubt.SATURATED, measurement.frames.saturated),
        (Doubt.AT_ZERO, measurement.frames.at_zero),
        (Doubt.MISSING, measurement.frames.missing & ~outside),
        (Doubt.HIT, hit),
        (Doubt.OUTSIDE, outside),
    ):
        found[pixels] |= np.uint8(bit)
    return found
