"""A request to make a run of images: all that the user says of them, and what is still to be said."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Literal

from drivers.cameras.raw_planes import Plane
from rigctl.files.choices import FrameKind
from rigctl.images.image_file import FirstRow
from rigctl.storage.bounded_file import MOST_FRAME_BYTES

Justified = Literal["left", "right"]


@dataclass(frozen=True, kw_only=True)
class ImportRequest:
    """What the options of `rigctl import` state of images; None is not stated."""

    run: Path
    files: tuple[Path, ...]  #: in the order in which they were taken
    kind: FrameKind
    angles_deg: tuple[float, ...] | None = None
    angle_key: str | None = None
    mosaic_deg: tuple[float, ...] | None = None  #: of the cell of 2 x 2 pixels at the top left, row by row
    exposure_s: float | None = None
    exposure_key: str | None = None
    same_exposure: bool = False
    black_level_dn: float | None = None
    black_level_key: str | None = None
    black_level_from_darks: bool = False
    bit_depth: int | None = None
    justified: Justified | None = None
    saturation_dn: float | None = None
    missing_dn: float | None = None
    none_missing: bool = False
    no_border_search: bool = False
    first_row: FirstRow | None = None
    plane: Plane | None = None
    most_bytes: int = MOST_FRAME_BYTES


def request_problems(request: ImportRequest, *, darks_are_there: bool) -> list[str]:
    """Return what is contradictory, out of range or missing, each with its option.

    `darks_are_there`: the run has dark frames already, which give the black level.
    """
    return [
        *_angle_problems(request),
        *_exposure_problems(request),
        *_black_level_problems(request, darks_are_there=darks_are_there),
        *_range_problems(request),
    ]


def _angle_problems(request: ImportRequest) -> Iterator[str]:
    ways = [request.angles_deg, request.angle_key, request.mosaic_deg]
    said = sum(way is not None for way in ways)
    if said > 1:
        yield "--angles, --angle-key, --mosaic: give one of them"
    if said == 0 and request.kind == "scene":
        yield "angles of the polarizer: say --angles 0,45,..., --angle-key KEY or --mosaic A,B,C,D"
    if request.angles_deg is not None and len(request.angles_deg) != len(request.files):
        yield f"--angles: {len(request.angles_deg)} angles for {len(request.files)} files; give one for each file"
    if request.mosaic_deg is not None and len(request.mosaic_deg) != 4:
        yield f"--mosaic: {len(request.mosaic_deg)} angles; a cell of 2 x 2 pixels has 4, row by row"


def _exposure_problems(request: ImportRequest) -> Iterator[str]:
    ways = (request.exposure_s is not None, request.exposure_key is not None, request.same_exposure)
    if sum(ways) > 1:
        yield "--exposure-s, --exposure-key, --same-exposure: give one of them"
    if not any(ways) and len(request.files) > 1:
        yield (
            "exposure: say --exposure-s X, --exposure-key KEY, or --same-exposure where it is not known but was "
            "the same for all files"
        )


def _black_level_problems(request: ImportRequest, *, darks_are_there: bool) -> Iterator[str]:
    ways = (
        request.black_level_dn is not None,
        request.black_level_key is not None,
        request.black_level_from_darks,
    )
    if sum(ways) > 1:
        yield "--black-level-dn, --black-level-key, --black-level-from-darks: give one of them"
    if not any(ways) and request.kind == "scene" and not darks_are_there:
        yield (
            "black level: say --black-level-dn X, --black-level-key KEY, or --black-level-from-darks where dark "
            "frames of this run will tell it"
        )


def _range_problems(request: ImportRequest) -> Iterator[str]:
    angles = {"--angles": request.angles_deg, "--mosaic": request.mosaic_deg}
    for option, values in angles.items():
        if not all(isfinite(value) for value in values or ()):
            yield f"{option}: every angle must be a finite number of degrees"
    if request.exposure_s is not None and not 0 < request.exposure_s < float("inf"):
        yield f"--exposure-s: is {request.exposure_s:g}, must be above 0"
    counts = {
        "--black-level-dn": request.black_level_dn,
        "--saturation-dn": request.saturation_dn,
        "--missing-dn": request.missing_dn,
    }
    for option, value in counts.items():
        if value is not None and not 0 <= value <= 65535:
            yield f"{option}: is {value:g}, must lie between 0 and 65535"
    if request.bit_depth is not None and not 1 <= request.bit_depth <= 16:
        yield f"--bit-depth: is {request.bit_depth}, must lie between 1 and 16"
