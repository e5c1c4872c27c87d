"""The files of a sky, and of skies of several kinds of aerosol."""

import json
from pathlib import Path

from rigctl.durable_file import write_durably
from rigctl.reports.figures.sky_figure import kinds_picture, sky_picture
from rigctl.reports.tables.sky_tables import kinds_json, sky_json
from rigctl.scene.sky_map import SkyMap, SkyOfKind


def write_sky(sky: SkyMap, out: Path) -> None:
    """Write sky.png and sky.json."""
    out.mkdir(parents=True, exist_ok=True)
    write_durably(out / "sky.png", sky_picture(sky))
    write_durably(out / "sky.json", (json.dumps(sky_json(sky), allow_nan=False) + "\n").encode())


def write_kinds(kinds: tuple[SkyOfKind, ...], out: Path) -> None:
    """Write sky-aerosols.png and sky-aerosols.json."""
    out.mkdir(parents=True, exist_ok=True)
    write_durably(out / "sky-aerosols.png", kinds_picture(kinds))
    write_durably(out / "sky-aerosols.json", (json.dumps(kinds_json(kinds), allow_nan=False) + "\n").encode())
