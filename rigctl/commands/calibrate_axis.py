"""``rigctl calibrate axis``: sense, axis offset and extinction of the polarizer in its stage."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.terminal import print_json, progress, results

if TYPE_CHECKING:
    from rigctl.calibrations.polarizer_scan import PolarizerCalibration
    from rigctl.jobs.calibrate_axis import CalibratedAxis


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
    write: Annotated[
        Path | None, typer.Option(metavar="RIG.toml", help="Write sense, offset and extinction into this rig file too.")
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
    from rigctl.jobs.calibrate_axis import AxisRequest, UndecidedSenseError, calibrate_axis

    request = AxisRequest(
        runs=tuple(runs),
        out=out,
        references_deg=tuple(reference_deg or ()),
        generator=generator,
        dolp=dolp,
        dolp_std=dolp_std,
        axis_std_deg=axis_std_deg,
        expect_offset_deg=expect_offset_deg,
        expect_std_deg=expect_std_deg,
        regions=regions,
        maps=maps,
        block_pixels=block,
        report=report,
        valid_days=valid_days,
        write=write,
    )
    try:
        found = calibrate_axis(request)
    except UndecidedSenseError as error:
        if as_json:
            print_json(error.file.as_json())
        raise
    for line in found.rig_changes:
        progress().print(f"{write}: {line}", markup=False, soft_wrap=True)
    if as_json:
        print_json(found.file.as_json())
    else:
        _print(found)


def _print(axis: "CalibratedAxis") -> None:
    from rigctl.calibrations.polarizer import rig_lines

    console, found = results(), axis.calibration
    console.print(f"sense {found.axis.best.sense:+d}, offset {_offset(found)}")
    if axis.directions_disagree:
        console.print(
            f"the directions disagree by {math.degrees(found.axis.scatter_rad):.2f} deg (rms), which is in the error: "
            f"check each, and that light and polarizers stayed as they were"
        )
    if found.extinction is not None:
        upper = "no upper limit" if found.extinction.upper is None else f"{found.extinction.upper:.4g}"
        ratio = "not measured" if found.extinction.ratio is None else f"{found.extinction.ratio:.4g}"
        console.print(f"extinction ratio {ratio} (95 %: {found.extinction.lower:.4g} to {upper})")
    _print_harmonics(found)
    for name, region in axis.regions.items():
        console.print(f"region {name}: offset {_offset(region)}", markup=False)
    console.print("for the rig file:")
    console.print(rig_lines(found), markup=False)
    if axis.is_generator_taken_as_perfect:
        console.print("the generator is taken as perfect: what it leaks is in the extinction ratio; give --dolp")


def _offset(found: "PolarizerCalibration") -> str:
    return f"{found.offset_deg.value:.4f} +- {found.offset_deg.std_error:.4f} deg"


def _print_harmonics(found: "PolarizerCalibration") -> None:
    from rigctl.calibrations.polarizer import HARMONIC_MEANING

    console = results()
    for one in found.harmonics:
        seen = f"seen: {HARMONIC_MEANING[one.order]}" if one.is_seen else "not seen"
        text = f"residual, {one.order} cycles a turn: {one.amplitude:.2%} +- {one.std_error:.2%} ({seen})"
        console.print(text, markup=False)
    if found.harmonics and not found.harmonics_told_apart:
        console.print("a scan of half a turn does not tell these apart: take it over a whole turn to see which it is")
