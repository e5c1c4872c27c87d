"""The rig file: which stage, which camera, how the polarizer sits, and what a simulated rig is made of."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AwareDatetime, Field, model_validator

from rigctl.files.choices import RoofChange
from rigctl.files.config import Section, load, with_std_apart
from rigctl.files.notify_section import NotifySection
from rigctl.files.place import GeometrySection, SiteSection
from rigctl.files.rendering_sections import RenderingSection

PLACEHOLDER = (
    "sense and offset of the polarizer are placeholders: angles, S1, S2 and AoLP mean nothing until "
    "`rigctl calibrate axis ... --write RIG.toml` has filled them in"
)
PositiveNumber = Annotated[float, Field(gt=0)]
NotNegativeNumber = Annotated[float, Field(ge=0)]
FractionNumber = Annotated[float, Field(gt=0, le=1)]


class StageSection(Section):
    """The rotation stage, and how to reach it.

    `options` are what the driver takes beside: see its documentation. `characterisation` is a file that
    `rigctl stage characterise` made of this stage; each move then waits until the stage rests.
    """

    driver: str
    port: str
    address: str | None = None
    serial_number: str | None = None
    tolerance_deg: Annotated[float, Field(gt=0, le=5)] = 0.02
    options: dict[str, bool | int | float | str] = Field(default_factory=dict)
    characterisation: Path | None = None


class PolarizerSection(Section):
    """Seat of the polarizer in the stage, as calibrated: neither sense nor offset has a default.

    polarizer angle = sense * stage angle + offset, counter-clockwise as the camera sees the scene. The offset may be
    given as ``{value = 12.3, std = 0.05}``; a comparison then allows for that standard uncertainty. `placeholder` says
    that sense and offset are not calibrated yet; every command that takes or reads frames says so.
    """

    sense: Literal[1, -1]
    offset_deg: float
    offset_std_deg: Annotated[float, Field(ge=0)] = 0.0
    extinction_ratio: Annotated[float, Field(gt=1)] | None = None
    placeholder: bool = False

    @model_validator(mode="before")
    @classmethod
    def _offset_with_std(cls, given: object) -> object:
        return with_std_apart(given, "offset_deg")


class CameraSection(Section):
    """The camera, and how to reach it."""

    address: str
    serial_number: str | None = None
    gain_db: float = 0.0
    timeout_s: PositiveNumber = 5.0


class SimulatedPolarizer(Section):
    """The polarizer as it truly sits in the simulated rig."""

    sense: Literal[1, -1]
    offset_deg: float
    transmittance_along: FractionNumber
    extinction_ratio: Annotated[float, Field(gt=1)]


# Pixels along a side of a picture: beyond any sensor.
LARGEST_SIDE = 20_000


class SimulatedCamera(Section):
    """The camera as it truly is in the simulated rig. Its numbers are assumed, not those of a real camera."""

    width: Annotated[int, Field(gt=0, le=LARGEST_SIDE)] = 782
    height: Annotated[int, Field(gt=0, le=LARGEST_SIDE)] = 582
    bit_depth: Annotated[int, Field(ge=8, le=16)] = 12
    pixel_pitch_um: PositiveNumber
    focal_length_mm: PositiveNumber
    aperture_diameter_mm: PositiveNumber
    optics_transmittance: FractionNumber
    quantum_efficiency: FractionNumber
    wavelength_nm: PositiveNumber
    gain_dn_per_e: PositiveNumber
    read_noise_e: NotNegativeNumber
    dark_current_e_per_s: NotNegativeNumber
    black_level_dn: NotNegativeNumber
    prnu: NotNegativeNumber
    dsnu_e: NotNegativeNumber
    full_well_e: PositiveNumber


class SimulationSection(Section):
    """The simulated rig: what it looks at, what it is made of, and which effects its pictures go through beside.

    An effect that `effects` does not name is not called. `clock` is when its clock begins; without, it is the host's.
    `perturb` changes the light of a scene of materials against what its file says.
    """

    scene: Path
    clock: AwareDatetime | None = None
    perturb: RoofChange | None = None
    seed: Annotated[int, Field(ge=0)] = 1
    flat_radiance: PositiveNumber
    polarizer: SimulatedPolarizer
    camera: SimulatedCamera
    effects: list[RenderingSection] = Field(default_factory=list)

    @model_validator(mode="after")
    def _each_effect_once(self) -> "SimulationSection":
        names = [section.effect for section in self.effects]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"effects names {', '.join(twice)} more than once")
        return self


class RigFile(Section):
    """Content of a rig file. Where it stands and how its camera points may stand here, or in session and scene file."""

    schema_version: Literal[1] = 1
    name: str
    stage: StageSection
    polarizer: PolarizerSection
    camera: CameraSection
    site: SiteSection | None = None
    geometry: GeometrySection | None = None
    simulation: SimulationSection | None = None
    notify: NotifySection | None = None

    @property
    def is_simulated(self) -> bool:
        """True if any device of the rig is simulated: then its frames are called so."""
        return self.stage.port.startswith("sim:") or self.camera.address.startswith("sim:")

    @property
    def has_simulated_clock(self) -> bool:
        """True if its time is simulated: a session does not wait then."""
        return self.simulation is not None and self.simulation.clock is not None

    @model_validator(mode="after")
    def _a_simulated_camera_needs_a_world(self) -> "RigFile":
        if self.is_simulated and self.simulation is None:
            raise ValueError("a simulated device (sim:...) needs a [simulation] table that says what it looks at")
        return self


def placeholder_doubt(rig: RigFile) -> str | None:
    """Return in words that sense and offset of a rig file are placeholders; None where they are not."""
    return f"rig {rig.name}: {PLACEHOLDER}" if rig.polarizer.placeholder else None


def load_rig(path: str | Path) -> RigFile:
    """Return the checked rig file; a scene and a characterisation that it names are sought beside it."""
    path = Path(path)
    rig = load(path, RigFile)
    if rig.stage.characterisation is not None:
        beside = (path.parent / rig.stage.characterisation).resolve()
        rig = rig.model_copy(update={"stage": rig.stage.model_copy(update={"characterisation": beside})})
    if rig.simulation is None:
        return rig
    scene = (path.parent / rig.simulation.scene).resolve()
    return rig.model_copy(update={"simulation": rig.simulation.model_copy(update={"scene": scene})})
