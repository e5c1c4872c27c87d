"""``rigctl dolp``: what noise does to the degree of polarization."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.terminal import print_json, progress, results

if TYPE_CHECKING:
    from rich.table import Table

    from model.processing.dolp_against_snr import DolpAgainstSnr
    from rigctl.jobs.dolp import ComparedEstimators

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

    Beside the paper's first-order mean and deviation and its 1e4 draws stands the exact law. 20 dB is a ratio of 10.

    Example: rigctl dolp fig5 --out fig5
    """
    from rigctl.jobs.dolp import dolp_by_snr

    found = dolp_by_snr(draws=draws, seed=seed, out=out)
    if as_json:
        print_json({name: _numbers(values) for name, values in vars(found).items()})
    else:
        results().print(_fig5_table(found))
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

    found = compare_estimators(out=out)
    if as_json:
        errors = {name: {"bias": _numbers(e.bias), "rms": _numbers(e.rms)} for name, e in found.errors.items()}
        print_json({"true_snr": found.true_snr.tolist()} | errors)
    else:
        results().print(_estimator_table(found))
    if out is not None:
        progress().print(f"{out / 'estimators.png'}", markup=False)


def _estimator_table(found: "ComparedEstimators") -> "Table":
    from rich.table import Table

    table = Table(box=None, pad_edge=False, title="bias/rms error", title_justify="left")
    table.add_column("true SNR", justify="right")
    for name in found.errors:
        table.add_column(name, justify="right", no_wrap=True)
    for k, ratio in enumerate(found.true_snr):
        table.add_row(f"{ratio:g}", *(f"{e.bias[k]:+.3f}/{e.rms[k]:.3f}" for e in found.errors.values()))
    return table


def _fig5_table(found: "DolpAgainstSnr") -> "Table":
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for title in ("SNR [dB]", "S0 [e-]", "mean: first", "exact", "drawn", "std: first", "exact", "drawn"):
        table.add_column(title, justify="right")
    for k, ratio in enumerate(found.snr):
        table.add_row(
            f"{20 * math.log10(ratio):.0f}",
            f"{found.s0_e[k]:.4g}",
            *(f"{values[k]:.5f}" for values in (found.first_mean, found.mean, found.drawn_mean)),
            *(f"{values[k]:.5f}" for values in (found.first_std, found.std, found.drawn_std)),
        )
    return table


def _numbers(values: Iterable[float]) -> list[float | None]:
    """Return numbers as JSON holds them: what does not exist is null."""
    return [float(v) if math.isfinite(v) else None for v in values]
