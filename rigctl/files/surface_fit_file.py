"""The fit file: which regions of which runs tell about a surface, how sun and camera stood, and what to find."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from model.surface.pbrdf import DiffuseKind, Shadowing
from rigctl.files.config import Section, load
from rigctl.files.regions import Name

FreeParameter = Literal["n", "k", "slope_rms", "dhr", "specular_weight"]
Bounds = tuple[float, float]
AcuteZenithDeg = Annotated[float, Field(ge=0, lt=90)]


class ObservationSection(Section):
    """One region of one run; azimuths are seen from the target, clockwise from north."""

    run: Path
    """Run folder. Example: `"runs/noon"`."""
    region: Name
    """Region of the regions file. Example: `"black-panel"`."""
    sun_zenith_deg: AcuteZenithDeg
    """Angle of the sun from the zenith. Example: `40.0`."""
    sun_azimuth_deg: float
    """Azimuth of the sun as seen from the target, clockwise from north. Example: `180.0`."""
    camera_zenith_deg: Annotated[float, Field(ge=0, le=180)]
    """Angle of the camera from the target's zenith. Example: `45.0`."""
    camera_azimuth_deg: float
    """Azimuth of the camera as seen from the target. Example: `0.0`."""
    camera_roll_deg: float = 0.0
    """Roll of the camera, counter-clockwise as it sees the scene. Example: `0.0`."""
    tilt_deg: Annotated[float, Field(ge=0, le=180)] = 0.0
    """Angle of the surface's normal from the zenith. Example: `0.0`."""
    tilt_azimuth_deg: float = 0.0
    """Azimuth to which the surface leans. Example: `0.0`."""


class SurfaceFitFile(Section):
    """Content of a fit file."""

    schema_version: Literal[1] = 1
    """Version of the layout. Example: `1`."""
    name: Annotated[str, Field(pattern=r"\S")]
    """Name of the fit. Example: `"black panel"`."""
    regions: Path
    """Regions file. Example: `"regions.toml"`."""
    material: str
    """Material that the fit begins with: of the library, or a file. Example: `"material-mine.toml"`."""
    wavelength_nm: Annotated[float, Field(gt=0)]
    """Wavelength of the runs. Example: `550.0`."""
    free: Annotated[tuple[FreeParameter, ...], Field(min_length=1)] = ("n", "slope_rms", "dhr")
    """Properties that are found; the others stay. Example: `["n", "slope_rms"]`."""
    bounds: Annotated[dict[FreeParameter, Bounds], Field(default_factory=dict)]
    """Limits of what is found. Example: `{ n = [1.3, 1.8] }`."""
    shadowing: Shadowing = "v-cavity"
    """How facets hide one another. Example: `"v-cavity"`."""
    diffuse: DiffuseKind = "coupled"
    """Form of the diffuse term. Example: `"coupled"`."""
    unmodelled_std: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Deviation of S1/S0 and S2/S0 that the model is taken to miss. Example: `0.002`."""
    observation: Annotated[list[ObservationSection], Field(min_length=1)]
    """Regions of runs, with how sun and camera stood."""


def load_surface_fit(path: Path) -> SurfaceFitFile:
    """Return the checked fit file; the files and folders that it names count from its own folder."""
    file = load(path, SurfaceFitFile)
    observations = [
        observation.model_copy(update={"run": path.parent / observation.run}) for observation in file.observation
    ]
    return file.model_copy(update={"regions": path.parent / file.regions, "observation": observations})
