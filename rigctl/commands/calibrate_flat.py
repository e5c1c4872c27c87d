"""``rigctl calibrate flat``: the response of each pixel behind the polarizer at each of its angles."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from rigctl.calibrations.flat.flat_file import flat_facts, flat_npz
from rigctl.calibrations.flat.run_flat import flat_of_run
from rigctl.durable_file import write_durably
from rigctl.errors import ConfigError
from rigctl.runs.run_folder import read_run
from rigctl.terminal import print_json, results, warn

# A pattern of less is none.
_LEAST_PATTERN = 1e-4


def flat(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder with flat frames at each angle, and darks.")],
    out: Annotated[Path, typer.Option(metavar="FILE.npz", help="File to write, such as flat.npz.")],
    valid_days: Annotated[
        float | None, typer.Option(metavar="DAYS", min=0.0, help="For how long it holds; 30 if not said.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print its numbers as JSON.")] = False,
) -> None:
    """Measure flat fields, one for each polarizer angle, each pixel with its error, from frames of even light.

    `rigctl stokes --flat FILE` and `rigctl compare --flat FILE` divide by them. Dividing adds the noise of the flats as
    a pattern that differs from angle to angle: it is stated, and goes into predictions; take many bright frames.

    Example: rigctl calibrate flat runs/flats --out flat.npz
    """
    folder = read_run(run)
    found = flat_of_run(folder)
    facts = flat_facts(found, folder, valid_days=valid_days)
    try:
        write_durably(out, flat_npz(found, facts))
    except OSError as error:
        raise ConfigError(f"{out}: cannot be written: {error.strerror}; its folder has to exist") from error
    if as_json:
        print_json(facts)
        return
    table = Table(box=None, pad_edge=False)
    for title in ("angle [deg]", "frames", "mean [DN]", "light over mean", "std error", "pattern [%]", "own noise [%]"):
        table.add_column(title, justify="right")
    for row in facts["angles"]:
        table.add_row(
            f"{row['polarizer_angle_deg']:.1f}",
            str(row["frames"]),
            f"{row['mean_dn']:.1f}",
            f"{row['throughput']['value']:.5f}",
            f"{row['throughput']['std_error']:.2g}",
            f"{100.0 * row['pattern_rms']:.3f}",
            f"{100.0 * row['noise_rms']:.3f}",
        )
    results().print(table)
    worse = [row for row in facts["angles"] if row["noise_rms"] > row["pattern_rms"]]
    if worse:
        largest = max(row["noise_rms"] / max(row["pattern_rms"], _LEAST_PATTERN) for row in worse)
        warn(
            f"{len(worse)} of {len(facts['angles'])} flats have more noise of their own than pattern: dividing by them "
            f"makes single pixels worse, and dust and vignetting alone better; take {largest**2:.0f} times as many "
            f"frames or more, or brighter ones"
        )
