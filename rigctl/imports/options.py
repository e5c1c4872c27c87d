"""Options of `rigctl import`; those of `PictureOptions` are also options of `rigctl look`."""

from collections.abc import Sequence
from typing import Annotated, Literal, TypedDict

from drivers.cameras.raw_planes import Plane
from rigctl.files.choices import COMMA_SEPARATED, FrameKind, MaxFrameMb


class PictureOptions(TypedDict, total=False):
    """Reading of pictures, and their polarizer angles.

    Parameters
    ----------
    angles : sequence of float, or str
        Polarizer angle of each file, or of each picture of stacks [deg], such as 0,60,-60, or a CSV table with the
        columns file and angle_deg; default: from headers or file names.
    mosaic : sequence of float
        Angles of the 2 x 2 cell at the top left, row by row [deg].
    first_row : {"top", "bottom"}
        First row in the files; default for FITS: bottom, unless ROWORDER says otherwise.
    plane : {"red", "green-1", "green-2", "blue", "green", "sum", "all"}
        Colour to take from colour images and RAW files; green-1 is the green in the rows of red.
    max_frame_mb : int
        Largest file of pictures that is read [MB of samples]; default: 268.
    """

    angles: Annotated[Sequence[float | str] | None, COMMA_SEPARATED]
    mosaic: Annotated[Sequence[float] | None, COMMA_SEPARATED]
    first_row: Literal["top", "bottom"] | None
    plane: Plane | None
    max_frame_mb: MaxFrameMb


class ImportOptions(PictureOptions, total=False):
    """Facts about pictures that become frames of a run.

    Parameters
    ----------
    angle_key : str
        Header keyword with the angle [deg].
    stage_angles : sequence of float, or str
        Stage angles of a polarizer scan [deg]: 0,10,20, a header keyword, or a CSV table (columns file,
        stage_angle_deg).
    kind : {"scene", "dark", "flat"}
        Kind of frames; default: from headers or file names, otherwise scene.
    exposure_s : float
        Exposure of every file [s].
    exposure_key : str
        Header keyword with the exposure [s]; default: EXPTIME if all files have it.
    same_exposure : bool
        All files have the same exposure, of unknown length.
    black_level_dn : float
        Counts without light [DN as in the files]; default: mean of the overscan if headers have BIASSEC.
    black_level_key : str
        Header keyword with the black level [DN].
    black_level_from_darks : bool
        Take the black level from dark frames that are imported too.
    bit_depth : int
        Bits per sample of the camera, 1 to 32.
    coadds : int
        Number of reads that each file is the sum of; default: COADDS of the header.
    averaged : int
        Number of reads that each file is the mean of; default: NCOMBINE of the header.
    justified : {"left", "right"}
        Position of these bits in a 16-bit sample, if the counts do not show it.
    saturation_dn : float
        Count from which a pixel is saturated [DN as in the files].
    missing_dn : float or "none"
        Value of missing pixels [DN as in the files], or none. NaN and infinite values are always missing.
    no_border_search : bool
        Do not look for constant pixels along the edges.
    """

    angle_key: str | None
    stage_angles: Annotated[Sequence[float | str] | None, COMMA_SEPARATED]
    kind: FrameKind | None
    exposure_s: float | None
    exposure_key: str | None
    same_exposure: bool
    black_level_dn: float | None
    black_level_key: str | None
    black_level_from_darks: bool
    bit_depth: int | None
    coadds: int | None
    averaged: int | None
    justified: Literal["left", "right"] | None
    saturation_dn: float | None
    missing_dn: float | Literal["none"] | None
    no_border_search: bool
