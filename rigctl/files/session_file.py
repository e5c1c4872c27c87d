"""The session file: frames, their order and times, and checks meanwhile ([interlocks])."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AwareDatetime, Field, model_validator

from rigctl.files.regions import Name, Region, require_distinct
from rigctl.files.toml import Section, load

# retry: take the frame again, and stop if that does not help; hold: wait until the problem has gone or the operator
# continues; stop: end the session; note: record it; off: do not check.
Action = Literal["retry", "hold", "stop", "note", "off"]
Watched = Literal["hold", "stop", "note", "off"]


class InterlockSection(Section):
    """Reactions to violations, each of which is an event of the run."""

    angle: Action = "retry"
    """A readback beyond the stage's tolerance. Example: `"retry"`."""
    button: Action = "retry"
    """The stage reports an event during a move, such as its button. Example: `"retry"`."""
    cell: Watched = "stop"
    """The light contradicts the cell of polarizers on the camera's pixels. Example: `"stop"`."""
    fault: Literal["retry", "hold", "stop"] = "stop"
    """The stage reports a fault, such as a stall. Example: `"stop"`."""
    homed: Watched = "stop"
    """The stage does not report that it found its reference mark. Example: `"stop"`."""
    settings: Action = "stop"
    """Camera settings that differ from the requested ones. Example: `"stop"`."""
    counter: Action = "note"
    """The camera's frame counter stands still, goes back, or has a gap. Example: `"note"`."""
    identical: Action = "retry"
    """A picture has exactly the noise of the one before. Example: `"retry"`."""
    black: Action = "retry"
    """A picture has one value everywhere. Example: `"retry"`."""
    exposure: Watched = "hold"
    """The first scene frame is far too bright; at a terminal hold only warns. Example: `"hold"`."""
    saturated: Action = "note"
    """More than `saturated_fraction` of a scene frame is saturated. Example: `"note"`."""
    low_signal: Action = "note"
    """More than `low_signal_fraction` of a scene frame is below `low_signal_level`. Example: `"note"`."""
    temperature: Watched = "note"
    """The camera is colder or warmer than allowed. Example: `"note"`."""
    sum_rule: Watched = "note"
    """I0 + I90 and I45 + I135 of a cycle differ. Example: `"note"`."""
    drift: Watched = "note"
    """The light changed from cycle to cycle, or within one. Example: `"note"`."""
    disk: Watched = "hold"
    """Less than `disk_free_mb` free. Example: `"hold"`."""
    clock: Watched = "note"
    """The host's clock was set. Example: `"note"`."""
    synchronised: Watched = "note"
    """The host's clock follows no time server. Example: `"note"`."""
    queue: Literal["note", "off"] = "note"
    """Frames wait for the disk. Example: `"note"`."""
    gone: Literal["retry", "hold", "stop"] = "retry"
    """A device is silent or unplugged. Example: `"retry"`."""

    retries: Annotated[int, Field(ge=1, le=100)] = 2
    """Number of times that a frame is taken again before the session stops. Example: `2`."""
    exposure_fraction: Annotated[float, Field(gt=0, le=1)] = 0.5
    """Share of saturated pixels of the first scene frame that trips exposure. Example: `0.5`."""
    saturated_fraction: Annotated[float, Field(ge=0, le=1)] = 0.01
    """Share of saturated pixels that trips saturated. Example: `0.01`."""
    low_signal_fraction: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Share of dark pixels that trips low_signal. Example: `0.5`."""
    low_signal_level: Annotated[float, Field(gt=0, lt=1)] = 0.02
    """Share of the range below which a pixel counts as dark. Example: `0.02`."""
    temperature_least_c: float = -20.0
    """Coldest that the camera may be. Example: `-20.0`."""
    temperature_most_c: float = 60.0
    """Warmest that the camera may be. Example: `60.0`."""
    sum_rule_tolerance: Annotated[float, Field(gt=0, le=1)] = 0.02
    """Difference of the two sums over their mean that trips sum_rule. Example: `0.02`."""
    drift_tolerance: Annotated[float, Field(gt=0, le=1)] = 0.02
    """Relative change of the light that trips drift. Example: `0.02`."""
    disk_free_mb: Annotated[float, Field(ge=0)] = 200.0
    """Free space below which disk trips. Example: `200.0`."""
    clock_jump_s: Annotated[float, Field(gt=0)] = 1.0
    """Step of the host's clock that trips clock. Example: `1.0`."""
    reconnect_s: Annotated[float, Field(gt=0)] = 60.0
    """Time for which a lost device is opened again. Example: `60.0`."""

    @model_validator(mode="after")
    def _temperatures_in_order(self) -> "InterlockSection":
        if self.temperature_least_c >= self.temperature_most_c:
            raise ValueError(
                f"temperature_least_c ({self.temperature_least_c:g}) must lie below temperature_most_c "
                f"({self.temperature_most_c:g})"
            )
        return self


# 0 next to 90, 45 next to 135: a linear drift of the light causes half the false polarization of 0, 45, 90, 135.
DEFAULT_ANGLES_DEG = (0.0, 90.0, 45.0, 135.0)

ExposureMs = Annotated[float, Field(gt=0, le=3_600_000)]
PositiveNumber = Annotated[float, Field(gt=0)]
ZenithDeg = Annotated[float, Field(gt=0, lt=180)]
# cycles: in the given order; palindrome: every second cycle backwards, so that a linear drift cancels over two;
# grouped: all frames of an angle, then the next angle, so that drift looks like polarization.
Order = Literal["cycles", "palindrome", "grouped"]


class Take(Section):
    """One group of frames. `cycles` goes through all angles, then through all angles again."""

    kind: Literal["scene", "dark", "flat"]
    """Object before the camera. Example: `"scene"`."""
    exposure_ms: ExposureMs | Literal["auto"] | Annotated[list[ExposureMs], Field(min_length=1)]
    """One exposure, several, or "auto" to meter it. Example: `2.5`."""
    angles_deg: Annotated[list[float], Field(min_length=1)] | None = None
    """Polarizer angles of a cycle; default 0, 90, 45, 135 for scenes, else the present one. Example: `[0, 45, 90]`."""
    cycles: Annotated[int, Field(ge=1, le=100_000)] = 1
    """Number of times that all angles are taken. Example: `10`."""
    order: Order = "cycles"
    """cycles: repeated; palindrome: every second backwards; grouped: angle by angle. Example: `"palindrome"`."""
    closing_repeat: bool = False
    """Take the first angle again at the end of each cycle, to measure the drift. Example: `true`."""
    bracket: Annotated[list[PositiveNumber], Field(min_length=1)] | None = None
    """Factors on the exposure, one frame each. Example: `[1.0, 4.0]`."""
    every_rounds: Annotated[int, Field(ge=1)] = 1
    """Interval of a schedule's rounds with this take. Example: `1`."""

    @property
    def exposures_s(self) -> tuple[float | None, ...]:
        """The exposures of this take, in seconds; None if metered."""
        if self.exposure_ms == "auto":
            return (None,)
        given = self.exposure_ms if isinstance(self.exposure_ms, list) else [self.exposure_ms]
        return tuple(exposure / 1000 for exposure in given)

    @property
    def exposure_factors(self) -> tuple[float, ...]:
        """Factors on each angle's exposure, one frame each."""
        return (1.0,) if self.bracket is None else tuple(self.bracket)

    @property
    def polarizer_angles_deg(self) -> tuple[float | None, ...]:
        """The polarizer angles of one cycle; None for the present angle."""
        if self.angles_deg is not None:
            return tuple(self.angles_deg)
        return DEFAULT_ANGLES_DEG if self.kind == "scene" else (None,)

    @model_validator(mode="after")
    def _one_angle_for_flats(self) -> "Take":
        if self.kind == "flat" and len(self.exposures_s) > 1 and len(self.polarizer_angles_deg) > 1:
            raise ValueError(
                "flats for a noise calibration are taken at one angle: give one, or leave angles_deg out; flat fields "
                "at several angles are taken with one exposure"
            )
        return self

    @model_validator(mode="after")
    def _order_fits(self) -> "Take":
        if self.closing_repeat and self.order == "grouped":
            raise ValueError("closing_repeat measures the drift of a cycle, and order 'grouped' has no cycles")
        if self.exposure_ms == "auto" and self.kind != "scene":
            raise ValueError("exposure_ms = 'auto' meters the scene: give darks by [darks], flats an exposure")
        return self


class DarkSection(Section):
    """Dark frames between the scene frames, at their exposures: before the first cycle, at intervals, and at the end.

    `every_rounds` is their interval in a schedule's rounds.
    """

    frames: Annotated[int, Field(ge=1, le=10_000)] = 4
    """Dark frames at each exposure, each time. Example: `4`."""
    every_cycles: Annotated[int, Field(ge=1)]
    """Cycles between dark frames. Example: `5`."""
    every_rounds: Annotated[int, Field(ge=1)] = 1
    """Interval of a schedule's rounds with dark frames. Example: `1`."""


class MeteringSection(Section):
    """Metering of an exposure of "auto": the brightest angle near `target`, the darkest at `least` or above.

    Both are shares of the largest count, of the given quantile of the pixels.
    """

    first_exposure_ms: ExposureMs = 1.0
    """Exposure that metering begins with. Example: `1.0`."""
    shortest_ms: ExposureMs = 0.01
    """Shortest exposure allowed. Example: `0.01`."""
    longest_ms: ExposureMs = 1000.0
    """Longest exposure allowed. Example: `1000.0`."""
    target: Annotated[float, Field(gt=0, lt=1)] = 0.8
    """Share of the largest count that the brightest angle comes near. Example: `0.8`."""
    least: Annotated[float, Field(ge=0, lt=1)] = 0.05
    """Share of the largest count that the darkest angle is not below. Example: `0.05`."""
    quantile: Annotated[float, Field(gt=0, le=1)] = 0.999
    """Of the pixels whose counts are metered. Example: `0.999`."""


class ScheduleSection(Section):
    """Times of the takes: each time is a round.

    Times are listed (`times`), at intervals of minutes between `start` and `end`, or when the sun's zenith angle passes
    a value. The two `while` conditions leave out rounds. Times need a zone, and conditions on the sun a [site] in the
    rig file.
    """

    times: Annotated[list[AwareDatetime], Field(min_length=1)] | None = None
    """Times of the rounds, each with its zone. Example: `[2026-06-21T10:00:00+02:00]`."""
    every_min: Annotated[float, Field(gt=0)] | None = None
    """Minutes between rounds, from start to end. Example: `15.0`."""
    zenith_passes_deg: Annotated[list[ZenithDeg], Field(min_length=1)] | None = None
    """Zenith angles of the sun whose passing begins a round. Example: `[50.0, 40.0]`."""
    start: AwareDatetime | None = None
    """Earliest time of a round. Example: `2026-06-21T10:00:00+02:00`."""
    end: AwareDatetime | None = None
    """Latest time of a round. Example: `2026-06-21T18:00:00+02:00`."""
    duration_h: Annotated[float, Field(gt=0, le=24 * 366)] = 24.0
    """Length of the schedule if no end is given. Example: `24.0`."""
    while_zenith_below_deg: ZenithDeg | None = None
    """Leave out rounds with the sun at or beyond this zenith angle. Example: `75.0`."""
    while_zenith_above_deg: ZenithDeg | None = None
    """Leave out rounds with the sun at or within this zenith angle. Example: `20.0`."""
    late_min: PositiveNumber = 5.0
    """Largest delay of a round; later ones are left out. Example: `5.0`."""

    @property
    def needs_sun(self) -> bool:
        """True if the schedule depends on the position of the sun."""
        given = (self.zenith_passes_deg, self.while_zenith_below_deg, self.while_zenith_above_deg)
        return any(value is not None for value in given)

    @model_validator(mode="after")
    def _has_times(self) -> "ScheduleSection":
        if self.times is None and self.every_min is None and self.zenith_passes_deg is None:
            raise ValueError("needs times, every_min or zenith_passes_deg")
        if self.start is not None and self.end is not None and self.end <= self.start:
            raise ValueError(f"end ({self.end.isoformat()}) must lie after start ({self.start.isoformat()})")
        return self


# Name of the whole picture, in place of a region.
PICTURE = "picture"


class SessionFile(Section):
    """Content of a session file.

    `regions` are watched while the session runs: their DoLP and its noise. `reference_region` has a constant
    reflectance, such as a white panel, and measures the drift of the light; default: the whole picture.
    """

    schema_version: Literal[1] = 1
    """Version of the layout. Example: `1`."""
    name: str
    """Name of the session, in its run. Example: `"afternoon"`."""
    take: Annotated[list[Take], Field(min_length=1)]
    """Groups of frames, in their order."""
    polarimetry: bool = True
    """false: also take scenes of fewer than three polarizer angles, without DoLP. Example: `true`."""
    darks: DarkSection | None = None
    """Dark frames among the scene frames."""
    metering: MeteringSection = MeteringSection()
    """Metering of an exposure of "auto"."""
    schedule: ScheduleSection | None = None
    """Times of the takes."""
    interlocks: InterlockSection = InterlockSection()
    """Checks of the session, with reactions."""
    regions: list[Region] = Field(default_factory=list)
    """Regions watched while the session runs."""
    reference_region: Name | None = None
    """Region of constant reflectance; default: the whole picture. Example: `"white-panel"`."""

    @model_validator(mode="after")
    def _regions_are_known(self) -> "SessionFile":
        names = [region.name for region in self.regions]
        require_distinct(names)
        if PICTURE in names:
            raise ValueError(f"a region cannot be called {PICTURE!r}, the name of the whole picture")
        if self.reference_region not in (None, *names):
            known = ", ".join(names) or "none"
            raise ValueError(f"reference_region is {self.reference_region!r}; [[regions]] has {known}")
        return self


def load_session(path: Path) -> SessionFile:
    """Return the checked session file."""
    return load(path, SessionFile)
