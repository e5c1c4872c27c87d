"""The files of a material."""

import json
from pathlib import Path

from rigctl.durable_file import write_durably
from rigctl.reports.figures import surface_figures
from rigctl.reports.tables.surface_tables import surface_json
from rigctl.scene.reflected_light import ReflectedMaps, SurfaceSheet


def write_surface(sheet: SurfaceSheet, maps: ReflectedMaps, out: Path) -> None:
    """Write surface.png (against angle), hemisphere.png (all directions of the camera) and surface.json."""
    contents = {
        "surface.png": surface_figures.against_angle(sheet, maps),
        "hemisphere.png": surface_figures.hemisphere(sheet, maps),
        "surface.json": (json.dumps(surface_json(sheet), indent=2, allow_nan=False) + "\n").encode(),
    }
    out.mkdir(parents=True, exist_ok=True)
    for name, data in contents.items():
        write_durably(out / name, data)
