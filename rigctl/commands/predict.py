"""``rigctl predict``: what the model says that a scene will give."""

from pathlib import Path
from typing import Annotated

import typer

from model.prediction import predict
from rigctl.comparison.scene_inputs import build_scenario, file_readout, gather
from rigctl.files.scene_file import load_scene
from rigctl.noise.noise_file import read_noise_file
from rigctl.reports.number_table import quantity_tables
from rigctl.reports.tables_json import prediction_json
from rigctl.terminal import print_json, progress, results

_MS_PER_S = 1000.0


def command(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml", help="Scene file.")],
    noise: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Noise calibration; takes the place of the assumed noise.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Print what the analytical model predicts for each region: counts, Stokes parameters, DoLP, deviations, SNR.

    Example: rigctl predict examples/scene-panels.toml
    """
    scene_file = load_scene(scene)
    inputs = gather(scene_file, None if noise is None else read_noise_file(noise))
    values = dict(zip(inputs.names, inputs.values.tolist(), strict=True))
    scenario = build_scenario(
        scene_file,
        values,
        readout=file_readout(scene_file),
        exposure_s=scene_file.acquisition.exposure_ms / _MS_PER_S,
    )
    content = prediction_json(predict(scenario), remarks=inputs.remarks)
    if as_json:
        print_json(content)
        return
    for table in quantity_tables(content["regions"]):
        results().print(table)
    for remark in (*content["remarks"], *(w for region in content["warnings"].values() for w in region)):
        progress().print(remark, markup=False)
