"""Curves of a run cycle by cycle, read from its frames in the background while somebody looks."""

import threading
import time
from collections.abc import Sequence
from dataclasses import replace

from rigctl.errors import ConfigError, DataError
from rigctl.files.session_file import PICTURE
from rigctl.live.cycle_history import CycleLook, Means, cycle_history
from rigctl.live.region_means import PixelMean, RegionMeans
from rigctl.runs.annotation_record import excluded_frames, exclusions_text
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import Run
from rigctl.runs.run_inputs import files_of
from rigctl.web.run_look import Curves, RegionCurve

# Whoever looks asks again each second: after this, nobody does, and nothing more is read.
_LOOKED_S = 10.0
_PERCENT = 100.0


class HistoryReader:
    """Takes the mean counts of every frame, the newest first, in a thread of its own."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._means: dict[int, dict[str, PixelMean]] = {}
        self._run: Run | None = None
        self._asked_s = 0.0
        self._thread: threading.Thread | None = None
        self._problem = ""

    @property
    def problem(self) -> str:
        """What cannot be read; empty where all can."""
        return self._problem

    def curves(self, run: Run) -> Curves:
        """Return the curves so far, and read on."""
        with self._lock:
            self._run, self._asked_s = run, time.monotonic()
            means: Means = dict(self._means)
            if self._thread is None or not self._thread.is_alive():
                self._thread = threading.Thread(target=self._work, name="history", daemon=True)
                self._thread.start()
        if not run.session.is_of_session or self._problem:
            return Curves(frames_there=len(run.frames), left_out=_left_out(run))
        read = tuple(record for record in run.frames if record.sequence in means)
        looks = cycle_history(replace(run, frames=read), means).looks
        return replace(_curves(looks, read, frames_there=len(run.frames)), left_out=_left_out(run))

    def _work(self) -> None:
        regions: RegionMeans | None = None
        while True:
            with self._lock:
                run = self._run
                is_over = time.monotonic() - self._asked_s > _LOOKED_S
            if run is None or is_over or self._problem:
                return
            record = next((r for r in reversed(run.frames) if r.sequence not in self._means), None)
            if record is None:
                time.sleep(0.2)
                continue
            try:
                regions = regions or RegionMeans(files_of(run)[1].regions if run.session.is_of_session else ())
                means = regions.of(run.counts(record))
            except (DataError, ConfigError) as error:
                self._problem = str(error)
                return
            with self._lock:
                self._means[record.sequence] = means


def _left_out(run: Run) -> str:
    return exclusions_text(excluded_frames(run.annotations)) if run.excluded else ""


def _curves(looks: Sequence[CycleLook], frames: Sequence[FrameRecord], *, frames_there: int) -> Curves:
    suns = {(frame.round, frame.cycle): frame.sun_elevation_deg for frame in frames}
    elevations = [suns.get((look.round, look.cycle)) for look in looks]
    names = sorted({name for look in looks for name in look.regions}, key=lambda name: (name == PICTURE, name))
    return Curves(
        time_s=tuple(look.time_s for look in looks),
        sun_zenith_deg=tuple(None if elevation is None else 90.0 - elevation for elevation in elevations),
        sum_rule=tuple(None if look.sum_rule is None else look.sum_rule.value for look in looks),
        drift_percent_per_min=tuple(None if look.drift is None else _PERCENT * look.drift.per_min for look in looks),
        regions=tuple(_curve(name, looks) for name in names),
        frames_read=len(frames),
        frames_there=frames_there,
    )


def _curve(name: str, looks: Sequence[CycleLook]) -> RegionCurve:
    seen = [look.regions.get(name) for look in looks]
    return RegionCurve(
        name=name,
        dolp=tuple(None if one is None else one.dolp.value for one in seen),
        dolp_std=tuple(None if one is None else one.dolp.sigma for one in seen),
        aolp_deg=tuple(None if one is None else one.aolp_deg for one in seen),
        aolp_std_deg=tuple(None if one is None else one.aolp_sigma_deg for one in seen),
        light_dn_per_s=tuple(None if one is None else one.light_dn_per_s for one in seen),
    )
