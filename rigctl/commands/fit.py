"""``rigctl fit``: what measured regions say about a surface."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.terminal import print_json, progress, results
from rigctl.errors import DataError
from rigctl.reports.writers.terminal_table import terminal_table

app = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def fit() -> None:
    """Find the parameters of a surface from measured regions.

    Example: rigctl fit surface examples/fit-black-panel.toml
    """


@app.command()
def surface(
    file: Annotated[Path, typer.Argument(metavar="FIT.toml", help="Which regions, which geometry, what to find.")],
    profile: Annotated[
        bool, typer.Option("--profile", help="Intervals from the profile of chi-square: slower, good at a bound too.")
    ] = False,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Material file to write.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Fit refractive index, roughness, reflectance and specular weight to regions of one or several runs.

    The light is taken to be the sun alone, and the scale of each run to be unknown: what tells is the polarization
    of every region, and how bright the regions of one run are beside each other. Take regions in and beside the
    glint.

    Example: rigctl fit surface examples/fit-black-panel.toml --out fitted.toml
    """
    from rigctl.jobs.fit import fit_surface_file
    from rigctl.numbers.number_text import p_value
    from rigctl.reports.tables.surface_tables import fit_json, fit_tables

    fitted = fit_surface_file(file, profile=profile, out=out)
    fit = fitted.fit
    if as_json:
        print_json(fit_json(fitted))
    else:
        for table in fit_tables(fitted):
            results().print(terminal_table(table))
            results().print()
        results().print(
            f"chi-square {fit.chi_square:.4g} with {fit.degrees_of_freedom} degrees of freedom, {p_value(fit.p_value)}"
        )
        for words in (*fit.findings, *fitted.assumptions):
            results().print(words)
    if out is None:
        return
    if fitted.material is None:
        raise DataError(f"{out} is not written: {'; '.join(fit.findings)}")
    progress().print(f"material: {out}")
