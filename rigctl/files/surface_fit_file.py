"""The fit file: which regions of which runs tell about a surface, how sun and camera stood, and what to find."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from model.surface.diffuse import DiffuseKind
from model.surface.shadowing import Shadowing
from rigctl.files.config import Section, load
from rigctl.files.regions import Name

FreeParameter = Literal["n", "k", "slope_rms", "dhr", "specular_weight"]
Bounds = tuple[float, float]
AcuteZenithDeg = Annotated[float, Field(ge=0, lt=90)]


class ObservationSection(Section):
    """One region of one run; azimuths are seen from the target, clockwise from north."""

    run: Path
    region: Name
    sun_zenith_deg: AcuteZenithDeg
    sun_azimuth_deg: float
    camera_zenith_deg: Annotated[float, Field(ge=0, le=180)]
    camera_azimuth_deg: float
    camera_roll_deg: float = 0.0
    tilt_deg: Annotated[float, Field(ge=0, le=180)] = 0.0
    tilt_azimuth_deg: float = 0.0


class SurfaceFitFile(Section):
    """Content of a fit file."""

    schema_version: Literal[1] = 1
    name: Annotated[str, Field(pattern=r"\S")]
    regions: Path
    material: str
    wavelength_nm: Annotated[float, Field(gt=0)]
    free: Annotated[tuple[FreeParameter, ...], Field(min_length=1)] = ("n", "slope_rms", "dhr")
    bounds: Annotated[dict[FreeParameter, Bounds], Field(default_factory=dict)]
    shadowing: Shadowing = "v-cavity"
    diffuse: DiffuseKind = "coupled"
    unmodelled_std: Annotated[float, Field(ge=0, lt=1)] = 0.0
    observation: Annotated[list[ObservationSection], Field(min_length=1)]


def load_surface_fit(path: Path) -> SurfaceFitFile:
    """Return the checked fit file; the files and folders that it names count from its own folder."""
    file = load(path, SurfaceFitFile)
    observations = [
        observation.model_copy(update={"run": path.parent / observation.run}) for observation in file.observation
    ]
    return file.model_copy(update={"regions": path.parent / file.regions, "observation": observations})
