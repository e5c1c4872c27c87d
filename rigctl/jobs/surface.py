"""Looking at what a material does to sunlight."""

from importlib.resources import as_file, files
from pathlib import Path

from model.surface.diffuse import DiffuseKind
from model.surface.material_library import MATERIALS, material
from model.surface.materials import Material, surface_of
from model.surface.shadowing import Shadowing
from rigctl.errors import ConfigError
from rigctl.files.material_file import NM_PER_M, find_material, load_material
from rigctl.scene.reflected_light import SurfaceSheet, reflected_maps, surface_sheet

# Material files among the examples, beside the library.
_FILES = "paper/rough-*.toml"


def list_materials() -> dict[str, Material]:
    """Return every material that comes with the program: the library by names, others by their files' paths."""
    found = {name: material(name) for name in MATERIALS}
    with as_file(files("rigctl") / "data" / "examples") as examples:
        for path in sorted(examples.glob(_FILES)):
            found[f"examples/{path.relative_to(examples)}"] = load_material(path)
    return found


def look_at_surface(
    material: str,
    *,
    wavelength_nm: float = 550.0,
    sun_zenith_deg: float = 45.0,
    shadowing: Shadowing = "v-cavity",
    diffuse: DiffuseKind = "coupled",
    out: Path | None = None,
) -> SurfaceSheet:
    """Return DoLP and reflectance of a material against angle, and where its values come from.

    What the arguments are stands at `rigctl.surface`, the same call for Python.

    Raises
    ------
    ConfigError
        There is no such material, or a number is outside its range.
    """
    if not 0.0 <= sun_zenith_deg < 90.0:
        raise ConfigError(f"--sun-zenith-deg: is {sun_zenith_deg:g}, must lie in [0, 90)")
    found = find_material(material, beside=Path())
    try:
        surface = surface_of(found, wavelength_m=wavelength_nm / NM_PER_M, shadowing=shadowing, diffuse=diffuse)
        sheet = surface_sheet(found, surface, wavelength_nm=wavelength_nm, sun_zenith_deg=sun_zenith_deg)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    if out is not None:
        from rigctl.reports.outputs.prediction_files import write_surface  # half a second, wanted for plots only

        write_surface(sheet, reflected_maps(surface, sun_zenith_deg=sun_zenith_deg), out)
    return sheet
