"""What is not known exactly of the rig that took a run, as inputs of a prediction."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from model.rig_errors import RigErrors, drifting_light
from rigctl.comparison.scene_inputs import Inputs
from rigctl.files.scene_file import RigSection
from rigctl.measurement.measurement import Measurement

OFFSET, EXPOSURE, DRIFT = "rig.polarizer_offset_deg", "rig.exposure_ratio", "rig.light_drift"
# Before the name of each angle.
ANGLE = "rig.angle_deg."
_SIGNED = frozenset({OFFSET, DRIFT})


def with_rig(inputs: Inputs, section: RigSection, measurement: Measurement) -> Inputs:
    """Return the inputs with those of the rig: of the scene file, and of the rig file that the run holds.

    The errors of the offset in both files are taken as independent. Without any uncertainty nothing is added, unless
    the scene file states a number that is not that of an ideal rig.
    """
    offset, exposure, drift = section.polarizer_offset_deg, section.exposure_ratio, section.light_drift
    numbers = {
        OFFSET: (offset.value, float(np.hypot(offset.std, _offset_std_deg(measurement)))),
        EXPOSURE: (exposure.value, exposure.std),
        DRIFT: (drift.value, drift.std),
    }
    numbers |= {name: (0.0, section.angle_std_deg) for name in _angle_names(measurement) if section.angle_std_deg > 0.0}
    values, deviations = (np.array(column) for column in zip(*numbers.values(), strict=True))
    if not np.any(deviations) and np.array_equal(values, [0.0, 1.0, 0.0]):
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


def rig_errors(values: Mapping[str, float], measurement: Measurement) -> RigErrors | None:
    """Return the errors of the rig that the inputs state; None where none of them is an input."""
    if OFFSET not in values:
        return None
    single_deg = [values.get(name, 0.0) for name in _angle_names(measurement)]
    return RigErrors(
        turned_rad=np.deg2rad(np.array(single_deg) + values[OFFSET]),
        exposure_ratio=values[EXPOSURE],
        light_ratio=drifting_light(values[DRIFT], frame_order(measurement)),
    )


def frame_order(measurement: Measurement) -> NDArray[np.intp]:
    """Return the place of each angle's frame in the first cycle, from 0."""
    sequence = [record.sequence for record in measurement.grid.records[0]]
    return np.argsort(np.argsort(sequence))


def _angle_names(measurement: Measurement) -> tuple[str, ...]:
    return tuple(f"{ANGLE}{name.removeprefix('dn_')}" for name in measurement.grid.channel_names)


def _offset_std_deg(measurement: Measurement) -> float:
    """Return how well the rig file of the run knows the polarizer's offset; 0 where there is none, as of images."""
    polarizer = (measurement.run.session.get("rig") or {}).get("polarizer") or {}
    return float(polarizer.get("offset_std_deg") or 0.0)
