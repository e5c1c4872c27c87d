"""From the frames of a run to pictures of its Stokes parameters and numbers of its regions."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from model.processing.mosaic import mean_inflation, reach_px, variance_factor
from model.processing.reconstruction import Design, design
from model.processing.samples import RepeatedPixels, RunningPixels, repeated
from rigctl.calibrations.flat.flat_file import FlatFields
from rigctl.calibrations.noise.noise_file import NoiseParameters
from rigctl.calibrations.polarizer.polarizer_file import PolarizerParameters
from rigctl.calibrations.registration.registration_file import ImageRegistration
from rigctl.errors import DataError
from rigctl.files.regions import Region, inner_masks, masks
from rigctl.measurement.corrected_frames import CorrectedFrames
from rigctl.measurement.corrections import NOTHING, Corrections, FoundCorrections
from rigctl.measurement.dark_level import DarkLevel, find_dark_level
from rigctl.measurement.flat_division import FlatDivision, flat_division
from rigctl.measurement.frame_grid import FrameGrid, arrange
from rigctl.measurement.image_registration import FrameShifts, frame_shifts
from rigctl.measurement.polarization_images import PolarizationImages, polarization_images
from rigctl.measurement.region_numbers import MeasuredRegion, measure_region, require_pixels
from rigctl.measurement.throughput_division import throughput_of, together
from rigctl.runs.run_folder import Run

FloatArray = NDArray[np.float64]

_LEAST_ANGLES = 3
# Pixels of regions over all frames are held up to this size; where they are more, frames are read twice.
MOST_HELD_BYTES = 256_000_000
_FLOAT_BYTES = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurement:
    """A run as it was measured.

    Attributes
    ----------
    run : Run
        Where it comes from.
    grid : FrameGrid
        Which frame is which angle of which cycle.
    plan : Design
        Measured polarizer angles and the inverse in use.
    extinction_ratio : float
        Of the polarizer, as taken; infinite where nobody states one: then it is assumed ideal.
    dark_level : DarkLevel
        What was taken off the counts, and whence.
    channels : (N, H, W) array
        Mean of each angle over the cycles, dark level off [grid.unit].
    saturated, missing : (H, W) arrays of bool
        Pixels that are so in any frame.
    light : (C,) array
        Mean of all pixels of all angles, cycle by cycle, dark level off [grid.unit].
    regions : mapping
        Name to what its pixels say.
    unmeasured : mapping
        Name of each region that gives no numbers to why.
    corrections : Corrections
        What was done to frames after the dark level.
    """

    run: Run
    grid: FrameGrid
    plan: Design
    extinction_ratio: float
    dark_level: DarkLevel
    channels: FloatArray
    saturated: NDArray[np.bool_]
    missing: NDArray[np.bool_]
    light: FloatArray
    regions: dict[str, MeasuredRegion]
    unmeasured: dict[str, str] = field(default_factory=dict)
    corrections: Corrections = NOTHING

    @cached_property
    def images(self) -> PolarizationImages:
        """Stokes parameters, DoLP and AoLP of every pixel; made when first asked for."""
        return polarization_images(self.plan, self.channels, unusable=self.saturated | self.missing)

    @property
    def shifts(self) -> FrameShifts | None:
        """Shifts by which frames were moved to lie on one another; None where they were not."""
        return self.corrections.shifts

    @property
    def flat(self) -> FlatDivision | None:
        """Flat fields that frames were divided by; None where they were not."""
        return self.corrections.flat

    @property
    def noise_factor(self) -> FloatArray:
        """Factor that the corrections put on the variance of noise, shape (N,)."""
        return self.corrections.noise_factor(self.grid.angles)


def measure(
    run: Run,
    *,
    regions: list[Region],
    noise: NoiseParameters | None = None,
    registration: ImageRegistration | None = None,
    flats: FlatFields | None = None,
    polarizer: PolarizerParameters | None = None,
    found: FoundCorrections | None = None,
    may_measure_none: bool = False,
) -> Measurement:
    """Return the Stokes pictures of a run and the numbers of its regions.

    Parameters
    ----------
    run : Run
        With scene frames of at least three angles that differ modulo 180 deg.
    regions : list of Region
        May be empty.
    noise : NoiseParameters or None
        A noise calibration: its black level serves where the run says nothing of one.
    registration : ImageRegistration or None
        A registration: frames are moved back by it.
    flats : FlatFields or None
        Flat fields: frames are divided by them, before they are moved.
    polarizer : PolarizerParameters or None
        A polarizer calibration: frames are divided by the throughput of their angle.
    found : FoundCorrections or None
        What the run's own diagnosis has frames corrected by, beside the calibrations.
    may_measure_none : bool
        Not one region need give numbers: why stands in `unmeasured`.

    Raises
    ------
    DataError
        The frames cannot give Stokes parameters, with the reason; or not one region gives numbers, unless that may be.
    ConfigError
        A region does not fit the pictures.
    """
    grid = arrange(run)
    extinction_ratio = _extinction_ratio(run)
    plan = _plan(run, grid, extinction_ratio)
    dark_level = _with_found(find_dark_level(run, grid, noise), grid, found)
    outer = masks(regions, width=grid.width, height=grid.height)
    inside = inner_masks(regions, outer, least_px=reach_px(run.session.interpolation))
    areas = [_Area(name=name, outer=outer[name], inside=mask) for name, mask in inside.items()]
    frames = CorrectedFrames(run, grid, dark_level, _corrections(run, grid, registration, flats, polarizer, found))
    measured, unmeasured = _measured_regions(areas, frames, _repeats(areas, frames, plan), plan, found)
    if unmeasured and not measured and not may_measure_none:
        raise DataError("; ".join(dict.fromkeys(unmeasured.values())))
    return Measurement(
        run=run,
        grid=grid,
        plan=plan,
        extinction_ratio=extinction_ratio,
        dark_level=dark_level,
        channels=frames.sums / grid.cycles,
        saturated=frames.saturated,
        missing=frames.missing,
        light=frames.light,
        regions=measured,
        unmeasured=unmeasured,
        corrections=frames.corrections,
    )


def _corrections(
    run: Run,
    grid: FrameGrid,
    registration: ImageRegistration | None,
    flats: FlatFields | None,
    polarizer: PolarizerParameters | None,
    found: FoundCorrections | None,
) -> Corrections:
    """Return what is done to frames by calibrations, and by what the run itself shows."""
    throughput = None if polarizer is None else throughput_of(grid, polarizer)
    shifts = None if found is None else found.shifts
    if shifts is None and registration is not None:
        shifts = frame_shifts(run, grid, registration)
    return Corrections(
        throughput=together(throughput, None if found is None else found.throughput),
        flat=None if flats is None else flat_division(grid, flats),
        shifts=shifts,
        interpolated=variance_factor(run.session.interpolation),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Area:
    """A region's pixels: all of it, and without its border."""

    name: str
    outer: NDArray[np.bool_]
    inside: NDArray[np.bool_]


# Gives the usable pixels of an area over all cycles.
_Repeats = Callable[[_Area], RepeatedPixels]


def _repeats(areas: Sequence[_Area], frames: CorrectedFrames, plan: Design) -> _Repeats:
    """Read every frame once, and return what gives the pixels of a region; where they are too many, read them again.

    Only when all frames were read is it known which pixels are usable in all of them.
    """
    inflation = mean_inflation(frames.interpolation)
    held_bytes = sum(int(area.inside.sum()) for area in areas) * frames.grid.cycles * frames.grid.angles * _FLOAT_BYTES
    if held_bytes <= MOST_HELD_BYTES:
        pixels = frames.pixels({area.name: area.inside for area in areas})

        def of_held(area: _Area) -> RepeatedPixels:
            usable = ~(frames.saturated | frames.missing)[area.inside]
            return repeated(pixels[area.name][:, :, usable], plan.inverse, noise_inflation=inflation)

        return of_held
    frames.pixels({})
    usable = ~(frames.saturated | frames.missing)
    running = {area.name: RunningPixels(plan.inverse, noise_inflation=inflation) for area in areas}
    again = frames.anew()
    for cycle in range(frames.grid.cycles):
        of_cycle = again.cycle(cycle, {area.name: area.inside & usable for area in areas})
        for name, found in of_cycle.items():
            running[name].add(found)
    return lambda area: running[area.name].result()


def _measured_regions(
    areas: Iterable[_Area], frames: CorrectedFrames, repeats: _Repeats, plan: Design, found: FoundCorrections | None
) -> tuple[dict[str, MeasuredRegion], dict[str, str]]:
    """Return what each region gives, and why others give nothing: one of them says nothing of the rest."""
    usable = ~(frames.saturated | frames.missing)
    channels = frames.sums / frames.grid.cycles
    measured: dict[str, MeasuredRegion] = {}
    unmeasured: dict[str, str] = {}
    for area in areas:
        excluded, edge = int(np.sum(area.inside & ~usable)), int(np.sum(area.outer & ~area.inside))
        try:
            require_pixels(area.name, int(np.sum(area.inside & usable)), excluded=excluded, edge=edge)
            measured[area.name] = measure_region(
                name=area.name,
                pixels=repeats(area),
                inside=area.inside & usable,
                excluded=excluded,
                edge=edge,
                channel_names=frames.grid.channel_names,
                plan=plan,
                level_std_error=frames.dark_level.std_error_dn * frames.grid.to_unit,
                relative_error=frames.corrections.relative_error(frames.grid.angles),
                own_error=0.0 if found is None else found.level_error(channels, area.inside & usable),
                interpolation=frames.interpolation,
            )
        except (DataError, ValueError, ArithmeticError) as error:
            unmeasured[area.name] = str(error)
    return measured, unmeasured


def _with_found(level: DarkLevel, grid: FrameGrid, found: FoundCorrections | None) -> DarkLevel:
    if found is None or found.dark is None:
        return level
    return replace(
        level,
        level_dn=level.level_dn + found.dark / grid.to_unit,
        source=f"{level.source}; and what the run itself shows of single angles",
    )


def signal_of_cycle(measurement: Measurement, cycle: int) -> FloatArray:
    """Return the frames of one cycle, dark level off, shape (N, H, W) [grid.unit]."""
    frames = CorrectedFrames(measurement.run, measurement.grid, measurement.dark_level, measurement.corrections)
    return np.stack([frames.read(cycle, angle) for angle in range(measurement.grid.angles)])


def _plan(run: Run, grid: FrameGrid, extinction_ratio: float) -> Design:
    distinct = np.unique(grid.target_angles_deg)
    if len(distinct) < _LEAST_ANGLES:
        raise DataError(
            f"{run.path}: its frames stand at {len(distinct)} angles that differ modulo 180 deg "
            f"({', '.join(f'{angle:g}' for angle in distinct)} deg); Stokes parameters need three"
        )
    try:
        return design(grid.polarizer_angles_rad, extinction_ratio)
    except ValueError as error:
        raise DataError(f"{run.path}: its polarizer angles do not give Stokes parameters: {error}") from error


def _extinction_ratio(run: Run) -> float:
    """Return what the rig file of the session says; infinite where there is none, as for imported images."""
    stated = run.session.polarizer.extinction_ratio
    return np.inf if stated is None else stated


def frame_order(measurement: Measurement) -> NDArray[np.intp]:
    """Return the place of each angle's frame in the first cycle, from 0."""
    sequence = [record.sequence for record in measurement.grid.records[0]]
    return np.argsort(np.argsort(sequence))
