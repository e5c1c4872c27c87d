"""Joint fit of all faults of a run to the residuals of its redundant angles.

With more than three polarizer angles, frames contradict each other where something is wrong: a throughput, an angle, a
dark level, a shift, a bent response. Each fault that is looked for is a `Cause`: one or more directions in the space of
parameters of single frames and of the response (`PER_FRAME`, `SHARED`). `fit_faults` works in four steps:

1. Means over blocks of 4 x 4 pixels of the residual, and of the change of the residual by each parameter (`_Blocks`).
2. Normal equations of every tile of blocks, and how much their right side scatters from tile to tile (`_Tiles`).
3. The set of causes with the highest evidence (`Weigher`); every further cause has to be worth its cost.
4. The named faults are taken out of pictures and design, and all is repeated until nothing changes.

Rounding to whole counts acts like a fault where the noise is below a third of a step, and is allowed for.

The module follows these steps: causes, parameters as faults of frames, blocks, tiles, evidence, search.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import NDArray

from model.counts import ROUNDING_VAR_DN2, rounding_error_rms
from model.numerics import fdtrc, fdtri
from model.processing.reconstruction import Design, design_from_system

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Chance of finding anything where nothing is wrong.
FALSE_FINDING_RATE = 0.01


@dataclass(frozen=True, kw_only=True, eq=False)
class JointFit:
    """Faults that explain a run best, and the evidence of all others once these are taken out."""

    evidence: "Evidence"
    weigher: "Weigher"
    candidates: NDArray[np.intp]  #: numbers of the causes that this run can show
    named: tuple[int, ...]  #: numbers of the causes that explain the run best, the strongest first
    stand_ins: dict[int, set[int]]  #: which could stand in the place of each of them, alone or with others
    parameters: FloatArray  #: of single frames and the response, as the named causes make them, shape (P,)
    light: float  #: mean counts, to which a curved response refers [DN]


_PASSES, _ROUNDS, _MOST_CAUSES, _LEAST_TILES = 8, 4, 6, 12


def fit_faults(
    system: FloatArray,
    pictures: FloatArray,
    usable: BoolArray,
    causes: tuple["Cause", ...],
    *,
    light: float,
    step: float = 0.0,
) -> JointFit | None:
    """Return the faults that explain the residuals of redundant angles best; None with too few usable pixels.

    Parameters
    ----------
    system
        Rows of the frames, shape (N, 3), N > 3.
    pictures
        Counts, dark level subtracted, shape (N, H, W) [DN].
    usable
        Pixels that are neither missing nor clipped in any frame, shape (H, W).
    causes
        Faults that are looked for.
    light
        Mean counts [DN].
    step
        Of the rounding of the pictures [DN]; 0 where none is known.

    Notes
    -----
    Gauss and Newton: faults that were found are taken out of the pictures and the design, and the fit is made about
    them, until neither the set nor its sizes change.
    """
    near = _usable_with_neighbours(usable)
    rounded = _rounded_parts(pictures, usable, null_basis=design_from_system(system).null_basis, step=step)
    parameters = np.zeros(parameter_count(len(pictures)))
    named: tuple[int, ...] | None = None
    for _ in range(_PASSES):
        faults = frame_faults(parameters, len(pictures))
        design, turned = corrected_system(system, faults)
        straight = corrected_pictures(pictures, faults, light=light)
        blocks = _blocks(design, turned, straight, near, faults=faults, light=light)
        tiles = _tiles(design.null_basis, blocks, rounded, parameters, causes)
        if tiles.count < _LEAST_TILES:
            return None
        fit = _fit_about(tiles, light, named or ())
        moved = fit.evidence.information @ (fit.parameters - parameters)
        is_small = np.abs(moved) <= _SETTLED * np.sqrt(np.diag(fit.evidence.covariance)) + 1e-300
        is_settled = fit.named == named and bool(np.all(is_small))
        before, named, parameters = named or (), fit.named, fit.parameters
        if is_settled or not named:
            break
    # Sets that follow one another, each the best once the other was taken out, are the same to a run.
    for twin in set(before) - set(fit.named) if fit.named else ():
        fit.stand_ins[max(fit.named, key=lambda index: fit.weigher.correlation(index, twin))].add(twin)
    return fit


# Last steps of a fit are below this share of a standard error.
_SETTLED = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class Cause:
    """A fault that is looked for."""

    name: str
    frame: int | None  #: None where it is of several frames
    unit: str
    directions: FloatArray  #: parameters that it changes, shape (P, its dimension)
    expected: FloatArray  #: standard deviation of its sizes in rigs, before anything is known
    log_odds: float = 0.0
    is_fault: bool = True


# Kinds of faults of one frame, in the order of the parameters; then those that all frames share.
PER_FRAME = ("throughput", "angle", "dark level", "shift x", "shift y")
SHARED = ("response curvature", "response power law")


def parameter_count(frames: int) -> int:
    """Return the number of parameters of single frames and of the response."""
    return len(PER_FRAME) * frames + len(SHARED)


def place(kind: str, frame: int, frames: int) -> int:
    """Return the position of a parameter: of one frame, or (frame 0) of all."""
    if kind in SHARED:
        return len(PER_FRAME) * frames + SHARED.index(kind)
    return PER_FRAME.index(kind) * frames + frame


# How large faults of rigs are before anything is known (standard deviations), in the units of the parameters. Planes of
# a mosaic lie a quarter of their pixel to each side.
_THROUGHPUT, _ANGLE_RAD, _DARK_SHARE, _SHIFT_PIXELS, _CURVATURE, _POWER = 0.02, 0.0175, 0.01, 0.7, 0.2, 0.15
_PLANES_PIXELS = 0.25

# Of explanations that fit alike, that by pair sums comes first. A dark level of one frame alone is rare, and two frames
# off by opposite shares, where one turned polarizer does the same, are rarer.
_PAIRS_LOG_ODDS, _DARK_LOG_ODDS, _WITHIN_LOG_ODDS = 4.0, -0.7, -2.0


def known_causes(angles_rad: FloatArray, order: Sequence[float], *, light: float) -> tuple[Cause, ...]:
    """Return every fault that is looked for in frames at some angles.

    Parameters
    ----------
    angles_rad
        Angles over the whole turn, shape (N,) [rad].
    order
        Mean time of each frame, in any unit; frames of the same time show no drift.
    light
        Mean counts [DN], to which a dark level is compared.
    """
    times = np.asarray(order, dtype=np.float64)
    return (
        *_of_single_frames(len(angles_rad), light),
        *_of_pairs(angles_rad),
        *_of_mosaics(angles_rad),
        *_of_all(times),
        *_of_whole_turns(angles_rad),
    )


def _cause(
    name: str,
    unit: str,
    expected: float,
    frames: int,
    *columns: dict[int, float],
    frame: int | None = None,
    log_odds: float = 0.0,
    is_fault: bool = True,
) -> Cause:
    """Return a cause whose directions are given as sizes of parameters by their places."""
    directions = np.zeros((parameter_count(frames), len(columns)))
    for k, column in enumerate(columns):
        directions[list(column), k] = list(column.values())
    return Cause(
        name=name,
        frame=frame,
        unit=unit,
        directions=directions,
        expected=np.full(len(columns), expected),
        log_odds=log_odds,
        is_fault=is_fault,
    )


def _of_single_frames(frames: int, light: float) -> Iterator[Cause]:
    for kind, expected, unit, log_odds in (
        ("throughput", _THROUGHPUT, "share", 0.0),
        ("angle", _ANGLE_RAD, "rad", 0.0),
        ("dark level", _DARK_SHARE * light, "DN", _DARK_LOG_ODDS),
    ):
        for frame in range(frames):
            column = {place(kind, frame, frames): 1.0}
            yield _cause(kind, unit, expected, frames, column, frame=frame, log_odds=log_odds)
    for frame in range(frames):
        columns = ({place(kind, frame, frames): 1.0} for kind in ("shift x", "shift y"))
        yield _cause("shift", "pixel", _SHIFT_PIXELS, frames, *columns, frame=frame)


def _of_pairs(angles_rad: FloatArray) -> Iterator[Cause]:
    """Give the light of orthogonal pairs compared with one another, and of the two of a pair.

    Throughputs stand first among the parameters: their places are the numbers of the frames.
    """
    frames, expected = len(angles_rad), 2**0.5 * _THROUGHPUT
    groups = _groups(angles_rad, np.pi / 2)
    complete = [group for group in groups if len(_groups(angles_rad[group], np.pi)) == 2]
    if len(groups) > 1 and len(complete) == len(groups):
        for group in groups[: 1 if len(groups) == 2 else None]:
            shares = dict.fromkeys(range(frames), -0.5) | dict.fromkeys(group.tolist(), 0.5)
            first = None if len(groups) == 2 else int(group[0])
            yield _cause(
                "throughput of pairs", "share", expected, frames, shares, frame=first, log_odds=_PAIRS_LOG_ODDS
            )
    for group in complete:
        halves = _groups(angles_rad[group], np.pi)
        shares = {int(group[at]): sign for half, sign in zip(halves, (0.5, -0.5), strict=True) for at in half}
        yield _cause(
            "throughput within a pair",
            "share",
            expected,
            frames,
            shares,
            frame=int(group[0]),
            log_odds=_WITHIN_LOG_ODDS,
        )


# Of angles that are the same, or a quarter turn apart, to the resolution of what people write [rad].
_SAME_RAD = np.radians(0.5)


def _groups(angles_rad: FloatArray, period_rad: float) -> list[NDArray[np.intp]]:
    """Return the numbers of the angles that are the same modulo a period."""
    left, groups = list(range(len(angles_rad))), []
    while left:
        apart = np.mod(angles_rad[left] - angles_rad[left[0]] + period_rad / 2, period_rad) - period_rad / 2
        group = [frame for frame, distance in zip(left, apart, strict=True) if abs(distance) < _SAME_RAD]
        groups.append(np.array(group))
        left = [frame for frame in left if frame not in group]
    return groups


def _of_mosaics(angles_rad: FloatArray) -> Iterator[Cause]:
    """Give opposite shifts of the two of each pair, as the four planes of a mosaic of polarizers lie."""
    frames = len(angles_rad)
    pairs = _groups(angles_rad, np.pi / 2)
    if frames != 4 or [len(pair) for pair in pairs] != [2, 2] or len(_groups(angles_rad, np.pi)) < frames:
        return
    columns = (
        {place(kind, int(one), frames): 1.0, place(kind, int(other), frames): -1.0}
        for one, other in pairs
        for kind in ("shift x", "shift y")
    )
    yield _cause("planes of a mosaic", "pixel", _PLANES_PIXELS, frames, *columns, is_fault=False)


def _of_all(times: FloatArray) -> Iterator[Cause]:
    frames, span = len(times), float(np.ptp(times))
    units = ("share at the mean light", "exponent - 1")
    for kind, expected, unit in zip(SHARED, (_CURVATURE, _POWER), units, strict=True):
        yield _cause(kind, unit, expected, frames, {place(kind, 0, frames): 1.0})
    if span > 0.0:
        late = (times - times.mean()) / span
        yield _cause("drift", "share", _THROUGHPUT, frames, dict(enumerate(late.tolist())))


def _of_whole_turns(angles_rad: FloatArray) -> Iterator[Cause]:
    """Give what comes once a turn and not twice: a wedge in the light and a wobble of the picture."""
    frames = len(angles_rad)
    if len(_groups(angles_rad, 2 * np.pi)) < len(_groups(angles_rad, np.pi)) + 2:
        return
    once = np.cos(angles_rad).tolist(), np.sin(angles_rad).tolist()
    throughput, *shifts = (
        [{place(kind, 0, frames) + frame: size for frame, size in enumerate(sizes)} for sizes in once]
        for kind in ("throughput", "shift x", "shift y")
    )
    yield _cause("wedge", "share", _THROUGHPUT, frames, *throughput)
    yield _cause("wobble", "pixel", _SHIFT_PIXELS, frames, *shifts[0], *shifts[1])


# A response that is bent further down has turned where the light is twice its mean: none does.
_LEAST_CURVATURE = -0.15

# Shifts below this change nothing that is seen [pixel].
_LEAST_SHIFT_PIXELS = 1e-4
_LARGEST_CURVATURE, _LARGEST_POWER, _LARGEST_SHARE, _LARGEST_SHIFT_PIXELS = 0.9, 0.8, 0.7, 12.0


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameFaults:
    """Sizes of the faults of N single frames, and of the response."""

    throughput: FloatArray
    angle_rad: FloatArray
    dark_dn: FloatArray
    shift_pixels: FloatArray  #: x and y, shape (N, 2)
    curvature: float
    power: float


def frame_faults(parameters: FloatArray, frames: int) -> FrameFaults:
    """Return parameters as faults of frames, held within what a correction can undo."""
    throughput, angle, dark, *shifts = parameters[: -len(SHARED)].reshape(len(PER_FRAME), frames)
    return FrameFaults(
        throughput=np.clip(throughput, -_LARGEST_SHARE, _LARGEST_SHARE),
        angle_rad=np.clip(angle, -_LARGEST_SHARE, _LARGEST_SHARE),
        dark_dn=dark,
        shift_pixels=np.clip(np.transpose(shifts), -_LARGEST_SHIFT_PIXELS, _LARGEST_SHIFT_PIXELS),
        curvature=float(np.clip(parameters[-2], -_LARGEST_CURVATURE, _LARGEST_CURVATURE)),
        power=float(np.clip(parameters[-1], -_LARGEST_POWER, _LARGEST_POWER)),
    )


def can_be_undone(parameters: FloatArray) -> bool:
    """Return whether faults are so small that a correction undoes all of them."""
    frames = (len(parameters) - len(SHARED)) // len(PER_FRAME)
    faults = frame_faults(parameters, frames)
    held = np.concatenate([faults.throughput, faults.angle_rad, faults.shift_pixels.T.ravel(), [faults.power]])
    asked = np.delete(parameters, np.s_[2 * frames : 3 * frames])
    return bool(np.array_equal(held, np.delete(asked, -2)) and _LEAST_CURVATURE <= parameters[-2] <= _LARGEST_CURVATURE)


def corrected_system(system: FloatArray, faults: FrameFaults) -> tuple[Design, FloatArray]:
    """Return the design with throughputs and angles as they are, and how its rows change with the angle.

    A turned polarizer turns S1 and S2 of its row.
    """
    cosine, sine = np.cos(2 * faults.angle_rad), np.sin(2 * faults.angle_rad)
    gain = 1.0 + faults.throughput
    rows = np.column_stack(
        [
            gain * system[:, 0],
            gain * (cosine * system[:, 1] - sine * system[:, 2]),
            gain * (sine * system[:, 1] + cosine * system[:, 2]),
        ]
    )
    turned = np.column_stack([np.zeros(len(rows)), -2.0 * rows[:, 2], 2.0 * rows[:, 1]])
    return design_from_system(rows), turned


def corrected_pictures(pictures: FloatArray, faults: FrameFaults, *, light: float) -> FloatArray:
    """Return pictures with dark levels, response and shifts undone, shape as given."""
    straight = pictures - faults.dark_dn[:, None, None]
    if faults.power:
        straight = light * np.sign(straight) * np.abs(straight / light) ** (1.0 / (1.0 + faults.power))
    if faults.curvature:
        root = np.maximum(1.0 + 4.0 * faults.curvature * straight / light, 0.01)
        straight = 2.0 * straight / (1.0 + np.sqrt(root))
    for index, (x, y) in enumerate(faults.shift_pixels):
        if max(abs(x), abs(y)) > _LEAST_SHIFT_PIXELS:
            straight[index] = _moved_back(_moved_back(straight[index], x, axis=1), y, axis=0)
    return np.asarray(straight)


def _moved_back(picture: FloatArray, shift_pixels: float, *, axis: int) -> FloatArray:
    """Return a picture moved back along an axis, by cubic convolution; edges are repeated (Keys 1981)."""
    whole = int(np.floor(shift_pixels))
    part = shift_pixels - whole
    taps = (
        0.5 * part * (part * (2.0 - part) - 1.0),
        0.5 * (part**2 * (3.0 * part - 5.0) + 2.0),
        0.5 * part * (part * (4.0 - 3.0 * part) + 1.0),
        0.5 * part**2 * (part - 1.0),
    )
    size = picture.shape[axis]
    pad = [(0, 0), (0, 0)]
    pad[axis] = (abs(whole) + 2, abs(whole) + 2)
    wide = np.pad(picture, pad, mode="edge")
    start = abs(whole) + 2 + whole - 1
    cuts = [[slice(None), slice(None)] for _ in taps]
    for step, cut in enumerate(cuts):
        cut[axis] = slice(start + step, start + step + size)
    return np.asarray(sum(tap * wide[tuple(cut)] for tap, cut in zip(taps, cuts, strict=True)))


def rounding_offsets(pictures: FloatArray, usable: BoolArray, *, step: float) -> FloatArray:
    """Return by how much rounding may have moved the level of each frame (standard deviation), unit of the pictures.

    Notes
    -----
    Where the light of a picture covers many steps the errors of its parts cancel.
    """
    if not usable.any() or not step > 0.0:
        return np.zeros(len(pictures))
    error = step * rounding_error_rms(_frame_noise_steps(pictures, usable, step=step))
    spread = np.array([np.subtract(*np.quantile(picture[usable], [0.95, 0.05])) for picture in pictures]) / step
    return np.asarray(error / np.sqrt(1.0 + np.maximum(spread, 0.0)))


def _frame_noise_steps(pictures: FloatArray, usable: BoolArray, *, step: float) -> FloatArray:
    """Return the noise of one pixel of each frame before rounding, in steps, from where the picture is smoothest."""
    whole = usable[:, 2:] & usable[:, 1:-1] & usable[:, :-2]
    bends = pictures[:, :, 2:] - 2.0 * pictures[:, :, 1:-1] + pictures[:, :, :-2]
    width = whole.shape[1] - whole.shape[1] % _PIECE_PIXELS
    found = np.zeros(len(pictures))
    for index, bend in enumerate(bends):
        squares = np.where(whole, bend**2, np.nan)[:, :width].reshape(-1, _PIECE_PIXELS).mean(axis=1) / (6.0 * step**2)
        kept = squares[np.isfinite(squares)]
        found[index] = np.sqrt(max(float(np.quantile(kept, 0.2)) - ROUNDING_VAR_DN2, 0.0)) if kept.size else 0.0
    return found


# Pieces of a row whose smoothness is compared.
_PIECE_PIXELS = 32

# Noise from which on rounding moves a mean by less than a fortieth of a step.
_HARMLESS_STEPS = 0.35


def _rounded_parts(
    pictures: FloatArray, usable: BoolArray, *, null_basis: FloatArray, step: float
) -> tuple[NDArray[np.intp], FloatArray] | None:
    """Return parts of the pictures whose rounding is the same: their numbers pixel by pixel, and errors of the frames.

    Pixels with the same counts in every frame are one part; without noise, their rounding is the same. None where noise
    makes rounding harmless.
    """
    if not step > 0.0 or not usable.any():
        return None
    onto = null_basis @ null_basis.T
    kept = np.sqrt(np.diag(onto))
    left = np.tensordot(onto[kept > 0.0] / kept[kept > 0.0, None], pictures, axes=1)
    noise = _frame_noise_steps(pictures, usable, step=step)
    noise = np.minimum(noise, np.sqrt(np.mean(_frame_noise_steps(left, usable, step=step) ** 2)))
    if noise.min() >= _HARMLESS_STEPS:
        return None
    counts = np.rint(pictures[:, usable] / step).astype(np.int64)
    # Numbers of the sets of counts, made frame by frame so that they stay small.
    together = np.zeros(counts.shape[1], dtype=np.int64)
    for one in counts:
        spread = int(np.ptp(one)) + 1
        together = np.unique(together * spread + (one - one.min()), return_inverse=True)[1]
    numbers = np.full(usable.shape, -1, dtype=np.intp)
    numbers[usable] = together
    return numbers, np.asarray(step * rounding_error_rms(noise))


def _usable_with_neighbours(usable: BoolArray) -> BoolArray:
    """Return the pixels that are usable and whose four neighbours are, away from where the picture ends.

    Resampling mixes nothings from beyond the picture, or from a border that holds none, into its outer pixels: such an
    edge is steep and does not walk with the scene, so that some pixels more are left out there.
    """
    inner = usable[1:-1, 1:-1] & usable[:-2, 1:-1] & usable[2:, 1:-1] & usable[1:-1, :-2] & usable[1:-1, 2:]
    if not inner.size:
        return np.zeros_like(usable)
    return np.asarray(np.pad(inner, 1) & ~_near_the_end(~usable))


# Pixels at the end of a picture into which resampling may have mixed what is beyond it, and whose slopes reach there.
_EDGE_PIXELS = 3


def _near_the_end(unusable: BoolArray) -> BoolArray:
    """Return the pixels that are near a side of the picture, or near what is unusable from there on."""
    wide = np.pad(unusable, _EDGE_PIXELS, constant_values=True)
    beyond = np.zeros_like(wide)
    for axis in (0, 1):
        beyond |= np.logical_and.accumulate(wide, axis=axis)
        beyond |= np.flip(np.logical_and.accumulate(np.flip(wide, axis), axis=axis), axis)
    for axis in (0, 1):
        rows = np.moveaxis(beyond, axis, 0).copy()
        near = rows.copy()
        for step in range(1, _EDGE_PIXELS + 1):
            near[step:] |= rows[:-step]
            near[:-step] |= rows[step:]
        beyond = np.moveaxis(near, 0, axis)
    return beyond[_EDGE_PIXELS:-_EDGE_PIXELS, _EDGE_PIXELS:-_EDGE_PIXELS]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Blocks:
    """Residuals of N frames and their changes by F features, block by block on a grid (R, C)."""

    residual: FloatArray  #: (N, R, C)
    features: FloatArray  #: change of the counts by each parameter of each frame, (F, R, C)
    instruments: FloatArray  #: features of the neighbours, whose noise is not that of the block
    residual_slopes: FloatArray  #: of the residual, x and y, (2, N, R, C)
    light: FloatArray
    steepness: FloatArray  #: mean square of the slopes
    pixels: FloatArray  #: number of usable pixels


# Side of a block [pixel]: its means hold the edges that show shifts, and little of the noise.
_BLOCK_PIXELS = 4

# Of 16 in a block: with fewer it is left out.
_LEAST_PIXELS = 4.0


def _blocks(
    plan: Design,
    slopes_of_angle: FloatArray,
    pictures: FloatArray,
    usable: BoolArray,
    *,
    faults: FrameFaults,
    light: float,
) -> _Blocks:
    """Return the block means of residuals and features."""
    height, width = (side - side % _BLOCK_PIXELS for side in usable.shape)
    good = usable[:height, :width]
    images = np.where(usable, pictures, 0.0)[:, :height, :width]
    pixels = _block_sums(good.astype(np.float64))
    pixels = np.where(pixels < _LEAST_PIXELS, 0.0, pixels)
    per_pixel = np.where(pixels > 0.0, 1.0 / np.maximum(pixels, _LEAST_PIXELS), 0.0)
    onto_light = plan.system @ plan.inverse
    means = _block_sums(images) * per_pixel
    fitted = np.asarray(np.tensordot(onto_light, means, axes=1))
    # Picture by picture: what is made of one stays in the cache until it is summed.
    slopes = np.swapaxes([_slope_sums(picture, good) for picture in pictures], 0, 1) * per_pixel
    walks = [np.tensordot(onto_light, slope, axes=1) for slope in slopes]
    turned = np.tensordot(slopes_of_angle @ plan.inverse, means, axes=1)
    gain = 1.0 + faults.throughput[:, None, None]
    # Of light before the throughputs: bent after them, it would bend the throughputs, and could stand in their place.
    bent = [_response_sums(picture, faults, light) for picture in np.tensordot(onto_light, images, axes=1) / gain]
    square, logarithm = np.swapaxes(bent, 0, 1) * per_pixel
    features = np.concatenate(
        [
            fitted / gain,
            turned,
            np.ones_like(fitted),
            -walks[0],
            -walks[1],
            gain * square,
            gain * (logarithm / (1.0 + faults.power)),
        ]
    )
    features = np.asarray(features * (pixels > 0))
    return _Blocks(
        residual=means - fitted,
        features=features,
        instruments=_instruments(features, pixels),
        residual_slopes=slopes - np.array(walks),
        light=np.asarray(fitted.mean(axis=0)),
        steepness=np.asarray(np.mean(walks[0] ** 2 + walks[1] ** 2, axis=0)),
        pixels=pixels,
    )


def _block_sums(pictures: FloatArray) -> FloatArray:
    """Return sums over blocks, weighted 1/4, 1/2, 1/4 first: what mosaics leave from pixel to pixel is gone."""
    return _summed_along(_summed_along(pictures, -1), -2)


def _summed_along(pictures: FloatArray, axis: int) -> FloatArray:
    moved = np.moveaxis(pictures, axis, -1)
    cut = moved.reshape(*moved.shape[:-1], -1, _BLOCK_PIXELS)
    first, last = cut[..., 0], cut[..., -1]
    sums = cut.sum(axis=-1) - 0.25 * (first + last)
    # A block's weights reach one pixel into its neighbours; at the border its own pixel stands for the one outside.
    before = np.concatenate([first[..., :1], last[..., :-1]], axis=-1)
    after = np.concatenate([first[..., 1:], last[..., -1:]], axis=-1)
    return np.asarray(np.moveaxis(sums + 0.25 * (before + after), -1, axis))


def _slope_sums(picture: FloatArray, good: BoolArray) -> FloatArray:
    """Return the block sums of a picture's slopes across and down, shape (2, h, w)."""
    height, width = good.shape
    sums = []
    for axis in (1, 0):
        turned = np.moveaxis(picture, axis, 1)
        slope = np.zeros_like(picture)
        np.moveaxis(slope, axis, 1)[:, 1:-1] = 0.5 * (turned[:, 2:] - turned[:, :-2])
        sums.append(_block_sums(np.where(good, slope[:height, :width], 0.0)))
    return np.array(sums)


# Light below this share of the mean has no logarithm worth having.
_DARKEST_SHARE = 0.01


def _response_sums(fitted: FloatArray, faults: FrameFaults, light: float) -> FloatArray:
    """Return the block sums of a picture as a parabola and as a power bend it, shape (2, h, w)."""
    relative = fitted / light
    rising = np.maximum(1.0 + 2.0 * faults.curvature * relative, _DARKEST_SHARE)
    logarithm = np.log(np.maximum(relative, _DARKEST_SHARE))
    return np.array([_block_sums(fitted * relative / rising), _block_sums(fitted * logarithm)])


def _instruments(features: FloatArray, pixels: FloatArray) -> FloatArray:
    """Return the mean features of the eight neighbours of each block; of shifts, its own."""
    held = (pixels > 0).astype(np.float64)
    around = _sums_around(held[None])[0]
    smooth = _sums_around(features) * (held / np.maximum(around, 1.0))
    frames = len(features) // (len(PER_FRAME) + len(SHARED))
    shifts = slice(place("shift x", 0, frames), place("shift y", frames, frames))
    smooth[shifts] = features[shifts]
    return np.asarray(smooth)


def _sums_around(images: FloatArray) -> FloatArray:
    """Return the sums of the eight neighbours of each block."""
    wide = np.pad(images, ((0, 0), (1, 1), (1, 1)))
    across = wide[:, :, :-2] + wide[:, :, 1:-1] + wide[:, :, 2:]
    return np.asarray(across[:, :-2] + across[:, 1:-1] + across[:, 2:] - images)


# Tiles are this many blocks wide: wider than blur and mosaics reach; in large pictures wider, so that they stay few.
_TILE_BLOCKS, _LARGE_TILE_BLOCKS, _LARGE_BLOCKS = 3, 5, 8000


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tiles:
    """Normal equations A x = b of T tiles, made about some parameters, and the evidence of causes that they give."""

    causes: tuple[Cause, ...]
    parameters: FloatArray
    information: FloatArray  #: A, shape (T, P, P)
    right: FloatArray  #: b, shape (T, P)
    expected_covariance: FloatArray  #: of the sum of b, if blocks are independent
    rounding_covariance: FloatArray
    grid: tuple[int, int]

    @property
    def count(self) -> int:
        """Number of tiles that hold anything."""
        return int(np.count_nonzero(np.einsum("tii->t", self.information) > 0.0))

    @cached_property
    def total(self) -> FloatArray:
        """Information of all tiles."""
        return np.asarray(self.information.sum(axis=0))

    @cached_property
    def total_right(self) -> FloatArray:
        """Right side of all tiles, about no faults."""
        return np.asarray(self.right.sum(axis=0) + self.total @ self.parameters)

    @cached_property
    def unseen(self) -> FloatArray:
        """Covariance of b by fine structure that looks like a curved response, and by the rounding of numbers."""
        feigned = self.total[:, -len(SHARED) :] * _RESPONSE_FLOOR
        rounding = np.diag(_LEAST_SCATTER * np.abs(np.diag(self.total)))
        return np.asarray(feigned @ feigned.T + rounding + self.rounding_covariance)

    def evidence(self, covariance: FloatArray, freedom: float) -> "Evidence":
        """Return the evidence with a covariance of the right side."""
        return Evidence(
            causes=self.causes,
            information=self.total,
            covariance=covariance + self.unseen,
            right=self.total_right,
            freedom=freedom,
        )

    def evidence_of(self, chosen: tuple[int, ...]) -> "Evidence":
        """Return the evidence with the scatter of what some causes leave at their best sizes."""
        return self.evidence_about(_sum_of(self.evidence(np.zeros_like(self.total), 1.0), chosen), chosen)

    def evidence_about(self, parameters: FloatArray, fitted: tuple[int, ...]) -> "Evidence":
        """Return the evidence with the scatter of what faults of a known size leave, some of them fitted."""
        directions = [self.causes[index].directions for index in fitted]
        about = parameters - self.parameters
        left = _left_out(
            self.information,
            self.right - self.information @ about,
            np.hstack([np.zeros((len(about), 0)), *directions]),
        )
        return self.evidence(*_score_covariance(left, self.expected_covariance, self.grid))

    def everything(self) -> FloatArray:
        """Return the sizes of all faults at once, held by what is expected of rigs and by the noise of the scores.

        The information of shifts is less than their noise, and nothing in some directions: it cannot stand for that
        noise.
        """
        expected = np.column_stack([cause.directions * cause.expected for cause in self.causes])
        done = self.total @ expected
        covariance = self.expected_covariance + self.unseen + done @ done.T
        variance = np.diag(covariance)
        # Rounding leaves a little on either side of 0 where nothing is known.
        size = np.where(variance > 0.0, np.sqrt(np.abs(variance)), np.inf)
        scaled = covariance / np.outer(size, size)
        return np.asarray(
            expected @ (done.T @ (np.linalg.lstsq(scaled, self.total_right / size, rcond=None)[0] / size))
        )


# Fine structure between pixels looks like a curved response of this size (standard deviation). Pictures without any
# noise leave the rounding of numbers, as a share of the variance that weights allow scores.
_RESPONSE_FLOOR, _LEAST_SCATTER = 0.01, 1e-6


def _tiles(
    null_basis: FloatArray,
    blocks: _Blocks,
    rounded: tuple[NDArray[np.intp], FloatArray] | None,
    parameters: FloatArray,
    causes: tuple[Cause, ...],
) -> _Tiles:
    """Return the normal equations of every tile, weighted by the noise that the residual shows."""
    frames = len(null_basis)
    side = _LARGE_TILE_BLOCKS if blocks.pixels.size > _LARGE_BLOCKS else _TILE_BLOCKS
    weights = blocks.pixels / _variance_of_a_pixel(blocks)
    features, grid = _tiled(blocks.features, side)
    instruments, _ = _tiled(blocks.instruments, side)
    residual, _ = _tiled(blocks.residual, side)
    weight, _ = _tiled(weights[None], side)
    onto = null_basis @ null_basis.T
    repeats = features.shape[1] // frames
    products = np.matmul(instruments * weight, features.transpose(0, 2, 1)) * np.tile(onto, (repeats, repeats))
    products -= _of_noise_in_slopes(blocks, weights, onto, products, np.count_nonzero(weight[:, 0] > 0.0, axis=1))
    rights = np.sum(instruments * weight * np.tile(residual, (1, repeats, 1)), axis=2)
    # Sums features of all frames for what frames share.
    alone, shared = len(PER_FRAME) * frames, len(SHARED)
    gather = np.zeros((alone + shared, (len(PER_FRAME) + shared) * frames))
    gather[:alone, :alone] = np.eye(alone)
    gather[alone:, alone:] = np.kron(np.eye(shared), np.ones(frames))
    by_rounding = 0.0 * products[0] if rounded is None else _rounding_covariance(blocks, weights, onto, *rounded)
    return _Tiles(
        causes=causes,
        parameters=parameters,
        information=np.asarray(gather @ products @ gather.T),
        right=np.asarray(rights @ gather.T),
        expected_covariance=np.asarray(gather @ _expected_covariance(blocks, weights) @ gather.T),
        rounding_covariance=np.asarray(gather @ by_rounding @ gather.T),
        grid=grid,
    )


# Of the light: pictures without any noise are computed ones, whose residual is that of rounding.
_LEAST_NOISE = 1e-7


def _variance_of_a_pixel(blocks: _Blocks) -> FloatArray:
    """Return the variance that one pixel's residual shows, block by block: of a level, of the light and at edges."""
    held = blocks.pixels > 0
    squares = (np.mean(blocks.residual**2, axis=0) * blocks.pixels)[held]
    light = np.clip(blocks.light[held], 0.0, None)
    parts = np.column_stack([np.ones_like(light), light, light**2, blocks.steepness[held]])
    if not held.any():
        return np.full(blocks.pixels.shape, np.inf)
    level = float(np.median(squares)) / 0.455 + (_LEAST_NOISE * float(light.max())) ** 2 + 1e-300
    sizes = parts.max(axis=0) + (parts.max(axis=0) == 0.0)
    expected = np.full_like(light, level)
    for _ in range(3):
        # Blocks far off what is expected (things that moved) do not make the noise.
        kept = np.minimum(squares, 9.0 * expected)
        found = _nonnegative_fit(parts / sizes / expected[:, None], kept / expected)
        expected = np.maximum(parts / sizes @ found, 0.05 * level)
    variance = np.full(blocks.pixels.shape, np.inf)
    variance[held] = expected
    return variance


def _nonnegative_fit(system: FloatArray, values: FloatArray) -> FloatArray:
    """Return the least-squares solution without negative parts; of so few parts every choice can be tried."""
    count = system.shape[1]
    gram, right = system.T @ system, system.T @ values
    best, least = np.zeros(count), 0.0
    for size in range(1, count + 1):
        for chosen in map(list, combinations(range(count), size)):
            part = np.linalg.lstsq(gram[np.ix_(chosen, chosen)], right[chosen], rcond=None)[0]
            # Less the square of the values, which all choices share.
            square = float(part @ gram[np.ix_(chosen, chosen)] @ part - 2.0 * part @ right[chosen])
            if square < least and np.all(part >= 0.0):
                best, least = np.zeros(count), square
                best[chosen] = part
    return best


def _tiled(images: FloatArray, side: int) -> tuple[FloatArray, tuple[int, int]]:
    """Return images (P, R, C) cut into tiles (T, P, side^2), filled up with nothing at the far edges."""
    rows, columns = images.shape[1:]
    padded = np.pad(images, ((0, 0), (0, -rows % side), (0, -columns % side)))
    down, across = padded.shape[1] // side, padded.shape[2] // side
    cut = padded.reshape(len(images), down, side, across, side).transpose(1, 3, 0, 2, 4)
    return np.ascontiguousarray(cut).reshape(down * across, len(images), side * side), (down, across)


# Of the information of a shift that can be taken for noise of slopes.
_MOST_NOISE = 0.98


def _of_noise_in_slopes(
    blocks: _Blocks, weights: FloatArray, onto: FloatArray, products: FloatArray, held_blocks: NDArray[np.intp]
) -> FloatArray:
    """Return what the noise of slopes, which are their own instruments, adds to the information of each tile."""
    frames, held = len(onto), weights > 0.0
    added = np.zeros_like(products)
    redundancy = round(float(np.trace(onto)))
    first = PER_FRAME.index("shift x") * frames
    for way, slopes in enumerate(blocks.residual_slopes):
        squares = np.sum(slopes[:, held] ** 2, axis=0) * weights[held] / redundancy
        # The median of a mean of squares (Wilson and Hilferty 1931): blocks with edges of their own do not count.
        noise = float(np.median(squares)) / (1.0 - 2.0 / (9.0 * redundancy)) ** 3 if held.any() else 0.0
        own = slice(first + way * frames, first + (way + 1) * frames)
        share = noise * (np.eye(frames) - onto) * onto
        most = _MOST_NOISE * np.maximum(np.diag(products[:, own, own].sum(axis=0)), 0.0)
        wanted = np.diag(share) * held_blocks.sum()
        kept = np.divide(most, wanted, out=np.ones_like(wanted), where=wanted > most)
        added[:, own, own] = held_blocks[:, None, None] * share * float(kept.min())
    return added


def _rounding_covariance(
    blocks: _Blocks, weights: FloatArray, onto: FloatArray, parts: NDArray[np.intp], errors: FloatArray
) -> FloatArray:
    """Return the covariance of the right sides by rounding: pixels of the same counts in all frames are off alike."""
    height, width = (_BLOCK_PIXELS * side for side in weights.shape)
    rows, columns = np.nonzero(parts[:height, :width] >= 0)
    block = (rows // _BLOCK_PIXELS) * weights.shape[1] + columns // _BLOCK_PIXELS
    each = np.divide(weights, blocks.pixels, out=np.zeros_like(weights), where=weights > 0.0).ravel()[block]
    part = parts[rows, columns]
    instruments = blocks.instruments.reshape(len(blocks.instruments), -1)
    sums = np.array([np.bincount(part, weights=each * row[block]) for row in instruments])
    repeats = len(instruments) // len(onto)
    return np.asarray(sums @ sums.T * np.tile((onto * errors**2) @ onto, (repeats, repeats)))


def _expected_covariance(blocks: _Blocks, weights: FloatArray) -> FloatArray:
    """Return the covariance of the right sides of independent blocks, the frames correlated as residuals are."""
    held = weights > 0.0
    residual = blocks.residual[:, held] * np.sqrt(weights[held])
    between = residual @ residual.T / max(int(np.count_nonzero(held)), 1)
    instruments = blocks.instruments[:, held]
    repeats = len(instruments) // len(between)
    return np.asarray((instruments * weights[held]) @ instruments.T * np.tile(between, (repeats, repeats)))


def _left_out(information: FloatArray, left: FloatArray, fitted: FloatArray) -> FloatArray:
    """Return what a fit to all other tiles leaves in each (the jackknife, without a fit for each)."""
    if not fitted.shape[1]:
        return left
    of_tiles = information @ fitted
    own = fitted.T @ of_tiles
    others = own.sum(axis=0) - own
    size = np.sqrt(np.abs(np.diag(own.sum(axis=0))))
    if not np.all(size > 0.0):
        return left
    scaled = others / np.outer(size, size)
    moved = np.linalg.pinv(scaled, rcond=1e-6) @ ((left @ fitted) / size)[:, :, None]
    return np.asarray(left + np.einsum("tpq,tq->tp", of_tiles / size, moved[:, :, 0]))


def _score_covariance(left: FloatArray, expected: FloatArray, grid: tuple[int, int]) -> tuple[FloatArray, float]:
    """Return the covariance of the sum of the right sides, shape (P, P), and the tiles' worth of its freedom.

    Few tiles cannot tell the covariance of many parameters: what they show is shrunk towards that of independent
    blocks, the more the less the tiles agree (Ledoit and Wolf 2004, J. Multivariate Anal. 88, 365). Tiles are taken as
    independent. Where coarser tiles scatter by more than that allows (shading, fringes), the errors of the parameters
    concerned are widened to what the coarser ones show.
    """
    covariance, freedom = _shrunk(left, expected)
    factor = _widening(left.reshape(*grid, -1), np.diag(_scatter(left)))
    return covariance * factor[:, None] * factor[None, :], freedom


# Of the scaled covariance of scores: directions below are sums of others, to rounding.
_RANK_TOLERANCE = 1e-8

# Times the number of tiles that a covariance is known at most.
_MOST_FREEDOM = 10.0


def _shrunk(left: FloatArray, expected: FloatArray) -> tuple[FloatArray, float]:
    """Return the scatter of tiles, shrunk towards what is expected of them."""
    held = left[np.any(left != 0.0, axis=1)]
    count = len(held)
    size = np.sqrt(np.maximum(np.diag(expected), 0.0))
    if count < 2 or not np.any(size > 0.0):
        return np.zeros_like(expected), 1.0
    scale = np.where(size > 0.0, size, np.inf)
    values, vectors = np.linalg.eigh(expected / np.outer(scale, scale))
    kept = values > _RANK_TOLERANCE * float(values[-1])
    back = size[:, None] * vectors[:, kept] * np.sqrt(values[kept])
    white = (held - held.mean(axis=0)) / scale @ (vectors[:, kept] / np.sqrt(values[kept]))
    white *= np.sqrt(count / (count - 1.0))
    scatter = white.T @ white
    level = float(np.trace(scatter)) / len(scatter)
    even = level * np.eye(len(scatter))
    chance = float(np.sum(np.sum(white**2, axis=1) ** 2)) - float(np.sum(scatter**2)) / count
    apart = float(np.sum((scatter - even) ** 2))
    share = float(np.clip(chance / apart, 0.0, 1.0)) if apart > 0.0 else 1.0
    covariance = np.asarray(back @ ((1.0 - share) * scatter + share * even) @ back.T)
    return covariance, min(count / max((1.0 - share) ** 2, 1e-9), _MOST_FREEDOM * count)


# Coarser tiles are made of 2 x 2, 4 x 4 ... of them while there are at least so many. Coarse tiles of nothing but noise
# scatter by more than a limit with this chance.
_LEAST_COARSE_TILES, _CHANCE = 4, 0.01


def _widening(coarse: FloatArray, own: FloatArray) -> FloatArray:
    """Return the factor of each parameter's error, from the scatter of coarser tiles."""
    widening, tiles = np.ones(len(own)), int(np.count_nonzero(np.any(coarse != 0.0, axis=2)))
    while True:
        coarse = np.pad(coarse, ((0, coarse.shape[0] % 2), (0, coarse.shape[1] % 2), (0, 0)))
        coarse = coarse.reshape(coarse.shape[0] // 2, 2, coarse.shape[1] // 2, 2, -1).sum(axis=(1, 3))
        flat = coarse.reshape(-1, coarse.shape[-1])
        if len(flat) < _LEAST_COARSE_TILES:
            return np.sqrt(widening)
        ratio = np.diag(_scatter(flat)) / np.where(own > 0.0, own, np.inf)
        # What independent tiles exceed by chance is no widening.
        by_chance = float(fdtri(len(flat) - 1, max(tiles - 1, 1), 1.0 - _CHANCE))
        widening = np.where(ratio > by_chance, np.maximum(widening, ratio), widening)


def _scatter(scores: FloatArray) -> FloatArray:
    held = scores[np.any(scores != 0.0, axis=1)]
    count = len(held)
    if count < 2:
        return np.zeros((scores.shape[1], scores.shape[1]))
    centred = held - held.mean(axis=0)
    return np.asarray(centred.T @ centred * (count / (count - 1.0)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Evidence of a run for all faults: right side b = A x + noise."""

    causes: tuple[Cause, ...]  #: all that are looked for
    information: FloatArray  #: A, shape (P, P)
    covariance: FloatArray  #: of b
    right: FloatArray  #: b about no faults
    freedom: float  #: number of independent parts that the covariance was made from


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimates:
    """Sizes of the faults of a set, fitted together."""

    values: FloatArray
    covariance: FloatArray
    parts: tuple[slice, ...]  #: which values are those of each fault
    is_determined: bool

    def size_of(self, which: int) -> tuple[float, float]:
        """Return a number with its error, or the length of a vector with the error along it."""
        part = self.parts[which]
        values, covariance = self.values[part], self.covariance[part, part]
        length = float(np.linalg.norm(values))
        if len(values) == 1:
            length, variance = float(values[0]), covariance[0, 0]
        elif length > 0.0:
            variance = (values / length) @ covariance @ (values / length)
        else:
            variance = np.max(np.diag(covariance))
        # Rounding leaves no variance of a fault that is hardly there.
        return length, float(np.sqrt(variance)) if variance >= 0.0 else np.inf

    def statistic(self, which: int) -> float:
        """Return the square of a size in its errors, over its dimension; 0 where it is not determined."""
        part = self.parts[which]
        value, spread = self.values[part], self.covariance[part, part]
        if not self.is_determined or np.linalg.eigvalsh(spread)[0] <= 0.0:
            return 0.0
        return float(value @ np.linalg.solve(spread, value)) / len(value)


# Share of a regressor's size that is left after others, below which it is one of them.
_NOTHING_LEFT = 1e-6


def estimates(evidence: Evidence, chosen: Sequence[int]) -> Estimates:
    """Return the sizes of some causes, by their numbers, fitted together, the others being nothing."""
    widths = [evidence.causes[index].directions.shape[1] for index in chosen]
    ends = np.cumsum(widths)
    parts = tuple(slice(int(end - width), int(end)) for end, width in zip(ends, widths, strict=True))
    directions = np.column_stack([evidence.causes[index].directions for index in chosen])
    normal = directions.T @ evidence.information @ directions
    size = np.sqrt(np.abs(np.diag(normal)))
    if not np.all(size > 0.0) or np.linalg.svd(normal / np.outer(size, size), compute_uv=False)[-1] < _NOTHING_LEFT:
        unknown = np.full_like(normal, np.inf)
        return Estimates(values=np.zeros(len(normal)), covariance=unknown, parts=parts, is_determined=False)
    inverse = np.linalg.inv(normal / np.outer(size, size)) / np.outer(size, size)
    found = inverse @ (directions.T @ evidence.right)
    spread = inverse @ (directions.T @ evidence.covariance @ directions) @ inverse.T
    return Estimates(values=found, covariance=spread, parts=parts, is_determined=True)


def _sum_of(evidence: Evidence, chosen: tuple[int, ...]) -> FloatArray:
    total = np.zeros(len(evidence.right))
    if chosen:
        fitted = estimates(evidence, chosen)
        for index, part in zip(chosen, fitted.parts, strict=True):
            total += evidence.causes[index].directions @ fitted.values[part]
    return total


# Errors of a fault that are this much larger than any rig's faults tell nothing.
_USELESS = 4.0


def is_useful(cause: Cause, error: float) -> bool:
    """Return whether the error of a fault is below what tells nothing."""
    return error < _USELESS * float(cause.expected.max())


# Of the information of a throughput: less is rounding. Of the regressor of a curved response, root mean square, that is
# left after throughputs, angles and dark levels: with less, the response cannot be tested.
_NUMBERS, LEAST_SHARE_LEFT = 1e-13, 0.05


def share_left(evidence: Evidence, index: int) -> float:
    """Return what is left of the regressor of a cause after throughputs, angles and dark levels, root mean square."""
    information = 0.5 * (evidence.information + evidence.information.T)
    count = (len(information) - len(SHARED)) // len(PER_FRAME) * 3
    direction = evidence.causes[index].directions[:, 0]
    own = float(direction @ information @ direction)
    size = np.sqrt(np.maximum(np.diag(information)[:count], 0.0))
    held = size > 0.0
    if not held.any() or not own > _NUMBERS * float(size.max()) ** 2:
        return 0.0
    others = information[:count, :count][np.ix_(held, held)] / np.outer(size[held], size[held])
    cross = (information[:count] @ direction)[held] / size[held]
    values, vectors = np.linalg.eigh(others)
    kept = values > 1e-7
    along = vectors[:, kept].T @ cross
    return float(np.sqrt(max(0.0, 1.0 - float(np.sum(along**2 / values[kept])) / own)))


# Least eigenvalue of the correlations of regressors that are fitted together: below, two would only undo one another.
_ALIKE = 0.03

# Faults are as large as is expected of rigs, or (the tail) some times that.
_TIMES_EXPECTED = (1.0, 6.0)


class Weigher:
    """Logarithms of the evidence of sets of causes: one whitening, many sets.

    Sizes of faults are normal with the standard deviations that are expected of rigs, or several times these, so that a
    cause more, or one that would have to be absurdly large, costs what it should. The covariance of the right side is
    itself estimated: tails are those of Student's distribution.
    """

    def __init__(self, evidence: Evidence) -> None:
        whitener = _whitener(evidence.covariance)
        measured = whitener @ evidence.right
        self._rank = len(measured)
        self._widths = np.array([cause.directions.shape[1] for cause in evidence.causes])
        self._starts = np.cumsum(self._widths) - self._widths
        expected = np.column_stack([cause.directions * cause.expected for cause in evidence.causes])
        regressors = whitener @ (evidence.information @ expected)
        self._gram = regressors.T @ regressors
        self._along = regressors.T @ measured
        self._total = float(measured @ measured)
        self._freedom = float(max(evidence.freedom, 8.0))
        self._odds = np.array([cause.log_odds for cause in evidence.causes])
        self._per_cause = -float(np.log(len(evidence.causes)))
        self._close = _collinearity(self._gram, self._starts, self._widths)

    def log_evidence(self, chosen: Sequence[int], *, is_even: bool = False) -> float:
        """Return the logarithm of the evidence of a set, up to what all sets share."""
        if not chosen:
            return -0.5 * (self._freedom + self._rank) * float(np.log1p(self._total / self._freedom))
        return float(self.of_sets(np.array([chosen], dtype=np.intp), is_even=is_even)[0])

    def of_sets(self, sets: NDArray[np.intp], *, is_even: bool = False) -> FloatArray:
        """Return the logarithms of the evidence of sets, -inf where causes are too alike."""
        heights, widths = np.full(len(sets), -np.inf), self._widths[sets]
        for kind in np.unique(widths, axis=0):
            these = np.flatnonzero(np.all(widths == kind, axis=1))
            starts = self._starts[sets[these]]
            parts = [starts[:, at, None] + np.arange(width) for at, width in enumerate(kind)]
            columns = np.concatenate(parts, axis=1)
            close = self._close[columns[:, :, None], columns[:, None, :]]
            apart = np.linalg.eigvalsh(close)[:, 0] >= _ALIKE if sets.shape[1] > 1 else np.full(len(these), True)
            heights[these[apart]] = self._of_columns(columns[apart])
        odds = 0.0 if is_even else self._odds[sets].sum(axis=1)
        return np.asarray(heights + odds + sets.shape[1] * self._per_cause)

    def _of_columns(self, columns: NDArray[np.intp]) -> FloatArray:
        gram, along = self._gram[columns[:, :, None], columns[:, None, :]], self._along[columns]
        heights = [self._of_sizes(gram * times**2, along * times) for times in _TIMES_EXPECTED]
        return np.asarray(np.logaddexp.reduce(heights, axis=0) - np.log(len(heights)))

    def _of_sizes(self, gram: FloatArray, along: FloatArray) -> FloatArray:
        normal = np.eye(gram.shape[1]) + gram
        explained = np.sum(along * np.linalg.solve(normal, along[:, :, None])[:, :, 0], axis=1)
        left = np.maximum(self._total - explained, 0.0)
        misfit = (self._freedom + self._rank) * np.log1p(left / self._freedom)
        return np.asarray(-0.5 * misfit - 0.5 * np.linalg.slogdet(normal)[1])

    def correlation(self, one: int, other: int) -> float:
        """Return how far two causes do the same to a run, from 0 to 1 (the largest canonical correlation)."""
        mine, its = (slice(self._starts[at], self._starts[at] + self._widths[at]) for at in (one, other))
        return min(float(np.linalg.norm(self._close[mine, its], 2)), 1.0)


# Scores are trusted to this share of their variance: regressors have noise of their own.
_SCORE_FLOOR = 0.01


def _whitener(covariance: FloatArray) -> FloatArray:
    size = np.sqrt(np.diag(covariance))
    size = np.where(size > 0.0, size, np.inf)
    held = np.isfinite(size)
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size) + _SCORE_FLOOR * np.diag(held))
    kept = values > 0.5 * _SCORE_FLOOR
    return np.asarray((vectors[:, kept] / np.sqrt(values[kept])).T / size)


def _collinearity(gram: FloatArray, starts: NDArray[np.intp], widths: NDArray[np.intp]) -> FloatArray:
    """Return the correlations of the regressors of all causes, those of one cause made independent."""
    scaled = np.zeros_like(gram)
    for start, width in zip(starts, widths, strict=True):
        own = slice(start, start + width)
        values, vectors = np.linalg.eigh(gram[own, own])
        kept = values > _NOTHING_LEFT * max(float(values[-1]), 0.0)
        scaled[own, own] = (vectors[:, kept] / np.sqrt(values[kept])) @ vectors[:, kept].T
    return np.asarray(scaled @ gram @ scaled)


# Loss of evidence (natural logarithm) up to which other causes could stand in place of those named: one in a hundred.
_CONFUSED_MARGIN = 4.6


def _fit_about(tiles: _Tiles, light: float, before: tuple[int, ...]) -> JointFit:
    """Return the fit, with errors from what is left once the causes that it names are taken out.

    Causes that were named before stay where others explain the run hardly better: twins would follow one another.
    """
    evidence = tiles.evidence_about(tiles.everything(), ())
    left_out: set[int] = set()
    while True:
        evidence, candidates, best = _best_causes(tiles, evidence, left_out, before)
        evidence, best = _with_its_own_errors(tiles, evidence, np.setdiff1d(candidates, [*left_out]), best)
        evidence, named = _that_stand(tiles, evidence, best, FALSE_FINDING_RATE / max(len(candidates), 1))
        if named or not best:
            break
        # What does not stand by itself must not stand in the way of what does.
        left_out |= set(best)
    weigher = Weigher(evidence)
    return JointFit(
        evidence=evidence,
        weigher=weigher,
        candidates=candidates,
        named=_by_size(evidence, named),
        # A response that polarization is too alike to test may be what is wrong all the same.
        stand_ins=_stand_ins(weigher, named, np.arange(len(tiles.causes)), margin=_CONFUSED_MARGIN),
        parameters=_sum_of(evidence, named),
        light=light,
    )


# Gain of evidence (natural logarithm) below which causes are not exchanged for others once they were taken out.
_HARDLY_BETTER = 3.0


def _best_causes(
    tiles: _Tiles, evidence: Evidence, left_out: set[int], kept: tuple[int, ...]
) -> tuple[Evidence, NDArray[np.intp], tuple[int, ...]]:
    """Return the causes that explain a run best, some left out, with the errors that are left about them."""
    named: tuple[int, ...] | None = None
    for _ in range(_ROUNDS):
        testable = [
            index
            for index, cause in enumerate(evidence.causes)
            if cause.name not in SHARED or share_left(evidence, index) > LEAST_SHARE_LEFT
        ]
        candidates, weigher = np.array(testable, dtype=np.intp), Weigher(evidence)
        before, named = named, _best_set(weigher, np.setdiff1d(candidates, [*left_out]))
        if kept and not left_out & set(kept):
            gained = weigher.log_evidence(named) - weigher.log_evidence(kept)
            named = kept if gained < _HARDLY_BETTER else named
        if named == before:
            break
        evidence = tiles.evidence_of(named)
    return evidence, candidates, named or ()


def _best_set(weigher: Weigher, candidates: NDArray[np.intp]) -> tuple[int, ...]:
    """Return the causes that explain a run best.

    A cause is added while that raises the evidence, and each is exchanged for a better one as long as there is any. All
    pairs are tried against a single cause that does not stand alone, and against nothing: faults of frames that stand
    close to one another can hide each other.
    """
    chosen: tuple[int, ...] = ()
    best = weigher.log_evidence(chosen)
    while len(chosen) < _MOST_CAUSES:
        larger, value = _grown(weigher, candidates, chosen)
        if len(larger) == 1 and value <= best:
            larger, value = max([(larger, value), _best_pair(weigher, candidates)], key=lambda found: found[1])
        larger, value = _exchanged(weigher, candidates, larger, value)
        if value <= best:
            break
        chosen, best = larger, value
    return chosen


def _grown(weigher: Weigher, candidates: NDArray[np.intp], chosen: tuple[int, ...]) -> tuple[tuple[int, ...], float]:
    """Return the best set of one cause more, all pairs tried against a single cause; as given without any other."""
    larger, value = _with_another(weigher, candidates, chosen)
    if len(larger) == 2:
        return max([(larger, value), _best_pair(weigher, candidates)], key=lambda found: found[1])
    return larger, value


def _with_another(
    weigher: Weigher, candidates: NDArray[np.intp], chosen: tuple[int, ...]
) -> tuple[tuple[int, ...], float]:
    others = np.setdiff1d(candidates, chosen)
    if not others.size:
        return chosen, -np.inf
    heights = weigher.of_sets(_each_with(chosen, others[:, None]))
    top = int(np.argmax(heights))
    return (*chosen, int(others[top])), float(heights[top])


def _best_pair(weigher: Weigher, candidates: NDArray[np.intp]) -> tuple[tuple[int, ...], float]:
    pairs = _pairs(candidates)
    if not pairs.size:
        return (), -np.inf
    heights = weigher.of_sets(pairs)
    top = int(np.argmax(heights))
    return (int(pairs[top, 0]), int(pairs[top, 1])), float(heights[top])


def _each_with(chosen: Sequence[int], others: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return a set with each of some others, shape (M, K)."""
    same = np.tile(np.array(chosen, dtype=np.intp), (len(others), 1))
    return np.hstack([same, others])


def _pairs(numbers: NDArray[np.intp]) -> NDArray[np.intp]:
    first, second = np.triu_indices(len(numbers), 1)
    return np.column_stack([numbers[first], numbers[second]])


def _exchanged(
    weigher: Weigher, candidates: NDArray[np.intp], chosen: tuple[int, ...], value: float
) -> tuple[tuple[int, ...], float]:
    for _ in range(3 * len(chosen)):
        others = np.setdiff1d(candidates, chosen)
        sets = [_with_another(weigher, others, chosen[:at] + chosen[at + 1 :]) for at in range(len(chosen))]
        better, height = max(sets, key=lambda found: found[1])
        if height <= value + 1e-6:
            break
        chosen, value = better, height
    return chosen, value


def _with_its_own_errors(
    tiles: _Tiles, evidence: Evidence, candidates: NDArray[np.intp], named: tuple[int, ...]
) -> tuple[Evidence, tuple[int, ...]]:
    """Return a larger set where it explains a run better by the errors that it leaves itself.

    The errors about a set hold what the set leaves unexplained, and so speak for it.
    """
    larger, value = _grown(Weigher(evidence), candidates, named)
    if len(larger) > _MOST_CAUSES or not np.isfinite(value):
        return evidence, named
    about = tiles.evidence_of(larger)
    weigher = Weigher(about)
    is_better = weigher.log_evidence(larger) > weigher.log_evidence(named)
    return (about, larger) if is_better else (evidence, named)


# Times the chance of the first cause that others may have: something is wrong, and the question is what.
_MORE_LENIENT = 5.0


def _that_stand(
    tiles: _Tiles, evidence: Evidence, named: tuple[int, ...], level: float
) -> tuple[Evidence, tuple[int, ...]]:
    """Return the causes left when the least significant is taken away, one after the other, with errors about them."""
    while named:
        chances = _significances(evidence, named)
        worst = int(np.argmax(chances))
        if min(chances) <= level and chances[worst] <= (_MORE_LENIENT * level if len(named) > 1 else level):
            break
        named = named[:worst] + named[worst + 1 :]
        evidence = tiles.evidence_of(named)
    return evidence, named


def _significances(evidence: Evidence, chosen: tuple[int, ...]) -> list[float]:
    """Return the p-value of each estimate of a set; 1 where it is hardly determined."""
    fitted = estimates(evidence, chosen)
    freedom = max(evidence.freedom - len(fitted.values) - 1, 1)
    return [
        float(fdtrc(part.stop - part.start, freedom, fitted.statistic(which)))
        if is_useful(evidence.causes[index], fitted.size_of(which)[1])
        else 1.0
        for which, (index, part) in enumerate(zip(chosen, fitted.parts, strict=True))
    ]


# Curvature, or exponent less 1, of a response whose counts are not light.
_BENT = 0.1


def _by_size(evidence: Evidence, chosen: tuple[int, ...]) -> tuple[int, ...]:
    """Return the causes by how many of its errors each is off, the most first.

    What is too large to be undone comes first, then a response far off a line, for all others were measured in counts
    that are not light; what is no fault comes last.
    """
    if not chosen:
        return ()
    fitted = estimates(evidence, chosen)

    def rank(at: int) -> tuple[bool, bool, bool, float]:
        cause = evidence.causes[chosen[at]]
        made = cause.directions @ fitted.values[fitted.parts[at]]
        is_bent = cause.name in SHARED and abs(fitted.size_of(at)[0]) > _BENT
        return not cause.is_fault, can_be_undone(made), not is_bent, -fitted.statistic(at)

    return tuple(chosen[at] for at in sorted(range(len(chosen)), key=rank))


def _stand_ins(
    weigher: Weigher, named: tuple[int, ...], candidates: NDArray[np.intp], *, margin: float
) -> dict[int, set[int]]:
    """Return, for each cause of a set, those that could stand in its place, alone or with others.

    One or two of the set are exchanged for one or two others; of two for two, each stands in for what it is most like.
    """
    found: dict[int, set[int]] = {index: set() for index in named}
    others = np.setdiff1d(candidates, named)
    if not others.size:
        return found
    least = weigher.log_evidence(named, is_even=True) - margin
    added = (others[:, None], _pairs(others))
    taken = [(1, added[0]), (2, added[0]), (2, added[1]), *([(1, added[1])] if len(named) == 1 else [])]
    for count, sets in taken:
        for leaving in combinations(named, count):
            staying = tuple(index for index in named if index not in leaving)
            alike = sets[weigher.of_sets(_each_with(staying, sets), is_even=True) > least] if sets.size else sets
            for arriving in alike.tolist():
                for index, other in _in_place_of(weigher, leaving, tuple(arriving)):
                    found[index].add(other)
    return found


def _in_place_of(weigher: Weigher, leaving: tuple[int, ...], arriving: tuple[int, ...]) -> Iterable[tuple[int, int]]:
    if len(leaving) != len(arriving):
        return product(leaving, arriving)
    ways = (tuple(zip(leaving, order, strict=True)) for order in permutations(arriving))
    return max(ways, key=lambda way: sum(weigher.correlation(*pair) for pair in way))
