"""Origin of a run by its session file, as far as the program asks."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, JsonValue, TypeAdapter

from rigctl.files.choices import Interpolation
from rigctl.files.place import GeometrySection, SiteSection
from rigctl.files.rig_file import polarizer_axes_deg
from rigctl.runs.simulated_light import SimulatedLight


@dataclass(frozen=True, kw_only=True)
class PolarizerAsTaken:
    """The polarizer by the rig file of a run; None is not stated."""

    sense: Literal[1, -1] | None = None
    offset_deg: Annotated[float, Field(allow_inf_nan=False)] | None = None
    offset_std_deg: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    extinction_ratio: Annotated[float, Field(gt=1, allow_inf_nan=False)] | None = None
    placeholder: bool = False


@dataclass(frozen=True, kw_only=True)
class CameraAsTaken:
    """The camera by the rig file of a run."""

    address: str = ""
    mosaic_deg: list[Annotated[float, Field(allow_inf_nan=False)]] | None = None
    interpolation: Interpolation = "none"


@dataclass(frozen=True, kw_only=True)
class SimulationAsTaken:
    """The simulation by the rig file of a run: the scene file that it showed."""

    scene: str | None = None


@dataclass(frozen=True, kw_only=True)
class RigAsTaken:
    """The rig file of a run, as far as runs of older programs have it too."""

    name: str | None = None
    polarizer: PolarizerAsTaken | None = None
    camera: CameraAsTaken | None = None
    simulation: SimulationAsTaken | None = None
    site: SiteSection | None = None
    geometry: GeometrySection | None = None


@dataclass(frozen=True, kw_only=True)
class SessionAsTaken:
    """The session file of a run, likewise."""

    name: str | None = None
    site: SiteSection | None = None


@dataclass(frozen=True, kw_only=True)
class DeviceAsTaken:
    """A device by its own word."""

    model: str | None = None
    serial_number: str | None = None


_Number = Annotated[float, Field(allow_inf_nan=False)]


@dataclass(frozen=True, kw_only=True)
class SessionNoise:
    """The numbers of a noise calibration that a session was watched with, in the order in which a run holds them."""

    gain_dn_per_e: _Number
    read_noise_e: _Number
    black_level_dn: _Number
    dark_current_e_per_s: _Number


@dataclass(frozen=True, kw_only=True)
class SessionRecord:
    """Origin of a run.

    Attributes
    ----------
    origin : str or None
        "simulated", "device" or "import"; None where the run does not say.
    rig, session : RigAsTaken, SessionAsTaken or None
        By its files; None of imported images.
    stage, camera : DeviceAsTaken
        Which devices these were.
    noise : SessionNoise or None
        What it was watched with.
    rounds_ns : tuple of int or None
        When each round was to begin [ns since 1970 UTC]; None is at once.
    until_ns : int or None
        From when on no frame was to be taken [ns since 1970 UTC].
    simulated_light : SimulatedLight or None
        The light of a simulated roof.
    """

    origin: str | None = None
    rig: RigAsTaken | None = None
    session: SessionAsTaken | None = None
    stage: DeviceAsTaken = DeviceAsTaken()
    camera: DeviceAsTaken = DeviceAsTaken()
    noise: SessionNoise | None = None
    rounds_ns: tuple[int | None, ...] = (None,)
    until_ns: int | None = None
    simulated_light: SimulatedLight | None = None

    @property
    def polarizer(self) -> PolarizerAsTaken:
        """The polarizer as the rig file has it; nothing is stated of imported images."""
        return PolarizerAsTaken() if self.rig is None or self.rig.polarizer is None else self.rig.polarizer

    @property
    def camera_address(self) -> str:
        """Address of the camera; empty where nobody says it."""
        return "" if self.rig is None or self.rig.camera is None else self.rig.camera.address

    @property
    def cell_deg(self) -> tuple[float, ...] | None:
        """Axes of the polarizers on the camera's pixels; None where it has none, or nobody says it."""
        polarizer = self.polarizer
        if self.rig is None or self.rig.camera is None or polarizer.sense is None or polarizer.offset_deg is None:
            return None
        return polarizer_axes_deg(self.rig.camera.mosaic_deg, sense=polarizer.sense, offset_deg=polarizer.offset_deg)

    @property
    def interpolation(self) -> Interpolation:
        """What its frames were made of a mosaic by; "none" too where there is no mosaic."""
        return "none" if self.rig is None or self.rig.camera is None else self.rig.camera.interpolation

    @property
    def simulated_scene(self) -> Path | None:
        """The scene file of a simulated run, where it stood."""
        simulation = None if self.rig is None else self.rig.simulation
        return None if simulation is None or simulation.scene is None else Path(simulation.scene)

    @property
    def site(self) -> SiteSection | None:
        """Site of the rig, by its rig file or by its session file."""
        places = (place.site for place in (self.rig, self.session) if place is not None)
        return next((site for site in places if site is not None), None)

    @property
    def is_of_session(self) -> bool:
        """The run was taken by a session, and not imported."""
        return self.rig is not None and self.session is not None


_SESSION = TypeAdapter(SessionRecord)


def session_record(content: Mapping[str, JsonValue]) -> SessionRecord:
    """Return what a session file says under ``session``.

    Raises
    ------
    pydantic.ValidationError
        What it says is not of its kind.
    """
    return _SESSION.validate_python(content)
