"""The frozen record of a scene: what file, materials, sun and calibration say, in the units of the file."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.surface.materials import Material
from rigctl.files.config import Uncertain
from rigctl.files.effect_sections import EffectsSection, ErrorsSection
from rigctl.files.light_sections import AtmosphereSection, FieldSection
from rigctl.files.place import GeometrySection
from rigctl.files.scene_file import AcquisitionSection, NoiseSection, SceneRegion, SensorSection

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Sun:
    """Position of the sun, and its irradiance outside the atmosphere over that at the mean distance.

    `azimuth_deg` is None where the file states phi alone.
    """

    zenith_deg: Uncertain
    azimuth_deg: Uncertain | None
    distance_factor: Uncertain


@dataclass(frozen=True, kw_only=True)
class Rig:
    """Errors of the rig that takes a cycle of frames, against what is recorded of it.

    Attributes
    ----------
    polarizer_offset_deg, exposure_ratio : Uncertain
        As in the scene file's [rig], with what the run's own files say of their uncertainty.
    angle_deg : tuple of Uncertain
        What each angle of the cycle is off on its own.
    angle_names : tuple of str
        Of these angles, such as "45".
    frame_order : tuple of int
        Place of each angle's frame in the cycle, from 0.
    """

    polarizer_offset_deg: Uncertain
    exposure_ratio: Uncertain
    angle_deg: tuple[Uncertain, ...]
    angle_names: tuple[str, ...]
    frame_order: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class SceneRegionRecord:
    """A region as the file has it, and its material at the sensor's wavelength; None where its radiance is given."""

    given: SceneRegion
    material: Material | None

    @property
    def name(self) -> str:
        """Name of the region."""
        return self.given.name


@dataclass(frozen=True, kw_only=True, eq=False)
class JointErrors:
    """Covariance of parameters that are off together, in the units of the file.

    Attributes
    ----------
    keys : tuple of str
        Of the parameters.
    covariance : (k, k) array
        Of their errors.
    """

    keys: tuple[str, ...]
    covariance: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """A scene, its sensor and its rig; `rigctl.scene.parameters` reads and sets every number of it by its key.

    Attributes
    ----------
    sensor : SensorSection
        With the effective wavelength.
    noise : NoiseSection
        A calibration's numbers in place of those of the file.
    sun : Sun or None
        By its angles, however the file states it.
    rig : Rig or None
        None where no cycle of frames is given yet.
    joint_errors : tuple of JointErrors
        Of what is off together; all other errors are independent.
    remarks : tuple of str
        What is assumed, and what was set aside, in words.
    """

    name: str
    sensor: SensorSection
    noise: NoiseSection
    acquisition: AcquisitionSection
    regions: tuple[SceneRegionRecord, ...]
    errors: ErrorsSection
    effects: EffectsSection
    sun: Sun | None = None
    geometry: GeometrySection | None = None
    atmosphere: AtmosphereSection | None = None
    field_of_view: FieldSection | None = None
    rig: Rig | None = None
    joint_errors: tuple[JointErrors, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def has_materials(self) -> bool:
        """True if any region's light is to be computed."""
        return any(region.material is not None for region in self.regions)

    @property
    def exposure_s(self) -> float:
        """Exposure of a frame as the file has it [s]."""
        return self.acquisition.exposure_ms / 1000.0
