"""The rig file: stage, camera, polarizer, monitors, and notices.

A simulated rig has a table [simulation]: its true polarizer and camera, and the effects on its pictures.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal, get_args
from urllib.parse import urlsplit

from pydantic import AwareDatetime, Field, PrivateAttr, model_validator

from rigctl.files.choices import Interpolation, RoofChange
from rigctl.files.place import GeometrySection, SiteSection
from rigctl.files.regions import Name, require_distinct
from rigctl.files.toml import Section, load, with_std_apart

# Pixels along a side of a picture, beyond any sensor.
LARGEST_SIDE = 20_000
# Largest defocus with a visible picture [mm].
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
    """An offset of each column, in addition to prnu and dsnu_e of [simulation.camera]."""

    effect: Literal["fixed-pattern"]
    """An offset of each column. Example: `"fixed-pattern"`."""
    column_offset_e: PositiveNumber
    """Deviation of the columns' offsets. Example: `3.0`."""


class DriftSection(Section):
    """Light that changes from frame to frame by a compounded rate and a flicker."""

    effect: Literal["drift"]
    """Light that changes from frame to frame. Example: `"drift"`."""
    rate_per_frame: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.0
    """Change from each frame to the next, compounded. Example: `0.001`."""
    flicker_std: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    """Additional relative deviation of each frame's light. Example: `0.002`."""


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
    """The true polarizer of the simulated rig."""

    sense: Literal[1, -1]
    """True sense of the simulated polarizer. Example: `1`."""
    offset_deg: float
    """True offset of the simulated polarizer. Example: `12.3`."""
    transmittance_along: FractionNumber
    """Transmittance along the axis. Example: `0.8`."""
    extinction_ratio: Annotated[float, Field(gt=1)]
    """Transmittance along the axis over that across. Example: `5000.0`."""


class SimulatedCamera(Section):
    """The true camera of the simulated rig. Its numbers are assumed, not those of a real camera."""

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
    """Distance of the detector behind the focus; `rigctl sim lens` changes it while the camera runs. Example: `0.1`."""


class SimulationSection(Section):
    """The simulated rig: its scene, its true devices, and the effects on its pictures.

    Effects that `effects` does not name are not computed. `clock` is the start of its clock; default: the host's.
    `perturb` changes the light of a scene of materials relative to its file.
    """

    scene: Path
    """Scene file of the simulated rig. Example: `"scene-panels.toml"`."""
    clock: AwareDatetime | None = None
    """Start of its clock; default: the host's clock. Example: `2026-06-21T10:00:00+02:00`."""
    perturb: RoofChange | None = None
    """Change of a scene of materials against its file. Example: `"visibility"`."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Seed of all its noise. Example: `1`."""
    flat_radiance: PositiveNumber
    """Radiance of the flat field in band, W m-2 sr-1. Example: `20.0`."""
    polarizer: SimulatedPolarizer
    """The true polarizer."""
    camera: SimulatedCamera
    """The camera as it truly is."""
    effects: list[RenderingSection] = Field(default_factory=list)
    """Effects on its pictures in addition to lens and detector."""
    _file: Path | None = PrivateAttr(default=None)

    @property
    def file(self) -> Path | None:
        """The rig file that contains it; None if it was not read from one."""
        return self._file

    def beside(self, file: Path) -> "SimulationSection":
        """Return it as in a rig file, with the scene file next to that."""
        self._file = file.resolve()  # copies have it too
        return self.model_copy(update={"scene": (file.parent / self.scene).resolve()})

    @model_validator(mode="after")
    def _each_effect_once(self) -> "SimulationSection":
        names = [section.effect for section in self.effects]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"effects names {', '.join(twice)} more than once")
        return self


PLACEHOLDER = (
    "sense and offset of the polarizer are placeholders: angles, S1, S2 and AoLP are meaningless until `rigctl "
    "calibrate axis ... --write RIG.toml` fills them in"
)
# Axes of a cell that are closer than this are equal.
_HALF_TURN_DEG, _LEAST_GAP_DEG = 180.0, 5.0

NoticeKind = Literal["finished", "stopped", "failed", "hold", "interlock", "disk is short"]
NOTICE_KINDS: tuple[NoticeKind, ...] = get_args(NoticeKind)


class StageSection(Section):
    """The rotation stage, and how to reach it.

    `options` are further options of the driver: see its documentation. `characterisation` is a file from `rigctl
    calibrate stage` for this stage; each move then waits until the stage rests.
    """

    driver: str
    """Driver of the stage, as `rigctl devices` prints it. Example: `"ellx"`."""
    port: str
    """Serial port of the stage, or sim: for a simulated one. Example: `"/dev/ttyUSB0"`."""
    address: str | None = None
    """Address of one of several stages on a port. Example: `"0"`."""
    serial_number: str | None = None
    """Refuse any other stage than this. Example: `"11400123"`."""
    tolerance_deg: Annotated[float, Field(gt=0, le=5)] = 0.02
    """Largest difference of readback and target. Example: `0.02`."""
    options: dict[str, bool | int | float | str] = Field(default_factory=dict)
    """Further options of the driver. Example: `{ steps_per_turn = 24000 }`."""
    characterisation: Path | None = None
    """File of `rigctl calibrate stage`; each move then waits until the stage rests. Example: `"stage.json"`."""


class PolarizerSection(Section):
    """Calibrated mounting of the polarizer in the stage: neither sense nor offset has a default.

    polarizer angle = sense * stage angle + offset, counter-clockwise as the camera sees the scene. The offset may be
    given as ``{value = 12.3, std = 0.05}``; a comparison then allows for that standard uncertainty. `placeholder` means
    that sense and offset are not calibrated yet; every command that takes or reads frames warns of it.
    """

    sense: Literal[1, -1]
    """1 if the polarizer's angle grows with that of the stage, -1 if it falls. Example: `1`."""
    offset_deg: float
    """Angle of the transmission axis at stage angle 0, from horizontal. Example: `12.3`."""
    offset_std_deg: Annotated[float, Field(ge=0)] = 0.0
    """Standard uncertainty of the offset. Example: `0.05`."""
    extinction_ratio: Annotated[float, Field(gt=1)] | None = None
    """Transmittance along the axis over that across. Example: `5000.0`."""
    placeholder: bool = False
    """Sense and offset are not calibrated yet; every command warns of it. Example: `true`."""

    @model_validator(mode="before")
    @classmethod
    def _offset_with_std(cls, given: object) -> object:
        return with_std_apart(given, "offset_deg")


class CameraSection(Section):
    """The camera, and how to reach it."""

    address: str
    """Driver and place of the camera, as `rigctl devices` prints them. Example: `"gige:192.168.0.5"`."""
    serial_number: str | None = None
    """Refuse any other camera than this. Example: `"02-2020C-07321"`."""
    gain_db: float = 0.0
    """Gain setting of the camera. Example: `0.0`."""
    filter: Annotated[str, Field(pattern=r"^[ -~]{1,60}$")] | None = None
    """Name of the filter in front of it, for the headers of frames and results. Example: `"V"`."""
    timeout_s: PositiveNumber = 5.0
    """Longest wait for a frame beyond its exposure. Example: `5.0`."""
    mosaic_deg: Annotated[list[float], Field(min_length=4, max_length=4)] | None = None
    """Polarizers on its pixels: angles of a cell of 2 x 2, row by row. Example: `[90, 45, 135, 0]`."""
    interpolation: Interpolation = "none"
    """Pictures of such a mosaic: none, four of half the size; bilinear, of the whole size. Example: `"none"`."""

    @model_validator(mode="after")
    def _cell_is_one(self) -> "CameraSection":
        if self.mosaic_deg is None:
            if self.interpolation != "none":
                raise ValueError(
                    "interpolation is for a camera with polarizers on its pixels: state mosaic_deg as well"
                )
            return self
        axes = sorted(angle % _HALF_TURN_DEG for angle in self.mosaic_deg)
        gaps = [after - before for before, after in pairwise([*axes, axes[0] + _HALF_TURN_DEG])]
        if min(gaps) < _LEAST_GAP_DEG:
            raise ValueError("mosaic_deg: the four angles of a cell must differ modulo 180 deg")
        return self


class MonitorSection(Section):
    """A sensor that is read once per exposure: temperature, humidity, irradiance. It never delays a frame.

    `options` are those of its driver: see docs/plug-ins.md. The drift of the light is compared with readings that have
    `follows_light`, such as an irradiance.
    """

    name: Name
    """Its name in the run. Example: `"air"`."""
    driver: str
    """Its driver: file, command, serial, or a plug-in's. Example: `"file"`."""
    deadline_s: Annotated[float, Field(gt=0, le=60)] = 1.0
    """Longest time of a reading. Example: `1.0`."""
    follows_light: bool = False
    """It grows with the light of the scene, like an irradiance. Example: `true`."""
    options: dict[str, bool | int | float | str | list[str]] = Field(default_factory=dict)
    """Options of the driver. Example: `{ path = "/run/air.txt", unit = "deg C" }`."""


class NotifySection(Section):
    """Receivers of notices: an address for JSON by HTTP POST, a command, or both.

    `events` selects the events. A notice that is not delivered within `timeout_s` is dropped, without delay of the
    session.
    """

    webhook: Annotated[str, Field(pattern=r"^https?://[^\s]+$", max_length=2000)] | None = None
    """Address that gets each notice as JSON by HTTP POST. Example: `"https://example.org/rig"`."""
    command: Annotated[list[str], Field(min_length=1, max_length=100)] | None = None
    """Program, with its arguments, that gets each notice on its standard input. Example: `["notify-send", "rig"]`."""
    events: list[NoticeKind] = Field(default_factory=lambda: list(NOTICE_KINDS))
    """Events that are reported; all unless given. Example: `["finished", "failed"]`."""
    timeout_s: Annotated[float, Field(gt=0, le=60)] = 5.0
    """Time after which a notice is dropped. Example: `5.0`."""

    @model_validator(mode="after")
    def _a_receiver_is_given(self) -> "NotifySection":
        if self.webhook is None and self.command is None:
            raise ValueError('names no receiver: give webhook = "https://..." or command = ["program", "argument"]')
        if self.webhook is not None and "@" in urlsplit(self.webhook).netloc:
            raise ValueError("webhook: an address with user and password is not supported: use a command, such as curl")
        return self


class RigFile(Section):
    """Content of a rig file. Site and direction of the camera may be here, or in session and scene file."""

    schema_version: Literal[1] = 1
    """Version of the layout. Example: `1`."""
    name: str
    """Name of the rig, in every run that it takes. Example: `"roof"`."""
    stage: StageSection | None
    """The rotation stage, and how to reach it; none if the camera has polarizers on its pixels."""
    polarizer: PolarizerSection
    """Mounting of the polarizer in the stage; optional for a camera with polarizers on its pixels."""
    camera: CameraSection
    """The camera, and how to reach it."""
    site: SiteSection | None = None
    """Place of the rig."""
    geometry: GeometrySection | None = None
    """Direction of its camera."""
    simulation: SimulationSection | None = None
    """Truth of a simulated rig."""
    monitors: list[MonitorSection] = Field(default_factory=list)
    """Sensors that are read with the frames."""
    notify: NotifySection | None = None
    """Receivers of notices about the end of a session and about trouble."""

    @property
    def is_simulated(self) -> bool:
        """True if any device of the rig is simulated; its frames are then marked."""
        ports = () if self.stage is None else (self.stage.port,)
        return any(address.startswith("sim:") for address in (*ports, self.camera.address))

    @property
    def cell_deg(self) -> tuple[float, ...] | None:
        """Axes of the polarizers on the camera's pixels, row by row of a cell, in [0, 180); None without any."""
        return polarizer_axes_deg(
            self.camera.mosaic_deg, sense=self.polarizer.sense, offset_deg=self.polarizer.offset_deg
        )

    @model_validator(mode="before")
    @classmethod
    def _mosaic_sits_as_stated(cls, given: object) -> object:
        """Allow a mosaic without a stage, and without a polarizer for unchanged angles."""
        camera = given.get("camera") if isinstance(given, dict) else None
        if isinstance(given, dict) and isinstance(camera, dict) and camera.get("mosaic_deg") is not None:
            return {"stage": None, "polarizer": {"sense": 1, "offset_deg": 0.0}} | given
        return given

    @model_validator(mode="after")
    def _monitors_differ(self) -> "RigFile":
        require_distinct([section.name for section in self.monitors])
        return self

    @model_validator(mode="after")
    def _something_turns_or_is_a_mosaic(self) -> "RigFile":
        if (self.stage is None) == (self.camera.mosaic_deg is None):
            raise ValueError(
                "needs a [stage] that turns the polarizer"
                if self.stage is None
                else "[stage] and mosaic_deg of [camera]: a camera with polarizers on its pixels has all angles in one "
                "exposure; leave one of them out"
            )
        return self

    @model_validator(mode="after")
    def _a_simulated_camera_needs_a_simulated_stage(self) -> "RigFile":
        """Refuse a real stage with a simulated camera, whose picture would not depend on the stage."""
        stage, camera = self.stage, self.camera.address
        if stage is not None and camera.startswith("sim:") and not stage.port.startswith("sim:"):
            raise ValueError(
                f'[stage] port = "{stage.port}" is a real port, and [camera] address = "{camera}" is simulated: such a '
                'camera sees a simulated stage only. Write port = "sim:ellx" (or sim:zaber, sim:apt), or the address '
                'of a real camera, such as "gige:192.168.0.5" (`rigctl devices` lists them)'
            )
        return self

    @model_validator(mode="after")
    def _a_simulated_camera_needs_a_world(self) -> "RigFile":
        if self.is_simulated and self.simulation is None:
            raise ValueError("a simulated device (sim:...) needs a [simulation] table with its scene")
        return self


def polarizer_axes_deg(
    mosaic_deg: Sequence[float] | None, *, sense: int, offset_deg: float
) -> tuple[float, ...] | None:
    """Return the axes of a cell in the picture, in [0, 180), by sense and offset; None without a cell."""
    if mosaic_deg is None:
        return None
    return tuple((sense * angle + offset_deg) % _HALF_TURN_DEG for angle in mosaic_deg)


def placeholder_doubt(rig: RigFile) -> str | None:
    """Return a warning if sense and offset of a rig file are placeholders; None if they are calibrated."""
    return f"rig {rig.name}: {PLACEHOLDER}" if rig.polarizer.placeholder else None


def unset_polarizer(run: Path, *, placeholder: bool) -> tuple[str, ...]:
    """Return a warning if sense and offset were placeholders when a run was taken."""
    return (f"{run}: {PLACEHOLDER}",) if placeholder else ()


def load_rig(path: str | Path) -> RigFile:
    """Return the checked rig file; its scene and characterisation are found relative to it."""
    path = Path(path)
    rig = load(path, RigFile)
    if rig.stage is not None and rig.stage.characterisation is not None:
        beside = (path.parent / rig.stage.characterisation).resolve()
        rig = rig.model_copy(update={"stage": rig.stage.model_copy(update={"characterisation": beside})})
    if rig.simulation is None:
        return rig
    return rig.model_copy(update={"simulation": rig.simulation.beside(path)})
