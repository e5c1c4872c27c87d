"""``rigctl dolp``: what noise does to the degree of polarization."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from model.processing.dolp_against_snr import DolpAgainstSnr, dolp_against_snr
from model.processing.estimators import ESTIMATORS, bias_and_rms
from rigctl.durable_file import write_durably
from rigctl.terminal import print_json, progress, results

app = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None)

_FIG5_STOKES = (1.0, 0.5, 0.5)
_FIG5_SNR_DB = (0.0, 40.0, 21)
_TRUE_SNR = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0)


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
    ratios = 10.0 ** (np.linspace(*_FIG5_SNR_DB) / 20.0)
    found = dolp_against_snr(_FIG5_STOKES, ratios, draws=draws, generator=np.random.default_rng(seed))
    if as_json:
        print_json({name: _numbers(values) for name, values in vars(found).items()})
    else:
        results().print(_fig5_table(found))
    if out is not None:
        from rigctl.reports.figures.dolp_figures import fig5_plot

        _write(out, "fig5.png", fig5_plot(found))


@app.command()
def estimators(
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for estimators.png.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Bias and rms error of estimators of the true DoLP against its true signal-to-noise ratio.

    In units of the deviation of S1/S0 and of S2/S0, which are taken as equal and uncorrelated.

    Example: rigctl dolp estimators --out estimators
    """
    found = {name: bias_and_rms(name, _TRUE_SNR) for name in ESTIMATORS}
    if as_json:
        print_json(
            {
                "true_snr": list(_TRUE_SNR),
                **{name: {"bias": _numbers(e.bias), "rms": _numbers(e.rms)} for name, e in found.items()},
            }
        )
    else:
        table = Table(box=None, pad_edge=False, title="bias/rms error", title_justify="left")
        table.add_column("true SNR", justify="right")
        for name in ESTIMATORS:
            table.add_column(name, justify="right", no_wrap=True)
        for k, ratio in enumerate(_TRUE_SNR):
            table.add_row(f"{ratio:g}", *(f"{e.bias[k]:+.3f}/{e.rms[k]:.3f}" for e in found.values()))
        results().print(table)
    if out is not None:
        from rigctl.reports.figures.dolp_figures import estimator_plot

        _write(out, "estimators.png", estimator_plot())


def _fig5_table(found: DolpAgainstSnr) -> Table:
    table = Table(box=None, pad_edge=False)
    for title in ("SNR [dB]", "S0 [e-]", "mean: first", "exact", "drawn", "std: first", "exact", "drawn"):
        table.add_column(title, justify="right")
    for k, ratio in enumerate(found.snr):
        table.add_row(
            f"{20 * np.log10(ratio):.0f}",
            f"{found.s0_e[k]:.4g}",
            *(f"{values[k]:.5f}" for values in (found.first_mean, found.mean, found.drawn_mean)),
            *(f"{values[k]:.5f}" for values in (found.first_std, found.std, found.drawn_std)),
        )
    return table


def _numbers(values: object) -> list[float | None]:
    """Return an array as JSON holds it: what does not exist is null."""
    return [float(v) if np.isfinite(v) else None for v in np.asarray(values, dtype=np.float64)]


def _write(out: Path, name: str, data: bytes) -> None:
    out.mkdir(parents=True, exist_ok=True)
    write_durably(out / name, data)
    progress().print(f"{out / name}", markup=False)
