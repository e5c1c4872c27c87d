"""What is not known exactly of the rig that took a run, as inputs of a prediction."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.prediction.rig_errors import RigErrors
from model.sensor.imperfections import drifting_light
from rigctl.files.scene_file import RigSection, SceneFile
from rigctl.measurement.measurement import Measurement
from rigctl.scene.scene_inputs import Inputs, file_readout

OFFSET, EXPOSURE, DRIFT = "rig.polarizer_offset_deg", "rig.exposure_ratio", "rig.light_drift"
# Of a rig that is as recorded.
IDEAL_RIG = {OFFSET: 0.0, EXPOSURE: 1.0, DRIFT: 0.0}
# Before the name of each angle.
ANGLE = "rig.angle_deg."
_SIGNED = frozenset({OFFSET, DRIFT})


@dataclass(frozen=True, kw_only=True, eq=False)
class TakenCycle:
    """What of a cycle of frames the errors of a rig act on.

    Attributes
    ----------
    channel_names : tuple of str
        Of the angles, rising.
    order : (n,) array
        Place of each angle's frame in the cycle, from 0.
    offset_std_deg : float
        How well the rig file knows the polarizer's offset.
    exposure_std : float
        How well the scene file knows the exposure, as a share of it.
    """

    channel_names: tuple[str, ...]
    order: NDArray[np.intp]
    offset_std_deg: float = 0.0
    exposure_std: float = 0.0


def cycle_of_run(measurement: Measurement, scene: SceneFile) -> TakenCycle:
    """Return the cycle of a run."""
    return TakenCycle(
        channel_names=measurement.grid.channel_names,
        order=frame_order(measurement),
        offset_std_deg=_offset_std_deg(measurement),
        exposure_std=_exposure_std(scene),
    )


def cycle_of_file(scene: SceneFile) -> TakenCycle:
    """Return the cycle that a scene file states, for a prediction without a run."""
    in_time_deg = np.mod(scene.acquisition.angles_deg, 180.0)
    return TakenCycle(
        channel_names=file_readout(scene).channel_names,
        order=np.argsort(in_time_deg, kind="stable"),
        exposure_std=_exposure_std(scene),
    )


def with_rig(inputs: Inputs, section: RigSection, cycle: TakenCycle) -> Inputs:
    """Return the inputs with those of the rig: of the scene file, and of the rig file that the run holds.

    The errors of the offset in both files are taken as independent. Without any uncertainty nothing is added, unless
    the scene file states a number that is not that of an ideal rig.
    """
    offset, exposure, drift = section.polarizer_offset_deg, section.exposure_ratio, section.light_drift
    numbers = {
        OFFSET: (offset.value, float(np.hypot(offset.std, cycle.offset_std_deg))),
        EXPOSURE: (exposure.value, float(np.hypot(exposure.std, cycle.exposure_std * exposure.value))),
        DRIFT: (drift.value, drift.std),
    }
    numbers |= {name: (0.0, section.angle_std_deg) for name in _angle_names(cycle) if section.angle_std_deg > 0.0}
    values, deviations = (np.array(column) for column in zip(*numbers.values(), strict=True))
    if not np.any(deviations) and is_ideal(dict(zip(numbers, values.tolist(), strict=True))):
        return inputs
    signed = [name in _SIGNED or name.startswith(ANGLE) for name in numbers]
    cov = np.zeros((len(inputs.names) + len(numbers),) * 2)
    cov[: len(inputs.names), : len(inputs.names)] = inputs.cov
    cov[len(inputs.names) :, len(inputs.names) :] = np.diag(deviations**2)
    return replace(
        inputs,
        names=(*inputs.names, *numbers),
        values=np.concatenate([inputs.values, values]),
        cov=cov,
        least=np.concatenate([inputs.least, np.where(signed, -np.inf, 0.0)]),
    )


def is_ideal(values: Mapping[str, float]) -> bool:
    """Whether numbers, of which some may be a rig's, are those of a rig that is as recorded."""
    turned = any(value for name, value in values.items() if name.startswith(ANGLE))
    return not turned and all(values.get(name, ideal) == ideal for name, ideal in IDEAL_RIG.items())


def rig_errors(values: Mapping[str, float], cycle: TakenCycle) -> RigErrors | None:
    """Return the errors of the rig that the inputs state; None where they state a rig that is as recorded."""
    if is_ideal(values):
        return None
    single_deg = [values.get(name, 0.0) for name in _angle_names(cycle)]
    stated = IDEAL_RIG | dict(values)
    return RigErrors(
        turned_rad=np.deg2rad(np.array(single_deg) + stated[OFFSET]),
        exposure_ratio=stated[EXPOSURE],
        light_ratio=drifting_light(stated[DRIFT], cycle.order),
    )


def frame_order(measurement: Measurement) -> NDArray[np.intp]:
    """Return the place of each angle's frame in the first cycle, from 0."""
    sequence = [record.sequence for record in measurement.grid.records[0]]
    return np.argsort(np.argsort(sequence))


def _angle_names(cycle: TakenCycle) -> tuple[str, ...]:
    return tuple(f"{ANGLE}{name.removeprefix('dn_')}" for name in cycle.channel_names)


def _exposure_std(scene: SceneFile) -> float:
    return scene.acquisition.exposure_std_ms / scene.acquisition.exposure_ms


def _offset_std_deg(measurement: Measurement) -> float:
    """Return how well the rig file of the run knows the polarizer's offset; 0 where there is none, as of images."""
    return measurement.run.session.polarizer.offset_std_deg
