"""The cycle of frames of a run, as the errors of its rig act on it."""

import numpy as np
from numpy.typing import NDArray

from rigctl.files.scene_file import SceneFile
from rigctl.measurement.measurement import Measurement
from rigctl.scene.rig_inputs import TakenCycle, exposure_std


def cycle_of_run(measurement: Measurement, scene: SceneFile) -> TakenCycle:
    """Return the cycle of a run."""
    return TakenCycle(
        angle_names=tuple(name.removeprefix("dn_") for name in measurement.grid.channel_names),
        frame_order=tuple(frame_order(measurement).tolist()),
        offset_std_deg=_offset_std_deg(measurement),
        exposure_std=exposure_std(scene),
    )


def frame_order(measurement: Measurement) -> NDArray[np.intp]:
    """Return the place of each angle's frame in the first cycle, from 0."""
    sequence = [record.sequence for record in measurement.grid.records[0]]
    return np.argsort(np.argsort(sequence))


def _offset_std_deg(measurement: Measurement) -> float:
    """Return how well the rig file of the run knows the polarizer's offset; 0 where there is none, as of images."""
    return measurement.run.session.polarizer.offset_std_deg
