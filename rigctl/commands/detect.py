"""``rigctl detect``: the RX detector on a run."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.terminal import print_json, progress, results, warn


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
    from rich.table import Table

    from rigctl.jobs.detect import DetectRequest, detect_target
    from rigctl.reports.rx_files import detection_json

    request = DetectRequest(background=background, target=target, regions=regions, scene=scene, noise=noise)
    detection = detect_target(run, request, out=out)
    found, names = detection.found, detection.files
    for doubt in detection.doubts:
        warn(doubt)
    content = detection_json(found, background=background, target=target)
    if as_json:
        print_json(content)
        return
    table = Table(title=f"RX: {target} on {background}", title_justify="left", box=None, pad_edge=False)
    for title in ("P_FA", "threshold", "P_D predicted", "P_D measured", "95 % band"):
        table.add_column(title, justify="right")
    for point in content["points"]:
        table.add_row(
            f"{point['p_false_alarm']:.1e}",
            f"{point['threshold']:.2f}",
            f"{point['p_detection_predicted']:.4f}",
            f"{point['p_detection_measured']:.4f}",
            f"{point['band_low']:.4f} to {point['band_high']:.4f}",
        )
    results().print(table)
    for text in (f"predicted from {found.predicted_from}", *found.warnings, f"{', '.join(names)} in {out}"):
        progress().print(text, markup=False)
