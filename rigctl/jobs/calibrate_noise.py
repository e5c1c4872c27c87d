"""Calibrating the sensor's noise: dark and flat frames in; the calibration, its file and its pages out."""

import time
from dataclasses import dataclass
from pathlib import Path

import cv2

from drivers.cameras.raw_planes import Plane
from rigctl.base.durable import MOST_FRAME_BYTES
from rigctl.base.numbers import utc_text
from rigctl.calibrations.noise_calibration import FrameCalibration, LevelDone, calibrate_frames
from rigctl.calibrations.noise_frames import FrameSet, emva_frames, folder_frames, run_frames, table_frames
from rigctl.calibrations.record import write_content, write_whole
from rigctl.console.exclusion_option import are_exclusions_ignored
from rigctl.console.json_text import Json
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import ExposureUnit
from rigctl.images import ImageReading


@dataclass(frozen=True, kw_only=True)
class NoiseRequest:
    """Where the frames are, and what is to be written.

    Attributes
    ----------
    out : Path
        Calibration file.
    run, emva, folder, table : Path or None
        Run folder, descriptor of an EMVA 1288 data set, folder of images or table of images; one of them.
    bit_depth : int or None
        Bits per sample of images.
    plane : str or None
        Colour of RAW files.
    exposure_unit : str or None
        Unit of the exposures as they are stated (ns, us, ms, s); None is the usual one of each source.
    most_bytes : int
        A picture of more bytes of samples is refused.
    plot, report, defects : Path or None
        Photon-transfer curve (PNG), page with curves and maps (HTML), map of defect pixels (PNG).
    """

    out: Path
    run: Path | None = None
    emva: Path | None = None
    folder: Path | None = None
    table: Path | None = None
    bit_depth: int | None = None
    plane: Plane | None = None
    exposure_unit: ExposureUnit | None = None
    most_bytes: int = MOST_FRAME_BYTES
    plot: Path | None = None
    report: Path | None = None
    defects: Path | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedNoise:
    """A noise calibration, and when it was made [ns since 1970 UTC]."""

    calibration: FrameCalibration
    created_ns: int

    def as_json(self) -> dict[str, Json]:
        """Return the content of its file."""
        return self.calibration.as_json(created_ns=self.created_ns)


def calibrate_noise(request: NoiseRequest, *, level_done: LevelDone | None = None) -> CalibratedNoise:
    """Return the noise calibration of frames, once its file and pages are written.

    Parameters
    ----------
    request : NoiseRequest
        Frames and files.
    level_done : callable or None
        Told after each level how many of how many are done.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, or cannot be written.
    RefusedFramesError
        The frames are unfit, with the flags that say why; nothing is written.
    """
    _require_folders(request.out, request.plot, request.report, request.defects)
    calibration = calibrate_frames(_frames(request), level_done=level_done)
    found = CalibratedNoise(calibration=calibration, created_ns=time.time_ns())
    write_content(request.out, found.as_json())
    if request.plot is not None:
        from rigctl.report.calibration import photon_transfer_png

        write_whole(request.plot, photon_transfer_png(calibration.noise))
    if request.report is not None:
        from rigctl.report.calibration import calibration_report
        from rigctl.report.output import report_file

        report = calibration_report(calibration, created_utc=utc_text(found.created_ns))
        write_whole(request.report, report_file(report, request.report))
    if request.defects is not None:
        write_whole(request.defects, _defects_png(request.defects, calibration))
    return found


def _require_folders(*paths: Path | None) -> None:
    missing = [f"{path}: there is no folder {path.parent}" for path in paths if path and not path.parent.is_dir()]
    if missing:
        raise ConfigError("\n".join(missing))


def _frames(request: NoiseRequest) -> FrameSet:
    if sum(given is not None for given in (request.run, request.emva, request.folder, request.table)) != 1:
        raise ConfigError(
            "give either --run RUN (a run folder), --emva FILE (the descriptor of an EMVA 1288 data set), "
            "--folder DIR (images) or --table FILE.csv (a list of images)"
        )
    unit = request.exposure_unit
    if request.run is not None:
        if unit is not None:
            raise ConfigError(
                "--exposure-unit: a run folder has its exposures in seconds, as they were taken; leave it"
            )
        return run_frames(request.run, ignore_exclusions=are_exclusions_ignored())
    if request.emva is not None:
        return emva_frames(request.emva, exposure_unit=unit, most_bytes=request.most_bytes)
    if request.bit_depth is None:
        raise ConfigError("images do not say how many bits the camera has: give --bit-depth, such as --bit-depth 12")
    reading = ImageReading(plane=request.plane, most_bytes=request.most_bytes)
    if request.folder is not None:
        return folder_frames(request.folder, bit_depth=request.bit_depth, reading=reading, exposure_unit=unit)
    return table_frames(request.table or Path(), bit_depth=request.bit_depth, reading=reading, exposure_unit=unit)


def _defects_png(path: Path, calibration: FrameCalibration) -> bytes:
    if calibration.pattern is None:
        raise DataError(f"{path}: there is no defect map, since no flat is brighter than its dark")
    done, encoded = cv2.imencode(".png", calibration.pattern.defects.mask)
    if not done:
        raise ConfigError(f"{path}: a map of this size cannot be written as PNG")
    return encoded.tobytes()
