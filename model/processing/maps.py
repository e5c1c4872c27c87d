"""Pictures of Stokes parameters, DoLP and AoLP from the frames of one cycle, in one pass over the counts.

Frames stand on the first axis, (N, H, W), as they come from a camera. Everything is single precision: 1e-6 of S0, of
DoLP, and of AoLP times DoLP, against the same formulas in double precision. Pixels go through in blocks that stay in
the processor's cache; memory is the result, some blocks, and one result that nobody holds any more.
"""

import math
import os
import weakref
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing.reconstruction import Design

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
Engine = Literal["numpy", "fast"]


@dataclass(frozen=True, kw_only=True, eq=False)
class PolarizationMaps:
    """Pictures of the polarization of a scene.

    Attributes
    ----------
    stokes : (3, H, W) array of float32
        S0, S1, S2 in the unit of the frames.
    dolp : (H, W) array of float32
        sqrt(S1^2 + S2^2) / S0: above 1 where noise makes it so. NaN where `valid` is false.
    aolp_rad : (H, W) array of float32
        Counter-clockwise from horizontal, in [0, pi) [rad]. 0 where S1 = S2 = 0: there it has no meaning. NaN where
        `valid` is false.
    valid : (H, W) array of bool
        S0 is above 0 and all three are finite.
    dolp_std, aolp_std_rad : (H, W) array of float32, or None
        Standard deviations to first order in those of the frames; that of AoLP is infinite where S1 = S2 = 0. NaN
        where `valid` is false. None where no deviations were given.
    """

    stokes: Float32Array
    dolp: Float32Array
    aolp_rad: Float32Array
    valid: NDArray[np.bool_]
    dolp_std: Float32Array | None = None
    aolp_std_rad: Float32Array | None = None


def polarization_maps(
    frames: NDArray[np.uint16] | Float32Array,
    design: Design,
    *,
    dark_dn: ArrayLike = 0.0,
    deviations: ArrayLike | None = None,
    engine: Engine = "numpy",
) -> PolarizationMaps:
    """Return Stokes parameters, DoLP and AoLP of every pixel, and their deviations where wanted.

    Parameters
    ----------
    frames
        Counts behind each angle of `design`, shape (N, H, W), uint16 or float32 [DN]. NaN marks a missing pixel.
    design
        Angles and inverse, of `model.processing.reconstruction.design`.
    dark_dn
        Dark level that is taken off: a scalar, one for each frame (N,), or pictures (N, H, W) [DN].
    deviations
        Standard deviations of the counts, independent from frame to frame, shape (N,) or (N, H, W), >= 0 [DN].
    engine
        "numpy", or "fast": compiled by numba, which must be installed. Both keep to the same errors.

    Returns
    -------
    The planes, in one piece of memory. Where the last of them is no longer held, it is taken again for the next maps of
    that size: the system's zeroing of new memory takes as long as all arithmetic.

    Raises
    ------
    ValueError
        An argument has another shape or type, or a deviation is negative.
    ImportError
        "fast" without numba.

    References
    ----------
    [MK14] eq. (15), (21)-(23), (24)-(28) to first order; the inverse that `design` holds.
    """
    _require_frames(frames, design)
    dark = _checked("dark_dn", dark_dn, frames.shape)
    sigma = None if deviations is None else _checked("deviations", deviations, frames.shape)
    # The least alone takes a third of the time of a comparison, but says nothing beside NaN.
    if sigma is not None and not sigma.min(initial=0.0) >= 0.0 and np.any(sigma < 0.0):
        raise ValueError(f"deviations holds {float(np.nanmin(sigma)):g}; allowed is 0 and above")
    planes, valid = _planes(5 if sigma is None else 7, frames.shape[1:])
    flat = planes.reshape(len(planes), -1)
    if engine == "fast":
        _by_numba(frames, design, dark, flat[:5], valid.reshape(-1))
    else:
        _by_numpy(frames, design, dark, flat[:5], valid.reshape(-1))
    if sigma is not None:
        _fill_deviations(flat, design, sigma, engine)
    if not valid.all():
        np.copyto(planes[3:], np.float32(np.nan), where=~valid)
    return PolarizationMaps(
        stokes=planes[:3],
        dolp=planes[3],
        aolp_rad=planes[4],
        valid=valid,
        dolp_std=None if sigma is None else planes[5],
        aolp_std_rad=None if sigma is None else planes[6],
    )


def _require_frames(frames: NDArray[np.uint16] | Float32Array, design: Design) -> None:
    angles = design.inverse.shape[1]
    if frames.ndim != 3 or frames.shape[0] != angles:
        raise ValueError(f"frames has shape {frames.shape}; allowed is ({angles}, H, W), a frame for each angle")
    if frames.dtype not in (np.uint16, np.float32):
        raise ValueError(f"frames has type {frames.dtype}; allowed are uint16 and float32")


def _checked(name: str, values: ArrayLike, shape: tuple[int, ...]) -> FloatArray | Float32Array:
    array = np.asarray(values)
    if array.dtype != np.float32:
        array = array.astype(np.float64)
    if array.shape in ((), (shape[0],)):
        return np.full(shape[0], array)
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}; allowed are (), ({shape[0]},) and {shape}")
    return array.reshape(shape[0], -1)


# The memory of the last result that nobody holds any more, and the largest that is kept: maps of 2448 x 2048.
_SPARE: deque[NDArray[np.uint8]] = deque(maxlen=1)
_MOST_SPARE_BYTES = 160 << 20


def _planes(count: int, shape: tuple[int, ...]) -> tuple[Float32Array, NDArray[np.bool_]]:
    """Return planes of numbers, shape (count, H, W), and one of truth values, with whatever is in them."""
    pixels = math.prod(shape)
    # One piece of memory: the system hands out large pages for it, which costs a tenth of small ones.
    size = (4 * count + 1) * pixels
    try:
        memory = _SPARE.pop()
    except IndexError:
        memory = np.empty(size, dtype=np.uint8)
    if memory.nbytes != size:
        memory = np.empty(size, dtype=np.uint8)
    lent = np.asarray(_Lent(memory))
    numbers, truths = lent[: 4 * count * pixels], lent[4 * count * pixels :]
    return numbers.view(np.float32).reshape(count, *shape), truths.view(np.bool_).reshape(shape)


class _Lent:
    """Memory of a result, which comes back when its last view is gone."""

    def __init__(self, memory: NDArray[np.uint8]) -> None:
        self.__array_interface__ = memory.__array_interface__
        self._memory = memory
        if memory.nbytes <= _MOST_SPARE_BYTES:
            weakref.finalize(self, _SPARE.append, memory).atexit = False


def _by_numba(
    frames: NDArray[np.uint16] | Float32Array,
    design: Design,
    dark: FloatArray | Float32Array,
    planes: Float32Array,
    valid: NDArray[np.bool_],
) -> None:
    from model.processing.compiled_maps import GROUP, fill_maps

    counts = frames.reshape(frames.shape[0], -1)
    if dark.ndim == 2:
        counts, dark = np.subtract(counts, dark, dtype=np.float64).astype(np.float32), np.zeros(counts.shape[0])
    inverse, together = design.inverse.astype(np.float32), np.ascontiguousarray(counts)
    whole, rest = _split_dark(dark)
    padded = np.zeros((4, len(whole) + -len(whole) % GROUP), dtype=np.float32)
    padded[:3, : len(whole)], padded[3, : len(whole)] = inverse, whole

    def fill(first: int, last: int) -> None:
        fill_maps(first, last, together, padded[:3], padded[3], inverse @ rest, planes, valid)

    _in_threads(fill, valid.size)


def _split_dark(dark: FloatArray | Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return whole counts and the rest of dark levels, shape (N,) each.

    Whole counts come off without rounding, the rest comes off Stokes parameters that are no larger than the light: so
    a faint picture on a high black level keeps its digits.
    """
    levels = np.asarray(dark, dtype=np.float64)
    whole = np.rint(levels)
    return whole.astype(np.float32), (levels - whole).astype(np.float32)


# Up to 2448 x 2048 one thread keeps the memory busy: two took half as much again of the processor for a tenth.
_PIXELS_A_THREAD, _MOST_THREADS = 8_000_000, 4


def _in_threads(fill: Callable[[int, int], None], pixels: int) -> None:
    """Fill all pixels; those of large pictures by a thread for each processor, this one among them."""
    wanted = min(pixels // _PIXELS_A_THREAD, _MOST_THREADS)
    threads = wanted if wanted < 2 else min(wanted, os.cpu_count() or 1)
    if threads < 2:
        fill(0, pixels)
        return
    from concurrent.futures import ThreadPoolExecutor

    edges = np.linspace(0, pixels, threads + 1).astype(int).tolist()
    with ThreadPoolExecutor(threads - 1) as pool:
        others = pool.map(fill, edges[1:-1], edges[2:])
        fill(edges[0], edges[1])
        for _ in others:
            pass


# Pixels that go through at once: 0.9 MB a plane, for the cache that all cores share. In blocks of an eighth the product
# of matrices takes half as long again, and each call has its fixed time.
BLOCK_PIXELS = 229_376


def _by_numpy(
    frames: NDArray[np.uint16] | Float32Array,
    design: Design,
    dark: FloatArray | Float32Array,
    planes: Float32Array,
    valid: NDArray[np.bool_],
) -> None:
    inverse = design.inverse.astype(np.float32)
    counts = frames.reshape(frames.shape[0], -1)

    def fill(first: int, last: int) -> None:
        most = min(BLOCK_PIXELS, last - first)
        signal, spare = np.empty((counts.shape[0], most), dtype=np.float32), np.empty(most, np.float32)
        for start in range(first, last, BLOCK_PIXELS):
            here = slice(start, min(start + BLOCK_PIXELS, last))
            size = here.stop - here.start
            level = dark if dark.ndim == 1 else dark[:, here]
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                _stokes_of(counts[:, here], level, inverse, signal[:, :size], planes[:3, here])
                _polar(planes[:, here], valid[here], spare[:size])

    _in_threads(fill, valid.size)


def _stokes_of(
    counts: NDArray[np.uint16] | Float32Array,
    dark: FloatArray | Float32Array,
    inverse: Float32Array,
    signal: Float32Array,
    stokes: Float32Array,
) -> None:
    """Fill the Stokes parameters of a block, shape (3, P)."""
    if dark.ndim == 2:
        np.subtract(counts, dark, out=signal, casting="same_kind")
        np.matmul(inverse, signal, out=stokes)
        return
    whole, rest = _split_dark(dark)
    if counts.dtype == np.float32 and not whole.any():
        np.matmul(inverse, counts, out=stokes)
    else:
        np.copyto(signal, counts)
        if whole.any():
            signal -= whole[:, np.newaxis]
        np.matmul(inverse, signal, out=stokes)
    if np.any(rest):
        stokes -= (inverse @ rest)[:, np.newaxis]


# The direction pi is the direction 0, and single precision rounds pi itself up.
_BELOW_HALF = np.nextafter(np.float32(0.5), np.float32(0.0))

# Infinity as whole number: all that is below, as a number without sign, is finite and not negative.
_INFINITY_BITS = np.float32(np.inf).view(np.uint32)


def _polar(planes: Float32Array, valid: NDArray[np.bool_], spare: Float32Array) -> None:
    """Fill DoLP, AoLP and their validity of a block from its Stokes parameters."""
    s0, s1, s2, dolp, angle = planes
    np.multiply(s1, s1, out=dolp)
    np.multiply(s2, s2, out=spare)
    dolp += spare
    np.sqrt(dolp, out=dolp)
    np.divide(dolp, s0, out=dolp)
    # Half of the argument of S1 + i S2, in [0, pi), by one arctangent that needs no unwrapping.
    np.negative(s1, out=spare)
    np.arctan2(s2, spare, out=angle)
    # From -pi on this comes to what is just below pi, and at pi to 0 itself: no pass that limits it.
    np.subtract(np.float32(np.pi), angle, out=angle)
    angle *= _BELOW_HALF
    # DoLP has the sign of S0, where it is 0 as well, and is not finite where S0 is 0 or a frame missing or infinite.
    np.less(dolp.view(np.uint32), _INFINITY_BITS, out=valid)


# Deviations make many planes in between: those of a block stay in the second-level cache.
_DEVIATION_PIXELS = 32_768
# More frames than that are left to numpy.
_COMPILED_FRAMES = 4


def _fill_deviations(planes: Float32Array, design: Design, sigma: FloatArray | Float32Array, engine: Engine) -> None:
    pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    products = np.stack([design.inverse[i] * design.inverse[j] for i, j in pairs]).astype(np.float32)
    stokes, (dolp, _, dolp_std, angle_std) = planes[:3], planes[3:]
    if engine == "fast" and len(sigma) <= _COMPILED_FRAMES:
        from model.processing.compiled_maps import fill_deviations

        given = list(sigma.astype(np.float32, copy=False).reshape(len(sigma), -1))
        missing = _COMPILED_FRAMES - len(sigma)  # replaced by the last one with zero weight
        products = np.pad(products, ((0, 0), (0, missing)))
        fill_deviations(tuple(stokes), dolp, products, (*given, *given[-1:] * missing), (dolp_std, angle_std))
        return
    for start in range(0, dolp.size, _DEVIATION_PIXELS):
        here = slice(start, min(start + _DEVIATION_PIXELS, dolp.size))
        variances = np.square(sigma if sigma.ndim == 1 else sigma[:, here], dtype=np.float32)
        cov = products @ variances
        dolp_std[here], angle_std[here] = _first_order(stokes[:, here], dolp[here], cov)


def _first_order(stokes: Float32Array, dolp: Float32Array, cov: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return deviations of DoLP and AoLP from the covariance of Stokes parameters, (00, 11, 22, 01, 02, 12) first."""
    v00, v11, v22, v01, v02, v12 = cov
    with np.errstate(divide="ignore", invalid="ignore"):
        length = dolp * stokes[0]
        # Where S1 = S2 = 0 the direction has no meaning; that of S1 is taken, as in the moments of DoLP.
        polarized = length > 0.0
        cosine = np.where(polarized, stokes[1] / length, np.float32(1.0))
        sine = np.where(polarized, stokes[2] / length, np.float32(0.0))
        along = v11 * cosine**2 + v22 * sine**2 + 2.0 * v12 * cosine * sine
        across = v11 * sine**2 + v22 * cosine**2 - 2.0 * v12 * cosine * sine
        variance = along - 2.0 * dolp * (v01 * cosine + v02 * sine) + dolp**2 * v00
        # A variance that cancels, as of full polarization, is below 0 by its rounding alone.
        return np.sqrt(np.maximum(variance, 0.0)) / stokes[0], np.sqrt(np.maximum(across, 0.0)) / (2.0 * length)
