"""Scale of imported images: how many bits, where they stand, what is saturated, what is missing."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import ConfigError, DataError
from rigctl.imports.image_border import Border
from rigctl.imports.image_levels import common_zero_bits, largest, missing_pixels, saturation_plateau
from rigctl.imports.import_request import ImportRequest

_TELLING_LEVELS = 8
# So many lowest bits that are zero are no accident.
_LEAST_UNUSED_BITS = 2


@dataclass(frozen=True, kw_only=True)
class Scale:
    """The way from the counts of the files to the counts of the run.

    Attributes
    ----------
    bit_depth : int
        Bits of the camera.
    shift_bits : int
        How far counts are shifted right on their way.
    saturation_dn : float
        A pixel at or above this is saturated [DN of the run].
    missing_dn : float or None
        The value that marks pixels that were not received [DN of the run].
    remarks : tuple of str
        What was recognised, for the user and for every frame.
    """

    bit_depth: int
    shift_bits: int
    saturation_dn: float
    missing_dn: float | None
    remarks: tuple[str, ...]


def find_scale(
    request: ImportRequest,
    levels: NDArray[np.int64],
    *,
    sample_bits: int,
    black_level_dn: float | None,
    levels_by_file: Sequence[NDArray[np.int64]] = (),
    borders: Sequence[Border] = (),
) -> Scale:
    """Return what the counts mean, by what the user says and the counts themselves show.

    Parameters
    ----------
    request : ImportRequest
        What the user says.
    levels : (65536,) array of int
        Pixels by count, over all files.
    sample_bits : {8, 16}
        Bits that a sample takes in the files.
    black_level_dn : float or None
        The smallest black level of the files [DN of the files].
    levels_by_file : sequence of (65536,) arrays of int
        The same file by file: some may have been resampled, and others not.
    borders : sequence of Border
        Constant pixels along the edges of files.

    Raises
    ------
    ConfigError
        The counts leave a choice that the user has to make.
    DataError
        The counts contradict what the user says.
    """
    depth, depth_remarks = _bit_depth(request, levels, sample_bits, levels_by_file)
    shift, shift_remarks = _shift(request, levels, depth, sample_bits, levels_by_file)
    full_scale_dn = (2**depth - 1) << shift
    saturation_dn, saturation_remarks = _saturation(request, levels, full_scale_dn)
    # A sky that is clipped up to the edge is no border.
    dark = [border for border in borders if border.value_dn < min(saturation_dn, largest(levels))]
    missing_dn, missing_remarks = _missing(request, levels, black_level_dn, dark)
    unit = 2**shift
    return Scale(
        bit_depth=depth,
        shift_bits=shift,
        saturation_dn=saturation_dn / unit,
        missing_dn=None if missing_dn is None else missing_dn / unit,
        remarks=(*depth_remarks, *shift_remarks, *saturation_remarks, *missing_remarks),
    )


def _bit_depth(
    request: ImportRequest,
    levels: NDArray[np.int64],
    sample_bits: int,
    levels_by_file: Sequence[NDArray[np.int64]],
) -> tuple[int, tuple[str, ...]]:
    if request.bit_depth is not None and request.bit_depth > sample_bits:
        raise DataError(f"--bit-depth {request.bit_depth}: samples in the files have only {sample_bits} bits")
    if request.bit_depth is not None:
        return request.bit_depth, ()
    if sample_bits == 8:
        return 8, ()
    zero_bits = common_zero_bits(levels)
    if zero_bits:
        raise ConfigError(
            f"bit depth: all counts are multiples of {2**zero_bits}, as {16 - zero_bits} bits left-justified in 16 "
            f"would be; say --bit-depth N (and --justified right if they are not)"
        )
    if largest(levels) < 2**15:
        raise ConfigError(
            f"bit depth: samples of 16 bits with counts up to {largest(levels)} do not tell how many the camera "
            "has; say --bit-depth N" + "".join(f" ({remark})" for remark in _some_left(levels_by_file))
        )
    return 16, (f"16 bits, since counts reach {largest(levels)}", *_some_left(levels_by_file))


def _some_left(levels_by_file: Sequence[NDArray[np.int64]]) -> tuple[str, ...]:
    """Return that some files show unused bits and others do not, as resampled ones would."""
    bits = [common_zero_bits(own) for own in levels_by_file if np.count_nonzero(own) >= _TELLING_LEVELS]
    plain = [zero for zero in bits if zero >= _LEAST_UNUSED_BITS]
    if not plain or len(plain) == len(bits):
        return ()
    depth = 16 - min(plain)
    remark = (
        f"counts of {len(plain)} of {len(bits)} files are multiples of {2 ** min(plain)}: if the camera has {depth} "
        f"bits and the other files were resampled, say --bit-depth {depth} --justified left"
    )
    return (remark,)


def _shift(
    request: ImportRequest,
    levels: NDArray[np.int64],
    depth: int,
    sample_bits: int,
    levels_by_file: Sequence[NDArray[np.int64]],
) -> tuple[int, tuple[str, ...]]:
    resampled = _resampled(request, levels, depth, sample_bits, levels_by_file)
    if resampled is not None:
        return resampled
    spare, zero_bits, top = sample_bits - depth, common_zero_bits(levels), largest(levels)
    could_be_right = top < 2**depth
    # A handful of round numbers, as in a drawn test image, is no sign of unused bits.
    tells = not could_be_right or int(np.count_nonzero(levels)) >= _TELLING_LEVELS
    could_be_left = spare > 0 and zero_bits >= spare and tells
    if not _possible(request, could_be_left, could_be_right):
        raise DataError(
            f"--bit-depth {depth}: counts reach {top} and are multiples of {2**zero_bits}, which "
            f"{depth} bits {_where(request)} of {sample_bits} do not hold"
        )
    if could_be_left and could_be_right and request.justified is None:
        raise ConfigError(
            f"justification: counts reach {top} only and all are multiples of {2**zero_bits}, so that {depth} bits "
            f"may stand at either end of {sample_bits}; say --justified left or --justified right"
        )
    if could_be_left and request.justified != "right":
        return spare, (f"left-justified: {depth} bits in {sample_bits}; counts were divided by {2**spare}",)
    return 0, _unused_bits(zero_bits, sample_bits)


def _resampled(
    request: ImportRequest,
    levels: NDArray[np.int64],
    depth: int,
    sample_bits: int,
    levels_by_file: Sequence[NDArray[np.int64]],
) -> tuple[int, tuple[str, ...]] | None:
    """Return the shift of files that stand left, of which some were resampled and show it no more; None otherwise."""
    spare = sample_bits - depth
    plain = sum(common_zero_bits(own) >= spare for own in levels_by_file)
    if spare <= 0 or plain == len(levels_by_file) or request.justified == "right":
        return None
    stated = request.justified == "left"
    if largest(levels) < 2**depth or (plain == 0 and not stated):
        return None
    shown = f"{plain} of {len(levels_by_file)} files show it" if plain else "no file shows it, it was said"
    remark = (
        f"left-justified: {depth} bits in {sample_bits}; {shown}, counts of the others were resampled: all were "
        f"divided by {2**spare} and rounded, which loses up to half a count"
    )
    return spare, (remark,)


def _unused_bits(zero_bits: int, sample_bits: int) -> tuple[str, ...]:
    if not zero_bits:
        return ()
    depth = sample_bits - zero_bits
    remark = (
        f"all counts are multiples of {2**zero_bits}: if they are {depth} bits left-justified in {sample_bits}, "
        f"say --bit-depth {depth} --justified left"
    )
    return (remark,)


def _where(request: ImportRequest) -> str:
    return "at either end" if request.justified is None else f"at the {request.justified} end"


def _possible(request: ImportRequest, could_be_left: bool, could_be_right: bool) -> bool:
    wanted = {"left": could_be_left, "right": could_be_right}
    return wanted[request.justified] if request.justified is not None else any(wanted.values())


def _saturation(request: ImportRequest, levels: NDArray[np.int64], full_scale_dn: int) -> tuple[float, tuple[str, ...]]:
    if request.saturation_dn is not None:
        return request.saturation_dn, ()
    plateau = saturation_plateau(levels, full_scale_dn=full_scale_dn)
    if plateau is None:
        return float(full_scale_dn), ()
    found = f"{plateau.fraction:.1%} of the pixels are at the largest count, {plateau.value_dn}"
    if plateau.certain:
        return float(plateau.value_dn), (f"{found}, and are taken as saturated (--saturation-dn)",)
    return float(full_scale_dn), (f"{found}: if they are saturated, say --saturation-dn {plateau.value_dn}",)


def _missing(
    request: ImportRequest, levels: NDArray[np.int64], black_level_dn: float | None, borders: Sequence[Border]
) -> tuple[float | None, tuple[str, ...]]:
    if request.missing_dn is not None or request.none_missing:
        return request.missing_dn, ()
    if borders:
        widest = max(borders, key=lambda border: border.fraction)
        remark = (
            f"a constant border of {widest.value_dn} takes up to {widest.fraction:.2%} of a file, in {len(borders)} of "
            "them: all pixels of that count are taken as missing (--no-border-search if they are not)"
        )
        return float(widest.value_dn), (remark,)
    block = missing_pixels(levels, black_level_dn=black_level_dn)
    if block is None:
        return None, ()
    found = f"{block.fraction:.1%} of the pixels are 0 and none lies between that and the darkest possible"
    if block.certain:
        return float(block.value_dn), (f"{found}: taken as missing (--missing-dn none if they are not)",)
    return None, (f"{found}: if they were not received, say --missing-dn 0",)
