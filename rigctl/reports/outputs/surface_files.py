"""The files of a material."""

from pathlib import Path

from rigctl.reports.figures import surface_figures
from rigctl.reports.outputs.folder import write_folder
from rigctl.reports.tables.surface_tables import surface_json
from rigctl.reports.writers.json_rows import json_file
from rigctl.scene.reflected_light import ReflectedMaps, SurfaceSheet


def write_surface(sheet: SurfaceSheet, maps: ReflectedMaps, out: Path) -> None:
    """Write surface.png (against angle), hemisphere.png (all directions of the camera) and surface.json."""
    contents = {
        "surface.png": surface_figures.against_angle(sheet, maps),
        "hemisphere.png": surface_figures.hemisphere(sheet, maps),
        "surface.json": json_file(surface_json(sheet)),
    }
    write_folder(out, contents)
