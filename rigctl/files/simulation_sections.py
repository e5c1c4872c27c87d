"""What a simulated rig is made of: polarizer, camera, and the effects that its pictures go through beside."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AwareDatetime, Field, PrivateAttr, model_validator

from rigctl.files.choices import RoofChange
from rigctl.files.config import Section

# Pixels along a side of a picture: beyond any sensor.
LARGEST_SIDE = 20_000
# Further off, no lens of this kind shows anything [mm].
MOST_DEFOCUS_MM = 5.0

NotNegativeNumber = Annotated[float, Field(ge=0)]
PositiveNumber = Annotated[float, Field(gt=0)]
FractionNumber = Annotated[float, Field(gt=0, le=1)]


class PointSpreadSection(Section):
    """A blur by a Gaussian."""

    effect: Literal["point-spread"]
    """A blur by a Gaussian. Example: `"point-spread"`."""
    sigma_px: PositiveNumber
    """Deviation of the Gaussian. Example: `0.8`."""


class VignettingSection(Section):
    """The fourth power of the cosine of the field angle, which follows from focal length and pixel pitch."""

    effect: Literal["vignetting"]
    """The fourth power of the cosine of the field angle. Example: `"vignetting"`."""


class FixedPatternSection(Section):
    """An offset of each column, beside the pixels' own prnu and dsnu_e in [simulation.camera]."""

    effect: Literal["fixed-pattern"]
    """An offset of each column. Example: `"fixed-pattern"`."""
    column_offset_e: PositiveNumber
    """Deviation of the columns' offsets. Example: `3.0`."""


class DriftSection(Section):
    """Light that changes from frame to frame: by a compounded rate, and by a flicker beside."""

    effect: Literal["drift"]
    """Light that changes from frame to frame. Example: `"drift"`."""
    rate_per_frame: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.0
    """Change from each frame to the next, compounded. Example: `0.001`."""
    flicker_std: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    """Deviation of each frame's light beside, relative. Example: `0.002`."""


class BeamWanderSection(Section):
    """A picture that goes round a circle as the polarizer turns."""

    effect: Literal["beam-wander"]
    """A picture that goes round a circle as the polarizer turns. Example: `"beam-wander"`."""
    radius_px: PositiveNumber
    """Radius of the circle. Example: `0.5`."""
    phase_deg: float = 0.0
    """Direction of the shift beyond that of the polarizer's axis, counter-clockwise. Example: `30.0`."""


class SmearSection(Section):
    """Light that falls on charge while a CCD without shutter moves it."""

    effect: Literal["smear"]
    """Light on charge while a CCD without shutter moves it. Example: `"smear"`."""
    row_transfer_us: PositiveNumber
    """Time in which a row is moved by one. Example: `1.5`."""


class CosmicHitsSection(Section):
    """Charge that particles leave in single pixels."""

    effect: Literal["cosmic-hits"]
    """Charge that particles leave in single pixels. Example: `"cosmic-hits"`."""
    rate_per_s: PositiveNumber
    """Hits a second on the whole sensor. Example: `0.5`."""
    mean_e: PositiveNumber
    """Mean charge of a hit. Example: `2000.0`."""


RenderingSection = Annotated[
    PointSpreadSection
    | VignettingSection
    | FixedPatternSection
    | DriftSection
    | BeamWanderSection
    | SmearSection
    | CosmicHitsSection,
    Field(discriminator="effect"),
]


class SimulatedPolarizer(Section):
    """The polarizer as it truly sits in the simulated rig."""

    sense: Literal[1, -1]
    """True sense of the simulated polarizer. Example: `1`."""
    offset_deg: float
    """True offset of the simulated polarizer. Example: `12.3`."""
    transmittance_along: FractionNumber
    """Transmittance along the axis. Example: `0.8`."""
    extinction_ratio: Annotated[float, Field(gt=1)]
    """Transmittance along the axis over that across. Example: `5000.0`."""


class SimulatedCamera(Section):
    """The camera as it truly is in the simulated rig. Its numbers are assumed, not those of a real camera."""

    width: Annotated[int, Field(gt=0, le=LARGEST_SIDE)] = 782
    """Pixels a row. Example: `782`."""
    height: Annotated[int, Field(gt=0, le=LARGEST_SIDE)] = 582
    """Rows of pixels. Example: `582`."""
    bit_depth: Annotated[int, Field(ge=8, le=16)] = 12
    """Bits of a count. Example: `12`."""
    pixel_pitch_um: PositiveNumber
    """Distance of the pixels' centres. Example: `8.3`."""
    focal_length_mm: PositiveNumber
    """Focal length of the lens. Example: `25.0`."""
    aperture_diameter_mm: PositiveNumber
    """Diameter of the entrance pupil. Example: `12.5`."""
    optics_transmittance: FractionNumber
    """Transmittance of the optics. Example: `0.9`."""
    quantum_efficiency: FractionNumber
    """Electrons per photon at the wavelength. Example: `0.5`."""
    wavelength_nm: PositiveNumber
    """Effective wavelength of the band. Example: `550.0`."""
    gain_dn_per_e: PositiveNumber
    """Counts per electron. Example: `0.25`."""
    read_noise_e: NotNegativeNumber
    """Deviation of the read noise. Example: `8.0`."""
    dark_current_e_per_s: NotNegativeNumber
    """Dark current of a pixel. Example: `5.0`."""
    black_level_dn: NotNegativeNumber
    """Counts without light at no exposure. Example: `64.0`."""
    prnu: NotNegativeNumber
    """Relative deviation of the pixels' response. Example: `0.005`."""
    dsnu_e: NotNegativeNumber
    """Deviation of the pixels' dark signal. Example: `2.0`."""
    full_well_e: PositiveNumber
    """Electrons that a pixel holds. Example: `16000.0`."""
    defocus_mm: Annotated[float, Field(ge=-MOST_DEFOCUS_MM, le=MOST_DEFOCUS_MM)] = 0.0
    """How far the detector is behind the focus; `rigctl sim lens` changes it while the camera runs. Example: `0.1`."""


class SimulationSection(Section):
    """The simulated rig: what it looks at, what it is made of, and which effects its pictures go through beside.

    An effect that `effects` does not name is not called. `clock` is when its clock begins; without, it is the host's.
    `perturb` changes the light of a scene of materials against what its file says.
    """

    scene: Path
    """Scene file of what the simulated rig looks at. Example: `"scene-panels.toml"`."""
    clock: AwareDatetime | None = None
    """When its clock begins; the host's clock without. Example: `2026-06-21T10:00:00+02:00`."""
    perturb: RoofChange | None = None
    """What of a scene of materials differs from what its file says. Example: `"visibility"`."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Seed of all its noise. Example: `1`."""
    flat_radiance: PositiveNumber
    """Radiance of the flat field in band, W m-2 sr-1. Example: `20.0`."""
    polarizer: SimulatedPolarizer
    """The polarizer as it truly sits."""
    camera: SimulatedCamera
    """The camera as it truly is."""
    effects: list[RenderingSection] = Field(default_factory=list)
    """Effects that its pictures go through beside lens and detector."""
    _file: Path | None = PrivateAttr(default=None)

    @property
    def file(self) -> Path | None:
        """The rig file that it stands in; None where it was not read from one."""
        return self._file

    def beside(self, file: Path) -> "SimulationSection":
        """Return it as it stands in a rig file: its scene is sought beside that."""
        self._file = file.resolve()  # copies have it too
        return self.model_copy(update={"scene": (file.parent / self.scene).resolve()})

    @model_validator(mode="after")
    def _each_effect_once(self) -> "SimulationSection":
        names = [section.effect for section in self.effects]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"effects names {', '.join(twice)} more than once")
        return self
