"""The scene frames of a run by cycle and polarizer angle."""

from collections import Counter, defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.quantities import counts_name
from rigctl.errors import DataError
from rigctl.numbers.angles import wrapped
from rigctl.runs.annotation_record import left_out_texts
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import Run

FloatArray = NDArray[np.float64]

# Targets are written with a few decimals at most; what is closer than this is one angle.
_ANGLE_DECIMALS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameGrid:
    """The scene frames of a run by cycle and angle.

    Attributes
    ----------
    records : tuple of tuple of FrameRecord
        records[cycle][angle], angles in ascending order.
    channel_names : tuple of str
        "dn_45" and so on, by the angle that was asked for, modulo 180 deg; a second frame at an angle within one
        cycle is "dn_45_2".
    target_angles_deg : (N,) array
        The angles that were asked for, modulo 180 deg; those of the readback where nobody asked [deg].
    polarizer_angles_rad : (N,) array
        By the stage's readback, the mean over the cycles [rad].
    exposures_s : (N,) array or None
        Exposure of each angle [s]; None where nobody knows and one shot gave all of them.
    left_out : tuple of str
        Frames that are not used, with the reason.
    """

    records: tuple[tuple[FrameRecord, ...], ...]
    channel_names: tuple[str, ...]
    target_angles_deg: FloatArray
    polarizer_angles_rad: FloatArray
    exposures_s: FloatArray | None
    left_out: tuple[str, ...]

    @property
    def frames(self) -> tuple[FrameRecord, ...]:
        """All of them, cycle by cycle."""
        return tuple(record for cycle in self.records for record in cycle)

    @property
    def cycles(self) -> int:
        """Number of whole cycles."""
        return len(self.records)

    @property
    def angles(self) -> int:
        """Number of frames of a cycle."""
        return len(self.channel_names)

    @property
    def width(self) -> int:
        """Columns of a picture."""
        return self.records[0][0].width

    @property
    def height(self) -> int:
        """Rows of a picture."""
        return self.records[0][0].height

    @property
    def is_one_exposure(self) -> bool:
        """All angles have the same exposure, so that counts can be compared as they are."""
        return self.exposures_s is None or bool(np.ptp(self.exposures_s) <= 1e-9 * self.exposures_s.max())

    @property
    def unit(self) -> str:
        """Unit of what is made of the counts."""
        return "DN" if self.is_one_exposure else "DN/s"

    @property
    def to_unit(self) -> FloatArray:
        """Factor from the counts of each angle to `unit`, shape (N,)."""
        if self.is_one_exposure or self.exposures_s is None:
            return np.ones(self.angles)
        return np.asarray(1.0 / self.exposures_s)


def arrange(run: Run) -> FrameGrid:
    """Return the scene frames of a run by cycle and angle.

    Raises
    ------
    DataError
        There are no scene frames, an angle is not known, sizes differ, or exposures are unknown for some only.
    """
    scene = [record for record in run.frames if record.kind == "scene"]
    _refuse_unusable(run, scene)
    # Cycles are counted over all frames that were taken: one that is excluded moves no other into its cycle.
    excluded = {
        one.sequence: one for one in run.excluded if one.kind == "scene" and one.polarizer_angle_deg is not None
    }
    by_cycle: dict[int, dict[str, FrameRecord]] = defaultdict(dict)
    for cycle, name, record in _named(sorted((*scene, *excluded.values()), key=lambda record: record.sequence)):
        if record.sequence not in excluded:
            by_cycle[cycle][name] = record
    sets = Counter(frozenset(channels) for channels in by_cycle.values())
    names = max(sets, key=lambda found: (len(found), sets[found]))
    whole = [by_cycle[cycle] for cycle in sorted(by_cycle) if frozenset(by_cycle[cycle]) == names]
    partial = [cycle for cycle in sorted(by_cycle) if frozenset(by_cycle[cycle]) != names]
    ordered = sorted(names, key=lambda name: (_target_deg(whole[0][name]), name))
    records = tuple(tuple(channels[name] for name in ordered) for channels in whole)
    return FrameGrid(
        records=records,
        channel_names=tuple(ordered),
        target_angles_deg=np.array([_target_deg(record) for record in records[0]]),
        polarizer_angles_rad=_mean_angles_rad(records),
        exposures_s=_exposures_s(run, records),
        left_out=(
            *left_out_texts(run.annotations, excluded.values()),
            *(f"cycle {cycle}: incomplete, {len(by_cycle[cycle].keys() & names)} of {len(names)}" for cycle in partial),
        ),
    )


def _refuse_unusable(run: Run, scene: list[FrameRecord]) -> None:
    if not scene:
        gone = sum(record.kind == "scene" for record in run.excluded)
        raise DataError(f"{run.path}: holds no scene frames{f': all {gone} are excluded' if gone else ''}")
    unknown = [record.file for record in scene if record.polarizer_angle_deg is None]
    sizes = {(record.width, record.height) for record in scene}
    problems = [f"the polarizer angle of {len(unknown)} frames is not known ({unknown[0]}, ...)"] if unknown else []
    if len(sizes) > 1:
        problems.append("frames differ in size: " + ", ".join(f"{w} x {h}" for w, h in sorted(sizes)))
    if problems:
        raise DataError(f"{run.path}: " + "; ".join(problems))


def _target_deg(record: FrameRecord) -> float:
    target = record.polarizer_angle_target_deg
    angle = record.polarizer_angle_deg if target is None else target
    return round((angle or 0.0) % 180.0, _ANGLE_DECIMALS) % 180.0


def _named(scene: list[FrameRecord]) -> list[tuple[int, str, FrameRecord]]:
    """Return each frame with its cycle and channel; without a cycle the n-th frame at an angle is of cycle n."""
    seen: Counter[tuple[int | None, float]] = Counter()
    found = []
    for record in scene:
        angle = _target_deg(record)
        before = seen[record.cycle, angle]
        seen[record.cycle, angle] += 1
        name = counts_name(f"{angle:g}")
        if record.cycle is None:
            found.append((before, name, record))
        else:
            found.append((record.cycle, name if before == 0 else f"{name}_{before + 1}", record))
    return found


def _mean_angles_rad(records: tuple[tuple[FrameRecord, ...], ...]) -> FloatArray:
    degrees = np.array([[record.polarizer_angle_deg for record in cycle] for cycle in records], dtype=np.float64)
    # An axis is the same after half a turn: average what is near the target, 179.998 deg as -0.002 beside 0.
    targets = np.array([_target_deg(record) for record in records[0]])
    near = targets + wrapped(degrees - targets, turn=180.0)
    return np.asarray(np.deg2rad(near.mean(axis=0)))


def _exposures_s(run: Run, records: tuple[tuple[FrameRecord, ...], ...]) -> FloatArray | None:
    known = {record.exposure_s is not None for cycle in records for record in cycle}
    if known == {False}:
        return None
    if len(known) == 2:
        raise DataError(f"{run.path}: the exposure of some scene frames is known and of others not")
    exposures = np.array([[record.exposure_s for record in cycle] for cycle in records], dtype=np.float64)
    if np.any(np.ptp(exposures, axis=0) > 1e-9 * exposures.max()):
        raise DataError(f"{run.path}: the exposure of an angle differs from cycle to cycle; this is not supported")
    return np.asarray(exposures[0])
