"""Numbers of frames as they come, for people who watch: means, level of light, sum rule, drift, DoLP with deviations.

They are fast enough to be computed of every frame; results for processing come from `rigctl.measure`.
"""

import math
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments
from model.processing import dolp
from model.processing.mosaic import coarse_pictures
from model.processing.reconstruction import aolp_moments_rad, design, stokes_moments
from model.sensor import SensorNoise, temporal_variance_dn2
from model.stokes import aolp_rad
from model.stokes import dolp as degree_of_polarization
from rigctl.calibrations.noise import NoiseParameters
from rigctl.errors import ConfigError
from rigctl.files.regions import Region, masks
from rigctl.files.session_file import PICTURE
from rigctl.measure.faults import Fault
from rigctl.runs.records import SessionNoise
from rigctl.session.status import (
    AngleNumbers,
    CyclePlace,
    DarkLevel,
    DarkSource,
    Estimate,
    LiveContent,
    LiveDiagnosis,
    RegionDrift,
    RegionPolarization,
)

if TYPE_CHECKING:
    from rigctl.runs.records import FrameRecord

_NEEDED = ("gain_dn_per_e", "read_noise_e", "black_level_dn")


@dataclass(frozen=True, kw_only=True)
class MeanNoise:
    """The temporal noise of means."""

    sensor: SensorNoise  #: Of the camera, as calibrated; fixed pattern stays in a mean and is left out.

    def dark_dn(self, exposure_s: float) -> float:
        """Return the mean count without light [DN]."""
        return self.sensor.black_level_dn + self.sensor.gain_dn_per_e * self.sensor.dark_current_e_per_s * exposure_s

    def variance_dn2(self, mean_dn: float, *, exposure_s: float, pixels: int) -> float:
        """Return the variance of the mean of so many pixels whose mean count is that [DN^2]."""
        signal_dn = max(0.0, mean_dn - self.dark_dn(exposure_s))
        return float(temporal_variance_dn2(signal_dn, noise=self.sensor, exposure_s=exposure_s)) / pixels


def noise_numbers(calibration: NoiseParameters) -> SessionNoise:
    """Return the numbers of a noise calibration that a session needs: they go into the run."""
    missing = [name for name in _NEEDED if name not in calibration.known]
    if missing:
        raise ConfigError(f"--noise: the calibration has no {', '.join(missing)}")
    sensor = calibration.sensor_noise()
    return SessionNoise(
        gain_dn_per_e=sensor.gain_dn_per_e,
        read_noise_e=sensor.read_noise_e,
        black_level_dn=sensor.black_level_dn,
        dark_current_e_per_s=sensor.dark_current_e_per_s,
    )


def mean_noise(numbers: SessionNoise) -> MeanNoise:
    """Return the noise of means by the numbers that `noise_numbers` gave."""
    return MeanNoise(sensor=SensorNoise(**asdict(numbers)))


@dataclass(frozen=True, kw_only=True)
class PixelMean:
    """A mean count."""

    mean_dn: float  #: [DN].
    pixels: int  #: Of how many.


@dataclass(frozen=True, kw_only=True, eq=False)
class _Window:
    rows: slice
    columns: slice
    inside: NDArray[np.bool_]


class RegionMeans:
    """Knows where regions lie in pictures of one size."""

    def __init__(self, regions: Sequence[Region] = ()) -> None:
        self._regions = list(regions)
        self._shape: tuple[int, ...] = ()
        self._windows: dict[str, _Window] = {}

    def of(self, counts: NDArray[np.uint16], *, share: float = 1.0) -> dict[str, PixelMean]:
        """Return the mean of the whole picture, and of each region by its name."""
        if counts.shape != self._shape:
            self._windows = self._fitted(counts.shape)
            self._shape = counts.shape
        means = {PICTURE: PixelMean(mean_dn=float(counts.mean()), pixels=max(1, round(share * counts.size)))}
        for name, window in self._windows.items():
            values = counts[window.rows, window.columns][window.inside]
            means[name] = PixelMean(mean_dn=float(values.mean()), pixels=max(1, round(share * values.size)))
        return means

    def _fitted(self, shape: tuple[int, ...]) -> dict[str, _Window]:
        height, width = shape
        found = masks(self._regions, width=width, height=height) if self._regions else {}
        return {name: _window(mask) for name, mask in found.items()}


def _window(mask: NDArray[np.bool_]) -> _Window:
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    along_y, along_x = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return _Window(rows=along_y, columns=along_x, inside=mask[along_y, along_x])


# More than this and the means of a frame say little.
_MOST_SATURATED = 0.01
# Squares that a whole cycle is diagnosed from while the session runs.
_COARSE_PIXELS = 20_000


@dataclass(frozen=True, kw_only=True, eq=False)
class CoarsePicture:
    """Mean counts of squares of pixels, NaN where one of them is saturated or missing; side of a square [pixel]."""

    counts_dn: NDArray[np.float64]
    side_pixels: int


@dataclass(frozen=True, kw_only=True)
class FrameSummary:
    """A frame in a few numbers."""

    kind: str  #: "scene", "dark" or "flat".
    round: int | None  #: Where in the session.
    cycle: int | None
    angle_deg: float | None  #: The polarizer angle that was asked for, in [0, 180).
    measured_deg: float | None  #: The same by the stage's readback.
    exposure_s: float  #: Integration time.
    time_s: float  #: When its exposure began, by one clock for all that are set against each other.
    saturated_fraction: float  #: Share of saturated pixels.
    means: Mapping[str, "PixelMean"]  #: Mean counts of the picture and of its regions, by name.
    coarse: CoarsePicture | None = None  #: The picture in some 20000 squares.


def frame_summary(
    record: "FrameRecord",
    means: Mapping[str, "PixelMean"],
    *,
    time_s: float,
    saturated_fraction: float,
    coarse: CoarsePicture | None = None,
) -> FrameSummary:
    """Return what a frame shows, by its record and the means of its counts."""
    target_deg = record.polarizer_angle_target_deg
    return FrameSummary(
        kind=record.kind,
        round=record.round,
        cycle=record.cycle,
        angle_deg=None if target_deg is None else target_deg % 180.0,
        measured_deg=record.polarizer_angle_deg,
        exposure_s=record.exposure_s or 0.0,
        time_s=time_s,
        saturated_fraction=saturated_fraction,
        means=means,
        coarse=coarse,
    )


def coarse_picture(counts: NDArray[np.uint16], record: "FrameRecord") -> CoarsePicture:
    """Return the mean counts of squares of the pixels of a frame, some 20000 of them."""
    bad = counts >= record.saturation_dn
    if record.missing_dn is not None:
        bad |= counts == record.missing_dn
    means, good, side = coarse_pictures(counts[None].astype(np.float64), ~bad, most_pixels=_COARSE_PIXELS)
    return CoarsePicture(counts_dn=np.where(good, means[0], np.nan), side_pixels=side)


def of_one_exposure(frames: Sequence[FrameSummary]) -> tuple[FrameSummary, ...]:
    """Return the frames of the longest exposure at which none is saturated; of the shortest if all are."""
    exposures_s = sorted({frame.exposure_s for frame in frames}, reverse=True)
    for exposure_s in exposures_s:
        alike = tuple(frame for frame in frames if frame.exposure_s == exposure_s)
        if all(frame.saturated_fraction <= _MOST_SATURATED for frame in alike) or exposure_s == exposures_s[-1]:
            return alike
    return ()


@dataclass(frozen=True, kw_only=True)
class Level:
    """Level of light that a mean stands for."""

    dn_per_s: float  #: Counts a second of exposure, those of the dark taken off.
    variance: float | None  #: What noise does to it [(DN/s)^2]; None without a calibration.


@dataclass(kw_only=True)
class LightLevels:
    """Remembers the last dark frame of each exposure."""

    noise: MeanNoise | None = None  #: From a calibration.
    _darks: dict[float, FrameSummary] = field(default_factory=dict)

    def add_dark(self, dark: FrameSummary) -> None:
        """Take in a dark frame."""
        self._darks[dark.exposure_s] = dark

    def source(self, exposure_s: float) -> DarkSource:
        """Return where the dark level at an exposure comes from."""
        if exposure_s in self._darks:
            return DarkSource.FRAMES
        return DarkSource.UNKNOWN if self.noise is None else DarkSource.CALIBRATION

    def dark_dn(self, region: str, exposure_s: float) -> float:
        """Return the mean count of a region without light [DN]; 0 where nothing is known of it."""
        dark = self._darks.get(exposure_s)
        if dark is not None:
            return dark.means[region].mean_dn
        return 0.0 if self.noise is None else self.noise.dark_dn(exposure_s)

    def level(self, frame: FrameSummary, region: str) -> Level:
        """Return the level of the light in a region of a frame."""
        mean, exposure_s = frame.means[region], frame.exposure_s
        variance_dn2 = (
            None
            if self.noise is None
            else self.noise.variance_dn2(mean.mean_dn, exposure_s=exposure_s, pixels=mean.pixels)
        )
        return Level(
            dn_per_s=(mean.mean_dn - self.dark_dn(region, exposure_s)) / exposure_s,
            variance=None if variance_dn2 is None else variance_dn2 / exposure_s**2,
        )


_S_PER_MIN = 60.0


@dataclass(frozen=True, kw_only=True)
class Drift:
    """A relative change of the light."""

    change: float  #: Relative change over `over_s`, positive if the light grew.
    sigma: float | None  #: Standard deviation of it by the camera's noise; None without a calibration.
    over_s: float  #: Time between the looks, the mean of the angles weighted by their light.

    @property
    def per_min(self) -> float:
        """Relative change a minute."""
        return self.change / self.over_s * _S_PER_MIN

    @property
    def sigma_per_min(self) -> float | None:
        """Standard deviation of `per_min`."""
        return None if self.sigma is None else self.sigma / self.over_s * _S_PER_MIN


def drift_of(
    frames: Sequence["FrameSummary"], before: Sequence["FrameSummary"], *, region: str, levels: "LightLevels"
) -> Drift | None:
    """Return how the light has changed: within a cycle that repeats an angle, or else since the cycle before.

    The sum of the changes of all angles over the sum of their means; polarization cancels, since each angle is
    compared with itself.
    """
    pairs = list(_pairs(frames, frames)) or list(_pairs(before, frames))
    looks = [(levels.level(one, region), levels.level(two, region), two.time_s - one.time_s) for one, two in pairs]
    light = sum((one.dn_per_s + two.dn_per_s) / 2.0 for one, two, _ in looks)
    light_s = sum((one.dn_per_s + two.dn_per_s) / 2.0 * time_s for one, two, time_s in looks)
    if light <= 0.0 or light_s <= 0.0:
        return None
    variances = [level.variance for one, two, _ in looks for level in (one, two)]
    known = [variance for variance in variances if variance is not None]
    return Drift(
        change=sum(two.dn_per_s - one.dn_per_s for one, two, _ in looks) / light,
        sigma=math.sqrt(sum(known)) / light if len(known) == len(variances) else None,
        over_s=light_s / light,
    )


def _pairs(
    earlier: Sequence["FrameSummary"], later: Sequence["FrameSummary"]
) -> Iterator[tuple["FrameSummary", "FrameSummary"]]:
    """Give the first look of an angle among the earlier frames and the last among the later, where they differ."""
    first: dict[float | None, FrameSummary] = {}
    for frame in earlier:
        first.setdefault(frame.angle_deg, frame)
    last = {frame.angle_deg: frame for frame in later}
    for angle, one in first.items():
        two = last.get(angle)
        if two is not None and two.time_s > one.time_s:
            yield one, two


_LEAST_ANGLES = 3
_ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
# A deviation for somebody who watches: three digits are plenty.
_TOLERANCE = 1e-3


def sum_rule(frames: Sequence[FrameSummary], *, region: str, levels: LightLevels) -> Estimate | None:
    """Return (I0 + I90) / (I45 + I135), which is 1; None without all four, or without light."""
    found: dict[float, Level] = {}
    for frame in frames:
        if frame.angle_deg in _ANGLES_DEG:
            found.setdefault(frame.angle_deg, levels.level(frame, region))
    if len(found) < len(_ANGLES_DEG):
        return None
    i0, i45, i90, i135 = (found[angle] for angle in _ANGLES_DEG)
    upper, lower = i0.dn_per_s + i90.dn_per_s, i45.dn_per_s + i135.dn_per_s
    if lower <= 0.0:
        return None
    ratio = upper / lower
    variances = [None if level.variance is None else level.variance for level in (i0, i90, i45, i135)]
    if any(variance is None for variance in variances):
        return Estimate(value=ratio, sigma=None)
    of_upper, of_lower = (sum(v for v in part if v is not None) for part in (variances[:2], variances[2:]))
    return Estimate(value=ratio, sigma=math.sqrt(of_upper + ratio**2 * of_lower) / lower)


def polarization(
    frames: Sequence[FrameSummary], *, region: str, levels: LightLevels, extinction_ratio: float | None
) -> RegionPolarization | None:
    """Return the polarization of a region's mean light in a cycle; None with fewer than three angles, or no light.

    The deviation is what noise does to one cycle. It knows nothing of drift, of fixed pattern, or of an error of the
    angles.
    """
    seen = [frame for frame in frames if frame.measured_deg is not None]
    if len({frame.angle_deg for frame in seen}) < _LEAST_ANGLES:
        return None
    angles_rad = np.deg2rad([frame.measured_deg or 0.0 for frame in seen])
    found = [levels.level(frame, region) for frame in seen]
    plan = design(angles_rad, np.inf if extinction_ratio is None else extinction_ratio)
    variances = np.diag([0.0 if level.variance is None else level.variance for level in found])
    stokes = stokes_moments(plan, Moments(mean=np.array([level.dn_per_s for level in found]), cov=variances))
    if stokes.mean[0] <= 0.0:
        return None
    degree = float(degree_of_polarization(stokes.mean))
    return RegionPolarization(
        dolp=Estimate(value=degree, sigma=_sigma(stokes) if variances.any() else None),
        aolp_deg=float(np.rad2deg(aolp_rad(stokes.mean))) if degree > 0.0 else None,
        light_dn_per_s=float(stokes.mean[0]),
        aolp_sigma_deg=_angle_sigma_deg(stokes) if degree > 0.0 and variances.any() else None,
    )


def _sigma(stokes: Moments) -> float | None:
    """Return the deviation of DoLP; None where it does not exist."""
    sigma = float(dolp.moments(stokes.mean, stokes.cov, tolerance=_TOLERANCE).std)
    return sigma if math.isfinite(sigma) else None


def _angle_sigma_deg(stokes: Moments) -> float | None:
    sigma = float(np.rad2deg(np.sqrt(aolp_moments_rad(stokes).cov[0, 0])))
    return sigma if math.isfinite(sigma) else None


def cycle_diagnosis(
    frames: Sequence[FrameSummary], *, levels: LightLevels, extinction_ratio: float | None
) -> LiveDiagnosis | None:
    """Return what a whole cycle says of its faults, from its coarse pictures; None where there are none."""
    seen = [frame for frame in frames if frame.measured_deg is not None]
    coarse = [frame.coarse for frame in seen if frame.coarse is not None]
    if not coarse or len(coarse) < len(seen) or len({frame.angle_deg for frame in seen}) < _LEAST_ANGLES:
        return None
    pictures = np.array([picture.counts_dn for picture in coarse]) - levels.dark_dn(PICTURE, seen[0].exposure_s)
    usable = np.asarray(np.isfinite(pictures).all(axis=0))
    pictures = np.where(usable, pictures, 0.0)
    angles_rad = np.deg2rad([frame.measured_deg or 0.0 for frame in seen])
    plan = design(angles_rad, np.inf if extinction_ratio is None else extinction_ratio)
    from rigctl.measure.diagnose import diagnose_pictures

    found = diagnose_pictures(
        plan,
        pictures,
        usable,
        angles_rad=angles_rad % (2.0 * np.pi),
        times=[float(place) for place in range(len(seen))],
        step=1.0,
        means={PICTURE: pictures[:, usable].mean(axis=1)} if usable.any() else {},
        side_pixels=coarse[0].side_pixels,
    )
    terms = tuple(Fault(**{key.name: getattr(term, key.name) for key in fields(Fault)}) for term in found.named)
    return LiveDiagnosis(terms=terms, first=None if found.first is None else found.first.name, reason=found.reason)


_MS_PER_S = 1000.0


class LiveNumbers:
    """Remembers the last frame of each angle, and the last whole cycle. Filled in one thread, read in another."""

    def __init__(
        self, *, noise: MeanNoise | None = None, extinction_ratio: float | None = None, reference: str = PICTURE
    ) -> None:
        self._lock = threading.Lock()
        self._levels = LightLevels(noise=noise)
        self._extinction_ratio = extinction_ratio
        self._reference = reference
        self._angles: dict[tuple[float, float], FrameSummary] = {}
        self._under_way: list[FrameSummary] = []
        self._cycle: tuple[FrameSummary, ...] = ()
        self._drift: Drift | None = None
        self._diagnosed: tuple[tuple[FrameSummary, ...], LiveDiagnosis | None] = ((), None)

    def add(self, frame: FrameSummary, *, ends_cycle: bool) -> Drift | None:
        """Take in a frame; return the drift of the light at the end of a cycle, where it can be told."""
        with self._lock:
            if frame.kind == "dark":
                self._levels.add_dark(frame)
            if frame.kind != "scene" or frame.angle_deg is None:
                return None
            if any(other.round != frame.round for other in self._angles.values()):
                self._angles.clear()
            self._angles[frame.angle_deg, frame.exposure_s] = frame
            self._under_way = [*(f for f in self._under_way if _is_of_cycle(f, frame)), frame]
            return self._end_cycle() if ends_cycle else None

    def _end_cycle(self) -> Drift | None:
        before = self._cycle if self._cycle and self._cycle[-1].round == self._under_way[-1].round else ()
        self._cycle, self._under_way = of_one_exposure(self._under_way), []
        self._drift = drift_of(self._cycle, before, region=self._reference, levels=self._levels)
        return self._drift

    def content(self) -> LiveContent:
        """Return the numbers as they stand.

        Of the last whole cycle; where frames are grouped by angle, of the last frame of each.
        """
        with self._lock:
            frames = self._cycle or of_one_exposure(list(self._angles.values()))
            angles = {f"{angle:g}": _shown(frame) for (angle, _), frame in sorted(self._angles.items())}
            if not frames:
                return LiveContent(angles=angles, regions={}, drift=self._region_drift())
            last, levels = frames[-1], self._levels
            dark = DarkLevel(source=levels.source(last.exposure_s), mean_dn=levels.dark_dn(PICTURE, last.exposure_s))
            return LiveContent(
                angles=angles,
                cycle=CyclePlace(round=last.round, cycle=last.cycle, exposure_ms=last.exposure_s * _MS_PER_S),
                dark=dark,
                sum_rule=sum_rule(frames, region=PICTURE, levels=levels),
                regions=self._regions(frames),
                drift=self._region_drift(),
                diagnosis=self._diagnosis(),
            )

    def _diagnosis(self) -> LiveDiagnosis | None:
        """Return what the last whole cycle says of its faults; made once for each."""
        if self._diagnosed[0] is not self._cycle:
            found = cycle_diagnosis(self._cycle, levels=self._levels, extinction_ratio=self._extinction_ratio)
            self._diagnosed = (self._cycle, found)
        return self._diagnosed[1]

    def _regions(self, frames: tuple[FrameSummary, ...]) -> dict[str, RegionPolarization]:
        found = {
            region: polarization(frames, region=region, levels=self._levels, extinction_ratio=self._extinction_ratio)
            for region in frames[-1].means
        }
        return {region: shown for region, shown in found.items() if shown is not None}

    def _region_drift(self) -> RegionDrift | None:
        if self._drift is None:
            return None
        return RegionDrift(
            region=self._reference,
            per_min=self._drift.per_min,
            sigma_per_min=self._drift.sigma_per_min,
            change=self._drift.change,
            over_s=self._drift.over_s,
        )


def _is_of_cycle(frame: FrameSummary, other: FrameSummary) -> bool:
    return (frame.round, frame.cycle) == (other.round, other.cycle)


def _shown(frame: FrameSummary) -> AngleNumbers:
    return AngleNumbers(
        mean_dn=frame.means[PICTURE].mean_dn,
        saturated_fraction=frame.saturated_fraction,
        exposure_ms=frame.exposure_s * _MS_PER_S,
        regions_dn={name: mean.mean_dn for name, mean in frame.means.items() if name != PICTURE},
    )
