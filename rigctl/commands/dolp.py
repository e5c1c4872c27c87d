"""``rigctl dolp``: what noise does to the degree of polarization."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.terminal import print_json, progress, results
from rigctl.report.table import terminal_table

app = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def dolp() -> None:
    """Show what noise does to the degree of linear polarization.

    Example: rigctl dolp fig5 --out fig5
    """


@app.command()
def fig5(
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for fig5.png.")] = None,
    draws: Annotated[int, typer.Option(metavar="N", min=10, help="Poisson draws for each ratio.")] = 10_000,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of the draws.")] = 1,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """[MK14] Fig. 5: DoLP of light with S = (1, 0.5, 0.5) against the SNR of S0, shot noise, four angles.

    Beside the paper's first-order mean and deviation and its 1e4 draws stands the exact law: of Poisson counts up to
    20 dB (given S0 > 0); above, of Gaussian ones, less what those are off at 20 dB, which falls with more light.
    20 dB is a ratio of 10.

    Example: rigctl dolp fig5 --out fig5
    """
    from rigctl.jobs.dolp import dolp_by_snr
    from rigctl.paper import fig5_table

    found = dolp_by_snr(draws=draws, seed=seed, out=out)
    if as_json:
        print_json({name: _numbers(values) for name, values in vars(found).items()})
    else:
        results().print(terminal_table(fig5_table(found)))
    if out is not None:
        progress().print(f"{out / 'fig5.png'}", markup=False)


@app.command()
def estimators(
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for estimators.png.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Bias and rms error of estimators of the true DoLP against its true signal-to-noise ratio.

    In units of the deviation of S1/S0 and of S2/S0, which are taken as equal and uncorrelated.

    Example: rigctl dolp estimators --out estimators
    """
    from rigctl.jobs.dolp import compare_estimators
    from rigctl.paper import estimator_table

    found = compare_estimators(out=out)
    if as_json:
        errors = {name: {"bias": _numbers(e.bias), "rms": _numbers(e.rms)} for name, e in found.errors.items()}
        print_json({"true_snr": found.true_snr.tolist()} | errors)
    else:
        results().print(terminal_table(estimator_table(found.errors, found.true_snr.tolist())))
    if out is not None:
        progress().print(f"{out / 'estimators.png'}", markup=False)


def _numbers(values: Iterable[float]) -> list[float | None]:
    """Return numbers as JSON holds them: what does not exist is null."""
    return [float(v) if math.isfinite(v) else None for v in values]
