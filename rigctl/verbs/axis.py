"""`rigctl calibrate axis`: sense, axis offset and extinction of the polarizer in its stage."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Unpack

from cyclopts import Parameter, validators

from rigctl.base.numbers import percent, plus_minus
from rigctl.console import Json, note
from rigctl.errors import ConfigError, DataError
from rigctl.verbs.options import FilePath, Part, RegionsPath, Result, RunOptions, RunPath, ValidDays, Writes, regions_of

if TYPE_CHECKING:
    from rigctl.calibrations.polarizer_scan import KnownLight, PolarizerCalibration
    from rigctl.files.regions import Region
    from rigctl.files.toml import Uncertain
    from rigctl.runs.folder import Run as RunRecord

# Scans measure a direction to hundredths of a degree; a larger difference is a mistake, or a change of the light.
_DISAGREEING_RAD = math.radians(0.5)
# DoLP for which the effect of harmonics on AoLP is shown.
_SHOWN_DOLP = 0.3


def axis(
    *runs: RunPath,
    reference_deg: Sequence[float] = (),
    generator: FilePath | None = None,
    dolp: float | None = None,
    dolp_std: float = 0.0,
    axis_std_deg: float = 0.0,
    expect_offset_deg: float | None = None,
    expect_std_deg: float = 5.0,
    regions: RegionsPath | None = None,
    out: Annotated[FilePath | None, Writes(), Parameter(required=True)] = None,
    maps: Annotated[FilePath | None, Writes()] = None,
    block: Annotated[int, Parameter(validator=validators.Number(gte=1))] = 8,
    report: Annotated[FilePath | None, Writes()] = None,
    valid_days: ValidDays = None,
    write: Annotated[FilePath | None, Writes(kind="edited")] = None,
    **frames: Unpack[RunOptions],
) -> "AxisResult":
    """Find sense of rotation and axis offset of the polarizer, and its extinction, each with its error.

    Either scan the stage in front of a fixed polarizer of known direction (--reference-deg), or turn a second
    polarizer, the generator, and take all stage angles at each of its angles (--generator). One reference fits
    either sense: give two that are not at 90 deg to each other, or one that is not along or across the axis of the
    stage's zero, with --expect-offset-deg. Angles are counter-clockwise from horizontal as the camera sees the scene.

    The axis of a warped or tilted polarizer differs from place to place: --regions gives each region its own numbers,
    --maps each block of the picture.

    Example: rigctl calibrate axis runs/ref0 runs/ref30 --reference-deg 0 --reference-deg 30 --out polarizer.json

    Parameters
    ----------
    runs : path or Run
        Run folders, one for each reference, or one with a generator.
    reference_deg : sequence of float
        Direction of the fixed reference of each run [deg]. Repeatable.
    generator : path
        File with the angles of the generator: TOML or CSV.
    dolp : float
        DoLP of reference or generator, above 0 up to 1; needed for the extinction ratio.
    dolp_std : float
        Standard uncertainty of the DoLP.
    axis_std_deg : float
        Standard uncertainty of the direction [deg].
    expect_offset_deg : float
        Rough offset, for instance from a mark on the mount [deg].
    expect_std_deg : float
        Standard uncertainty of this rough offset [deg].
    regions : path or sequence of Region
        Regions file: each region gets its own numbers; the first gives the result.
    out : path
        Calibration file to write, such as polarizer.json. Optional in Python.
    maps : path
        File for maps over the picture (.npz); needs --generator.
    block : int
        Side of a block of the maps [pixel].
    report : path
        Report with curves, harmonics and maps to write (HTML).
    valid_days : float
        Validity [days]; default: 180.
    write : path
        Rig file to update with sense, offset and extinction.
    **frames
        See `RunOptions`.
    """
    from rigctl.calibrations.polarizer import polarizer_content, require_writable_rig, write_into_rig
    from rigctl.calibrations.polarizer_scan import load_generator, polarimeter_maps
    from rigctl.calibrations.record import write_content, write_whole
    from rigctl.console import with_answer
    from rigctl.runs.check import run_to_measure

    if write is not None:
        require_writable_rig(Path(write))
    known = _known_light(
        reference_deg,
        dolp=_dolp(dolp, dolp_std),
        axis_std_deg=axis_std_deg,
        expected_deg=expect_offset_deg,
        expected_std_deg=expect_std_deg,
    )
    areas = [None] if regions is None else regions_of(regions)
    records = [run_to_measure(Path(run), **frames) for run in runs]
    turning = None if generator is None else Path(generator)
    found, *_ = each = [_calibrated(records, reference_deg, turning, area, known) for area in areas]
    by_region = {area.name: one for area, one in zip(areas, each, strict=True) if area}
    file = polarizer_content(found, records, regions=by_region, valid_days=valid_days)
    if not found.axis.is_decided:
        raise with_answer(DataError(_undecided(found)), file)
    if maps is not None and turning is None:
        raise ConfigError("--maps: are made with a turning generator; give --generator FILE")
    drawn = None
    if maps is not None and turning is not None:
        generator_dolp = 1.0 if known.dolp is None else known.dolp.value
        drawn = polarimeter_maps(records[0], load_generator(turning), side_pixels=block, generator_dolp=generator_dolp)
    if out is not None:
        write_content(Path(out), file)
    for line in () if write is None else write_into_rig(Path(write), found):
        note(f"{write}: {line}", below=True)
    if maps is not None and drawn is not None:
        write_whole(Path(maps), drawn.npz())
    if report is not None:
        from rigctl.report.files import encoded
        from rigctl.report.polarizer import polarizer_report

        page = polarizer_report(found, file, regions=by_region, maps=drawn)
        write_whole(Path(report), encoded(page, str(report)))
    return AxisResult(
        calibration=found,
        regions=by_region,
        file=file,
        is_generator_taken_as_perfect=generator is not None and dolp is None,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisResult(Result):
    """A polarizer calibration."""

    calibration: "PolarizerCalibration"  #: for the first region, or the whole picture
    regions: "dict[str, PolarizerCalibration]"  #: by region
    file: dict[str, Json]
    is_generator_taken_as_perfect: bool  #: the DoLP of the generator was not given

    def content(self) -> Iterable[Part]:
        """Return sense, offset, extinction and residual harmonics, and the lines for the rig file."""
        from rigctl.calibrations.polarizer import rig_lines

        found = self.calibration
        yield f"sense {found.axis.best.sense:+d}, offset {_offset(found)}"
        if found.axis.scatter_rad > _DISAGREEING_RAD:
            yield (
                f"the directions disagree by {math.degrees(found.axis.scatter_rad):.2f} deg (rms), which is in the "
                f"error: check each, and that light and polarizers stayed as they were"
            )
        if found.extinction is not None:
            upper = "no upper limit" if found.extinction.upper is None else f"{found.extinction.upper:.4g}"
            ratio = "not measured" if found.extinction.ratio is None else f"{found.extinction.ratio:.4g}"
            yield f"extinction ratio {ratio} (95 %: {found.extinction.lower:.4g} to {upper})"
        yield from _harmonics(found)
        for name, region in self.regions.items():
            yield f"region {name}: offset {_offset(region)}"
        yield "for the rig file:"
        yield rig_lines(found)
        if self.is_generator_taken_as_perfect:
            yield "the generator is assumed to be perfect, so its leakage lowers the extinction ratio; give --dolp"

    def as_json(self) -> dict[str, Json]:
        """Return the content of the calibration file."""
        return self.file


def _offset(found: "PolarizerCalibration") -> str:
    return f"{plus_minus(found.offset_deg.value, found.offset_deg.std_error)} deg"


def _harmonics(found: "PolarizerCalibration") -> Iterable[str]:
    import numpy as np

    from calibration.polarimeter.analyzer import false_dolp
    from rigctl.calibrations.polarizer import HARMONIC_MEANING, NO_HARMONICS
    from rigctl.files.session_file import DEFAULT_ANGLES_DEG

    for one in found.harmonics:
        if one.is_seen:
            size = plus_minus(100.0 * one.amplitude, 100.0 * one.std_error)
            yield f"residual, {one.order} cycles a turn: {size} % (seen: {HARMONIC_MEANING[one.order]})"
            yield _effect(false_dolp(one, np.radians(DEFAULT_ANGLES_DEG)))
    unseen = [one for one in found.harmonics if not one.is_seen]
    if unseen:
        largest = percent(max(one.amplitude + 2.0 * one.std_error for one in unseen))
        yield f"residual, {', '.join(str(one.order) for one in unseen)} cycles a turn: below {largest} (not seen)"
    if not found.harmonics:
        yield NO_HARMONICS


def _effect(false: float) -> str:
    if false == 0.0:
        return "  it leaves DoLP and AoLP of frames at 0, 45, 90 and 135 deg alone: it goes into their sum rule"
    turned_deg = 0.5 * math.degrees(math.asin(min(1.0, false / _SHOWN_DOLP)))
    return (
        f"  in frames at 0, 45, 90 and 135 deg it moves DoLP by up to {false:.2g}, and turns AoLP by up to "
        f"{turned_deg:.2g} deg at a DoLP of {_SHOWN_DOLP}"
    )


def _known_light(
    references_deg: Sequence[float],
    *,
    dolp: "Uncertain | None",
    axis_std_deg: float,
    expected_deg: float | None,
    expected_std_deg: float,
) -> "KnownLight":
    from rigctl.calibrations.polarizer_scan import KnownLight

    if not all(math.isfinite(angle) for angle in references_deg):
        raise ConfigError(f"--reference-deg is {list(references_deg)}; allowed are finite angles")
    for name, value in {"--axis-std-deg": axis_std_deg, "--expect-std-deg": expected_std_deg}.items():
        if not 0.0 <= value < math.inf:
            raise ConfigError(f"{name} is {value}; allowed is 0 or more")
    return KnownLight(
        axis_error_rad=math.radians(axis_std_deg),
        dolp=dolp,
        expected_rad=None if expected_deg is None else math.radians(expected_deg),
        expected_error_rad=math.radians(expected_std_deg),
    )


def _dolp(value: float | None, std: float) -> "Uncertain | None":
    from rigctl.files.toml import Uncertain

    if value is None:
        return None
    if not 0.0 < value <= 1.0 or std < 0.0:
        raise ConfigError(f"--dolp is {value}, --dolp-std is {std}; allowed are above 0 up to 1, and 0 or more")
    return Uncertain(value=value, std=std)


def _calibrated(
    runs: "list[RunRecord]",
    references_deg: Sequence[float],
    generator: Path | None,
    region: "Region | None",
    known: "KnownLight",
) -> "PolarizerCalibration":
    from rigctl.calibrations.polarizer_scan import (
        analyzer_scan,
        from_generator,
        from_references,
        generator_scan,
        load_generator,
    )

    if generator is not None and not references_deg and len(runs) == 1:
        return from_generator(*generator_scan(runs[0], region, load_generator(generator)), known)
    if generator is None and len(references_deg) == len(runs) > 0:
        scans = [analyzer_scan(run, region) for run in runs]
        return from_references(scans, [math.radians(angle) for angle in references_deg], known)
    raise ConfigError(
        f"{len(runs)} runs and {len(references_deg)} reference directions are given; give one --reference-deg for each "
        f"run, or --generator FILE with one run"
    )


def _undecided(found: "PolarizerCalibration") -> str:
    axis = found.axis
    (first, second) = (
        f"sense {one.sense:+d} with offset {math.degrees(one.offset_rad):.3f} deg" for one in (axis.best, axis.other)
    )
    if axis.scatter_rad > _DISAGREEING_RAD:
        return (
            f"the directions contradict one another: {first} leaves {math.degrees(axis.scatter_rad):.2f} deg (rms) "
            f"between them, far more than the noise of the scans, and the other sense fits no better: check each "
            f"direction (counter-clockwise from horizontal as the camera sees the scene) and that it is of its own run"
        )
    if found.channels is not None:
        return (
            f"the sense of rotation cannot be determined: {first} and {second} fit equally well, because the stage had "
            f"only one axis (angles 90 deg apart count as one). Scan the generator at two or more stage angles, such "
            f"as 0 and 45 deg"
        )
    return (
        f"the sense of rotation cannot be determined: {first} and {second} fit equally well. Add a run with a "
        f"reference about 30 deg away (a second RUN and --reference-deg). If the offset is roughly known, "
        f"--expect-offset-deg may decide, unless the reference is horizontal or vertical or both offsets are within "
        f"five --expect-std-deg"
    )
