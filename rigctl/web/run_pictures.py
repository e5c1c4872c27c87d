"""Pictures of a run: which of its frames each shows, drawn once for all who look."""

from collections.abc import Sequence

import numpy as np

from rigctl.errors import DataError
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import Run
from rigctl.web.pictures import (
    MAP_WIDTH,
    MOST_WIDTH,
    CyclePictures,
    Picture,
    Shelf,
    map_pictures,
    picture_of,
    smaller,
)

MAPS = ("s0", "dolp", "aolp")
THUMB = "thumb"
_THUMB_WIDTH = 160
# A frame of an angle that is not among so many of the last is of an earlier take.
_RECENT = 64
_KEPT, _KEPT_CYCLES = 24, 2
_LEAST_ANGLES = 3


class RunPictures:
    """The newest pictures of a run, drawn when the first asks and kept for the next."""

    def __init__(self) -> None:
        self._drawn: Shelf[dict[str, Picture]] = Shelf(_KEPT)
        self._cycles: Shelf[CyclePictures] = Shelf(_KEPT_CYCLES)

    def newest_sequence(self, run: Run, name: str) -> int | None:
        """Return by which number a picture is told from a later one of that name; None where there is none."""
        if name in MAPS:
            cycle = last_cycle(run.frames)
            return cycle[-1].sequence if cycle else None
        found = _named(run.frames, name)
        return None if found is None else found.sequence

    def picture(self, run: Run, name: str, *, zebra: bool, dolp_top: float) -> Picture | None:
        """Return the newest picture of an angle or a map; None where there is none.

        Raises
        ------
        DataError
            A frame is damaged, or the angles do not determine the maps.
        """
        if name in MAPS:
            cycle = last_cycle(run.frames)
            return self._maps(run, cycle, dolp_top=dolp_top)[name] if cycle else None
        record = _named(run.frames, name)
        if record is None:
            return None
        width = _THUMB_WIDTH if name == THUMB else MOST_WIDTH
        key = ("frame", record.sequence, zebra, width)
        return self._drawn.kept(key, lambda: {"": _frame(run, record, zebra=zebra, most_width=width)})[""]

    def _maps(self, run: Run, cycle: Sequence[FrameRecord], *, dolp_top: float) -> dict[str, Picture]:
        sequences = tuple(record.sequence for record in cycle)
        frames = self._cycles.kept(sequences, lambda: _cycle(run, cycle))
        try:
            return self._drawn.kept(("maps", sequences, dolp_top), lambda: map_pictures(frames, dolp_top=dolp_top))
        except ValueError as error:
            raise DataError(f"{run.path}: no maps: {error}") from error


def last_cycle(frames: Sequence[FrameRecord]) -> tuple[FrameRecord, ...]:
    """Return the frames of the newest whole cycle, one for each angle; empty where there is none.

    Notes
    -----
    A cycle is whole once the next one has begun, or once it has as many angles as the one before. Where frames are
    grouped by angle, it is the newest frame of each.
    """
    scenes = [frame for frame in frames if frame.kind == "scene" and frame.polarizer_angle_deg is not None]
    cycles: dict[tuple[int | None, int | None], dict[str, FrameRecord]] = {}
    for frame in scenes:
        cycles.setdefault((frame.round, frame.cycle), {})[_angle_name(frame)] = frame
    most = max(map(len, cycles.values()), default=0)
    whole = [cycle for cycle in cycles.values() if len(cycle) == most]
    if most < _LEAST_ANGLES:
        return ()
    newest = max(whole, key=lambda cycle: max(frame.sequence for frame in cycle.values()))
    return tuple(sorted(newest.values(), key=lambda frame: frame.sequence))


def newest_by_name(frames: Sequence[FrameRecord]) -> dict[str, FrameRecord]:
    """Return the newest frame of each angle, and the newest dark and flat, by name."""
    found = {frame.kind: frame for frame in frames if frame.kind != "scene"}
    scenes = [frame for frame in frames if frame.kind == "scene"][-_RECENT:]
    return found | {_angle_name(frame): frame for frame in scenes}


def _named(frames: Sequence[FrameRecord], name: str) -> FrameRecord | None:
    newest = newest_by_name(frames)
    return next(iter(reversed(newest.values())), None) if name == THUMB else newest.get(name)


def _angle_name(frame: FrameRecord) -> str:
    angle_deg = frame.polarizer_angle_target_deg
    angle_deg = frame.polarizer_angle_deg if angle_deg is None else angle_deg
    return "scene" if angle_deg is None else f"{angle_deg:g}"


def _frame(run: Run, record: FrameRecord, *, zebra: bool, most_width: int) -> Picture:
    return picture_of(run.counts(record), saturation_dn=record.saturation_dn, most_width=most_width, zebra=zebra)


def _cycle(run: Run, cycle: Sequence[FrameRecord]) -> CyclePictures:
    ratio = run.session.polarizer.extinction_ratio
    return CyclePictures(
        frames=np.stack([smaller(run.counts(record), most_width=MAP_WIDTH) for record in cycle]),
        angles_rad=np.deg2rad([record.polarizer_angle_deg or 0.0 for record in cycle]),
        dark_dn=np.array([_dark_dn(run, record) for record in cycle]),
        extinction_ratio=np.inf if ratio is None else ratio,
    )


def _dark_dn(run: Run, record: FrameRecord) -> float:
    """Return the level without light: of the newest dark frame of that exposure, else of the camera's black level."""
    darks = [frame for frame in run.frames if frame.kind == "dark" and frame.exposure_s == record.exposure_s]
    if darks:
        return float(run.counts(darks[-1]).mean())
    return record.black_level_dn or 0.0
