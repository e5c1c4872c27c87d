"""The frames that surveyed images become: upright, cut into channels, with their bits in place."""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigctl.images.image_file import read_image
from rigctl.imports.image_scale import Scale
from rigctl.imports.image_survey import SurveyedImage
from rigctl.imports.import_request import ImportRequest
from rigctl.runs.frame_record import FrameRecord

_SAME_AXIS_DEG = 180.0
JPEG = "blocks of 8 x 8 pixels show that JPEG was at work, which changes counts: noise and edges are not the camera's"


def axis_deg(angle_deg: float) -> float:
    """Return the angle of a transmission axis in [0, 180) [deg]: turned by half a circle it is the same axis."""
    return round(angle_deg % _SAME_AXIS_DEG, 6) % _SAME_AXIS_DEG


def frames_of(
    request: ImportRequest,
    images: Iterable[SurveyedImage],
    scale: Scale,
    *,
    first_sequence: int,
    present: Iterable[FrameRecord],
) -> Iterator[tuple[FrameRecord, NDArray[np.uint16]]]:
    """Return the frames of all files one by one, each file read when it is its turn.

    Parameters
    ----------
    request : ImportRequest
        What the user says.
    images : iterable of SurveyedImage
        The files, in order.
    scale : Scale
        What their counts mean.
    first_sequence : int
        Sequence number of the first frame.
    present : iterable of FrameRecord
        Frames that the run holds already; cycles are counted on from theirs.
    """
    cycles = Counter(
        axis_deg(record.polarizer_angle_deg)
        for record in present
        if record.kind == request.kind and record.polarizer_angle_deg is not None
    )
    sequence = first_sequence
    for image in images:
        record = _record(request, image, scale)
        for angle_deg, counts in _pictures(request, image):
            placed = replace(_at_angle(record, angle_deg, cycles), sequence=sequence)
            yield placed, _in_place(counts, scale.shift_bits)
            sequence += 1


def _in_place(counts: NDArray[np.uint16], shift_bits: int) -> NDArray[np.uint16]:
    """Return counts divided by a power of two and rounded; those of a camera are multiples of it."""
    if not shift_bits:
        return counts
    half = np.uint32(1) << np.uint32(shift_bits - 1)
    largest = np.uint32(65535) >> np.uint32(shift_bits)
    rounded = (counts.astype(np.uint32) + half) >> np.uint32(shift_bits)
    return np.asarray(np.minimum(rounded, largest), dtype=np.uint16)


def _at_angle(record: FrameRecord, angle_deg: float | None, cycles: Counter[float]) -> FrameRecord:
    if angle_deg is None:
        return record
    cycle = cycles[axis_deg(angle_deg)]
    cycles[axis_deg(angle_deg)] += 1
    return replace(record, cycle=cycle, polarizer_angle_target_deg=angle_deg, polarizer_angle_deg=angle_deg)


def _pictures(request: ImportRequest, image: SurveyedImage) -> Iterator[tuple[float | None, NDArray[np.uint16]]]:
    counts = read_image(image.path, plane=request.plane, most_bytes=request.most_bytes).counts
    upright = counts if image.first_row == "top" else counts[::-1]
    if request.mosaic_deg is None:
        yield image.angle_deg, upright
        return
    for index, angle_deg in enumerate(request.mosaic_deg):
        row, column = divmod(index, 2)
        yield angle_deg, upright[row::2, column::2]


def _record(request: ImportRequest, image: SurveyedImage, scale: Scale) -> FrameRecord:
    black_level_dn = image.black_level_dn
    return FrameRecord(
        kind=request.kind,
        sequence=0,
        bit_depth=scale.bit_depth,
        saturation_dn=scale.saturation_dn,
        missing_dn=scale.missing_dn,
        exposure_s=image.exposure_s,
        black_level_dn=None if black_level_dn is None else black_level_dn / 2**scale.shift_bits,
        start_utc=image.start_utc,
        source_file=str(image.path),
        remarks=(*image.remarks, *_row_remarks(image), *_coding_remarks(image), *scale.remarks),
    )


def _coding_remarks(image: SurveyedImage) -> tuple[str, ...]:
    return (JPEG,) if image.is_jpeg else ()


def _row_remarks(image: SurveyedImage) -> tuple[str, ...]:
    return () if image.first_row == "top" else ("turned: the file has its bottom row first",)
