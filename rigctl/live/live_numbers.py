"""Numbers of the frames as they come, by angle and by cycle: for whoever watches, not for processing."""

import threading

from rigctl.files.session_file import PICTURE
from rigctl.live.cycle_numbers import cycle_diagnosis, polarization, sum_rule
from rigctl.live.drift import Drift, drift_of
from rigctl.live.frame_summary import FrameSummary, of_one_exposure
from rigctl.live.light_levels import LightLevels
from rigctl.live.live_status import (
    AngleNumbers,
    CyclePlace,
    DarkLevel,
    LiveContent,
    LiveDiagnosis,
    RegionDrift,
    RegionPolarization,
)
from rigctl.live.mean_noise import MeanNoise

_MS_PER_S = 1000.0


class LiveNumbers:
    """Remembers the last frame of each angle, and the last whole cycle. Filled in one thread, read in another.

    Parameters
    ----------
    noise : MeanNoise or None
        From a calibration; without one no deviation is predicted.
    extinction_ratio : float or None
        Of the polarizer; None is taken for an ideal one.
    reference : str
        The region by which drift is measured.
    """

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

        Notes
        -----
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
