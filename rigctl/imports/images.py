"""Frames of a run from images that other programs wrote.

`import_images` reads every picture once for its size, header and histogram, and for a constant border that
resampling or a mask left. Together with what the user states (`ImportOptions`) they decide what a count means
(`find_scale`): number of bits, their end of the sample, saturation, missing pixels. Nothing is
written before every problem is known. Then each picture becomes frames: upright, cut into the channels of a mosaic,
with its bits in place.

A frame of a run has the counts of one read of the camera. A sum of n reads is divided by n, and kept in single
precision as means with fractions and counts below 0 are: its noise has 1/n of the variance of one read.
"""

import re
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import ceil, isfinite
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from model.processing.jpeg_traces import jpeg_traces
from rigctl.base.durable import MOST_FRAME_MB, flush_folder
from rigctl.base.numbers import is_utc_text
from rigctl.errors import ConfigError, DataError, RunFolderError
from rigctl.files.choices import FrameKind
from rigctl.images import FIRST_OF, FLIP, LOSSY, STALE, FirstRow, ImageFile, name_of, read_images, unlike_settings
from rigctl.imports import headers
from rigctl.imports.levels import (
    LEVELS,
    common_zero_bits,
    histogram,
    largest,
    missing_pixels,
    odd_pattern,
    saturation_plateau,
)
from rigctl.imports.options import ImportOptions
from rigctl.runs.folder import Run, read_run
from rigctl.runs.records import FrameRecord
from rigctl.runs.writer import RunWriter

_ORIGIN = "import"
_BYTES_PER_MB = 1_000_000
_LISTED = 3  # files that have one and the same problem
_CLIPPED_SHARE = 1e-3  # of the pixels of a file, beyond which it is reported
_JPEG = "blocks of 8 x 8 pixels show that JPEG was at work, which changes counts: noise and edges are not the camera's"


def import_images(
    run: Path, files: Sequence[Path], options: ImportOptions
) -> tuple[tuple[FrameRecord, ...], tuple[str, ...], tuple[float, float]]:
    """Make a run of images, or add them to one that was imported.

    Returns
    -------
    frames, remarks, clipped
        The new frames; what was recognised in the files, and doubts; the shares of all pixels that are clipped at the
        upper end of the range and at 0.

    Raises
    ------
    ConfigError
        Something is not stated, or stated wrongly: one message with every problem.
    DataError
        The files are unfit, or contradict what is stated: one message with every problem.
    """
    present = _present_run(run)
    images, scale, remarks = _surveyed(files, options, present)
    if present is None:
        frames = _write_new(run, files, options, images, scale)
    else:
        with RunWriter.append(run) as writer:
            frames = _write(writer, files, options, images, scale, present.frames)
    all_remarks = (*remarks, *scale.remarks, *_file_remarks(images, scale), *axis_remarks(options, frames))
    return frames, all_remarks, _clipped_shares(images, scale, frames)


def axis_remarks(options: ImportOptions, frames: Sequence[FrameRecord]) -> tuple[str, ...]:
    """Return a remark if scene frames have fewer than three different axes."""
    scenes = [frame for frame in frames if frame.kind == "scene"]
    axes = {axis_deg(frame.polarizer_angle_deg) for frame in scenes if frame.polarizer_angle_deg is not None}
    if not scenes or len(axes) >= 3:
        return ()
    if not axes and options.get("stage_angles") is not None:
        return ("stage angles only: `rigctl calibrate axis` takes these frames, Stokes parameters need the axis",)
    return (f"{len(axes)} different axes only: Stokes parameters need three or more, modulo 180 degrees",)


def _present_run(path: Path) -> Run | None:
    if not path.exists() or (path.is_dir() and not any(path.iterdir())):
        return None
    run = read_run(path)
    if run.session.origin != _ORIGIN:
        raise RunFolderError(f"{path}: holds frames that were taken, not imported; import into a folder of its own")
    return run


def _surveyed(
    files: Sequence[Path], options: ImportOptions, present: Run | None
) -> tuple[list["SurveyedImage"], "Scale", list[str]]:
    """Return every picture with the facts about it, the scale of the counts, and remarks on headers and names."""
    images: list[SurveyedImage] = []
    unsaid: list[str] = []
    unfit: list[str] = []
    refused: dict[tuple[bool, str], list[Path]] = {}
    for number, path in enumerate(files):
        try:
            images += [_survey(options, number, image) for image in _read(path, options)]
        except (ConfigError, DataError) as error:
            refused.setdefault((isinstance(error, ConfigError), str(error)), []).append(path)
    for (is_unsaid, text), paths in refused.items():
        more = f" and {len(paths) - _LISTED} more" if len(paths) > _LISTED else ""
        (unsaid if is_unsaid else unfit).append(f"{', '.join(map(str, paths[:_LISTED]))}{more}: {text}")
    is_whole = not unfit and not unsaid
    unfit += _size_problems(options, images)
    stack = [(image.file.path, image.file.header) for image in images if FLIP in image.file.header]
    unfit += unlike_settings(stack, same_exposure=options.get("same_exposure", False))
    remarks: list[str] = []
    try:
        images = _at_angles(files, options, images, remarks, is_whole=is_whole)
    except ConfigError as error:
        unsaid.append(str(error))
    images = _by_headers(options, images, remarks)
    has_darks = present is not None and any(record.kind == "dark" for record in present.frames)
    unsaid = [
        *_angle_problems(options),
        *_exposure_problems(files, options, images),
        *_black_level_problems(options, images, darks_are_there=has_darks),
        *_range_problems(options),
        *unsaid,
    ]
    scale: Scale | None = None
    if images:
        try:
            scale = _scale_beside(present, options, images)
            unfit += _contradictions(options, images[0], scale, present)
        except ConfigError as error:
            unsaid.append(str(error))
        except DataError as error:
            unfit.append(str(error))
    problems = "\n  ".join(["nothing was imported:", *unsaid, *unfit])
    if unsaid:
        raise ConfigError(problems)
    if unfit or scale is None:
        raise DataError(problems)
    return images, scale, remarks


def _read(path: Path, options: ImportOptions) -> Iterator[ImageFile]:
    most_bytes = options.get("max_frame_mb", MOST_FRAME_MB) * _BYTES_PER_MB
    for image in read_images(path, plane=options.get("plane"), most_bytes=most_bytes):
        if image.is_lossy:
            raise DataError(LOSSY)
        yield image


def _scale_beside(present: Run | None, options: ImportOptions, images: Sequence["SurveyedImage"]) -> "Scale":
    """Return the scale of the counts; all frames of a run have the same number of bits."""
    if options.get("bit_depth") is not None or present is None or not present.frames:
        return find_scale(options, images)
    depth = present.frames[0].bit_depth
    scale = find_scale({**options, "bit_depth": depth}, images)
    return replace(scale, remarks=(f"{depth} bits, as the other frames of this run", *scale.remarks))


def _contradictions(
    options: ImportOptions, image: "SurveyedImage", scale: "Scale", present: Run | None
) -> Iterator[str]:
    if present is None or not present.frames:
        return
    cells = 1 if options.get("mosaic") is None else 2
    height, width = image.shape[0] // cells, image.shape[1] // cells
    record = present.frames[0]
    if (record.height, record.width) != (height, width):
        yield (
            f"frames of {width} x {height} pixels do not fit {present.path}, whose frames have "
            f"{record.width} x {record.height}"
        )
    if record.bit_depth != scale.bit_depth:
        yield f"--bit-depth {scale.bit_depth}: the frames of {present.path} have {record.bit_depth}"


def _clipped_shares(
    images: Sequence["SurveyedImage"], scale: "Scale", frames: Sequence[FrameRecord]
) -> tuple[float, float]:
    """Return which shares of all pixels are saturated, and at 0 without being missing."""
    half = 1 << max(scale.shift_bits - 1, 0)
    at_zero = sum(image.at_zero if image.is_wide else int(image.levels[:half].sum()) for image in images)
    total = sum(image.shape[0] * image.shape[1] for image in images)
    high = sum(record.saturated_fraction for record in frames) / len(frames)
    return high, 0.0 if scale.missing_dn == 0 else at_zero / total


def _file_remarks(images: Sequence["SurveyedImage"], scale: "Scale") -> Iterator[str]:
    """Yield remarks on single files, and their number."""
    stacks = {file: number for file, number in Counter(image.number for image in images).items() if number > 1}
    if stacks:
        first = next(name_of(image.file.path).rpartition("[")[0] for image in images if image.number in stacks)
        others = f" and {len(stacks) - 1} other files hold" if len(stacks) > 1 else " holds"
        colours = "; if they are colours, say --plane red, green or blue" if 3 in stacks.values() else ""
        yield f"{first}{others} {sum(stacks.values())} pictures, each a frame{colours}"
    saturated = ceil(scale.saturation_dn * (1 << scale.shift_bits))
    shares = {
        name_of(image.file.path): float(image.levels[saturated:].sum() / max(image.levels.sum(), 1)) for image in images
    }
    clipped = [f"{share:.2%} of {name}" for name, share in shares.items() if share > _CLIPPED_SHARE]
    if clipped:
        yield f"saturated pixels, where nothing is measured: {', '.join(clipped)}"
    odd = {name_of(image.file.path): text for image in images if (text := odd_pattern(image.levels))}
    if odd:
        yield f"odd bits in {len(odd)} of {len(images)} files ({', '.join(odd)}): {next(iter(odd.values()))}"
    coded = [name_of(image.file.path) for image in images if image.is_jpeg]
    if coded:
        yield f"{len(coded)} of {len(images)} files ({', '.join(coded)}): {_JPEG}"
    yield from dict.fromkeys(remark for image in images for remark in image.file.remarks if _is_doubt(remark))


def _is_doubt(remark: str) -> bool:
    return remark.startswith((STALE, FIRST_OF))


def _write_new(
    run: Path, files: Sequence[Path], options: ImportOptions, images: Sequence["SurveyedImage"], scale: "Scale"
) -> tuple[FrameRecord, ...]:
    parent = run.absolute().parent
    try:
        parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=parent, prefix=f".{run.name}-", suffix=".part") as scratch:
            unfinished = Path(scratch) / "run"
            with RunWriter.create(unfinished, {"origin": _ORIGIN}) as writer:
                frames = _write(writer, files, options, images, scale, ())
            unfinished.replace(run)
        flush_folder(parent)
    except OSError as error:
        raise RunFolderError(f"{run}: cannot be written: {error.strerror}") from error
    return frames


def _write(
    writer: RunWriter,
    files: Sequence[Path],
    options: ImportOptions,
    images: Sequence["SurveyedImage"],
    scale: "Scale",
    present: Sequence[FrameRecord],
) -> tuple[FrameRecord, ...]:
    frames = _frames(files, options, images, scale, first_sequence=writer.next_sequence, present=present)
    written = writer.write_frames(frames)
    kinds = " and ".join(sorted({image.kind for image in images}))
    writer.closing_event("imported", kind=kinds, frames=len(written), files=[str(file) for file in files])
    return written


def _angle_problems(options: ImportOptions) -> Iterator[str]:
    ways = [options.get("angles"), options.get("angle_key"), options.get("mosaic")]
    if sum(way is not None for way in ways) > 1:
        yield "--angles, --angle-key, --mosaic: give one of them"
    mosaic = options.get("mosaic")
    if mosaic is not None and len(mosaic) != 4:
        yield f"--mosaic: {len(mosaic)} angles; a cell of 2 x 2 pixels has 4, row by row"


def _exposure_problems(
    files: Sequence[Path], options: ImportOptions, images: Sequence["SurveyedImage"]
) -> Iterator[str]:
    ways = (
        options.get("exposure_s") is not None,
        options.get("exposure_key") is not None,
        options.get("same_exposure", False),
    )
    if sum(ways) > 1:
        yield "--exposure-s, --exposure-key, --same-exposure: give one of them"
    if not any(ways) and max(len(files), len(images)) > 1 and any(image.exposure_s is None for image in images):
        yield (
            "exposure: say --exposure-s X, --exposure-key KEY, or --same-exposure where it is not known but was "
            "the same for all files"
        )


def _black_level_problems(
    options: ImportOptions, images: Sequence["SurveyedImage"], *, darks_are_there: bool
) -> Iterator[str]:
    ways = (
        options.get("black_level_dn") is not None,
        options.get("black_level_key") is not None,
        options.get("black_level_from_darks", False),
    )
    if sum(ways) > 1:
        yield "--black-level-dn, --black-level-key, --black-level-from-darks: give one of them"
    kinds = {image.kind for image in images} or {options.get("kind") or "scene"}
    is_known = all(image.black_level_dn is not None for image in images if image.kind == "scene")
    if not (any(ways) or (images and is_known)) and "scene" in kinds and "dark" not in kinds and not darks_are_there:
        key = headers.key_of_all(headers.BLACK_LEVEL_KEYS, [image.file.header for image in images])
        yield (
            "black level: say --black-level-dn X, --black-level-key KEY, or --black-level-from-darks where dark "
            "frames of this run give it" + (f"; the headers have {key}" if key else "")
        )


def _range_problems(options: ImportOptions) -> Iterator[str]:
    exposure_s, bit_depth = options.get("exposure_s"), options.get("bit_depth")
    if not all(map(isfinite, options.get("mosaic") or ())):
        yield "--mosaic: every angle must be a finite number of degrees"
    if exposure_s is not None and not 0 < exposure_s < float("inf"):
        yield f"--exposure-s: is {exposure_s:g}, must be above 0"
    levels = {
        "--black-level-dn": (options.get("black_level_dn"), _LOWEST_DN),
        "--saturation-dn": (options.get("saturation_dn"), 0.0),
        "--missing-dn": (options.get("missing_dn"), _LOWEST_DN),
    }
    for option, (value, least) in levels.items():
        if value is not None and value != "none" and not least <= value <= _LARGEST_DN:
            yield f"{option}: is {value:g}, must lie between {least:g} and {_LARGEST_DN:g}"
    if bit_depth is not None and not 1 <= bit_depth <= _MOST_BITS:
        yield f"--bit-depth: is {bit_depth}, must lie between 1 and {_MOST_BITS}"
    if options.get("coadds") is not None and options.get("averaged") is not None:
        yield "--coadds, --averaged: give one of them"
    for option, reads in {"--coadds": options.get("coadds"), "--averaged": options.get("averaged")}.items():
        if reads is not None and not 1 <= reads <= _MOST_READS:
            yield f"{option}: is {reads}, must lie between 1 and {_MOST_READS}"


# A border takes so much of an edge, and at most so large a share of the image.
_LEAST_OF_EDGE, _LARGEST_SHARE = 0.5, 0.3
# A value that is more common inside the image is not that of a border.
_LARGEST_SHARE_INSIDE = 0.01


@dataclass(frozen=True, kw_only=True)
class Border:
    """Pixels of one value that hang together along the edges."""

    value_dn: int  #: Their count.
    fraction: float  #: Of all pixels.
    is_elsewhere: bool  #: Other pixels have this count too: they are of the picture.


def constant_border(counts: NDArray[np.uint16]) -> Border | None:
    """Return the constant border of an image, or None.

    The most common value along the four edges, where pixels of it hang together and take half of an edge or more, and
    are rare in the rest of the image. An image that is dark all over has none.
    """
    edges = np.concatenate([counts[0], counts[-1], counts[:, 0], counts[:, -1]])
    values, numbers = np.unique(edges, return_counts=True)
    value = int(values[np.argmax(numbers)])
    pixels = int(np.count_nonzero(border_pixels(counts, value)))
    inside = int(np.count_nonzero(counts == value)) - pixels
    if not pixels or pixels > _LARGEST_SHARE * counts.size or inside > _LARGEST_SHARE_INSIDE * counts.size:
        return None
    return Border(value_dn=value, fraction=pixels / counts.size, is_elsewhere=inside > 0)


def border_pixels(counts: NDArray[np.uint16], value_dn: int) -> NDArray[np.bool_]:
    """Return which pixels are of a border of this count: pieces that take half of an edge or more."""
    pieces, _ = label(counts == value_dn)
    found: set[int] = set()
    for edge in (pieces[0], pieces[-1], pieces[:, 0], pieces[:, -1]):
        numbers, lengths = np.unique(edge[edge > 0], return_counts=True)
        found |= set(numbers[lengths >= _LEAST_OF_EDGE * edge.size].tolist())
    return np.isin(pieces, sorted(found))


# Of samples of 32 bits, with or without sign.
_MOST_BITS, _LOWEST_DN, _LARGEST_DN, _MOST_READS = 32, -(2.0**31), 2.0**32 - 1.0, 1_000_000
_TELLING_LEVELS = 8
# Fewer lowest bits that are zero may be an accident.
_LEAST_UNUSED_BITS = 2


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Conversion of counts of the files to counts of the run."""

    bit_depth: int  #: Bits of the camera.
    shift_bits: int  #: Shift of the counts to the right.
    saturation_dn: float  #: A pixel at or above this is saturated [DN of the run].
    missing_dn: float | None  #: The value that marks pixels that were not received [DN of the run].
    #: Borders of counts below this are given that value, as other pixels have theirs too [DN of the files]; None: they
    #: have it already.
    marks_borders_below_dn: float | None
    remarks: tuple[str, ...]  #: What was recognised, for the user and for every frame.


def find_scale(options: ImportOptions, images: Sequence["SurveyedImage"]) -> Scale:
    """Return the scale of the counts by the options and by the counts themselves."""
    levels = np.zeros(LEVELS, np.int64)
    for image in images:
        levels[: image.levels.size] += image.levels
    unset = sum(image.unset for image in images)
    wide = [image for image in images if image.is_wide]
    if wide:
        return _scale_of_wide(options, levels, wide, unset)
    sample_bits = max(image.file.sample_bits for image in images)
    black_level_dn = min((image.black_level_dn for image in images if image.black_level_dn is not None), default=None)
    levels_by_file = [image.levels for image in images]
    borders = [image.border for image in images if image.border is not None]
    depth, depth_remarks = _bit_depth(options, levels, sample_bits, levels_by_file)
    shift, shift_remarks = _shift(options, levels, depth, sample_bits, levels_by_file)
    full_scale_dn = (2**depth - 1) << shift
    saturation_dn, saturation_remarks = _saturation(options, levels, full_scale_dn)
    # A sky that is clipped up to the edge is not a border.
    darkest_dn = min(saturation_dn, largest(levels))
    dark = [border for border in borders if border.value_dn < darkest_dn]
    missing_dn, missing_remarks = _missing(options, levels, black_level_dn, dark)
    is_asked = options.get("missing_dn") is None
    is_marked = is_asked and (len({border.value_dn for border in dark}) > 1 or any(b.is_elsewhere for b in dark))
    if is_marked or (unset and options.get("missing_dn") in (None, "none")):
        missing_dn = float(_unused(levels, shift, saturation_dn) << shift)
    unit = 2**shift
    return Scale(
        bit_depth=depth,
        shift_bits=shift,
        saturation_dn=saturation_dn / unit,
        missing_dn=None if missing_dn is None else missing_dn / unit,
        marks_borders_below_dn=darkest_dn if is_marked else None,
        remarks=(*depth_remarks, *shift_remarks, *saturation_remarks, *missing_remarks, *_unset_remarks(unset)),
    )


def _unset_remarks(unset: int) -> tuple[str, ...]:
    return (f"{unset} pixels are NaN or infinite, and are taken as missing",) if unset else ()


def _scale_of_wide(
    options: ImportOptions, levels: NDArray[np.int64], images: Sequence["SurveyedImage"], unset: int
) -> Scale:
    """Return the scale of sums, means and counts below 0, whose bits must be stated."""
    low, high = min(image.range_dn[0] for image in images), max(image.range_dn[1] for image in images)
    reads, bit_depth = max(image.reads for image in images), options.get("bit_depth")
    asked = "--bit-depth N, the bits of the camera" + (
        "" if reads > 1 else ", with --coadds N where files are sums of N reads, --averaged N where they are means"
    )
    if bit_depth is None:
        raise ConfigError(
            f"bit depth: counts{' of a read' if reads > 1 else ''} run from {low:g} to {high:g}; say {asked}"
        )
    if options.get("justified") == "left":
        raise ConfigError("--justified left: is for whole counts of 16 bits; divide the files, or leave it out")
    full_scale_dn = 2**bit_depth - 1
    if high > full_scale_dn:
        raise DataError(
            f"--bit-depth {bit_depth}: counts{' of a read' if reads > 1 else ''} reach {high:g}; say {asked}"
        )
    stated = options.get("saturation_dn") is not None
    saturation_dn, remarks = (
        _saturation(options, levels, full_scale_dn) if full_scale_dn < LEVELS or stated else (full_scale_dn, ())
    )
    in_part = "pixels that were saturated in some of the reads are not recognised: their means are too small"
    unit = images[0].unit
    missing_dn = _stated_missing_dn(options)
    if missing_dn is None and unset:
        missing_dn = _LOWEST_DN * unit
    return Scale(
        bit_depth=bit_depth,
        shift_bits=0,
        saturation_dn=saturation_dn / unit if stated else float(saturation_dn),
        missing_dn=None if missing_dn is None else missing_dn / unit,
        marks_borders_below_dn=None,
        remarks=(*remarks, *((in_part,) if reads > 1 else ()), *_unset_remarks(unset)),
    )


def _bit_depth(
    options: ImportOptions,
    levels: NDArray[np.int64],
    sample_bits: int,
    levels_by_file: Sequence[NDArray[np.int64]],
) -> tuple[int, tuple[str, ...]]:
    stated = options.get("bit_depth")
    if stated is not None:
        if stated > sample_bits:
            raise DataError(f"--bit-depth {stated}: samples in the files have only {sample_bits} bits")
        return stated, ()
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
            f"bit depth: samples of 16 bits with counts up to {largest(levels)} do not show how many the camera "
            "has; say --bit-depth N" + "".join(f" ({remark})" for remark in _some_left(levels_by_file))
        )
    return 16, (f"16 bits, since counts reach {largest(levels)}", *_some_left(levels_by_file))


def _some_left(levels_by_file: Sequence[NDArray[np.int64]]) -> tuple[str, ...]:
    """Return a remark if some files show unused bits and others do not, as resampled files would."""
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
    options: ImportOptions,
    levels: NDArray[np.int64],
    depth: int,
    sample_bits: int,
    levels_by_file: Sequence[NDArray[np.int64]],
) -> tuple[int, tuple[str, ...]]:
    resampled = _resampled(options, levels, depth, sample_bits, levels_by_file)
    if resampled is not None:
        return resampled
    spare, zero_bits, top = sample_bits - depth, common_zero_bits(levels), largest(levels)
    could_be_right = top < 2**depth
    # A few round numbers, as in a drawn test image, are not a sign of unused bits.
    is_telling = not could_be_right or int(np.count_nonzero(levels)) >= _TELLING_LEVELS
    could_be_left = spare > 0 and zero_bits >= spare and is_telling
    stated = options.get("justified")
    if not {"left": could_be_left, "right": could_be_right, None: could_be_left or could_be_right}[stated]:
        where = "at either end" if stated is None else f"at the {stated} end"
        raise DataError(
            f"--bit-depth {depth}: counts reach {top} and are multiples of {2**zero_bits}, which "
            f"{depth} bits {where} of {sample_bits} do not hold"
        )
    if could_be_left and could_be_right and stated is None:
        raise ConfigError(
            f"justification: counts reach {top} only and all are multiples of {2**zero_bits}, so that {depth} bits "
            f"may stand at either end of {sample_bits}; say --justified left or --justified right"
        )
    if could_be_left and stated != "right":
        return spare, (f"left-justified: {depth} bits in {sample_bits}; counts were divided by {2**spare}",)
    return 0, _unused_bits(zero_bits, sample_bits)


def _resampled(
    options: ImportOptions,
    levels: NDArray[np.int64],
    depth: int,
    sample_bits: int,
    levels_by_file: Sequence[NDArray[np.int64]],
) -> tuple[int, tuple[str, ...]] | None:
    """Return the shift of files that stand left, of which some were resampled and show it no more; None otherwise."""
    spare = sample_bits - depth
    plain = sum(common_zero_bits(own) >= spare for own in levels_by_file)
    if spare <= 0 or plain == len(levels_by_file) or options.get("justified") == "right":
        return None
    stated = options.get("justified") == "left"
    if largest(levels) < 2**depth or (plain == 0 and not stated):
        return None
    shown = f"{plain} of {len(levels_by_file)} files show it" if plain else "no file shows it, it was stated"
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


def _saturation(options: ImportOptions, levels: NDArray[np.int64], full_scale_dn: int) -> tuple[float, tuple[str, ...]]:
    stated = options.get("saturation_dn")
    if stated is not None:
        return stated, ()
    plateau = saturation_plateau(levels, full_scale_dn=full_scale_dn)
    if plateau is None:
        return float(full_scale_dn), ()
    found = f"{plateau.fraction:.1%} of the pixels are at the largest count, {plateau.value_dn}"
    if plateau.certain:
        return float(plateau.value_dn), (f"{found}, and are taken as saturated (--saturation-dn)",)
    return float(full_scale_dn), (f"{found}: if they are saturated, say --saturation-dn {plateau.value_dn}",)


def _missing(
    options: ImportOptions, levels: NDArray[np.int64], black_level_dn: float | None, borders: Sequence[Border]
) -> tuple[float | None, tuple[str, ...]]:
    if options.get("missing_dn") is not None:
        return _stated_missing_dn(options), ()
    if borders:
        widest = max(borders, key=lambda border: border.fraction)
        remark = (
            f"a constant border of {widest.value_dn} takes up to {widest.fraction:.2%} of a file, in {len(borders)} of "
            "them: its pixels are taken as missing (--no-border-search if they are not)"
        )
        return float(widest.value_dn), (remark,)
    block = missing_pixels(levels, black_level_dn=black_level_dn)
    if block is None:
        return None, ()
    found = f"{block.fraction:.1%} of the pixels are 0 and none lies between that and the darkest possible"
    if block.certain:
        return float(block.value_dn), (f"{found}: taken as missing (--missing-dn none if they are not)",)
    return None, (f"{found}: if they were not received, say --missing-dn 0",)


def _stated_missing_dn(options: ImportOptions) -> float | None:
    stated = options.get("missing_dn")
    return None if stated is None or stated == "none" else stated


def _unused(levels: NDArray[np.int64], shift_bits: int, saturation_dn: float) -> int:
    """Return a count that no pixel has once it is shifted: the largest below saturation, or else above."""
    taken = _in_place(np.flatnonzero(levels).astype(np.uint16), shift_bits)
    free = np.setdiff1d(np.arange(LEVELS >> shift_bits), taken)
    if free.size == 0:
        raise DataError("a border cannot be marked: every count occurs in the pictures; say --no-border-search")
    below = free[free < saturation_dn / 2**shift_bits]
    return int((below if below.size else free)[-1])


_FITS_TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?")


@dataclass(frozen=True, kw_only=True)
class SurveyedImage:
    """A picture, as far as it is known before anything is written."""

    file: ImageFile  #: Without its samples.
    number: int = 0  #: Of its file; pictures of a stack have the same.
    shape: tuple[int, int]  #: Its size.
    kind: FrameKind  #: Object before the camera.
    first_row: FirstRow = "top"  #: Which row comes first in the file, as it or the user says.
    levels: NDArray[np.int64] = field(repr=False)  #: Number of its pixels at each count.
    angle_deg: float | None = None  #: Of the polarizer's axis.
    stage_angle_deg: float | None = None  #: Readback of the polarizer's stage.
    exposure_s: float | None = None
    black_level_dn: float | None = None
    start_utc: str | None = None  #: Start of the exposure, where the header has it in standard form.
    border: Border | None = None  #: Constant pixels along its edges.
    is_jpeg: bool = False  #: Its blocks of 8 x 8 pixels show that it went through JPEG.
    reads: int = 1  #: Reads of the camera that it was made of.
    unit: int = 1  #: Divisor of its counts for those of one read: 1 unless it is a sum.
    range_dn: tuple[float, float] = (0.0, 0.0)  #: Least and largest count of one read.
    is_wide: bool = False  #: Its counts are not whole numbers of 16 bits.
    at_zero: int = 0  #: Pixels of the count 0.
    unset: int = 0  #: Pixels that are NaN or infinite.
    lit: tuple[slice, slice] | None = None  #: Rows and columns that see light, where the header says so.
    by_sections: tuple[str, ...] = ()  #: Consequences of keywords of sections.


def _at_angles(
    files: Sequence[Path],
    options: ImportOptions,
    images: list[SurveyedImage],
    remarks: list[str],
    *,
    is_whole: bool,
) -> list[SurveyedImage]:
    """Return the images with their angles, by the user, by headers or by names; note where from."""
    pictures = [(image.number, image.file.path, image.file.header) for image in images]

    def by(option: str, stated: Sequence[float | str] | None) -> Sequence[float | None]:
        if stated is None:
            return [None] * len(images)
        return headers.stated_angles(option, stated, pictures, files=len(files), is_whole=is_whole)

    key, stage_angles = options.get("angle_key"), options.get("stage_angles")
    axes = by("--angles", options.get("angles")) if key is None else by("--angle-key", [key])
    images = [
        replace(image, angle_deg=axis, stage_angle_deg=stage)
        for image, axis, stage in zip(images, axes, by("--stage-angles", stage_angles), strict=True)
    ]
    ways = (options.get("angles"), key, options.get("mosaic"), stage_angles)
    scenes = [image for image in images if image.kind == "scene"]
    if scenes and all(way is None for way in ways):
        angles, source = headers.angles_of([(one.file.path, one.file.header) for one in scenes])
        remarks.append(f"polarizer angles {source}: {', '.join(f'{one:g}' for one in dict.fromkeys(angles))} deg")
        left = iter(angles)
        images = [replace(one, angle_deg=next(left)) if one.kind == "scene" else one for one in images]
    return images


def _by_headers(options: ImportOptions, images: list[SurveyedImage], remarks: list[str]) -> list[SurveyedImage]:
    """Return the images with the exposures that all headers have; note what headers and names say."""
    kinds = Counter(image.kind for image in images)
    if options.get("kind") is None and kinds.keys() - {"scene"}:
        remarks.append(f"by headers or names: {', '.join(f'{number} {kind}' for kind, number in kinds.items())} frames")
    summed = {image.reads: image for image in images if image.reads > 1}
    if summed and options.get("coadds") is None and options.get("averaged") is None:
        how = {reads: headers.reads_of(image.file.header)[1:] for reads, image in summed.items()}
        words = "; ".join(
            f"{reads} reads by {key}, as their {'sum' if is_sum else 'mean'}" for reads, (is_sum, key) in how.items()
        )
        remarks.append(f"files are of {words} (--coadds N or --averaged N if that is wrong)")
    if summed:
        remarks.append("counts and exposure are those of one read")
    remarks += dict.fromkeys(text for image in images for text in image.by_sections)
    ways = (options.get("exposure_s"), options.get("exposure_key"), options.get("same_exposure") or None)
    if all(way is None for way in ways):
        key = headers.key_of_all(headers.EXPOSURE_KEYS, [image.file.header for image in images])
        if key is not None:
            remarks.append(f"exposure by the header keyword {key} [s]")
            images = [replace(image, exposure_s=float(image.file.header[key])) for image in images]
    return images


def _survey(options: ImportOptions, number: int, image: ImageFile) -> SurveyedImage:
    reads, is_sum, _ = headers.reads_of(image.header)
    coadds, averaged = options.get("coadds"), options.get("averaged")
    if coadds is not None or averaged is not None:
        reads, is_sum = coadds or averaged or 1, coadds is not None
    unit = reads if is_sum else 1
    lit, overscan, key = headers.sections_of(image.header, image.counts.shape)
    whole = np.s_[:, :]
    samples, unset = image.counts[lit or whole], None if image.unset is None else image.unset[lit or whole]
    counts: NDArray[Any] = samples / unit if unit > 1 else samples
    good = counts if unset is None else counts[~unset]
    black_level_dn = _number(
        image.header, "--black-level-key", options.get("black_level_key"), options.get("black_level_dn")
    )
    by_sections = () if lit is None else (f"pictures are cut to {key}",)
    if black_level_dn is None and not options.get("black_level_from_darks") and overscan is not None:
        strip = image.counts[overscan] if image.unset is None else image.counts[overscan][~image.unset[overscan]]
        black_level_dn = float(strip.mean()) if strip.size else None
        by_sections = (*by_sections, "the black level is the mean of the overscan, BIASSEC")
    is_wide = counts.dtype != np.uint16
    return SurveyedImage(
        file=replace(image, counts=np.empty(0), unset=None),
        number=number,
        shape=(counts.shape[0], counts.shape[1]),
        kind=options.get("kind") or headers.kind_of(image.header, name_of(image.path)) or "scene",
        first_row=_first_row(options, image),
        exposure_s=_number(image.header, "--exposure-key", options.get("exposure_key"), options.get("exposure_s")),
        black_level_dn=None if black_level_dn is None else black_level_dn / unit,
        start_utc=_start(image.header),
        levels=histogram(good),
        border=None if options.get("no_border_search") or is_wide else constant_border(counts),
        is_jpeg=not is_wide and (traces := jpeg_traces(counts)) is not None and traces.is_found,
        reads=reads,
        unit=unit,
        range_dn=(float(good.min()), float(good.max())),
        is_wide=is_wide,
        at_zero=int(np.count_nonzero(good == 0)),
        unset=0 if unset is None else int(np.count_nonzero(unset)),
        lit=lit,
        by_sections=by_sections,
    )


def _first_row(options: ImportOptions, image: ImageFile) -> FirstRow:
    stated = options.get("first_row")
    if stated is not None and stated != image.first_row and image.first_row_stated:
        raise ConfigError(f"--first-row {stated}: the file itself says {image.first_row}")
    return stated or image.first_row


def _number(header: headers.Header, option: str, key: str | None, given: float | None) -> float | None:
    if key is None:
        return given
    value = headers.value_of(header, option, key)
    if isinstance(value, bool) or not isinstance(value, int | float) or value < 0:
        raise ConfigError(f"{option} {key}: {value!r} is not a number of 0 or more")
    return float(value)


def _start(header: headers.Header) -> str | None:
    text = str(header.get("DATE-OBS", ""))
    is_utc = str(header.get("TIMESYS", "UTC")).strip().upper() == "UTC"
    return f"{text}Z" if is_utc and _FITS_TIME.fullmatch(text) and is_utc_text(text) else None


def _size_problems(options: ImportOptions, images: list[SurveyedImage]) -> list[str]:
    problems = []
    for image in images:
        if image.shape != images[0].shape:
            problems.append(
                f"{image.file.path}: {_size(image)} pixels, but {images[0].file.path} has {_size(images[0])}"
            )
        if options.get("mosaic") is not None and (image.shape[0] % 2 or image.shape[1] % 2):
            problems.append(f"{image.file.path}: {_size(image)} pixels cannot be cut into cells of 2 x 2 (--mosaic)")
    return problems


def _size(image: SurveyedImage) -> str:
    return f"{image.shape[1]} x {image.shape[0]}"


_SAME_AXIS_DEG = 180.0
# Kind of frames, and the angle whose repeats are cycles.
Place = tuple[FrameKind, Literal["polarizer", "stage"], float] | None


def axis_deg(angle_deg: float) -> float:
    """Return the angle of a transmission axis in [0, 180) [deg]: turned by half a circle it is the same axis."""
    return round(angle_deg % _SAME_AXIS_DEG, 6) % _SAME_AXIS_DEG


def _frames(
    files: Sequence[Path],
    options: ImportOptions,
    images: Sequence[SurveyedImage],
    scale: Scale,
    *,
    first_sequence: int,
    present: Iterable[FrameRecord],
) -> Iterator[tuple[FrameRecord, NDArray[Any]]]:
    """Return the frames of all pictures one by one, each file read when it is its turn."""
    cycles = Counter(_place(record) for record in present)
    sequence = first_sequence
    pictures = (picture for path in files for picture in _read(path, options))
    for image, picture in zip(images, pictures, strict=True):
        record = _record(image, scale)
        for angle_deg, counts, border in _parts(options, image, picture, scale):
            placed = replace(_at_angle(record, angle_deg, cycles), sequence=sequence)
            shifted = (
                np.asarray(counts / image.unit, dtype=np.float32)
                if image.is_wide
                else _in_place(counts, scale.shift_bits)
            )
            if border is not None and scale.missing_dn is not None:
                shifted = np.where(border, shifted.dtype.type(scale.missing_dn), shifted)
            yield placed, shifted
            sequence += 1


def _in_place(counts: NDArray[np.uint16], shift_bits: int) -> NDArray[np.uint16]:
    """Return counts divided by a power of two and rounded; those of a camera are multiples of it."""
    if not shift_bits:
        return counts
    half = np.uint32(1) << np.uint32(shift_bits - 1)
    largest = np.uint32(65535) >> np.uint32(shift_bits)
    rounded = (counts.astype(np.uint32) + half) >> np.uint32(shift_bits)
    return np.asarray(np.minimum(rounded, largest), dtype=np.uint16)


def _at_angle(record: FrameRecord, angle_deg: float | None, cycles: Counter[Place]) -> FrameRecord:
    record = replace(record, polarizer_angle_target_deg=angle_deg, polarizer_angle_deg=angle_deg)
    place = _place(record)
    if place is None:
        return record
    cycles[place] += 1
    return replace(record, cycle=cycles[place] - 1)


def _place(record: FrameRecord) -> Place:
    """Return the angle whose repeats are counted as cycles: of the polarizer, else of the stage."""
    if record.polarizer_angle_deg is not None:
        return record.kind, "polarizer", axis_deg(record.polarizer_angle_deg)
    return None if record.stage_angle_deg is None else (record.kind, "stage", round(record.stage_angle_deg % 360.0, 6))


def _parts(
    options: ImportOptions, image: SurveyedImage, file: ImageFile, scale: Scale
) -> Iterator[tuple[float | None, NDArray[Any], NDArray[np.bool_] | None]]:
    """Yield angle, counts, and which pixels have to be marked as missing: of a border, or without a number."""
    part, rows = image.lit or np.s_[:, :], slice(None, None, 1 if image.first_row == "top" else -1)
    upright = file.counts[part][rows]
    below_dn, border = scale.marks_borders_below_dn, None if file.unset is None else file.unset[part][rows]
    if below_dn is not None and image.border is not None and image.border.value_dn < below_dn:
        of_border = border_pixels(upright, image.border.value_dn)
        border = of_border if border is None else border | of_border
    mosaic = options.get("mosaic")
    if mosaic is None:
        yield image.angle_deg, upright, border
        return
    for index, angle_deg in enumerate(mosaic):
        cell = np.s_[index // 2 :: 2, index % 2 :: 2]
        yield angle_deg, upright[cell], None if border is None else border[cell]


def _record(image: SurveyedImage, scale: Scale) -> FrameRecord:
    black_level_dn = image.black_level_dn
    return FrameRecord(
        kind=image.kind,
        sequence=0,
        bit_depth=scale.bit_depth,
        saturation_dn=scale.saturation_dn,
        missing_dn=scale.missing_dn,
        exposure_s=image.exposure_s,
        stage_angle_deg=image.stage_angle_deg,
        reads=image.reads if image.reads > 1 else None,
        real_counts=image.is_wide or None,
        camera_temperature_c=headers.temperature_c(image.file.header),
        black_level_dn=None if black_level_dn is None else black_level_dn / 2**scale.shift_bits,
        start_utc=image.start_utc,
        source_file=str(image.file.path),
        **headers.origin_of(image.file.header),
        remarks=(
            *image.file.remarks,
            *(() if image.first_row == "top" else ("turned: the file has its bottom row first",)),
            *((_JPEG,) if image.is_jpeg else ()),
            *scale.remarks,
        ),
    )
