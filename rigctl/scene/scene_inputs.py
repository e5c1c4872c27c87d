"""The numbers that a prediction rests on, with their covariance."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.scene.parameter_table import ANGLE, EXPOSURE
from rigctl.scene.parameters import Parameter, parameters, with_values
from rigctl.scene.rig_inputs import is_as_recorded
from rigctl.scene.scene_record import Scene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Inputs:
    """Every number that a prediction rests on, k of them.

    Attributes
    ----------
    scene : Scene
        Whose numbers they are.
    names : tuple of str
        Keys, such as "regions.black_panel.stokes_radiance.0".
    values : (k,) array
        In the units of the file.
    cov : (k, k) array
        Their covariance.
    least, most : (k,) arrays
        Between which numbers each has to stay; infinite where there is no limit.
    remarks : tuple of str
        What is assumed, and what was set aside, in words.
    fitted : tuple of str
        Those that were fitted so that they make up for others: their covariance with these holds to first order.
    """

    scene: Scene
    names: tuple[str, ...]
    values: FloatArray
    cov: FloatArray
    least: FloatArray
    most: FloatArray
    remarks: tuple[str, ...]
    fitted: tuple[str, ...] = ()

    def at(self, values: FloatArray) -> Scene:
        """Return the scene with other numbers in the place of these."""
        return with_values(self.scene, dict(zip(self.names, values.tolist(), strict=True)))

    def of(self, key: str) -> float:
        """Return the value of one of them."""
        return float(self.values[self.names.index(key)])


def gather(scene: Scene) -> Inputs:
    """Return the numbers of a scene with their covariance; of a rig that is exactly as recorded there are none."""
    found = [parameter for parameter in parameters(scene) if _is_input(scene, parameter)]
    return Inputs(
        scene=scene,
        names=tuple(parameter.key for parameter in found),
        values=np.array([parameter.value for parameter in found]),
        cov=_covariance(scene, found),
        least=np.array([parameter.least for parameter in found]),
        most=np.array([parameter.most for parameter in found]),
        remarks=scene.remarks,
    )


def _is_input(scene: Scene, parameter: Parameter) -> bool:
    if parameter.key.startswith(ANGLE) and parameter.std == 0.0:
        return False
    if parameter.key.startswith("rig."):
        return scene.rig is not None and not is_as_recorded(scene.rig)
    # What is not known of the exposure is in rig.exposure_ratio.
    return parameter.key != EXPOSURE


def only_uncertain(inputs: Inputs) -> Inputs:
    """Return the inputs that have an uncertainty."""
    kept = np.flatnonzero(np.diag(inputs.cov) > 0.0)
    return replace(
        inputs,
        names=tuple(inputs.names[k] for k in kept),
        values=inputs.values[kept],
        cov=inputs.cov[np.ix_(kept, kept)],
        least=inputs.least[kept],
        most=inputs.most[kept],
    )


def _covariance(scene: Scene, found: list[Parameter]) -> FloatArray:
    cov = np.diag([parameter.std**2 for parameter in found])
    places = {parameter.key: k for k, parameter in enumerate(found)}
    for joint in scene.joint_errors:
        there = [places[key] for key in joint.keys]
        cov[np.ix_(there, there)] = joint.covariance
    return cov
