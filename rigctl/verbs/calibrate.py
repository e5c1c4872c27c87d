"""`rigctl calibrate`: parameters of sensor, optics and lens from frames, each with its standard error.

Each verb reads frames, calls `calibration` for the numbers, and writes one file; `calibrate axis` and
`calibrate pointing` have modules of their own.
"""

import re
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Unpack

from cyclopts import Parameter, validators

from drivers.cameras.raw_planes import Plane
from rigctl.base.durable import MOST_FRAME_MB
from rigctl.base.numbers import percent, plus_minus, to_digits
from rigctl.console import Json, note, progress, warn
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import ExposureUnit, MaxFrameMb
from rigctl.verbs.options import (
    FilePath,
    Part,
    Result,
    RunOptions,
    RunPath,
    ScenePath,
    ValidDays,
    Writes,
    scene_file_of,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from calibration.pointing.pose import LensCalibration
    from calibration.polarimeter.pictures import Registration
    from calibration.sensor.curves import DoublingTemperature
    from calibration.sensor.noise import NoiseCalibration
    from rigctl.calibrations.kinds import MeasuredOverFrames
    from rigctl.calibrations.noise import NoiseParameters
    from rigctl.calibrations.noise_frames import FrameSet

_BOARD = re.compile(r"(\d{1,3})x(\d{1,3})")
_LEAST_CORNERS = 3
# A pattern below this is rounding.
_LEAST_PATTERN = 1e-4
# Largest number of causes of an error that are printed, and the least share of one.
_MOST_CAUSES, _LEAST_SHARE = 6, 0.01


def noise(
    *,
    out: Annotated[FilePath | None, Writes(), Parameter(required=True)] = None,
    run: RunPath | None = None,
    emva: FilePath | None = None,
    folder: FilePath | None = None,
    table: FilePath | None = None,
    bit_depth: Annotated[int | None, Parameter(validator=validators.Number(gte=1, lte=16))] = None,
    plane: Plane | None = None,
    exposure_unit: ExposureUnit | None = None,
    black_level_dn: Annotated[float | None, Parameter(validator=validators.Number(gte=0))] = None,
    black_level_error_dn: Annotated[float | None, Parameter(validator=validators.Number(gt=0))] = None,
    overscan: str | None = None,
    plot: Annotated[FilePath | None, Writes()] = None,
    report: Annotated[FilePath | None, Writes()] = None,
    defects: Annotated[FilePath | None, Writes()] = None,
    max_frame_mb: MaxFrameMb = MOST_FRAME_MB,
    **frames: Unpack[RunOptions],
) -> "NoiseResult":
    """Measure gain, read noise, dark current, black level, saturation, PRNU and DSNU of a sensor.

    Take at least two flats and two darks at each of ten exposures up to saturation, and a stack of 16 flats and 16
    darks at one of them. Unfit frames are refused with the reason (exit code 4), and no file is written.

    Images may come from a run, an EMVA 1288 data set, a folder or a table. In a folder, names say what each image is
    (dark_10ms_001.png, flat/10ms/001.fits); in a table, the columns file, kind, exposure_ms, photons, level. Both need
    --bit-depth.

    Exposures are in nanoseconds in a descriptor, milliseconds in a table, seconds in a header, and in the unit that
    follows them in a name. --exposure-unit overrides this, and gives the unit for names such as exp000522.

    Without dark frames, flats give gain, linearity and saturation if the black level is known (--black-level-dn,
    --overscan, BIASSEC of the headers, or recorded in the run). Read noise and dark current then stay undetermined.

    Example: rigctl calibrate noise --run runs/noise --out noise.json --report noise.html

    Parameters
    ----------
    out : path
        Calibration file to write, such as noise.json. Optional in Python.
    run : path or Run
        Run folder with dark and flat frames.
    emva : path
        Descriptor of an EMVA 1288 data set.
    folder : path
        Folder of PNG, TIFF, FITS or RAW images.
    table : path
        CSV table of images: file, kind, exposure_ms, ...
    bit_depth : int
        Bits per sample of a folder's images.
    plane : str
        Colour to take from RAW files, such as green.
    exposure_unit : {"ns", "us", "ms", "s"}
        Unit of the exposures, if not the usual one.
    black_level_dn : float
        Counts without light [DN], if there are no dark frames.
    black_level_error_dn : float
        Standard error of the black level [DN]; default: 0.5.
    overscan : str
        Strip of pixels without light, X,Y,WIDTH,HEIGHT; its mean is the black level; default: BIASSEC of the headers.
    plot : path
        Picture of the photon-transfer curve to write (PNG).
    report : path
        Report with curves and maps to write (HTML).
    defects : path
        Map of defect pixels to write (PNG).
    max_frame_mb : int
        Largest picture that is read [MB of samples].
    **frames
        See `RunOptions`.
    """
    from rich.progress import Progress

    from calibration.results import RefusedFramesError
    from rigctl.calibrations.noise import QUANTITIES
    from rigctl.calibrations.noise_calibration import calibrate_frames
    from rigctl.calibrations.record import write_content, write_whole
    from rigctl.console import with_answer
    from rigctl.images import ImageReading

    written = [Path(path) for path in (out, plot, report, defects) if path is not None]
    _require_folders(written)
    box = _overscan_box(overscan)
    most_bytes = max_frame_mb * 1_000_000
    try:
        images = _noise_frames(
            run=None if run is None else Path(run),
            emva=None if emva is None else Path(emva),
            folder=None if folder is None else Path(folder),
            table=None if table is None else Path(table),
            bit_depth=bit_depth,
            reading=ImageReading(plane=plane, most_bytes=most_bytes, is_cut=box is None),
            exposure_unit=exposure_unit,
            frames=frames,
        )
        images = _with_black_level(images, black_level_dn, black_level_error_dn, box)
        with Progress(console=progress(), transient=True) as bar:
            task = bar.add_task("levels", total=None)
            found = calibrate_frames(
                images, level_done=lambda done, total: bar.update(task, completed=done, total=total)
            )
    except RefusedFramesError as error:
        with_answer(error, {**dict.fromkeys(QUANTITIES), "flags": [asdict(flag) for flag in error.flags]})
        raise
    result = NoiseResult(calibration=found, frames=images, created_ns=time.time_ns())
    if out is not None:
        write_content(Path(out), result.as_json())
    if plot is not None:
        from rigctl.report.noise import photon_transfer_png

        write_whole(Path(plot), photon_transfer_png(found))
    if report is not None:
        from rigctl.base.numbers import utc_text
        from rigctl.report.files import encoded
        from rigctl.report.noise import calibration_report

        page = calibration_report(found, images, created_utc=utc_text(result.created_ns))
        write_whole(Path(report), encoded(page, str(report)))
    if defects is not None:
        write_whole(Path(defects), _defects_png(Path(defects), found))
    return result


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseResult(Result):
    """A noise calibration with its frames and the time at which it was made."""

    calibration: "NoiseCalibration"
    frames: "FrameSet"
    created_ns: int  #: since 1970 UTC

    def content(self) -> Iterable[Part]:
        """Return the most important numbers, a table of all, the undetermined ones, and the flags."""
        from calibration.sensor.noise import first_lines
        from rigctl.report.noise import calibration_rows, calibration_table, unknown_lines

        found = self.calibration
        yield from first_lines(found)
        yield calibration_table(calibration_rows(found))
        yield from unknown_lines(found)
        yield from (f"{flag.name}: {flag.message}" for flag in found.flags)

    def as_json(self) -> dict[str, Json]:
        """Return the content of the calibration file."""
        from rigctl.calibrations.noise_calibration import noise_content

        return noise_content(self.calibration, self.frames, created_ns=self.created_ns)


def _require_folders(paths: Iterable[Path]) -> None:
    missing = [f"{path}: there is no folder {path.parent}" for path in paths if not path.parent.is_dir()]
    if missing:
        raise ConfigError("\n".join(missing))


def _noise_frames(
    *,
    run: Path | None,
    emva: Path | None,
    folder: Path | None,
    table: Path | None,
    bit_depth: int | None,
    reading: Any,
    exposure_unit: ExposureUnit | None,
    frames: RunOptions,
) -> "FrameSet":
    from rigctl.calibrations.noise_frames import emva_frames, folder_frames, run_frames, table_frames

    if sum(given is not None for given in (run, emva, folder, table)) != 1:
        raise ConfigError(
            "give either --run RUN (a run folder), --emva FILE (the descriptor of an EMVA 1288 data set), "
            "--folder DIR (images) or --table FILE.csv (a list of images)"
        )
    if run is not None:
        if exposure_unit is not None:
            raise ConfigError("--exposure-unit: a run folder records its exposures in seconds; leave it out")
        return run_frames(run, **frames)
    if emva is not None:
        return emva_frames(emva, exposure_unit=exposure_unit, most_bytes=reading.most_bytes)
    if bit_depth is None:
        raise ConfigError("images do not say how many bits the camera has: give --bit-depth, such as --bit-depth 12")
    if folder is not None:
        return folder_frames(folder, bit_depth=bit_depth, reading=reading, exposure_unit=exposure_unit)
    return table_frames(table or Path(), bit_depth=bit_depth, reading=reading, exposure_unit=exposure_unit)


def _overscan_box(text: str | None) -> tuple[int, int, int, int] | None:
    if text is None:
        return None
    found = re.fullmatch(r"(\d{1,6}),(\d{1,6}),(\d{1,6}),(\d{1,6})", text.replace(" ", ""))
    if found is None:
        raise ConfigError(f"--overscan: is {text!r}; write x,y,width,height in pixels, such as 2048,0,32,2048")
    x, y, width, height = map(int, found.groups())
    return x, y, width, height


def _with_black_level(
    frames: "FrameSet", level_dn: float | None, error_dn: float | None, box: tuple[int, int, int, int] | None
) -> "FrameSet":
    """Return frames with the black level that replaces dark frames, if one is given."""
    from dataclasses import replace

    from calibration.estimate import Estimate
    from rigctl.calibrations.noise_frames import STATED_BLACK_ERROR_DN, with_overscan

    given = [name for name, one in (("--black-level-dn", level_dn), ("--overscan", box)) if one is not None]
    if error_dn is not None and level_dn is None:
        raise ConfigError("--black-level-error-dn: is the error of --black-level-dn, which is not given")
    if len(given) > 1:
        raise ConfigError(f"{' and '.join(given)}: give one of them")
    if given and any(group.kind == "dark" for group in frames.groups):
        raise ConfigError(f"{given[0]}: there are dark frames, which give the black level; leave it out")
    if box is not None:
        return with_overscan(frames, box)
    if level_dn is None:
        return frames
    n_frames = sum(len(group.loaders) for group in frames.groups)
    level = Estimate(value=level_dn, std_error=error_dn or STATED_BLACK_ERROR_DN, n=n_frames)
    return replace(frames, black_level_dn=level)


def _defects_png(path: Path, calibration: "NoiseCalibration") -> bytes:
    import cv2

    if calibration.pattern is None:
        raise DataError(f"{path}: there is no defect map, since no flat is brighter than a dark level")
    done, encoded = cv2.imencode(".png", calibration.pattern.defects.mask)
    if not done:
        raise ConfigError(f"{path}: a map of this size cannot be written as PNG")
    return encoded.tobytes()


def doubling(
    *files: FilePath,
    temperature_c: Sequence[float] = (),
    by_variance: bool = False,
) -> "DoublingResult":
    """Find the rise of temperature that doubles the dark current, with its standard error (EMVA 1288).

    Example: rigctl calibrate doubling noise_20c.json noise_30c.json noise_40c.json

    Parameters
    ----------
    files : path
        Noise calibrations of one camera, two or more.
    temperature_c : sequence of float
        Temperature of each file, where the frames do not record it. Repeatable.
    by_variance : bool
        Take the dark current by variance: for cameras that clamp their black level.
    """
    import numpy as np

    from calibration.sensor.curves import doubling_temperature
    from rigctl.calibrations.noise import read_noise_file

    paths = [Path(file) for file in files]
    if len(paths) < 2:
        raise ConfigError("give two calibrations or more, of one camera at different temperatures")
    if temperature_c and len(temperature_c) != len(paths):
        raise ConfigError(f"--temperature-c is given {len(temperature_c)} times for {len(paths)} files")
    read = [read_noise_file(path) for path in paths]
    known = temperature_c or [_temperature_c(*one) for one in zip(paths, read, strict=True)]
    currents = [_dark_current(path, one, by_variance) for path, one in zip(paths, read, strict=True)]
    serials = {one.made_for.camera_serial for one in read if one.made_for is not None} - {None}
    if len(serials) > 1:
        named = ", ".join(sorted(map(str, serials)))
        raise DataError(f"these are calibrations of different cameras: serial numbers {named}")
    found = doubling_temperature(
        np.array(known),
        np.array([current.value for current in currents]),
        np.array([current.std_error for current in currents]),
    )
    return DoublingResult(found=found)


@dataclass(frozen=True, kw_only=True)
class DoublingResult(Result):
    """Rise of temperature that doubles the dark current."""

    found: "DoublingTemperature"

    def content(self) -> Iterable[Part]:
        """Return a sentence."""
        one = self.found
        doubling = plus_minus(one.value_k, one.std_error_k)
        yield f"the dark current doubles every {doubling} K ({one.n_temperatures} temperatures)"

    def as_json(self) -> dict[str, Json]:
        """Return value, standard error and number of temperatures."""
        return asdict(self.found)


def _temperature_c(path: Path, found: "NoiseParameters") -> float:
    known = None if found.made_for is None else found.made_for.temperature_c
    if known is None:
        raise ConfigError(
            f"{path}: its frames do not record the temperature of the camera: give --temperature-c for each file"
        )
    return known


def _dark_current(path: Path, found: "NoiseParameters", by_variance: bool) -> "MeasuredOverFrames[float]":
    current = found.dark_current_e_per_s
    if by_variance:
        current = None if found.performance is None else found.performance.dark_current_variance_e_per_s
    if current is None:
        raise DataError(f"{path}: its dark current is not determined; it needs dark frames at two exposures or more")
    return current


def flat(
    run: RunPath,
    /,
    *,
    out: Annotated[FilePath | None, Writes(), Parameter(required=True)] = None,
    valid_days: ValidDays = None,
    **frames: Unpack[RunOptions],
) -> "FlatResult":
    """Measure a flat field for each polarizer angle from frames of even light.

    `rigctl stokes --flat FILE` and `rigctl compare --flat FILE` divide by the flat fields. Dividing adds the noise of
    the flats as a fixed pattern; the command prints its size, and predictions include it. Take many bright frames.

    Example: rigctl calibrate flat runs/flats --out flat.npz

    Parameters
    ----------
    run : path or Run
        Run folder with flat frames at each angle, and darks.
    out : path
        File to write, such as flat.npz. Optional in Python.
    valid_days : float
        Validity [days]; default: 30.
    **frames
        See `RunOptions`.
    """
    from rigctl.calibrations.flat import flat_bytes, flat_of_run
    from rigctl.calibrations.record import write_whole
    from rigctl.runs.check import run_to_measure

    record = run_to_measure(Path(run), **frames)
    file, flats = flat_of_run(record, valid_days=valid_days)
    if out is not None:
        write_whole(Path(out), flat_bytes(file, flats))
    result = FlatResult(file=file)
    if result.doubt is not None:
        warn(result.doubt)
    return result


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatResult(Result):
    """Flat fields of each polarizer angle."""

    file: dict[str, Any]  #: content of the file apart from the pictures

    @property
    def doubt(self) -> str | None:
        """Warning if flats have more noise than pattern, otherwise None."""
        angles = self.file["angles"]
        worse = [one for one in angles if one["noise_rms"] > one["pattern_rms"]]
        if not worse:
            return None
        largest = max(one["noise_rms"] / max(one["pattern_rms"], _LEAST_PATTERN) for one in worse)
        return (
            f"{len(worse)} of {len(angles)} flats have more noise of their own than pattern: dividing by "
            f"them makes single pixels worse, and dust and vignetting alone better; take {largest**2:.0f} times as "
            f"many frames or more, or brighter ones"
        )

    def content(self) -> Iterable[Part]:
        """Return throughput, pattern and noise of each angle."""
        from rigctl.report.document import Column, Table

        columns: tuple[Column[dict[str, Any]], ...] = (
            Column(title="angle [deg]", text=lambda row: f"{row['polarizer_angle_deg']:.1f}"),
            Column(title="frames", text=lambda row: str(row["frames"])),
            Column(title="mean [DN]", text=lambda row: f"{row['mean_dn']:.1f}"),
            Column(title="light over mean", text=lambda row: f"{row['throughput']['value']:.5f}"),
            Column(title="std error", text=lambda row: f"{row['throughput']['std_error']:.2g}"),
            Column(title="pattern [%]", text=lambda row: f"{100.0 * row['pattern_rms']:.3f}"),
            Column(title="own noise [%]", text=lambda row: f"{100.0 * row['noise_rms']:.3f}"),
        )
        rows = tuple(self.file["angles"])
        pattern, noise = (percent(max(row[key] for row in rows)) for key in ("pattern_rms", "noise_rms"))
        yield f"pixels differ by {pattern} (rms), known to {noise} each"
        yield Table(columns=columns, rows=rows)

    def as_json(self) -> dict[str, Json]:
        """Return the numbers of the file."""
        return self.file


def lens(
    *pictures: FilePath,
    board: str,
    square_mm: Annotated[float, Parameter(validator=validators.Number(gte=0.001))],
    out: Annotated[FilePath | None, Writes(), Parameter(required=True)] = None,
) -> "LensResult":
    """Measure focal length, principal point and distortion of a lens from pictures of a chessboard.

    Take ten pictures or more at the focus of use. Move the board over the whole field, and tilt it by 20 to 40 deg in
    different directions. `rigctl calibrate pointing` uses the file.

    Example: rigctl calibrate lens board-01.png board-02.png board-03.png --board 9x6 --square-mm 25 --out lens.json

    Parameters
    ----------
    pictures : path
        Three or more images of the board.
    board : str
        Number of inner corners along the sides, such as 9x6.
    square_mm : float
        Side of a square [mm].
    out : path
        Calibration file to write, such as lens.json. Optional in Python.
    """
    from calibration.pointing.pose import calibrate_lens
    from rigctl.calibrations.lens import lens_content
    from rigctl.calibrations.record import write_content

    sides = _BOARD.fullmatch(board)
    if sides is None or min(int(sides[1]), int(sides[2])) < _LEAST_CORNERS:
        raise ConfigError(f"--board: is {board!r}; write its inner corners like 9x6, 3 or more along each side")
    paths = [Path(picture) for picture in pictures]
    found = calibrate_lens(
        [_upright_image(path) for path in paths],
        columns=int(sides[1]),
        rows=int(sides[2]),
        square_m=square_mm / 1000.0,
    )
    result = LensResult(found=found, file=lens_content(found, paths))
    if out is not None:
        write_content(Path(out), result.file)
    for place in found.unused:
        warn(f"{paths[place]}: does not show the whole board, left out")
    return result


@dataclass(frozen=True, kw_only=True, eq=False)
class LensResult(Result):
    """A lens calibration from pictures of a chessboard."""

    found: "LensCalibration"
    file: dict[str, Json]

    def content(self) -> Iterable[Part]:
        """Return the residual of the corners, focal lengths and principal point."""
        yield f"{len(self.found.used)} pictures, corners {self.found.rms_px:.3f} pixel about where they should be"
        values = self.found.lens.parameters[:4].tolist()
        variances = self.found.lens.covariance.diagonal()[:4].tolist()
        names = ("focal length right", "focal length down", "axis right", "axis down")
        for name, value, variance in zip(names, values, variances, strict=True):
            yield f"{name:<20} {plus_minus(value, variance**0.5)} pixel"

    def as_json(self) -> dict[str, Json]:
        """Return the content of the file."""
        return self.file


def _upright_image(path: Path) -> "NDArray[Any]":
    from rigctl.errors import DataError
    from rigctl.images import read_image

    try:
        image = read_image(path)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
    return image.raw_counts if image.first_row == "top" else image.raw_counts[::-1]


def radiometric(
    run: RunPath,
    /,
    *,
    panel: str,
    scene: ScenePath,
    out: Annotated[FilePath | None, Writes(), Parameter(required=True)] = None,
    noise: FilePath | None = None,
    valid_days: ValidDays = None,
    **frames: Unpack[RunOptions],
) -> "RadiometricResult":
    """Measure the counts per unit of radiance from a reference panel, for each polarizer angle.

    The radiance of the panel is predicted from its material and the sun of the run, or given in the scene file as
    stokes_radiance. Most of the error comes from the uncertainties in the scene file.
    `rigctl compare --scale panel --radiometric FILE` uses the file.

    Example: rigctl calibrate radiometric runs/panels --panel white_panel --scene scene.toml --out radiometric.json

    Parameters
    ----------
    run : path or Run
        Run folder with the panel in its pictures.
    panel : str
        Name of the region that is the panel.
    scene : path or SceneFile
        Scene file with the panel's material and the light.
    out : path
        Calibration file to write, such as radiometric.json. Optional in Python.
    noise : path
        Noise calibration file of the camera.
    valid_days : float
        Validity [days]; default: 90.
    **frames
        See `RunOptions`.
    """
    from rigctl.calibrations.record import write_content
    from rigctl.comparison.scale import panel_response
    from rigctl.measure.frames import CalibrationPaths, calibrations_of_run
    from rigctl.measure.measure import measure
    from rigctl.runs.check import run_to_measure
    from rigctl.scene.scene import scene_of_file

    content = scene_file_of(scene)
    record = run_to_measure(Path(run), **frames)
    paths = CalibrationPaths(named={} if noise is None else {"noise": Path(noise)})
    given = calibrations_of_run(paths, record, ())
    regions = [region for region in content.regions if region.name == panel]
    measurement = measure(record, regions=list(regions), calibrations=given)
    files = {"scene": scene, "noise": noise}
    named = {what: Path(path) for what, path in files.items() if isinstance(path, str | Path)}
    used = scene_of_file(content, given.noise)
    file = panel_response(measurement, used, panel=panel, files=named, valid_days=valid_days)
    if out is not None:
        write_content(Path(out), file)
    for doubt in given.doubts:
        warn(doubt)
    for remark in file["remarks"]:
        note(remark)
    return RadiometricResult(file=file)


@dataclass(frozen=True, kw_only=True, eq=False)
class RadiometricResult(Result):
    """Counts per unit of radiance from a panel of known reflectance."""

    file: dict[str, Any]

    def content(self) -> Iterable[Part]:
        """Return the response at each angle, its ratio to the scene file's, and the causes of its error."""
        from rigctl.report.document import Table, text_columns

        found, scale = self.file, self.file["over_scene_file"]
        ratio, all_angles = scale["value"], found["response_dn_per_radiance"]
        yield (
            f"{plus_minus(all_angles['value'], all_angles['std_error'])} DN per W m-2 sr-1, "
            f"{plus_minus(ratio, scale['std_error'])} times what the scene file says of the sensor"
        )
        numbers = [(f"{one['polarizer_angle_deg']:.2f}", one["response_dn_per_radiance"]) for one in found["channels"]]
        rows = tuple(
            (name, to_digits(one["value"], one["std_error"]), f"{one['std_error']:.2g}")
            for name, one in (*numbers, ("all", all_angles))
        )
        yield Table(columns=text_columns("angle [deg]", "DN per W m-2 sr-1", "std error", left=()), rows=rows)
        shares = [(name, part) for name, part in found["variance_shares"].items() if part >= _LEAST_SHARE]
        if shares:
            yield "variance: " + ", ".join(f"{part:.0%} {name}" for name, part in shares[:_MOST_CAUSES])

    def as_json(self) -> dict[str, Json]:
        """Return the content of the file."""
        return self.file


def registration(
    run: RunPath,
    /,
    *,
    cycle: int | None = None,
    out: Annotated[FilePath | None, Writes()] = None,
    valid_days: ValidDays = None,
    force_registration: bool = False,
    **frames: Unpack[RunOptions],
) -> "RegistrationResult":
    """Measure the shift of the picture at each polarizer angle, for instance from a wedged polarizer.

    A shift of 0.1 pixel makes a false DoLP of 0.003 on a natural scene, and up to 0.05 at edges. With --out the shifts
    are written to a file, and `rigctl stokes --register FILE` and `rigctl compare --register FILE` undo them. A shift
    that does not make edges match better, in tiles that it was not fitted on, is refused (exit code 4).

    Example: rigctl calibrate registration runs/panels --out walk.json

    Parameters
    ----------
    run : path or Run
        Run folder of a scene with edges.
    cycle : int
        Cycle to use, counted from 0; default: the first.
    out : path
        Calibration file to write, such as walk.json.
    valid_days : float
        Validity [days]; default: 180.
    force_registration : bool
        Write the file even if no shift is significant.
    **frames
        See `RunOptions`.
    """
    from rigctl.calibrations.record import write_content
    from rigctl.calibrations.registration import register_run, registration_doubt
    from rigctl.runs.check import run_to_measure

    record = run_to_measure(Path(run), **frames)
    file, found = register_run(record, cycle=cycle, valid_days=valid_days)
    doubt = registration_doubt(file, found)
    is_refused = doubt is not None and not force_registration
    if out is not None and not is_refused:
        write_content(Path(out), file)
    if doubt is not None:
        warn(doubt + ("; --force-registration keeps it" if is_refused else ""))
    return RegistrationResult(found=found, file=file, is_refused=is_refused)


@dataclass(frozen=True, kw_only=True, eq=False)
class RegistrationResult(Result):
    """Shift of the picture at each polarizer angle."""

    found: "Registration"
    file: dict[str, Any]  #: content of the file
    is_refused: bool  #: the shift does not make the pictures match; no file was written

    @property
    def exit_code(self) -> int:
        """4 if the registration is refused."""
        from rigctl.console import EXIT_DATA

        return EXIT_DATA if self.is_refused else 0

    def content(self) -> Iterable[Part]:
        """Return the shift at each angle, the residual of the edges, and the circle of a wedge."""
        from rigctl.calibrations.registration import before_and_after, shifted
        from rigctl.report.document import Column, Table

        columns: tuple[Column[dict[str, Any]], ...] = (
            Column(title="angle [deg]", text=lambda row: f"{row['angle_deg']:.2f}"),
            Column(title="right [pixel]", text=lambda row: f"{row['shift_pixels'][0]:+.3f}"),
            Column(title="down [pixel]", text=lambda row: f"{row['shift_pixels'][1]:+.3f}"),
            Column(
                title="std errors [pixel]", text=lambda row: ", ".join(f"{one:.3f}" for one in row["std_error_pixels"])
            ),
        )
        circle, angles = self.file["wander"], self.file["angles"]
        if circle is not None:
            size, residual = circle["radius_pixels"], circle["residual_pixels"]
            yield f"pictures walk on a circle of {size:.3f} pixel, residual {residual:.3f} pixel"
        yield Table(columns=columns, rows=tuple(angles))
        for index in shifted(self.found):
            text = f"edges at {angles[index]['angle_deg']:.1f} deg that do not lie on one another: "
            yield text + before_and_after(self.found, index)
        if self.file["finding"] is not None:
            yield self.file["finding"]

    def as_json(self) -> dict[str, Json]:
        """Return the content of the file."""
        return self.file
