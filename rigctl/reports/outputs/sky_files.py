"""The files of a sky, and of skies of several kinds of aerosol."""

from pathlib import Path

from rigctl.reports.figures.sky_figure import kinds_picture, sky_picture
from rigctl.reports.outputs.folder import write_folder
from rigctl.reports.tables.sky_tables import kinds_json, sky_json
from rigctl.reports.writers.json_rows import json_file
from rigctl.scene.sky_map import SkyMap, SkyOfKind


def write_sky(sky: SkyMap, out: Path) -> None:
    """Write sky.png and sky.json."""
    write_folder(out, {"sky.png": sky_picture(sky), "sky.json": json_file(sky_json(sky), indent=None)})


def write_kinds(kinds: tuple[SkyOfKind, ...], out: Path) -> None:
    """Write sky-aerosols.png and sky-aerosols.json."""
    content = json_file(kinds_json(kinds), indent=None)
    write_folder(out, {"sky-aerosols.png": kinds_picture(kinds), "sky-aerosols.json": content})
