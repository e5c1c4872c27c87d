"""``rigctl calibrate axis``: sense, axis offset and extinction of the polarizer in its stage."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from rigctl.calibrations.content_file import write_content
from rigctl.calibrations.polarizer.generator_file import load_generator
from rigctl.calibrations.polarizer.polarimeter_maps import PolarimeterMaps, polarimeter_maps
from rigctl.calibrations.polarizer.polarizer_calibration import (
    KnownLight,
    PolarizerCalibration,
    from_generator,
    from_references,
)
from rigctl.calibrations.polarizer.polarizer_json import (
    HARMONIC_MEANING,
    polarizer_json,
    region_json,
    rig_lines,
)
from rigctl.calibrations.polarizer.scan_frames import analyzer_scan, generator_scan
from rigctl.config import Uncertain
from rigctl.durable_file import write_durably
from rigctl.errors import ConfigError, DataError
from rigctl.files.regions import Region, load_regions
from rigctl.runs.run_folder import Run, read_run
from rigctl.terminal import print_json, results

# Scans know a direction to hundredths of a degree: what is farther off is a mistake, or light that changed.
_DISAGREEING_RAD = float(np.radians(0.5))


def axis(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Run folders, one for each reference.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="Calibration file to write, such as polarizer.json.")],
    reference_deg: Annotated[
        list[float] | None, typer.Option(metavar="DEG", help="Direction of the fixed reference of each run.")
    ] = None,
    generator: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Angles of a turning generator: TOML or CSV.")
    ] = None,
    dolp: Annotated[float | None, typer.Option(help="DoLP of reference or generator; gives the extinction.")] = None,
    dolp_std: Annotated[float, typer.Option(help="Its standard uncertainty.")] = 0.0,
    axis_std_deg: Annotated[float, typer.Option(metavar="DEG", help="How well the direction is known.")] = 0.0,
    expect_offset_deg: Annotated[
        float | None, typer.Option(metavar="DEG", help="Offset as a mark on the mount says it, roughly.")
    ] = None,
    expect_std_deg: Annotated[float, typer.Option(metavar="DEG", help="How well the mark says it.")] = 5.0,
    regions: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Regions file: the first for the result, each by itself beside.")
    ] = None,
    maps: Annotated[
        Path | None, typer.Option(metavar="FILE.npz", help="Maps over the picture; with --generator.")
    ] = None,
    block: Annotated[int, typer.Option(metavar="PIXELS", min=1, help="Side of a block of the maps.")] = 8,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE.html", help="Page with curves, harmonics and maps.")
    ] = None,
    valid_days: Annotated[
        float | None, typer.Option(metavar="DAYS", min=0.0, help="For how long it holds; 180 if not said.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the calibration as JSON.")] = False,
) -> None:
    """Sense of rotation and axis offset of the polarizer, and its extinction, each with its error.

    Either scan the stage in front of a fixed polarizer of known direction (--reference-deg), or turn a second
    polarizer, the generator, and take all stage angles at each of its angles (--generator). One reference fits
    either sense: give two that are not at 90 deg to each other, or one that is not along or across the axis of the
    stage's zero, with --expect-offset-deg. Angles are counter-clockwise from horizontal as the camera sees the scene.

    A polarizer that is warped or tilted has another axis at each place: --regions gives each region its own numbers,
    --maps each block of the picture. --report makes a page of it.

    Example: rigctl calibrate axis runs/ref0 runs/ref30 --reference-deg 0 --reference-deg 30 --out polarizer.json
    """
    _require_finite(reference_deg or [], axis_std_deg=axis_std_deg, expect_std_deg=expect_std_deg)
    known = KnownLight(
        axis_error_rad=float(np.radians(axis_std_deg)),
        dolp=_dolp(dolp, dolp_std),
        expected_rad=None if expect_offset_deg is None else float(np.radians(expect_offset_deg)),
        expected_error_rad=float(np.radians(expect_std_deg)),
    )
    areas = [None] if regions is None else list(load_regions(regions))
    folders = [read_run(run) for run in runs]
    found, *_ = each = [_calibrate(folders, reference_deg or [], generator, area, known) for area in areas]
    content = polarizer_json(found, folders, valid_days=valid_days)
    content["regions"] = [region_json(area.name, one) for area, one in zip(areas, each, strict=True) if area]
    if as_json:
        print_json(content)
    if not found.axis.is_decided:
        raise DataError(_undecided(found))
    blocks = None if maps is None else _maps(folders[0], generator, known, side_pixels=block)
    write_content(out, content)
    if blocks is not None and maps is not None:
        _write(maps, blocks.npz())
    if report is not None:
        _write_report(report, found, content, blocks)
    if not as_json:
        _print(content)
        if generator is not None and dolp is None:
            results().print("the generator is taken as perfect: what it leaks is in the extinction ratio; give --dolp")


def _require_finite(references_deg: list[float], *, axis_std_deg: float, expect_std_deg: float) -> None:
    if not np.isfinite(references_deg).all():
        raise ConfigError(f"--reference-deg is {references_deg}; allowed are finite angles")
    errors = {"--axis-std-deg": axis_std_deg, "--expect-std-deg": expect_std_deg}
    for name, value in errors.items():
        if not 0.0 <= value < np.inf:
            raise ConfigError(f"{name} is {value}; allowed is 0 or more")


def _dolp(value: float | None, std: float) -> Uncertain | None:
    if value is None:
        return None
    if not 0.0 < value <= 1.0 or std < 0.0:
        raise ConfigError(f"--dolp is {value}, --dolp-std is {std}; allowed are above 0 up to 1, and 0 or more")
    return Uncertain(value=value, std=std)


def _calibrate(
    runs: list[Run], references_deg: list[float], generator: Path | None, region: Region | None, known: KnownLight
) -> PolarizerCalibration:
    if generator is not None and not references_deg and len(runs) == 1:
        return from_generator(generator_scan(runs[0], region, load_generator(generator)), known)
    if generator is None and len(references_deg) == len(runs):
        scans = [analyzer_scan(run, region) for run in runs]
        return from_references(scans, [float(np.radians(angle)) for angle in references_deg], known)
    raise ConfigError(
        f"{len(runs)} runs and {len(references_deg)} reference directions are given; give one --reference-deg for each "
        f"run, or --generator FILE with one run"
    )


def _maps(run: Run, generator: Path | None, known: KnownLight, *, side_pixels: int) -> PolarimeterMaps:
    if generator is None:
        raise ConfigError("--maps: are made with a turning generator; give --generator FILE")
    dolp = 1.0 if known.dolp is None else known.dolp.value
    return polarimeter_maps(run, load_generator(generator), side_pixels=side_pixels, generator_dolp=dolp)


def _write_report(
    path: Path, found: PolarizerCalibration, content: dict[str, Any], maps: PolarimeterMaps | None
) -> None:
    from rigctl.reports.pages.polarizer_page import polarizer_report
    from rigctl.reports.writers.report_file import report_file

    _write(path, report_file(polarizer_report(found, content, maps), path))


def _write(path: Path, data: bytes) -> None:
    try:
        write_durably(path, data)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}; its folder has to exist") from error


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


def _print(content: dict[str, Any]) -> None:
    console = results()
    offset, extinction = content["offset_deg"], content["extinction_ratio"]
    console.print(f"sense {content['sense']:+d}, offset {offset['value']:.4f} +- {offset['std_error']:.4f} deg")
    if content["scatter_deg"] > np.degrees(_DISAGREEING_RAD):
        console.print(
            f"the directions disagree by {content['scatter_deg']:.2f} deg (rms), which is in the error: check each, "
            f"and that light and polarizers stayed as they were"
        )
    if extinction is not None:
        upper = "no upper limit" if extinction["upper"] is None else f"{extinction['upper']:.4g}"
        ratio = "not measured" if extinction["ratio"] is None else f"{extinction['ratio']:.4g}"
        console.print(f"extinction ratio {ratio} (95 %: {extinction['lower']:.4g} to {upper})")
    for one in content["harmonics"]:
        seen = f"seen: {HARMONIC_MEANING[one['order']]}" if one["is_seen"] else "not seen"
        console.print(
            f"residual, {one['order']} cycles a turn: {one['amplitude']:.2%} +- {one['std_error']:.2%} ({seen})",
            markup=False,
        )
    if content["harmonics"] and not content["harmonics_told_apart"]:
        console.print("a scan of half a turn does not tell these apart: take it over a whole turn to see which it is")
    for one in content["regions"]:
        angle = one["offset_deg"]
        console.print(
            f"region {one['name']}: offset {angle['value']:.4f} +- {angle['std_error']:.4f} deg", markup=False
        )
    console.print("for the rig file:")
    console.print(rig_lines(content), markup=False)
