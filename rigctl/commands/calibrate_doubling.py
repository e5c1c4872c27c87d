"""``rigctl calibrate doubling``: the doubling interval of the dark current, from calibrations when cold and warm."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.terminal import print_json, results


def doubling(
    files: Annotated[list[Path], typer.Argument(metavar="NOISE.json...", help="Calibrations of one camera.")],
    temperature_c: Annotated[
        list[float] | None, typer.Option(help="Temperature of each file, where the frames do not say it.")
    ] = None,
    by_variance: Annotated[
        bool, typer.Option("--by-variance", help="Take the dark current by variance: cameras that clamp black.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Find the rise of temperature that doubles the dark current, with its standard error (EMVA 1288).

    Example: rigctl calibrate doubling noise_20c.json noise_30c.json noise_40c.json
    """
    from rigctl.jobs.calibrate_doubling import calibrate_doubling

    found = calibrate_doubling(files, temperatures_c=temperature_c or (), by_variance=by_variance)
    if as_json:
        print_json(asdict(found))
        return
    results().print(
        f"the dark current doubles every {found.value_k:.2f} +- {found.std_error_k:.2f} K "
        f"({found.n_temperatures} temperatures)"
    )
