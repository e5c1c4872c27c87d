"""Pictures of Stokes parameters and numbers of regions from the frames of a run.

`measure` reads every frame once, subtracts the dark level, applies corrections, and averages over the cycles. Numbers
of a region come from its pixels: means with their covariance, deviations over the pixels and over the cycles, DoLP and
AoLP. Their errors include noise, texture that neighbours share, the dark level, corrections, and differences from cycle
to cycle.

Pixels hit by particles in single frames are left out. If counts are clipped at 0, or noise is below a count, means are
those of the signal behind the counts (`model.counts`). Drift of the light is divided out. A number no larger than the
rounding of its terms is 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import cv2
import numpy as np
from numpy.typing import NDArray

from model.counts import (
    DITHERED_DN,
    ROUNDING_VAR_DN2,
    Hits,
    estimate_signal,
    find_hits,
    find_single_hits,
    rounded_moments,
    rounding_error_rms,
)
from model.moments import Moments, propagate_linear
from model.processing import dolp
from model.processing.dolp_interval import aolp_limits_rad, dolp_intervals, is_polarized, student_intervals
from model.processing.maps import Float32Array, polarization_maps
from model.processing.mosaic import Interpolation, deviation_inflation, mean_inflation, reach_px
from model.processing.reconstruction import Design, aolp_moments_rad, channel_ratios, design, normalized_moments
from model.processing.samples import (
    Repeatability,
    RepeatedPixels,
    RunningPixels,
    Sample,
    deviation,
    effective_pixels,
    mean_moments,
    mean_over_deviation,
    region_mean_moments,
    repeated,
)
from model.quantities import OF_RATIOS, is_counts, ratio_name
from model.sensor import SensorNoise, temporal_variance_dn2
from model.stokes import dolp as degree_of_polarization
from rigctl.calibrations.noise import NoiseParameters
from rigctl.errors import DataError
from rigctl.files.regions import Region, inner_masks, masks
from rigctl.measure.frames import (
    CorrectedFrames,
    FlatDivision,
    FoundCorrections,
    FrameGrid,
    FrameShifts,
    RunCalibrations,
    arrange,
    corrected_frames,
)
from rigctl.runs.folder import Run

FloatArray = NDArray[np.float64]

# Pixels of each region, by its name.
Masks = Mapping[str, NDArray[np.bool_]]

# quantity -> statistic -> sample; the same names as in `model.prediction.Quantities`.
MeasuredQuantities = dict[str, dict[str, Sample]]


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredRegion:
    """A region by its pixels."""

    pixels: int  #: used
    excluded: int  #: left out as saturated or missing
    edge: int  #: left out along the border
    hit: int = 0  #: left out as hit by particles in single frames
    #: Largest shares of the counts of an angle that are 0, and saturated.
    at_ends: tuple[float, float] = (0.0, 0.0)
    #: True if means follow from the law of counts, because counts are clipped or noise is below a count.
    is_by_law: bool = False
    #: Number of independent pixels that S0 is worth; errors of deviations use it.
    independent_pixels: float
    channels_mean: Moments  #: mean of each angle over pixels and cycles, and the covariance of that mean
    scatter_cov: FloatArray  #: of the mean of each angle, by the scatter of the pixels alone
    channel_pixels: FloatArray  #: counts of each pixel behind each angle, of the first cycle
    channel_pixels_mean: FloatArray  #: of the mean of all cycles
    stokes_pixels: FloatArray  #: Stokes parameters of each pixel, of the first cycle
    stokes_pixels_mean: FloatArray  #: of the mean of all cycles
    #: Every other pixel, as on a chessboard: an estimate from one half can be tested on the other.
    first_half: NDArray[np.bool_]
    inside: NDArray[np.bool_]
    repeatability: Repeatability  #: relative errors of the means by differences from cycle to cycle
    quantities: MeasuredQuantities  #: everything that is compared with a prediction


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurement:
    """A run as it was measured."""

    frames: CorrectedFrames  #: after all were read
    plan: Design  #: measured polarizer angles and the inverse in use
    extinction_ratio: float  #: of the polarizer, as recorded; infinite (an ideal polarizer) without a record
    regions: dict[str, MeasuredRegion]
    unmeasured: dict[str, str] = field(default_factory=dict)  #: regions without numbers, with the reason

    @property
    def run(self) -> Run:
        """The run."""
        return self.frames.run

    @property
    def grid(self) -> FrameGrid:
        """Its frames by cycle and angle."""
        return self.frames.grid

    @property
    def channels(self) -> FloatArray:
        """Mean of each angle over the cycles, dark level subtracted [grid.unit]."""
        return self.frames.channels

    @cached_property
    def images(self) -> PolarizationImages:
        """Stokes parameters, DoLP and AoLP of every pixel."""
        return polarization_images(self.plan, self.channels, unusable=~self.frames.usable)

    @property
    def clipped_shares(self) -> tuple[float, float]:
        """Shares of pixels that are clipped in any frame, at the upper end of the range and at 0."""
        return float(self.frames.saturated.mean()), float(self.frames.at_zero.mean())

    @property
    def shifts(self) -> FrameShifts | None:
        """Shifts of the frames that a registration undid; None without one."""
        return self.frames.corrections.shifts

    @property
    def flat(self) -> FlatDivision | None:
        """Flat fields that frames were divided by; None without one."""
        return self.frames.corrections.flat

    @property
    def noise_factor(self) -> FloatArray:
        """Factor of means of several reads and of the corrections on the variance of noise, shape (N,)."""
        return np.asarray(self.frames.corrections.noise_factor(self.grid.angles) / self.grid.reads)


def measure(
    run: Run,
    *,
    regions: list[Region],
    calibrations: RunCalibrations | None = None,
    found: FoundCorrections | None = None,
    may_measure_none: bool = False,
) -> Measurement:
    """Return the Stokes pictures of a run and the numbers of its regions."""
    grid = arrange(run)
    stated = run.session.polarizer.extinction_ratio
    extinction_ratio = np.inf if stated is None else stated
    plan = _plan(run, grid, extinction_ratio)
    outer = masks(regions, width=grid.width, height=grid.height)
    inside = inner_masks(regions, outer, least_px=reach_px(run.session.interpolation))
    frames = corrected_frames(run, grid, calibrations or RunCalibrations(), found)
    measured, unmeasured = _measured_regions(outer, inside, frames, _repeats(inside, frames, plan), plan, found)
    if unmeasured and not measured and not may_measure_none:
        raise DataError("; ".join(dict.fromkeys(unmeasured.values())))
    return Measurement(
        frames=frames, plan=plan, extinction_ratio=extinction_ratio, regions=measured, unmeasured=unmeasured
    )


def signal_of_cycle(measurement: Measurement, cycle: int) -> FloatArray:
    """Return the frames of one cycle, dark level subtracted, shape (N, H, W) [grid.unit]."""
    return np.stack([*measurement.frames.signals(cycle)])


_LEAST_ANGLES = 3


def _plan(run: Run, grid: FrameGrid, extinction_ratio: float) -> Design:
    distinct = np.unique(grid.target_angles_deg)
    if len(distinct) < _LEAST_ANGLES:
        raise DataError(
            f"{run.path}: its frames have {len(distinct)} angles that differ modulo 180 deg "
            f"({', '.join(f'{angle:g}' for angle in distinct)} deg); Stokes parameters need three"
        )
    try:
        return design(grid.polarizer_angles_rad, extinction_ratio)
    except ValueError as error:
        raise DataError(f"{run.path}: its polarizer angles do not give Stokes parameters: {error}") from error


# Largest size of the pixels of regions over all frames in memory; above it frames are read twice.
MOST_HELD_BYTES = 256_000_000

_FLOAT_BYTES = 8

# Gives the pixels of a region that lie in a mask, by its name: those of all cycles, (C, N, P), or their numbers where
# they are too many to be held.
_Repeats = Callable[[str, NDArray[np.bool_]], FloatArray | RepeatedPixels]


def _repeats(inside: Masks, frames: CorrectedFrames, plan: Design) -> _Repeats:
    """Read every frame once, and return a reader of a region's pixels, which reads frames again if they are too many.

    The pixels usable in all frames are known only after reading all of them.
    """
    held_bytes = sum(map(np.count_nonzero, inside.values())) * frames.grid.cycles * frames.grid.angles * _FLOAT_BYTES
    if held_bytes <= MOST_HELD_BYTES:
        pixels = frames.read(inside)
        return lambda name, own: pixels[name][:, :, own[inside[name]]]
    frames.read({})
    usable = frames.usable
    inflation = mean_inflation(frames.interpolation)
    running = {
        name: RunningPixels(plan.inverse, inside=mask & usable, times=frames.grid.times, noise_inflation=inflation)
        for name, mask in inside.items()
    }
    places = {name: np.flatnonzero(mask & usable) for name, mask in inside.items()}
    for cycle in range(frames.grid.cycles):
        pixels = {name: np.empty((frames.grid.angles, of.size)) for name, of in places.items()}
        for angle, signal in enumerate(frames.signals(cycle)):
            for name, of in places.items():
                pixels[name][angle] = signal.ravel()[of]
        for name, found in pixels.items():
            running[name].add(found)
    return lambda name, _: running[name].result()


def _measured_regions(
    outer: Masks,
    inside: Masks,
    frames: CorrectedFrames,
    repeats: _Repeats,
    plan: Design,
    found: FoundCorrections | None,
) -> tuple[dict[str, MeasuredRegion], dict[str, str]]:
    """Return the numbers of each region, and reasons for regions without numbers."""
    measured: dict[str, MeasuredRegion] = {}
    unmeasured: dict[str, str] = {}
    for name, mask in inside.items():
        try:
            measured[name] = _measured_region(name, outer[name], mask, frames, repeats, plan, found)
        except (DataError, ValueError, ArithmeticError) as error:
            unmeasured[name] = str(error)
    return measured, unmeasured


def _measured_region(
    name: str,
    outer: NDArray[np.bool_],
    mask: NDArray[np.bool_],
    frames: CorrectedFrames,
    repeats: _Repeats,
    plan: Design,
    found: FoundCorrections | None,
) -> MeasuredRegion:
    usable, grid = frames.usable, frames.grid
    own = mask & usable
    excluded, edge = int(np.count_nonzero(mask & ~usable)), int(np.count_nonzero(outer & ~mask))
    require_pixels(name, int(np.count_nonzero(own)), excluded=excluded, edge=edge)
    given = repeats(name, own)
    error: FloatArray | float = 0.0 if found is None else found.level_error(frames.channels, own)
    signal, at_ends, hits = None, (float(np.mean(frames.at_zero[own])), 0.0), None
    if isinstance(given, np.ndarray):
        whole = mask & ~frames.missing
        used = _cleaned(name, np.asarray(repeats(name, whole)), whole, frames) if _is_cut_off(frames, whole) else None
        # Pixels saturated for another reason than noise are left out, not estimated.
        if used is None or used[2] is None:
            used = _cleaned(name, given, own, frames)
        values, own, signal, rounding, at_ends, hits = used
        error = np.hypot(error, rounding)
        if hits is not None:
            error = np.hypot(error, hits.small_error * hits.mean)
        excluded = int(np.count_nonzero(mask) - np.count_nonzero(own)) - _number(hits)
        given = repeated(
            values,
            plan.inverse,
            inside=own,
            times=grid.times,
            noise_inflation=mean_inflation(frames.interpolation),
        )
    return measure_region(
        name=name,
        pixels=given,
        inside=own,
        excluded=excluded,
        edge=edge,
        channel_names=grid.channel_names,
        plan=plan,
        level_std_error=frames.dark_level.std_error_dn * grid.to_unit,
        relative_error=frames.corrections.relative_error(grid.angles),
        own_error=error,
        interpolation=frames.interpolation,
        hits=hits,
        signal=signal,
        at_ends=at_ends,
    )


def _is_cut_off(frames: CorrectedFrames, inside: NDArray[np.bool_]) -> bool:
    """Return whether enough pixels are saturated to bias the mean of the others."""
    share = float(np.mean(frames.saturated[inside])) if inside.any() else 0.0
    return frames.are_counts and _CLIPPED < share < _MOSTLY_CLIPPED


# Pixels, where they are, their signal by the law of counts, errors by rounding, shares at both ends, and hits.
_Cleaned = tuple[FloatArray, NDArray[np.bool_], FloatArray | None, FloatArray, tuple[float, float], Hits | None]


def _cleaned(name: str, pixels: FloatArray, inside: NDArray[np.bool_], frames: CorrectedFrames) -> _Cleaned:
    """Return pixels without those that were hit, and the signal behind them by the law of counts."""
    hits = _hits(pixels, inside, frames)
    kept, hit, left = inside.copy(), np.zeros(pixels.shape[1]), np.zeros((pixels.shape[1], 1))
    if hits is not None:
        kept[inside], hit, left = ~hits.pixels, hits.small, (hits.small * hits.mean)[:, None]
        pixels = pixels[:, :, ~hits.pixels]
    signal, rounding, at_ends = None, np.zeros(hit.size), (float(np.mean(frames.at_zero[kept])), 0.0)
    if frames.are_counts:
        signal, rounding, at_ends = _signal_by_law(name, pixels, frames, hit)
    return pixels - left, kept, None if signal is None else signal - left, rounding, at_ends, hits


def _hits(pixels: FloatArray, inside: NDArray[np.bool_], frames: CorrectedFrames) -> Hits | None:
    """Return the pixels of a region hit by particles, from repeats or, without them, from neighbours.

    In a mosaic of polarizers each angle has its own pixels, so an edge may look like a hit of one angle.
    """
    step = float(frames.grid.to_unit.max())
    if len(pixels) > 1:
        return find_hits(pixels, step=step)
    if frames.run.session.cell_deg is not None:
        return None
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    light = np.empty_like(pixels[0])
    for angle, values in enumerate(pixels[0]):
        image = np.full(inside[part].shape, np.median(values), dtype=np.float32)
        image[inside[part]] = values
        light[angle] = cv2.medianBlur(image, 5)[inside[part]]
    return find_single_hits(pixels[0] - light, light, step=step)


# Share of counts at 0 that moves a mean by a tenth of its error, or more; and the share that leaves too little.
_CLIPPED, _MOSTLY_CLIPPED = 1e-3, 0.5

# Misfits from which on the law does not describe the counts: where rounding moves a mean, and where counts are cut off.
# There the slightly non-normal law of few electrons is harmless.
_MISFIT_ROUNDED, _MISFIT_CLIPPED = 1e-3, 0.03


def _signal_by_law(
    name: str, pixels: FloatArray, frames: CorrectedFrames, hit: FloatArray
) -> tuple[FloatArray | None, FloatArray, tuple[float, float]]:
    """Return the signal behind the counts of each angle, errors of the angles by rounding, and shares at both ends.

    The signal is the mean over the cycles by the law of counts. It is None where noise dithers and hardly a count lies
    at an end, and where the law does not describe the counts of every angle: all angles have the same texture, and few
    different counts do not show that the law lacks it.
    """
    grid, throughput = frames.grid, frames.corrections.throughput
    to_counts = 1.0 / grid.to_unit * (1.0 if throughput is None else throughput.value)
    levels = frames.dark_level.level_dn
    counts = np.rint(pixels * to_counts[:, None] + levels[:, None])
    np.maximum(counts, 0.0, out=counts)
    tops = np.array([int(np.ceil(record.saturation_dn)) for record in grid.records[0]])
    stds = counts.std(axis=(0, 2))
    at_zero, at_top = np.zeros((2, len(tops)))
    for angle in np.flatnonzero((counts.min(axis=(0, 2)) == 0.0) | (counts.max(axis=(0, 2)) >= tops)).tolist():
        at_zero[angle], at_top[angle] = np.mean(counts[:, angle] == 0.0), np.mean(counts[:, angle] >= tops[angle])
    ends = float(at_zero.max()), float(at_top.max())
    if ends[0] > _MOSTLY_CLIPPED:
        raise DataError(
            f"region {name}: {ends[0]:.0%} of its counts behind {grid.channel_names[int(at_zero.argmax())]} are 0: "
            "the light cannot be determined; raise the camera's black level, or expose for longer"
        )
    is_moved = (np.maximum(at_zero, at_top) > _CLIPPED) | (stds < DITHERED_DN)
    signal, rounding = pixels.mean(axis=0), np.zeros(len(tops))
    if not is_moved.any():
        return None, rounding, ends
    is_lawful, tested = True, 0
    for angle, top in enumerate(tops.tolist()):
        own, std = counts[:, angle].astype(np.int64), stds[angle]
        highest = top if at_top[angle] else int(own.max() + 6.0 * std + 10.0)
        found = estimate_signal(own, highest=highest, hit=float(hit[angle]))
        most = _MISFIT_CLIPPED if max(at_zero[angle], at_top[angle]) > _CLIPPED else _MISFIT_ROUNDED
        is_lawful &= found is not None and found.misfit < most
        tested += found is not None and found.is_tested
        if found is None:
            rounding[angle] = rounding_error_rms(np.sqrt(max(std**2 - ROUNDING_VAR_DN2, 0.0)))
        elif is_moved[angle]:
            rounding[angle] = abs(found.mean_dn - own.mean())
            signal[angle] = (found.stands_for[np.minimum(own, highest)].mean(axis=0) - levels[angle]) / to_counts[angle]
    if is_lawful and tested >= len(tops) / 2:
        return signal, np.zeros(len(tops)), ends
    return None, rounding / to_counts, ends


# Least pixels for a fourth moment.
LEAST_PIXELS = 16


def require_pixels(name: str, left: int, *, excluded: int, edge: int) -> None:
    """Refuse a region of which too few pixels are left."""
    if left < LEAST_PIXELS:
        raise DataError(
            f"region {name}: {left} pixels are left of {left + excluded + edge} "
            f"({excluded} are saturated or missing, {edge} lie along its border); at least {LEAST_PIXELS} are needed"
        )


def measure_region(
    *,
    name: str,
    pixels: RepeatedPixels,
    inside: NDArray[np.bool_],
    excluded: int,
    edge: int,
    channel_names: tuple[str, ...],
    plan: Design,
    level_std_error: FloatArray,
    relative_error: FloatArray,
    own_error: FloatArray | float = 0.0,
    interpolation: Interpolation = "none",
    hits: Hits | None = None,
    signal: FloatArray | None = None,
    at_ends: tuple[float, float] = (0.0, 0.0),
) -> MeasuredRegion:
    """Return the numbers of a region; means are those of `signal`, shape (N, P), where that is not the mean count."""
    count = pixels.mean.shape[1]
    require_pixels(name, count, excluded=excluded + _number(hits), edge=edge)
    light = np.zeros(inside.shape)
    light[inside] = plan.inverse[0] @ pixels.mean
    independent = effective_pixels(light, inside)
    inflation = count / independent
    scattered = region_mean_moments(pixels.mean if signal is None else signal, inside)
    mean = scattered.mean
    of_angles = np.diag(np.square(mean * relative_error) + np.square(own_error))
    of_level = np.outer(level_std_error, level_std_error)
    channels_mean = replace(scattered, cov=scattered.cov + of_level + of_angles + pixels.repeatability.cov(mean))
    stokes_pixels = np.asarray(plan.inverse @ pixels.first)
    quantities = _of_vectors(
        pixels, channel_names, channels_mean, plan, inflation, deviation_inflation(interpolation)
    ) | _of_pixel_dolp(stokes_pixels, inflation)
    if hits is not None:
        quantities = _without_small_hits(quantities, hits, channel_names, plan.inverse, pixels.cycles)
    if at_ends[0] > _CLIPPED or (at_ends[1] > _CLIPPED and signal is not None):
        # Clipping also affects every deviation, and the DoLP of every pixel.
        means = ((quantity, found["mean"]) for quantity, found in quantities.items() if "pixels" not in quantity)
        quantities = {quantity: {"mean": one} for quantity, one in means if quantity != "dolp_snr"}
    return MeasuredRegion(
        pixels=count,
        excluded=excluded,
        edge=edge,
        hit=_number(hits),
        at_ends=at_ends,
        is_by_law=signal is not None,
        independent_pixels=independent,
        channels_mean=channels_mean,
        scatter_cov=scattered.cov,
        channel_pixels=pixels.first,
        channel_pixels_mean=pixels.mean,
        stokes_pixels=stokes_pixels,
        stokes_pixels_mean=np.asarray(plan.inverse @ pixels.mean),
        inside=inside,
        repeatability=pixels.repeatability,
        # Whole cells if neighbours share samples, since their pixels differ.
        first_half=np.sum(np.array(np.nonzero(inside)) // (1 if interpolation == "none" else 2), axis=0) % 2 == 0,
        quantities=quantities,
    )


def _number(hits: Hits | None) -> int:
    return 0 if hits is None else int(np.count_nonzero(hits.pixels))


def _without_small_hits(
    quantities: MeasuredQuantities, hits: Hits, channel_names: Sequence[str], inverse: FloatArray, cycles: int
) -> MeasuredQuantities:
    """Return numbers whose deviations are corrected for hits that are too small to be found."""
    found = {quantity: dict(statistics) for quantity, statistics in quantities.items()}
    variance, error = hits.small * hits.square, hits.small_error * hits.square
    squares = np.concatenate([np.eye(len(channel_names)), inverse]) ** 2
    for quantity, row in zip((*channel_names, "s0", "s1", "s2"), squares, strict=True):
        for statistic, repeats in (("std", 1), ("std_temporal", 1), ("std_spatial_mean", cycles)):
            if statistic in found[quantity]:
                less = float(row @ variance) / repeats, float(row @ error) / repeats
                found[quantity][statistic] = _less(found[quantity][statistic], *less)
    if {"dolp_pixels", "s1n"} <= found.keys():
        normalized = np.array([found[name]["mean"].value for name in ("s1n", "s2n")])
        degree = float(np.hypot(*normalized))
        axis = normalized / degree if degree > 0.0 else np.array([1.0, 0.0])
        row = ((axis @ inverse[1:] - degree * inverse[0]) / found["s0"]["mean"].value) ** 2
        before = found["dolp_pixels"]["std"]
        after = found["dolp_pixels"]["std"] = _less(before, float(row @ variance), float(row @ error))
        if "dolp_snr" in found:
            ratio, snr = before.value / after.value, found["dolp_snr"]["mean"]
            of_guess = 0.5 * snr.value * ratio * float(row @ error) / after.value**2
            both = float(np.hypot(snr.std_error * ratio, of_guess))
            found["dolp_snr"]["mean"] = replace(snr, value=snr.value * ratio, std_error=both)
    return found


def _less(sample: Sample, variance: float, error: float) -> Sample:
    """Return a deviation less a part of its variance, which has an error of its own."""
    left = sample.value**2 - variance
    if not left > 0.0:
        return sample
    value = float(np.sqrt(left))
    own = sample.std_error * sample.value / value
    return replace(sample, value=value, std_error=float(np.hypot(own, 0.5 * error / value)))


# Share of the terms of a sum, or of 1 for a ratio, that their rounding may leave of what is 0.
_ROUNDING = 32.0 * float(np.finfo(np.float64).eps)


def _of_vectors(
    pixels: RepeatedPixels,
    channel_names: tuple[str, ...],
    channels_mean: Moments,
    plan: Design,
    inflation: float,
    of_noise: float,
) -> MeasuredQuantities:
    """Return means and deviations of channels and Stokes parameters, and the numbers of the mean Stokes vector."""
    stokes_mean = propagate_linear(channels_mean, plan.inverse)
    freedom_of = partial(pixels.repeatability.freedom, moments=channels_mean)
    counts = np.abs(channels_mean.mean)
    # Rounding of a Stokes parameter, a sum of counts.
    rounding = _ROUNDING * (np.abs(plan.inverse) @ counts)
    stokes_mean = replace(stokes_mean, mean=np.where(np.abs(stokes_mean.mean) > rounding, stokes_mean.mean, 0.0))
    found = _linear(
        channel_names,
        channels_mean,
        freedom_of(np.eye(counts.size)),
        (pixels.first, pixels.mean, pixels.temporal),
        _ROUNDING * counts,
        inflation,
        of_noise,
    )
    found |= _linear(
        ("s0", "s1", "s2"),
        stokes_mean,
        freedom_of(plan.inverse),
        (plan.inverse @ pixels.first, plan.inverse @ pixels.mean, pixels.temporal_stokes),
        rounding,
        inflation,
        of_noise,
    )
    return found | _of_mean_stokes(stokes_mean, plan.inverse, freedom_of)


def _linear(
    names: Sequence[str],
    mean: Moments,
    freedom: FloatArray,
    pixels: tuple[FloatArray, FloatArray, tuple[Sample, ...]],
    rounding: FloatArray,
    inflation: float,
    of_noise: float,
) -> MeasuredQuantities:
    """Return mean and deviations of channels or Stokes parameters; numbers no larger than their rounding are 0.

    `pixels` are those of the first cycle, the mean of all, and their temporal noise. `inflation` is of errors of what
    varies over the pixels, `of_noise` of what varies with time.
    """
    first, mean_pixels, temporal = pixels
    found: MeasuredQuantities = {}
    for k, name in enumerate(names):
        samples = {
            "mean": of_few(float(mean.mean[k]), float(np.sqrt(mean.cov[k, k])), float(freedom[k])),
            "std": _inflated(deviation(first[k]), inflation),
            "std_spatial_mean": _inflated(deviation(mean_pixels[k]), inflation),
        }
        if temporal:
            samples["std_temporal"] = _inflated(temporal[k], of_noise)
        found[name] = {statistic: _without_rounding(sample, rounding[k]) for statistic, sample in samples.items()}
    return found


def of_few(value: float, std_error: float, freedom: float) -> Sample:
    """Return a number with its intervals, whose error rests on so many degrees of freedom."""
    intervals = student_intervals(value, std_error, freedom)
    return Sample(value=value, std_error=std_error, intervals=intervals, freedom=freedom)


def _without_rounding(sample: Sample, rounding: float = _ROUNDING) -> Sample:
    return replace(
        sample,
        value=sample.value if abs(sample.value) > rounding else 0.0,
        std_error=sample.std_error if sample.std_error > rounding else 0.0,
    )


# Standard deviation of a uniform angle.
_ANY_ANGLE_DEG = 180.0 / np.sqrt(12.0)


def _of_mean_stokes(
    stokes: Moments, inverse: FloatArray, freedom_of: Callable[[FloatArray], FloatArray]
) -> MeasuredQuantities:
    if stokes.mean[0] <= 0.0:
        return {}
    normalized = normalized_moments(stokes)
    values, gradients = zip(*(function(*normalized.mean.tolist()) for function in OF_RATIOS.values()), strict=True)
    errors = np.sqrt(np.einsum("ki,ij,kj->k", gradients, normalized.cov, gradients))
    # Of (S1, S2) / S0 by the counts of the angles.
    rows = (inverse[1:] - np.outer(normalized.mean, inverse[0])) / stokes.mean[0]
    found = {
        name: {"mean": _without_rounding(of_few(value, float(error), freedom))}
        for name, value, error, freedom in zip(
            OF_RATIOS, values, errors, freedom_of(np.array(gradients) @ rows).tolist(), strict=True
        )
    }
    if not np.any(stokes.mean[1:]):
        return found
    degree = dolp.first_order(stokes.mean, stokes.cov)
    angle = aolp_moments_rad(stokes)
    axis = normalized.mean / np.hypot(*normalized.mean)
    along, across = freedom_of(np.array([axis, [-axis[1], axis[0]]]) @ rows).tolist()
    strength = Sample(value=float(degree.mean), std_error=float(np.sqrt(degree.variance)), freedom=along)
    found["dolp"] = {"mean": replace(_without_rounding(strength), intervals=dolp_intervals(normalized, along))}
    angle_error = float(np.rad2deg(np.sqrt(angle.cov[0, 0])))
    if not is_polarized(normalized):
        angle_error = max(angle_error, _ANY_ANGLE_DEG)
    value = float(np.rad2deg(angle.mean[0]))
    low, high = (
        (value + float(np.rad2deg(below)), value + float(np.rad2deg(above)))
        for below, above in aolp_limits_rad(normalized, across)
    )
    found["aolp_deg"] = {"mean": Sample(value=value, std_error=angle_error, intervals=(low, high), freedom=across)}
    return found


def _of_pixel_dolp(stokes_pixels: FloatArray, inflation: float) -> MeasuredQuantities:
    """Return mean, deviation and SNR of the DoLP of single pixels; nothing where a pixel has no light."""
    if np.any(stokes_pixels[0] <= 0.0):
        return {}
    values = np.asarray(degree_of_polarization(stokes_pixels.T))
    mean = mean_moments(values[None, :])
    mean_error = float(np.sqrt(mean.cov[0, 0]))
    found: MeasuredQuantities = {
        "dolp_pixels": {
            "mean": _without_rounding(_inflated(Sample(value=float(mean.mean[0]), std_error=mean_error), inflation)),
            "std": _without_rounding(_inflated(deviation(values), inflation)),
        }
    }
    if found["dolp_pixels"]["std"].value > 0.0:
        found["dolp_snr"] = {"mean": _inflated(mean_over_deviation(values), inflation)}
    return found


def measured_with_ratios(region: MeasuredRegion) -> MeasuredQuantities:
    """Return the numbers of a region with a ratio for each channel, unless there is no light."""
    moments = region.channels_mean
    names = [name for name in region.quantities if is_counts(name)]
    if not moments.mean.mean() > 0.0:
        return region.quantities
    ratios, errors = channel_ratios(moments)
    rows = (np.eye(ratios.size) - ratios[:, None] / ratios.size) / moments.mean.mean()
    samples = map(of_few, ratios.tolist(), errors.tolist(), region.repeatability.freedom(rows, moments).tolist())
    return region.quantities | {ratio_name(name): {"mean": sample} for name, sample in zip(names, samples, strict=True)}


def _inflated(sample: Sample, inflation: float) -> Sample:
    return replace(sample, std_error=sample.std_error * float(np.sqrt(inflation)))


@dataclass(frozen=True, kw_only=True, eq=False)
class PolarizationImages:
    """Maps of a run in single precision, for pictures; numbers of regions come from its channels."""

    stokes: Float32Array  #: S0, S1, S2, in the unit of the measurement.
    dolp: Float32Array  #: NaN where it has no meaning: no light, saturated or missing.
    aolp_deg: Float32Array  #: Counter-clockwise from horizontal, in [0, 180); NaN where there is no light.
    unusable: NDArray[np.bool_]  #: Saturated or missing in any frame.
    #: Error of the angle, from the scatter of S1 and S2 between neighbours: noise and fine texture.
    aolp_error_deg: Float32Array
    #: Twice the largest residual of the fit over the mean of the angles: at 0, 45, 90, 135 deg what orthogonal pairs
    #: differ by. None with three angles; NaN where there is no light.
    residual: FloatArray | None


def polarization_images(plan: Design, channels: FloatArray, *, unusable: NDArray[np.bool_]) -> PolarizationImages:
    """Return the images of a run."""
    maps = polarization_maps(channels.astype(np.float32), plan)
    dark = unusable | ~maps.valid
    return PolarizationImages(
        stokes=maps.stokes,
        dolp=np.where(dark, np.float32(np.nan), maps.dolp),
        aolp_deg=np.rad2deg(maps.aolp_rad),
        unusable=unusable,
        aolp_error_deg=_aolp_error_deg(maps.stokes),
        residual=_residual(plan, channels, dark),
    )


_NEIGHBOURHOOD = (7, 7)


def _aolp_error_deg(stokes: Float32Array) -> Float32Array:
    squares = sum(_scatter_squares(component) for component in stokes[1:]) / 2.0
    # Of the neighbours' mean: where there is no polarization, that of single pixels is the noise itself.
    smooth = [cv2.blur(component, _NEIGHBOURHOOD, borderType=cv2.BORDER_REPLICATE) for component in stokes[1:]]
    polarized = np.maximum(np.hypot(*smooth), 1e-12)
    return np.asarray(np.minimum(np.degrees(0.5 * np.sqrt(squares) / polarized), 90.0))


def _scatter_squares(image: Float32Array) -> Float32Array:
    """Return the local variance of a pixel about the line through its neighbours."""
    bent = np.zeros_like(image)
    bent[:, 1:-1] = np.square(image[:, 2:] - 2.0 * image[:, 1:-1] + image[:, :-2]) / 6.0
    # Running sums may be below 0 by rounding.
    return np.maximum(cv2.blur(bent, _NEIGHBOURHOOD, borderType=cv2.BORDER_REPLICATE), 0.0)


def _residual(plan: Design, channels: FloatArray, dark: NDArray[np.bool_]) -> FloatArray | None:
    if plan.redundancy == 0:
        return None
    left = np.tensordot(plan.null_basis @ plan.null_basis.T, channels, axes=1)
    largest = np.take_along_axis(left, np.argmax(np.abs(left), axis=0)[None], axis=0)[0]
    # For equal sizes the sign of the first angle, so that a picture has a single one.
    if plan.redundancy == 1:
        largest = left[0] / max(float(np.abs(plan.null_basis[0, 0])), 1e-12) * float(np.abs(plan.null_basis).max())
    mean = channels.mean(axis=0)
    return np.where(dark | (mean <= 0.0), np.nan, 2.0 * largest / np.where(mean > 0.0, mean, 1.0))


# Inputs of a temporal deviation, in the order of the vector that is varied.
INPUTS = ("gain_dn_per_e", "read_noise_e", "dark_current_e_per_s")


@dataclass(frozen=True, kw_only=True, eq=False)
class TemporalNoise:
    """Numbers of a calibration that give the temporal noise."""

    values: FloatArray  #: Gain [DN/e-], read noise [e-] and dark current [e-/s].
    cov: FloatArray  #: Their covariance.
    remarks: tuple[str, ...]  #: numbers that were replaced, with the reason


def temporal_noise(noise: NoiseParameters) -> TemporalNoise:
    """Return the numbers of a noise calibration that give the temporal noise."""
    if noise.read_noise_e is None:
        raise DataError(
            "the noise calibration has no read_noise_e (it is not determined): it cannot predict a temporal deviation; "
            "calibrate with dark frames"
        )
    remarks = []
    dark = noise.dark_current_e_per_s
    if dark is None:
        remarks.append("dark current: not calibrated, taken as 0")
    elif dark.value < 0.0:
        remarks.append(f"dark current: the calibration's {dark.value:.3g} e-/s is below 0 by its error; 0 is used")
    sensor = noise.sensor_noise()
    return TemporalNoise(
        values=np.array([sensor.gain_dn_per_e, sensor.read_noise_e, sensor.dark_current_e_per_s]),
        cov=noise.covariance_of(INPUTS),
        remarks=tuple(remarks),
    )


def temporal_variance(measurement: Measurement, region: MeasuredRegion, values: FloatArray) -> FloatArray:
    """Return the temporal variance of each channel of a region at its measured signal, shape (N,) [grid.unit^2]."""
    grid = measurement.grid
    if grid.exposures_s is None:
        raise DataError(f"{measurement.run.path}: its exposure is not known, so the noise cannot be predicted")
    gain, read_noise, dark_current = values.tolist()
    noise = SensorNoise(
        gain_dn_per_e=gain, read_noise_e=read_noise, dark_current_e_per_s=dark_current, black_level_dn=0.0
    )
    signal_dn = region.channels_mean.mean / grid.to_unit
    variance = temporal_variance_dn2(signal_dn, noise=noise, exposure_s=grid.exposures_s) / grid.reads
    if np.any(variance < DITHERED_DN**2 + 1.0) and grid.is_whole and not measurement.frames.corrections.is_any:
        unrounded, level_dn = variance - ROUNDING_VAR_DN2, measurement.frames.dark_level.level_dn + signal_dn
        third = gain * (unrounded - (gain * read_noise) ** 2)
        even = rounded_moments(level_dn, unrounded, 0.0, third)[1]
        # Texture dithers as noise does.
        spread = np.var(region.channel_pixels_mean, axis=1) / grid.to_unit**2 - even / grid.cycles
        variance = rounded_moments(level_dn, unrounded, np.maximum(spread, 0.0), third)[1]
    factor = measurement.frames.corrections.noise_factor(grid.angles)
    return np.asarray((variance + grid.rounding_dn2) * grid.to_unit**2 * factor)
