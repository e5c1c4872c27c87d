"""`rigctl look`: S0, DoLP and AoLP of a few images, without calibration."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from drivers.cameras.raw_planes import Plane
from rigctl.base.durable import MOST_FRAME_MB
from rigctl.console import Json, note
from rigctl.errors import ConfigError, DataError
from rigctl.verbs.options import COMMA_SEPARATED, FilePath, MaxFrameMb, Part, Result, Writes

if TYPE_CHECKING:
    from rigctl.images import ImageFile
    from rigctl.measure.measure import PolarizationImages

_BYTES_PER_MB = 1_000_000
_LEAST_ANGLES = 3
_LABEL = "uncalibrated"


def look(
    files: Sequence[FilePath],
    /,
    *,
    angles: Annotated[Sequence[float] | None, COMMA_SEPARATED] = None,
    mosaic: Annotated[Sequence[float] | None, COMMA_SEPARATED] = None,
    first_row: Literal["top", "bottom"] | None = None,
    plane: Plane | None = None,
    max_frame_mb: MaxFrameMb = MOST_FRAME_MB,
    out: Annotated[FilePath, Writes()] = Path("look.png"),
) -> "LookResult":
    """Show S0, DoLP and AoLP maps of a few images, without exposure or black level.

    Angles come from the headers or the names of the files (panel_0.png, panel_45deg.png, ...), or are given. Images of
    one angle are averaged. The maps are not calibrated: the black level is not subtracted, which makes DoLP too small.
    For numbers, make a run from the images (rigctl import) and measure it (rigctl stokes).

    Example: rigctl look panel_0.png panel_45.png panel_90.png panel_135.png

    Example: rigctl look fruits.png --mosaic 90,45,135,0

    Parameters
    ----------
    files : sequence of path
        FITS, PNG, TIFF or camera RAW images, folders of them, arrays in HDF5 and NetCDF files (scan.h5:/entry/data).
    angles : sequence of float
        Polarizer angle of each file [deg], as in 0,45,90,135.
    mosaic : sequence of float
        Angles of the 2 x 2 cell at the top left, row by row [deg].
    first_row : {"top", "bottom"}
        First row in the files; default for FITS: bottom, unless ROWORDER says otherwise.
    plane : {"red", "green-1", "green-2", "blue", "green", "sum", "all"}
        Colour to take from RAW files; green-1 is the green in the rows of red.
    max_frame_mb : int
        Largest picture that is read [MB of samples].
    out : path
        Picture to write.
    """
    import numpy as np

    from model.processing.reconstruction import design
    from rigctl.base.durable import write_durably
    from rigctl.images import image_files, name_of
    from rigctl.imports.headers import angles_of
    from rigctl.imports.levels import histogram, saturation_plateau
    from rigctl.measure.measure import polarization_images
    from rigctl.report.measurement import uncalibrated_pictures

    paths = image_files([Path(file) for file in files])
    if angles is not None and mosaic is not None:
        raise ConfigError("--angles, --mosaic: give one of them")
    if mosaic is not None and len(mosaic) != 4:
        raise ConfigError(f"--mosaic: {len(mosaic)} angles; a cell of 2 x 2 pixels has 4, row by row")
    if angles is not None and len(angles) != len(paths):
        raise ConfigError(f"--angles: {len(angles)} angles for {len(paths)} files; give one for each file")
    images = _read(paths, plane, max_frame_mb * _BYTES_PER_MB)
    pictures = [
        image.counts if image.unset is None else np.where(image.unset, np.nan, image.counts) for image in images
    ]
    is_top = [(first_row or image.first_row) == "top" for image in images]
    rows = [picture if top else picture[::-1] for picture, top in zip(pictures, is_top, strict=True)]
    if mosaic is not None:
        found, source = tuple(mosaic) * len(rows), "as given"
        height, width = (side - side % 2 for side in rows[0].shape)
        rows = [row[k // 2 : height : 2, k % 2 : width : 2] for row in rows for k in range(4)]
    elif angles is not None:
        found, source = tuple(angles), "as given"
    else:
        found, source = angles_of([name_of(path) for path in paths], [image.header for image in images])
    at = np.round(np.mod(found, 180.0), 6) % 180.0
    distinct = np.unique(at)
    if distinct.size < _LEAST_ANGLES:
        there = ", ".join(f"{angle:g}" for angle in distinct)
        raise ConfigError(
            f"Stokes parameters need three angles that differ modulo 180 deg; there are {there} deg, {source}: say "
            "--angles 0,45,... or --mosaic A,B,C,D"
        )
    counts = np.stack(rows)
    channels = np.stack([counts[at == angle].mean(axis=0, dtype=np.float64) for angle in distinct])
    unset = np.isnan(channels).any(axis=0)
    largest = 2 ** max(int(max(np.nanmax(counts), 0)).bit_length(), 8) - 1
    plateau = saturation_plateau(histogram(counts), full_scale_dn=largest)
    largest = plateau.value_dn if plateau is not None and plateau.certain else largest
    clipped = np.any(counts >= largest, axis=0)
    plan = design(np.radians(distinct))
    maps = polarization_images(plan, np.where(unset, 0.0, channels), unusable=clipped | unset)
    result = LookResult(
        maps=maps,
        angles_deg={} if mosaic is not None else dict(zip(map(str, paths), found, strict=True)),
        angle_source=source,
        files=tuple(paths),
        clipped_shares=(float(clipped.mean()), float(np.any(counts == 0, axis=0).mean())),
        largest_dn=largest,
    )
    write_durably(Path(out), uncalibrated_pictures(maps))
    note(
        f"{out}: S0, DoLP and AoLP, {_LABEL}: dark level, exposure and response are not taken into account", below=True
    )
    note("measured: rigctl import RUN FILES --same-exposure --black-level-dn X --stokes FOLDER", below=True)
    return result


@dataclass(frozen=True, kw_only=True, eq=False)
class LookResult(Result):
    """Uncalibrated maps of a few images."""

    maps: "PolarizationImages"
    angles_deg: dict[str, float]  #: angle of each file; empty for mosaics
    angle_source: str  #: source of the angles
    files: tuple[Path, ...]
    clipped_shares: tuple[float, float]  #: shares of the pixels at the upper end of the range and at 0 in any image
    largest_dn: int  #: assumed upper end of the range

    @property
    def _quartiles(self) -> dict[str, float]:
        import numpy as np

        good = self.maps.dolp[np.isfinite(self.maps.dolp)]
        levels = (5, 50, 95)
        values = np.percentile(good, levels) if good.size else np.full(len(levels), np.nan)
        return {f"p{level}": float(value) for level, value in zip(levels, values, strict=True)}

    def content(self) -> Iterable[Part]:
        """Return the DoLP of the pixels, clipped shares, the angles, and a warning that nothing is calibrated."""
        from rigctl.base.numbers import percent
        from rigctl.images import name_of
        from rigctl.report.measurement import uncalibrated_pictures

        low, middle, high = self._quartiles.values()
        yield f"DoLP {middle:.3f} (median; 90 % of the pixels {low:.3f} to {high:.3f}), {_LABEL}"
        top, bottom = map(percent, self.clipped_shares)
        yield f"clipped in one image or more: {top} of the pixels at {self.largest_dn} DN, {bottom} at 0"
        named = "; ".join(f"{name_of(Path(file))} {angle:g}" for file, angle in self.angles_deg.items())
        yield f"angles {self.angle_source}" + (f" [deg]: {named}" if named else "")
        yield lambda: uncalibrated_pictures(self.maps)

    def as_json(self) -> dict[str, Json]:
        """Return percentiles of DoLP, clipped shares and angles."""
        from rigctl.base.numbers import finite

        high, low = self.clipped_shares
        return {
            "calibrated": False,
            "dolp": {name: finite(value) for name, value in self._quartiles.items()},
            "clipped": {"high": high, "low": low, "largest_dn": self.largest_dn},
            "angles_deg": dict(self.angles_deg),
            "angle_source": self.angle_source,
            "files": [str(file) for file in self.files],
        }


def _read(paths: Sequence[Path], plane: Plane | None, most_bytes: int) -> "list[ImageFile]":
    """Return the images; raise an error if their sizes differ."""
    from rigctl.images import read_image

    images: list[ImageFile] = []
    for path in paths:
        try:
            images.append(read_image(path, plane=plane, most_bytes=most_bytes))
        except (ConfigError, DataError) as error:
            raise type(error)(f"{path}: {error}") from error
        if images[-1].counts.shape != images[0].counts.shape:
            sizes = " and ".join(f"{one.counts.shape[1]} x {one.counts.shape[0]}" for one in (images[0], images[-1]))
            raise DataError(f"{paths[0]} and {path} have {sizes} pixels; one size is needed")
    return images
