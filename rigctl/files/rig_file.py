"""The rig file: which stage, which camera, how the polarizer sits, what is read beside, and who is told."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import Field, model_validator

from rigctl.files.choices import Interpolation
from rigctl.files.config import Section, load, with_std_apart
from rigctl.files.place import GeometrySection, SiteSection
from rigctl.files.regions import Name, require_distinct
from rigctl.files.simulation_sections import SimulationSection

PLACEHOLDER = (
    "sense and offset of the polarizer are placeholders: angles, S1, S2 and AoLP mean nothing until "
    "`rigctl calibrate axis ... --write RIG.toml` has filled them in"
)
# Begins the address of a device that a recording stands for.
REPLAY = "replay:"
# Axes of one cell that are closer than this are one.
_HALF_TURN_DEG, _LEAST_GAP_DEG = 180.0, 5.0

NoticeKind = Literal["finished", "stopped", "failed", "hold", "interlock", "disk is short"]
NOTICE_KINDS: tuple[NoticeKind, ...] = get_args(NoticeKind)

PositiveNumber = Annotated[float, Field(gt=0)]


class StageSection(Section):
    """The rotation stage, and how to reach it.

    `options` are what the driver takes beside: see its documentation. `characterisation` is a file that
    `rigctl calibrate stage` made of this stage; each move then waits until the stage rests.
    """

    driver: str
    """What speaks to the stage, as `rigctl devices` names it. Example: `"ellx"`."""
    port: str
    """Serial port of the stage, or sim: for a simulated one. Example: `"/dev/ttyUSB0"`."""
    address: str | None = None
    """Of several stages on one port, which. Example: `"0"`."""
    serial_number: str | None = None
    """Refuse any other stage than this. Example: `"11400123"`."""
    tolerance_deg: Annotated[float, Field(gt=0, le=5)] = 0.02
    """How far a readback may lie from its target. Example: `0.02`."""
    options: dict[str, bool | int | float | str] = Field(default_factory=dict)
    """What the driver takes beside. Example: `{ steps_per_turn = 24000 }`."""
    characterisation: Path | None = None
    """File of `rigctl calibrate stage`; each move then waits until the stage rests. Example: `"stage.json"`."""


class PolarizerSection(Section):
    """Seat of the polarizer in the stage, as calibrated: neither sense nor offset has a default.

    polarizer angle = sense * stage angle + offset, counter-clockwise as the camera sees the scene. The offset may be
    given as ``{value = 12.3, std = 0.05}``; a comparison then allows for that standard uncertainty. `placeholder` says
    that sense and offset are not calibrated yet; every command that takes or reads frames says so.
    """

    sense: Literal[1, -1]
    """Whether the polarizer's angle grows (1) or falls (-1) with that of the stage. Example: `1`."""
    offset_deg: float
    """Angle of the transmission axis at stage angle 0, from horizontal. Example: `12.3`."""
    offset_std_deg: Annotated[float, Field(ge=0)] = 0.0
    """Standard uncertainty of the offset. Example: `0.05`."""
    extinction_ratio: Annotated[float, Field(gt=1)] | None = None
    """Transmittance along the axis over that across. Example: `5000.0`."""
    placeholder: bool = False
    """Sense and offset are not calibrated yet; every command says so. Example: `true`."""

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
    timeout_s: PositiveNumber = 5.0
    """How long to wait for a frame beyond its exposure. Example: `5.0`."""
    mosaic_deg: Annotated[list[float], Field(min_length=4, max_length=4)] | None = None
    """Polarizers on its pixels: angles of a cell of 2 x 2, row by row. Example: `[90, 45, 135, 0]`."""
    interpolation: Interpolation = "none"
    """Of such a mosaic: none, four pictures of half the size; bilinear, of the whole. Example: `"none"`."""

    @model_validator(mode="after")
    def _cell_is_one(self) -> "CameraSection":
        if self.mosaic_deg is None:
            if self.interpolation != "none":
                raise ValueError("interpolation is for a camera with polarizers on its pixels: state mosaic_deg, too")
            return self
        axes = sorted(angle % _HALF_TURN_DEG for angle in self.mosaic_deg)
        gaps = [after - before for before, after in pairwise([*axes, axes[0] + _HALF_TURN_DEG])]
        if min(gaps) < _LEAST_GAP_DEG:
            raise ValueError("mosaic_deg: the four angles of a cell differ from one another, modulo 180 deg")
        return self


class MonitorSection(Section):
    """A sensor that is read once an exposure: temperature, humidity, irradiance. It delays no frame and loses none.

    `options` are what its driver takes: see docs/plug-ins.md. A reading that `follows_light`, such as an irradiance,
    is what the drift of the light is held against.
    """

    name: Name
    """Its name in the run. Example: `"air"`."""
    driver: str
    """What reads it: file, command, serial, or a plug-in's. Example: `"file"`."""
    deadline_s: Annotated[float, Field(gt=0, le=60)] = 1.0
    """A reading that takes longer is none. Example: `1.0`."""
    follows_light: bool = False
    """It grows with the light that the rig sees, as an irradiance does. Example: `true`."""
    options: dict[str, bool | int | float | str | list[str]] = Field(default_factory=dict)
    """What the driver takes. Example: `{ path = "/run/air.txt", unit = "deg C" }`."""


class NotifySection(Section):
    """Address that gets a notice as JSON by HTTP POST, command that gets it on its standard input, or both.

    `events` says of what. A notice that cannot be delivered within `timeout_s` is dropped: no session waits for one.
    """

    webhook: Annotated[str, Field(pattern=r"^https?://[^\s]+$", max_length=2000)] | None = None
    """Address that gets each notice as JSON by HTTP POST. Example: `"https://example.org/rig"`."""
    command: Annotated[list[str], Field(min_length=1, max_length=100)] | None = None
    """Program, with its arguments, that gets each notice on its standard input. Example: `["notify-send", "rig"]`."""
    events: list[NoticeKind] = Field(default_factory=lambda: list(NOTICE_KINDS))
    """Which events are told; all without. Example: `["finished", "failed"]`."""
    timeout_s: Annotated[float, Field(gt=0, le=60)] = 5.0
    """After which a notice is dropped. Example: `5.0`."""

    @model_validator(mode="after")
    def _somebody_is_told(self) -> "NotifySection":
        if self.webhook is None and self.command is None:
            raise ValueError('names nobody: give webhook = "https://..." or command = ["program", "argument"]')
        return self


class RigFile(Section):
    """Content of a rig file. Where it stands and how its camera points may stand here, or in session and scene file."""

    schema_version: Literal[1] = 1
    """Version of the layout. Example: `1`."""
    name: str
    """Name of the rig, in every run that it takes. Example: `"roof"`."""
    stage: StageSection | None
    """The rotation stage, and how to reach it; none where the camera has polarizers on its pixels."""
    polarizer: PolarizerSection
    """Seat of the polarizer in the stage; of a camera with polarizers on its pixels it may be left out."""
    camera: CameraSection
    """The camera, and how to reach it."""
    site: SiteSection | None = None
    """Where the rig stands."""
    geometry: GeometrySection | None = None
    """How its camera points."""
    simulation: SimulationSection | None = None
    """What a simulated rig is made of."""
    monitors: list[MonitorSection] = Field(default_factory=list)
    """Sensors that are read beside the frames."""
    notify: NotifySection | None = None
    """Whom a session tells of its end and of trouble."""

    @property
    def is_simulated(self) -> bool:
        """True if any device of the rig is simulated: then its frames are called so."""
        ports = () if self.stage is None else (self.stage.port,)
        return any(address.startswith("sim:") for address in (*ports, self.camera.address))

    @property
    def cell_deg(self) -> tuple[float, ...] | None:
        """Axes of the polarizers on the camera's pixels, row by row of a cell, in [0, 180); None where it has none."""
        return polarizer_axes_deg(
            self.camera.mosaic_deg, sense=self.polarizer.sense, offset_deg=self.polarizer.offset_deg
        )

    @property
    def is_replayed(self) -> bool:
        """True if a recording stands for any device of the rig."""
        ports = () if self.stage is None else (self.stage.port,)
        return any(address.startswith(REPLAY) for address in (*ports, self.camera.address))

    @model_validator(mode="before")
    @classmethod
    def _mosaic_sits_as_stated(cls, given: object) -> object:
        """Let a mosaic do without a stage, and its angles stand as they are where no polarizer is stated."""
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
    def _a_simulated_camera_needs_a_world(self) -> "RigFile":
        if self.is_simulated and self.simulation is None:
            raise ValueError("a simulated device (sim:...) needs a [simulation] table that says what it looks at")
        return self


def polarizer_axes_deg(
    mosaic_deg: Sequence[float] | None, *, sense: int, offset_deg: float
) -> tuple[float, ...] | None:
    """Return the axes of a cell as the picture shows them, in [0, 180), by sense and offset; None without a cell."""
    if mosaic_deg is None:
        return None
    return tuple((sense * angle + offset_deg) % _HALF_TURN_DEG for angle in mosaic_deg)


def placeholder_doubt(rig: RigFile) -> str | None:
    """Return in words that sense and offset of a rig file are placeholders; None where they are not."""
    return f"rig {rig.name}: {PLACEHOLDER}" if rig.polarizer.placeholder else None


def unset_polarizer(run: Path, *, placeholder: bool) -> tuple[str, ...]:
    """Return in words that sense and offset of a run were placeholders as it was taken; nothing where they were not."""
    return (f"{run}: {PLACEHOLDER}",) if placeholder else ()


def load_rig(path: str | Path) -> RigFile:
    """Return the checked rig file; a scene and a characterisation that it names are sought beside it."""
    path = Path(path)
    rig = load(path, RigFile)
    if rig.stage is not None and rig.stage.characterisation is not None:
        beside = (path.parent / rig.stage.characterisation).resolve()
        rig = rig.model_copy(update={"stage": rig.stage.model_copy(update={"characterisation": beside})})
    if rig.simulation is None:
        return rig
    return rig.model_copy(update={"simulation": rig.simulation.beside(path)})
