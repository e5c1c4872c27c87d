"""A still camera's RAW file as an image to import, and whether the files of a stack were taken alike."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from drivers.cameras.raw_files import RawPicture, read_raw
from drivers.cameras.raw_planes import Plane
from drivers.errors import LimitError, ProtocolError
from rigctl.errors import ConfigError, DataError

# Of a header: FITS cards, and what a RAW file tells of itself.
HeaderValue = str | float | bool
EXPOSURE, ISO, BLACK, WHITE = "EXPTIME", "ISO", "BLACK", "WHITE"
# Cameras round the exposure that they write; a third of a stop is 26 %.
_EXPOSURE_TOLERANCE = 0.02


@dataclass(frozen=True, kw_only=True)
class RawSettings:
    """Settings of a still camera, as its file tells; None where it does not."""

    exposure_s: float | None
    iso: float | None
    flip: int


def raw_picture(path: Path, *, plane: Plane | None) -> RawPicture:
    """Return a RAW file's picture.

    Raises
    ------
    ConfigError
        ``--plane`` has to be said, or does not fit.
    DataError
        The file is damaged or no RAW file.
    """
    try:
        return read_raw(path, plane=plane)
    except LimitError as error:
        raise ConfigError(f"--plane: {_without_path(path, error)}") from error
    except ProtocolError as error:
        raise DataError(_without_path(path, error)) from error


def raw_header(picture: RawPicture) -> dict[str, HeaderValue]:
    """Return what a RAW file tells, under names that ``--exposure-key`` and ``--black-level-key`` can ask for."""
    told: dict[str, HeaderValue | None] = {
        EXPOSURE: picture.exposure_s,
        ISO: picture.iso,
        BLACK: picture.black_level_dn,
        WHITE: picture.white_level_dn,
    }
    return {name: value for name, value in told.items() if value is not None}


def raw_settings(picture: RawPicture) -> RawSettings:
    """Return how the camera was set."""
    return RawSettings(exposure_s=picture.exposure_s, iso=picture.iso, flip=picture.flip)


def unlike_settings(stack: Sequence[tuple[Path, RawSettings]], *, same_exposure: bool) -> list[str]:
    """Return what differs between the first file of a stack and the others, and must not.

    Parameters
    ----------
    stack : sequence of (path, settings)
        The RAW files.
    same_exposure : bool
        The user says that all exposures are alike.
    """
    problems = []
    for path, settings in stack[1:]:
        first_path, first = stack[0]
        if settings.iso != first.iso:
            problems.append(f"{path}: ISO {settings.iso}, but {first_path} has {first.iso}: one gain for all is needed")
        if settings.flip != first.flip:
            problems.append(f"{path}: the camera was held another way than for {first_path}")
        if same_exposure and not _alike(settings.exposure_s, first.exposure_s):
            problems.append(
                f"{path}: exposed {settings.exposure_s} s and {first_path} {first.exposure_s} s: not --same-exposure, "
                f"but --exposure-key {EXPOSURE}"
            )
    return problems


def _alike(one_s: float | None, other_s: float | None) -> bool:
    if one_s is None or other_s is None:
        return one_s == other_s
    return abs(one_s - other_s) <= _EXPOSURE_TOLERANCE * other_s


def _without_path(path: Path, error: Exception) -> str:
    return str(error).removeprefix(f"{path}: ")
