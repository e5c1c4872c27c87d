"""The scene file: what the model is told of the scene and of the sensor, and how uncertain that is."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from rigctl.config import Fraction, NotNegative, Positive, Section, Uncertain, load
from rigctl.files.regions import Region, require_distinct
from rigctl.files.session_file import DEFAULT_ANGLES_DEG

StokesValues = tuple[Uncertain, Uncertain, Uncertain]
Row = tuple[float, float, float]


class SensorSection(Section):
    """Optics and sensor; efficiency and transmittance are those at the effective wavelength."""

    pixel_pitch_um: Positive
    f_number: Positive
    optics_transmittance: Fraction
    quantum_efficiency: Fraction
    wavelength_nm: Positive
    bit_depth: Annotated[int, Field(ge=8, le=16)]
    polarizer_transmittance: Fraction
    extinction_ratio: Positive

    @model_validator(mode="after")
    def _polarizes(self) -> "SensorSection":
        if self.extinction_ratio.value <= 1:
            raise ValueError(f"extinction_ratio is {self.extinction_ratio.value:g}, must be above 1")
        return self


class NoiseSection(Section):
    """The sensor's noise where no calibration is given. These numbers are assumed, and called so."""

    gain_dn_per_e: Positive
    read_noise_e: NotNegative
    dark_current_e_per_s: NotNegative
    black_level_dn: NotNegative
    prnu: NotNegative
    dsnu_e: NotNegative


class AcquisitionSection(Section):
    """How the frames are taken; `rigctl compare` takes these from the run instead."""

    exposure_ms: Annotated[float, Field(gt=0)]
    angles_deg: Annotated[tuple[float, ...], Field(min_length=3)] = DEFAULT_ANGLES_DEG
    cycles: Annotated[int, Field(ge=1)] = 1


class SceneRegion(Region):
    """A region and the radiance that comes from it to the aperture.

    `texture_rms` multiplies the whole Stokes vector of a pixel by one random factor; `texture_covariance` is
    a further covariance of the pixels' Stokes radiance. Both are of the surface, not of the sensor.
    """

    stokes_radiance: StokesValues
    texture_rms: NotNegative = Uncertain(value=0.0)
    texture_covariance: tuple[Row, Row, Row] | None = None

    @model_validator(mode="after")
    def _physical(self) -> "SceneRegion":
        s0, s1, s2 = (component.value for component in self.stokes_radiance)
        if s0 <= 0:
            raise ValueError(f"stokes_radiance has S0 = {s0:g}, must be above 0")
        if s1 * s1 + s2 * s2 > s0 * s0:
            raise ValueError(f"stokes_radiance ({s0:g}, {s1:g}, {s2:g}) has a degree of polarization above 1")
        return self


class SceneFile(Section):
    """What a scene file holds."""

    schema_version: Literal[1] = 1
    name: str
    sensor: SensorSection
    noise: NoiseSection
    acquisition: AcquisitionSection
    background_radiance: Annotated[float, Field(gt=0)]
    regions: Annotated[list[SceneRegion], Field(min_length=1)]

    @model_validator(mode="after")
    def _distinct_names(self) -> "SceneFile":
        require_distinct([region.name for region in self.regions])
        return self


def load_scene(path: Path) -> SceneFile:
    """Return the checked scene file."""
    return load(path, SceneFile)
