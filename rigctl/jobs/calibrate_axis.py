"""Calibrating the polarizer in its stage: scans of runs in; sense, axis, extinction and their file out."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigctl.calibrations.polarizer import PolarizerNumbers, polarizer_file, require_writable_rig, write_into_rig
from rigctl.calibrations.polarizer_scan import (
    KnownLight,
    PolarimeterMaps,
    PolarizerCalibration,
    analyzer_scan,
    from_generator,
    from_references,
    generator_scan,
    load_generator,
    polarimeter_maps,
)
from rigctl.calibrations.record import CalibrationFile, write_content, write_whole
from rigctl.console.exclusion_option import are_exclusions_ignored
from rigctl.errors import ConfigError, DataError
from rigctl.files.regions import Region, load_regions
from rigctl.files.toml import Uncertain
from rigctl.runs.check import used_run
from rigctl.runs.folder import Run

# Scans know a direction to hundredths of a degree: what is farther off is a mistake, or light that changed.
_DISAGREEING_RAD = float(np.radians(0.5))


@dataclass(frozen=True, kw_only=True)
class AxisRequest:
    """The scans, what is known of their light, and what is to be written.

    Attributes
    ----------
    runs : tuple of Path
        Run folders: one for each reference, or one with a generator.
    out : Path
        Calibration file.
    references_deg : tuple of float
        Direction of the fixed reference of each run [deg].
    generator : Path or None
        Angles of a turning generator.
    dolp, dolp_std : float or None, float
        Degree of linear polarization of reference or generator, in (0, 1], and its standard uncertainty.
    axis_std_deg : float
        Standard uncertainty of its direction [deg].
    expect_offset_deg, expect_std_deg : float or None, float
        The offset, roughly, and how well it is known [deg].
    regions : Path or None
        The first region is for the result; each is calibrated by itself too.
    maps, block_pixels : Path or None, int
        Maps over the picture, and the side of their blocks.
    report : Path or None
        Page with curves, harmonics and maps.
    valid_days : float or None
        For how long the calibration holds.
    """

    runs: tuple[Path, ...]
    out: Path
    references_deg: tuple[float, ...] = ()
    generator: Path | None = None
    dolp: float | None = None
    dolp_std: float = 0.0
    axis_std_deg: float = 0.0
    expect_offset_deg: float | None = None
    expect_std_deg: float = 5.0
    regions: Path | None = None
    maps: Path | None = None
    block_pixels: int = 8
    report: Path | None = None
    valid_days: float | None = None
    write: Path | None = None


class UndecidedSenseError(DataError):
    """The scans leave the sense of rotation open; ``file`` is what would have been written."""

    def __init__(self, message: str, file: CalibrationFile[PolarizerNumbers]) -> None:
        super().__init__(message)
        self.file = file


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedAxis:
    """A polarizer calibration, and its file.

    Attributes
    ----------
    calibration : PolarizerCalibration
        Of the first region, or of the whole picture.
    regions : mapping
        Name to the calibration of each region by itself.
    file : CalibrationFile
        What was written.
    directions_disagree : bool
        The directions lie farther apart than scans are wrong.
    is_generator_taken_as_perfect : bool
        Nothing was known of its DoLP.
    rig_changes : tuple of str
        Lines of the rig file that went and came.
    """

    calibration: PolarizerCalibration
    regions: dict[str, PolarizerCalibration]
    file: CalibrationFile[PolarizerNumbers]
    directions_disagree: bool
    is_generator_taken_as_perfect: bool
    rig_changes: tuple[str, ...] = ()


def calibrate_axis(request: AxisRequest) -> CalibratedAxis:
    """Return the polarizer calibration by scans, once its file, maps and page are written.

    Raises
    ------
    ConfigError, DataError, CalibrationError
        A number or a file is wrong, or the scans are unfit.
    UndecidedSenseError
        The scans do not tell the sense of rotation; nothing is written.
    """
    if request.write is not None:
        require_writable_rig(request.write)
    known = _known_light(request)
    areas = [None] if request.regions is None else list(load_regions(request.regions))
    runs = [used_run(run, ignore_exclusions=are_exclusions_ignored()) for run in request.runs]
    found, *_ = each = [_calibrate(runs, request, area, known) for area in areas]
    regions = {area.name: one for area, one in zip(areas, each, strict=True) if area}
    file = polarizer_file(found, runs, regions=regions, valid_days=request.valid_days)
    if not found.axis.is_decided:
        raise UndecidedSenseError(_undecided(found), file)
    maps = None if request.maps is None else _maps(runs[0], request, known)
    write_content(request.out, file.as_json())
    changes = () if request.write is None else write_into_rig(request.write, found)
    if maps is not None and request.maps is not None:
        write_whole(request.maps, maps.npz())
    if request.report is not None:
        from rigctl.report.calibration import polarizer_report
        from rigctl.report.output import report_file

        report = polarizer_report(found, file, regions=regions, maps=maps)
        write_whole(request.report, report_file(report, request.report))
    return CalibratedAxis(
        calibration=found,
        regions=regions,
        file=file,
        rig_changes=changes,
        directions_disagree=found.axis.scatter_rad > _DISAGREEING_RAD,
        is_generator_taken_as_perfect=request.generator is not None and request.dolp is None,
    )


def _known_light(request: AxisRequest) -> KnownLight:
    if not np.isfinite(request.references_deg).all():
        raise ConfigError(f"--reference-deg is {list(request.references_deg)}; allowed are finite angles")
    errors = {"--axis-std-deg": request.axis_std_deg, "--expect-std-deg": request.expect_std_deg}
    for name, value in errors.items():
        if not 0.0 <= value < np.inf:
            raise ConfigError(f"{name} is {value}; allowed is 0 or more")
    expected_deg = request.expect_offset_deg
    return KnownLight(
        axis_error_rad=float(np.radians(request.axis_std_deg)),
        dolp=_dolp(request.dolp, request.dolp_std),
        expected_rad=None if expected_deg is None else float(np.radians(expected_deg)),
        expected_error_rad=float(np.radians(request.expect_std_deg)),
    )


def _dolp(value: float | None, std: float) -> Uncertain | None:
    if value is None:
        return None
    if not 0.0 < value <= 1.0 or std < 0.0:
        raise ConfigError(f"--dolp is {value}, --dolp-std is {std}; allowed are above 0 up to 1, and 0 or more")
    return Uncertain(value=value, std=std)


def _calibrate(runs: list[Run], request: AxisRequest, region: Region | None, known: KnownLight) -> PolarizerCalibration:
    references = request.references_deg
    if request.generator is not None and not references and len(runs) == 1:
        return from_generator(generator_scan(runs[0], region, load_generator(request.generator)), known)
    if request.generator is None and len(references) == len(runs):
        scans = [analyzer_scan(run, region) for run in runs]
        return from_references(scans, [float(np.radians(angle)) for angle in references], known)
    raise ConfigError(
        f"{len(runs)} runs and {len(references)} reference directions are given; give one --reference-deg for each "
        f"run, or --generator FILE with one run"
    )


def _maps(run: Run, request: AxisRequest, known: KnownLight) -> PolarimeterMaps:
    if request.generator is None:
        raise ConfigError("--maps: are made with a turning generator; give --generator FILE")
    dolp = 1.0 if known.dolp is None else known.dolp.value
    generator = load_generator(request.generator)
    return polarimeter_maps(run, generator, side_pixels=request.block_pixels, generator_dolp=dolp)


def _undecided(found: PolarizerCalibration) -> str:
    axis = found.axis
    (first, second) = (
        f"sense {one.sense:+d} with offset {np.degrees(one.offset_rad):.3f} deg" for one in (axis.best, axis.other)
    )
    if axis.scatter_rad > _DISAGREEING_RAD:
        return (
            f"the directions contradict one another: {first} leaves {np.degrees(axis.scatter_rad):.2f} deg (rms) "
            f"between them, far more than the noise of the scans, and the other sense fits no better: check each "
            f"direction (counter-clockwise from horizontal as the camera sees the scene) and that it is of its own run"
        )
    if found.channels is not None:
        return (
            f"the sense of rotation is not found: {first} and {second} fit alike, since the stage stood at one axis "
            f"only (angles that are 90 deg apart count as one): scan the generator at two stage angles or more, such "
            f"as 0 and 45 deg"
        )
    return (
        f"the sense of rotation is not found: {first} and {second} fit alike; a single reference cannot tell them "
        f"apart without --expect-offset-deg (nor with it, if both are within five of its --expect-std-deg), and one "
        f"along or across the axis of the stage's zero (horizontal or vertical) not even with it: add a run with a "
        f"reference some 30 deg away (a second RUN and --reference-deg)"
    )
