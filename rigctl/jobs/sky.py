"""Computing the sky of a scene."""

from collections.abc import Callable
from pathlib import Path

from rigctl.files.choices import Engine
from rigctl.files.scene_file import SceneFile, scene_file
from rigctl.scene.sky_map import SkyMap, SkyOfKind, skies_of_kinds, sky_map


def compute_sky(
    scene: Path | SceneFile,
    *,
    engine: Engine = "own",
    out: Path | None = None,
    tell: Callable[[float], None] | None = None,
) -> SkyMap:
    """Return the sky of a scene over the hemisphere.

    Parameters
    ----------
    scene : Path or SceneFile
        Scene file with sun, atmosphere and the sensor's band.
    engine : {"own", "sasktran2"}
        What solves it.
    out : Path or None
        Folder for sky.png and sky.json.
    tell : callable or None
        Told the optical depth of each wavelength that is solved.

    Raises
    ------
    ConfigError
        The file says nothing of sun and atmosphere, or of a sun too low; or the engine is not installed.
    """
    found = sky_map(scene_file(scene), engine=engine, tell=tell)
    if out is not None:
        from rigctl.reports.outputs.prediction_files import write_sky  # half a second, wanted for a picture only

        write_sky(found, out)
    return found


def compute_skies_by_aerosol(
    scene: Path | SceneFile,
    *,
    engine: Engine = "own",
    out: Path | None = None,
    progress: Callable[[SkyOfKind], None] | None = None,
) -> tuple[SkyOfKind, ...]:
    """Return the sky of a scene for each kind of aerosol, that of the file first.

    Parameters
    ----------
    scene : Path
        Scene file with sun, atmosphere and the sensor's band.
    engine : {"own", "sasktran2"}
        What solves them.
    out : Path or None
        Folder for sky-aerosols.png and sky-aerosols.json.
    progress : callable or None
        Told of every sky that is computed.

    Raises
    ------
    ConfigError
        The scene's sky is a table, which has one aerosol, or cannot be computed.
    """
    found = []
    for one in skies_of_kinds(scene_file(scene), engine=engine):
        if progress is not None:
            progress(one)
        found.append(one)
    kinds = tuple(found)
    if out is not None:
        from rigctl.reports.outputs.prediction_files import write_kinds  # half a second, wanted for a picture only

        write_kinds(kinds, out)
    return kinds
