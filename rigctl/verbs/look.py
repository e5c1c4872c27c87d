"""`rigctl look`: S0, DoLP and AoLP of a few images, without calibration."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Unpack

from rigctl.base.durable import MOST_FRAME_MB
from rigctl.console import Json, note, warn
from rigctl.errors import ConfigError, DataError
from rigctl.imports.options import PictureOptions
from rigctl.verbs.options import FilePath, Part, Result, Writes

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
    out: Annotated[FilePath, Writes()] = Path("look.png"),
    **options: Unpack[PictureOptions],
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
        FITS, PNG, TIFF, JPEG or camera RAW images, folders of them, arrays in HDF5 and NetCDF files
        (scan.h5:/entry/data). Each picture of a stack counts.
    out : path
        Picture to write.
    **options
        Angles, and how the files are read, see `PictureOptions`.
    """
    import numpy as np

    from model.processing.reconstruction import design
    from rigctl.base.durable import write_durably
    from rigctl.images import image_files
    from rigctl.imports.headers import angles_of, stated_angles
    from rigctl.imports.levels import histogram, saturation_plateau
    from rigctl.measure.measure import polarization_images
    from rigctl.report.measurement import uncalibrated_pictures

    paths = image_files([Path(file) for file in files])
    angles, mosaic, first_row = options.get("angles"), options.get("mosaic"), options.get("first_row")
    if angles is not None and mosaic is not None:
        raise ConfigError("--angles, --mosaic: give one of them")
    if mosaic is not None and len(mosaic) != 4:
        raise ConfigError(f"--mosaic: {len(mosaic)} angles; a cell of 2 x 2 pixels has 4, row by row")
    pictures = _read(paths, options)
    images = [image for _, image in pictures]
    lossy = [str(image.path) for image in images if image.is_lossy]
    if lossy:
        warn(
            f"{len(lossy)} of {len(images)} images are JPEG ({lossy[0]}): a tone curve changes DoLP, compression its "
            "edges; rigctl import takes raw frames only"
        )
    rows = [image.counts if (first_row or image.first_row) == "top" else image.counts[::-1] for image in images]
    if mosaic is not None:
        found, source = tuple(mosaic) * len(rows), "as given"
        height, width = (side - side % 2 for side in rows[0].shape)
        rows = [row[k // 2 : height : 2, k % 2 : width : 2] for row in rows for k in range(4)]
    elif angles is not None:
        named = [(number, image.path, image.header) for number, image in pictures]
        found, source = stated_angles("--angles", angles, named, files=len(paths)), "as given"
    else:
        found, source = angles_of([(image.path, image.header) for image in images])
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
    names = [str(image.path) for image in images]
    result = LookResult(
        maps=maps,
        angles_deg={} if mosaic is not None else dict(zip(names, found, strict=True)),
        angle_source=source,
        files=tuple(image.path for image in images),
        clipped_shares=(float(clipped.mean()), float(np.any(counts == 0, axis=0).mean())),
        largest_dn=largest,
    )
    write_durably(Path(out), uncalibrated_pictures(maps))
    note(
        f"{out}: S0, DoLP and AoLP, {_LABEL}: dark level, exposure and response are not taken into account", below=True
    )
    if not lossy:
        bits = "" if images[0].sample_bits == 8 else " --bit-depth N"
        note(f"measured: rigctl import RUN FILES --same-exposure --black-level-dn X{bits} --stokes FOLDER", below=True)
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


def _read(paths: Sequence[Path], options: PictureOptions) -> "list[tuple[int, ImageFile]]":
    """Return the images with the numbers of their files, missing pixels as NaN; raise an error if sizes differ."""
    import numpy as np

    from rigctl.images import read_images

    most_bytes = options.get("max_frame_mb", MOST_FRAME_MB) * _BYTES_PER_MB
    pictures: list[tuple[int, ImageFile]] = []
    for number, path in enumerate(paths):
        try:
            for image in read_images(path, plane=options.get("plane"), most_bytes=most_bytes):
                counts = image.counts if image.unset is None else np.where(image.unset, np.nan, image.counts)
                pictures.append((number, replace(image, counts=counts)))
        except (ConfigError, DataError) as error:
            raise type(error)(f"{path}: {error}") from error
        first, last = pictures[0][1], pictures[-1][1]
        if first.counts.shape != last.counts.shape:
            sizes = " and ".join(f"{one.counts.shape[1]} x {one.counts.shape[0]}" for one in (first, last))
            raise DataError(f"{first.path} and {last.path} have {sizes} pixels; one size is needed")
    return pictures
