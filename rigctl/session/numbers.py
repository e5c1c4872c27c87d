"""Live numbers of a session: means, level of light, sum rule, drift and DoLP with standard deviations.

They are fast enough to be computed for every frame. Results for processing come from `rigctl.measure`.
"""

import math
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments
from model.processing import dolp
from model.processing.reconstruction import aolp_moments_rad, design, stokes_moments
from model.sensor import SensorNoise, temporal_variance_dn2
from model.stokes import aolp_rad
from model.stokes import dolp as degree_of_polarization
from rigctl.calibrations.noise import NoiseParameters
from rigctl.errors import ConfigError
from rigctl.files.regions import Region, masks
from rigctl.files.session_file import PICTURE
from rigctl.measure.faults import Fault
from rigctl.runs.records import FrameRecord, SessionNoise
from rigctl.session.status import (
    AngleNumbers,
    DarkSource,
    Estimate,
    LiveContent,
    LiveDiagnosis,
    RegionDrift,
    RegionPolarization,
)

_NEEDED = ("gain_dn_per_e", "read_noise_e", "black_level_dn")
_ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
_LEAST_ANGLES = 3
# With a larger share of saturated pixels, means say little.
_MOST_SATURATED = 0.01
# Number of squares from which a cycle is diagnosed while the session runs.
_COARSE_PIXELS = 20_000
# Relative tolerance of live standard deviations: three digits are enough.
_TOLERANCE = 1e-3
_S_PER_MIN, _MS_PER_S = 60.0, 1000.0

# Level of light: counts above dark per second of exposure [DN/s], and their variance by noise [(DN/s)^2], None without
# a calibration.
Level = tuple[float, float | None]


@dataclass(frozen=True, kw_only=True)
class PixelMean:
    """Mean count of some pixels [DN], and their number."""

    mean_dn: float
    pixels: int


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameSummary:
    """A frame in a few numbers."""

    kind: str  #: "scene", "dark" or "flat".
    round: int | None
    cycle: int | None
    angle_deg: float | None  #: Requested polarizer angle, in [0, 180).
    measured_deg: float | None  #: Polarizer angle by the stage's readback.
    exposure_s: float
    time_s: float  #: Start of the exposure, by one clock for all frames that are compared.
    saturated_fraction: float  #: Share of saturated pixels.
    means: Mapping[str, PixelMean]  #: Of the picture and of its regions, by name.
    #: Mean counts of about 20000 squares of pixels (NaN if a pixel is saturated or missing), and the side of a square.
    coarse: tuple[NDArray[np.float32], int] | None = None


class LiveNumbers:
    """The last frame of each angle, and the last complete cycle. Filled in one thread, read in another."""

    def __init__(
        self, *, noise: SessionNoise | None = None, extinction_ratio: float | None = None, reference: str = PICTURE
    ) -> None:
        self._lock = threading.Lock()
        self._levels = LightLevels(noise)
        self._extinction_ratio = extinction_ratio
        self._reference = reference
        self._angles: dict[tuple[float, float], FrameSummary] = {}
        self._under_way: list[FrameSummary] = []
        self._cycle: tuple[FrameSummary, ...] = ()
        self._drift: RegionDrift | None = None
        self._diagnosed: tuple[tuple[FrameSummary, ...], LiveDiagnosis | None] = ((), None)

    def add(self, frame: FrameSummary, *, ends_cycle: bool) -> RegionDrift | None:
        """Add a frame; return the drift of the light at the end of a cycle, if it is known."""
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

    def _end_cycle(self) -> RegionDrift | None:
        before = self._cycle if self._cycle and self._cycle[-1].round == self._under_way[-1].round else ()
        self._cycle, self._under_way = of_one_exposure(self._under_way), []
        self._drift = drift_of(self._cycle, before, region=self._reference, levels=self._levels)
        return self._drift

    def content(self) -> LiveContent:
        """Return the numbers of the last complete cycle, or of the last frame of each angle if frames are grouped.

        They are computed from a copy, because the session adds frames meanwhile.
        """
        with self._lock:
            cycle, drift, seen, levels = self._cycle, self._drift, dict(self._angles), self._levels.copy()
        frames = cycle or of_one_exposure(list(seen.values()))
        angles = {f"{angle:g}": _shown(frame) for (angle, _), frame in sorted(seen.items())}
        if not frames:
            return LiveContent(angles=angles, regions={}, drift=drift)
        if self._diagnosed[0] is not cycle:  # computed once per cycle
            found = cycle_diagnosis(cycle, levels=levels, extinction_ratio=self._extinction_ratio)
            self._diagnosed = (cycle, found)
        last = frames[-1]
        return LiveContent(
            angles=angles,
            cycle={"round": last.round, "cycle": last.cycle, "exposure_ms": last.exposure_s * _MS_PER_S},
            dark={"source": levels.source(last.exposure_s), "mean_dn": levels.dark_dn(PICTURE, last.exposure_s)},
            sum_rule=sum_rule(frames, region=PICTURE, levels=levels),
            regions=polarizations(frames, levels=levels, extinction_ratio=self._extinction_ratio),
            drift=drift,
            diagnosis=self._diagnosed[1],
        )


class RegionMeans:
    """Means over the regions of a picture; the pixels of each region are found once per picture size."""

    def __init__(self, regions: Sequence[Region] = ()) -> None:
        self._regions = list(regions)
        self._shape: tuple[int, ...] = ()
        self._windows: dict[str, tuple[slice, slice, NDArray[np.bool_]]] = {}

    def of(self, counts: NDArray[np.uint16], *, share: float = 1.0) -> dict[str, PixelMean]:
        """Return the mean of the whole picture and of each region, by name."""
        import cv2

        if counts.shape != self._shape:
            self._windows = self._fitted(counts.shape)
            self._shape = counts.shape
        mean_dn = cv2.sumElems(counts)[0] / counts.size
        means = {PICTURE: PixelMean(mean_dn=mean_dn, pixels=max(1, round(share * counts.size)))}
        for name, (rows, columns, inside) in self._windows.items():
            values = counts[rows, columns][inside]
            means[name] = PixelMean(mean_dn=float(values.mean()), pixels=max(1, round(share * values.size)))
        return means

    def _fitted(self, shape: tuple[int, ...]) -> dict[str, tuple[slice, slice, NDArray[np.bool_]]]:
        height, width = shape
        found = masks(self._regions, width=width, height=height) if self._regions else {}
        return {name: _window(mask) for name, mask in found.items()}


def frame_summary(
    record: FrameRecord,
    means: Mapping[str, PixelMean],
    *,
    time_s: float,
    saturated_fraction: float,
    coarse: tuple[NDArray[np.float32], int] | None = None,
) -> FrameSummary:
    """Return the summary of a frame, from its record and the means of its counts."""
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


def coarse_picture(counts: NDArray[np.uint16], record: FrameRecord) -> tuple[NDArray[np.float32], int]:
    """Return the mean counts of about 20000 squares of pixels of a frame, and the side of a square."""
    import cv2

    height, width = counts.shape
    side = max(1, math.ceil(math.sqrt(height * width / _COARSE_PIXELS)))
    counts, size = counts[: height - height % side, : width - width % side], (width // side, height // side)
    full_dn = math.ceil(record.saturation_dn)  # an integer: comparing with a float would convert the picture
    bad = counts >= full_dn if counts.max() >= full_dn else np.zeros(1, dtype=np.bool_)
    if record.missing_dn is not None:
        bad = bad | (counts == record.missing_dn)
    strips = (counts[row : row + side] for row in range(0, len(counts), side))
    sums = np.concatenate([cv2.reduce(strip, 0, cv2.REDUCE_SUM, dtype=cv2.CV_32F) for strip in strips])
    means = cv2.resize(sums, size, interpolation=cv2.INTER_AREA) / np.float32(side)
    if bad.any():
        means[cv2.resize(bad.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.0] = np.nan
    return np.asarray(means, dtype=np.float32), side


def of_one_exposure(frames: Sequence[FrameSummary]) -> tuple[FrameSummary, ...]:
    """Return the frames of the longest exposure without a saturated frame; of the shortest if all have one."""
    exposures_s = sorted({frame.exposure_s for frame in frames}, reverse=True)
    for exposure_s in exposures_s:
        alike = tuple(frame for frame in frames if frame.exposure_s == exposure_s)
        if all(frame.saturated_fraction <= _MOST_SATURATED for frame in alike) or exposure_s == exposures_s[-1]:
            return alike
    return ()


class LightLevels:
    """Dark levels: the last dark frame of each exposure, or the noise calibration."""

    def __init__(self, noise: SessionNoise | None = None) -> None:
        self._noise = noise
        self._darks: dict[float, FrameSummary] = {}

    def copy(self) -> "LightLevels":
        """Return a copy."""
        levels = LightLevels(self._noise)
        levels._darks = dict(self._darks)
        return levels

    def add_dark(self, dark: FrameSummary) -> None:
        """Add a dark frame."""
        self._darks[dark.exposure_s] = dark

    def source(self, exposure_s: float) -> DarkSource:
        """Return where the dark level at an exposure comes from."""
        if exposure_s in self._darks:
            return DarkSource.FRAMES
        return DarkSource.UNKNOWN if self._noise is None else DarkSource.CALIBRATION

    def dark_dn(self, region: str, exposure_s: float) -> float:
        """Return the mean count of a region without light [DN]; 0 if it is not known."""
        dark = self._darks.get(exposure_s)
        if dark is not None:
            return dark.means[region].mean_dn
        return 0.0 if self._noise is None else dark_level_dn(self._noise, exposure_s)

    def level(self, frame: FrameSummary, region: str) -> Level:
        """Return the level of the light in a region of a frame."""
        mean, exposure_s = frame.means[region], frame.exposure_s
        light = (mean.mean_dn - self.dark_dn(region, exposure_s)) / exposure_s
        if self._noise is None:
            return light, None
        return light, mean_variance_dn2(self._noise, mean, exposure_s) / exposure_s**2


def drift_of(
    frames: Sequence[FrameSummary], before: Sequence[FrameSummary], *, region: str, levels: LightLevels
) -> RegionDrift | None:
    """Return the drift of the light: within a cycle that repeats an angle, otherwise since the previous cycle.

    It is the sum of the changes of all angles over the sum of their means. Polarization cancels, because each angle is
    compared with itself.
    """
    pairs = list(_pairs(frames, frames)) or list(_pairs(before, frames))
    looks = [(*levels.level(one, region), *levels.level(two, region), two.time_s - one.time_s) for one, two in pairs]
    light = sum((one + two) / 2.0 for one, _, two, _, _ in looks)
    light_s = sum((one + two) / 2.0 * time_s for one, _, two, _, time_s in looks)
    if light <= 0.0 or light_s <= 0.0:
        return None
    variance = _sum_known([look[place] for look in looks for place in (1, 3)])
    change, over_s = sum(two - one for one, _, two, _, _ in looks) / light, light_s / light
    return RegionDrift(
        region=region,
        per_min=change / over_s * _S_PER_MIN,
        sigma_per_min=None if variance is None else math.sqrt(variance) / light / over_s * _S_PER_MIN,
        change=change,
        over_s=over_s,
    )


def sum_rule(frames: Sequence[FrameSummary], *, region: str, levels: LightLevels) -> Estimate | None:
    """Return (I0 + I90) / (I45 + I135), which should be 1; None without all four angles, or without light."""
    found: dict[float, Level] = {}
    for frame in frames:
        if frame.angle_deg in _ANGLES_DEG:
            found.setdefault(frame.angle_deg, levels.level(frame, region))
    if len(found) < len(_ANGLES_DEG):
        return None
    (i0, var0), (i45, var45), (i90, var90), (i135, var135) = (found[angle] for angle in _ANGLES_DEG)
    if i45 + i135 <= 0.0:
        return None
    ratio = (i0 + i90) / (i45 + i135)
    of_upper, of_lower = _sum_known([var0, var90]), _sum_known([var45, var135])
    if of_upper is None or of_lower is None:
        return Estimate(value=ratio, sigma=None)
    return Estimate(value=ratio, sigma=math.sqrt(of_upper + ratio**2 * of_lower) / (i45 + i135))


def polarizations(
    frames: Sequence[FrameSummary], *, levels: LightLevels, extinction_ratio: float | None
) -> dict[str, RegionPolarization]:
    """Return the polarization of each region of a cycle for which it can be computed."""
    found = {
        region: polarization(frames, region=region, levels=levels, extinction_ratio=extinction_ratio)
        for region in frames[-1].means
    }
    return {region: shown for region, shown in found.items() if shown is not None}


def polarization(
    frames: Sequence[FrameSummary], *, region: str, levels: LightLevels, extinction_ratio: float | None
) -> RegionPolarization | None:
    """Return the polarization of a region's mean light in a cycle; None with fewer than three angles, or no light.

    The standard deviation includes the noise of one cycle, but not drift, fixed pattern or errors of the angles.
    """
    seen = [frame for frame in frames if frame.measured_deg is not None]
    if len({frame.angle_deg for frame in seen}) < _LEAST_ANGLES:
        return None
    angles_rad = np.deg2rad([frame.measured_deg or 0.0 for frame in seen])
    found = [levels.level(frame, region) for frame in seen]
    plan = design(angles_rad, np.inf if extinction_ratio is None else extinction_ratio)
    variances = np.diag([variance or 0.0 for _, variance in found])
    stokes = stokes_moments(plan, Moments(mean=np.array([light for light, _ in found]), cov=variances))
    if stokes.mean[0] <= 0.0:
        return None
    degree = float(degree_of_polarization(stokes.mean))
    return RegionPolarization(
        dolp=Estimate(value=degree, sigma=_sigma(stokes) if variances.any() else None),
        aolp_deg=float(np.rad2deg(aolp_rad(stokes.mean))) if degree > 0.0 else None,
        light_dn_per_s=float(stokes.mean[0]),
        aolp_sigma_deg=_angle_sigma_deg(stokes) if degree > 0.0 and variances.any() else None,
    )


def cycle_diagnosis(
    frames: Sequence[FrameSummary], *, levels: LightLevels, extinction_ratio: float | None
) -> LiveDiagnosis | None:
    """Return the faults that the coarse pictures of a complete cycle show; None without such pictures."""
    seen = [frame for frame in frames if frame.measured_deg is not None]
    coarse = [frame.coarse for frame in seen if frame.coarse is not None]
    if not coarse or len(coarse) < len(seen) or len({frame.angle_deg for frame in seen}) < _LEAST_ANGLES:
        return None
    dark_dn = levels.dark_dn(PICTURE, seen[0].exposure_s)
    pictures = np.array([counts_dn for counts_dn, _ in coarse], dtype=np.float64) - dark_dn
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
        side_pixels=coarse[0][1],
    )
    terms = tuple(Fault(**{key.name: getattr(term, key.name) for key in fields(Fault)}) for term in found.named)
    return LiveDiagnosis(terms=terms, first=None if found.first is None else found.first.name, reason=found.reason)


def noise_numbers(calibration: NoiseParameters) -> SessionNoise:
    """Return the numbers of a noise calibration that a session needs and stores in the run."""
    missing = [name for name in _NEEDED if name not in calibration.known]
    if missing:
        raise ConfigError(
            f"--noise: the calibration has no {', '.join(missing)} (not determined); calibrate with dark frames"
        )
    sensor = calibration.sensor_noise()
    return SessionNoise(
        gain_dn_per_e=sensor.gain_dn_per_e,
        read_noise_e=sensor.read_noise_e,
        black_level_dn=sensor.black_level_dn,
        dark_current_e_per_s=sensor.dark_current_e_per_s,
    )


def dark_level_dn(noise: SessionNoise, exposure_s: float) -> float:
    """Return the mean count without light [DN]."""
    return noise.black_level_dn + noise.gain_dn_per_e * noise.dark_current_e_per_s * exposure_s


def mean_variance_dn2(noise: SessionNoise, mean: PixelMean, exposure_s: float) -> float:
    """Return the temporal variance of a mean count [DN^2], without fixed pattern."""
    signal_dn = max(0.0, mean.mean_dn - dark_level_dn(noise, exposure_s))
    sensor = SensorNoise(**asdict(noise))
    return float(temporal_variance_dn2(signal_dn, noise=sensor, exposure_s=exposure_s)) / mean.pixels


def _window(mask: NDArray[np.bool_]) -> tuple[slice, slice, NDArray[np.bool_]]:
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    along_y, along_x = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return along_y, along_x, mask[along_y, along_x]


def _pairs(
    earlier: Sequence[FrameSummary], later: Sequence[FrameSummary]
) -> Iterator[tuple[FrameSummary, FrameSummary]]:
    """Yield pairs of frames at one angle: the first among the earlier frames, and the last among the later ones."""
    first: dict[float | None, FrameSummary] = {}
    for frame in earlier:
        first.setdefault(frame.angle_deg, frame)
    last = {frame.angle_deg: frame for frame in later}
    for angle, one in first.items():
        two = last.get(angle)
        if two is not None and two.time_s > one.time_s:
            yield one, two


def _sum_known(variances: Sequence[float | None]) -> float | None:
    """Return the sum of variances; None if one is unknown."""
    known = [variance for variance in variances if variance is not None]
    return sum(known) if len(known) == len(variances) else None


def _sigma(stokes: Moments) -> float | None:
    """Return the deviation of DoLP; None where it does not exist."""
    sigma = float(dolp.moments(stokes.mean, stokes.cov, tolerance=_TOLERANCE).std)
    return sigma if math.isfinite(sigma) else None


def _angle_sigma_deg(stokes: Moments) -> float | None:
    sigma = float(np.rad2deg(np.sqrt(aolp_moments_rad(stokes).cov[0, 0])))
    return sigma if math.isfinite(sigma) else None


def _is_of_cycle(frame: FrameSummary, other: FrameSummary) -> bool:
    return (frame.round, frame.cycle) == (other.round, other.cycle)


def _shown(frame: FrameSummary) -> AngleNumbers:
    return AngleNumbers(
        mean_dn=frame.means[PICTURE].mean_dn,
        saturated_fraction=frame.saturated_fraction,
        exposure_ms=frame.exposure_s * _MS_PER_S,
        regions_dn={name: mean.mean_dn for name, mean in frame.means.items() if name != PICTURE},
    )
