"""Errors of the rig that takes a cycle of frames, as part of a scene."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from model.prediction import RigErrors
from rigctl.files.config import Uncertain
from rigctl.scene.scene_record import Rig, Scene

if TYPE_CHECKING:
    from rigctl.files.scene_file import RigSection, SceneFile


@dataclass(frozen=True, kw_only=True)
class TakenCycle:
    """A cycle of frames, as far as the errors of a rig act on it.

    Attributes
    ----------
    angle_names : tuple of str
        Of the polarizer angles, rising, such as "45".
    frame_order : tuple of int
        Place of each angle's frame in the cycle, from 0.
    offset_std_deg : float
        How well the rig file knows the polarizer's offset.
    exposure_std : float
        How well the scene file knows the exposure, as a share of it.
    """

    angle_names: tuple[str, ...]
    frame_order: tuple[int, ...]
    offset_std_deg: float = 0.0
    exposure_std: float = 0.0


def cycle_of_file(scene: "SceneFile") -> TakenCycle:
    """Return the cycle that a scene file states, for a prediction without a run."""
    in_time_deg = np.mod(scene.acquisition.angles_deg, 180.0)
    return TakenCycle(
        angle_names=tuple(f"{angle:g}" for angle in np.sort(in_time_deg)),
        frame_order=tuple(np.argsort(in_time_deg, kind="stable").tolist()),
        exposure_std=exposure_std(scene),
    )


def exposure_std(scene: "SceneFile") -> float:
    """Return how well a scene file knows the exposure, as a share of it."""
    return scene.acquisition.exposure_std_ms / scene.acquisition.exposure_ms


def with_rig(scene: Scene, section: "RigSection", cycle: TakenCycle) -> Scene:
    """Return the scene with the rig that takes a cycle: of the scene file, and of the rig file that the run holds.

    The errors of the offset in both files are taken as independent, those of exposure and ratio too.
    """
    offset, exposure = section.polarizer_offset_deg, section.exposure_ratio
    rig = Rig(
        polarizer_offset_deg=_widened(offset, cycle.offset_std_deg),
        exposure_ratio=_widened(exposure, cycle.exposure_std * exposure.value),
        angle_deg=tuple(Uncertain(value=0.0, std=section.angle_std_deg) for _ in cycle.angle_names),
        angle_names=cycle.angle_names,
        frame_order=cycle.frame_order,
    )
    return replace(scene, rig=rig)


def is_ideal(rig: Rig) -> bool:
    """Return True if a rig is as recorded, as far as the values go."""
    turned = any(angle.value for angle in (rig.polarizer_offset_deg, *rig.angle_deg))
    return not turned and rig.exposure_ratio.value == 1.0


def is_as_recorded(rig: Rig) -> bool:
    """Return True if a rig is exactly as recorded: ideal, and without any uncertainty."""
    stated = (rig.polarizer_offset_deg, rig.exposure_ratio, *rig.angle_deg)
    return is_ideal(rig) and not any(number.std for number in stated)


def rig_errors(scene: Scene) -> RigErrors | None:
    """Return the errors of the rig of a scene; None where it is as recorded."""
    rig = scene.rig
    if rig is None or is_ideal(rig):
        return None
    single_deg = np.array([angle.value for angle in rig.angle_deg])
    return RigErrors(
        turned_rad=np.deg2rad(single_deg + rig.polarizer_offset_deg.value),
        exposure_ratio=rig.exposure_ratio.value,
    )


def _widened(number: Uncertain, std: float) -> Uncertain:
    return Uncertain(value=number.value, std=float(np.hypot(number.std, std)))
