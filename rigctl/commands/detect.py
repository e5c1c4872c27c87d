"""``rigctl detect``: the RX detector on a run."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.terminal import print_json, progress, results, solving_shown, warn
from rigctl.reports.writers.terminal_table import terminal_table


def command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.")],
    background: Annotated[str, typer.Option(metavar="NAME", help="Region that gives mean and covariance.")],
    target: Annotated[str, typer.Option(metavar="NAME", help="Region that is to be detected.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for map, curves and numbers.")],
    regions: Annotated[Path | None, typer.Option(metavar="FILE", help="Regions file.")] = None,
    scene: Annotated[
        Path | None, typer.Option(metavar="SCENE.toml", help="Scene file: predicts from it; holds the regions too.")
    ] = None,
    noise: Annotated[Path | None, typer.Option(metavar="FILE", help="Noise calibration, for a scene.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Run the RX detector on the Stokes parameters of a run's first cycle.

    Writes the map of D, the measured ROC of the target's pixels with its 95 % band, and the predicted ROC by the exact
    law on top, from the scene file or from the regions' own moments.

    Example: rigctl detect runs/panels --background asphalt --target black_panel --out rx
    --regions examples/regions.toml
    """
    from rigctl.jobs.detect import DetectRequest, detect_target
    from rigctl.reports.tables.detection_tables import detection_json, round_roc_table

    request = DetectRequest(background=background, target=target, regions=regions, scene=scene, noise=noise)
    with solving_shown():
        detection = detect_target(run, request, out=out)
    found, names = detection.found, detection.files
    for doubt in detection.doubts:
        warn(doubt)
    if as_json:
        print_json(detection_json(found, background=background, target=target))
        return
    results().print(terminal_table(round_roc_table(found, background=background, target=target)))
    for text in (f"predicted from {found.predicted_from}", *found.warnings, f"{', '.join(names)} in {out}"):
        progress().print(text, markup=False)
