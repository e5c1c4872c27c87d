"""``rigctl paper``: the paper, figure by figure and sentence by sentence."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.terminal import progress, results
from rigctl.files.choices import SnrForm


def command(
    figures: Annotated[
        list[int] | None, typer.Option("--figure", metavar="N", help="2 or 5 to 15; repeatable; all where left out.")
    ] = None,
    materials: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="library, rough, or a scene file like theirs; repeatable; both by default."),
    ] = None,
    snr: Annotated[
        SnrForm, typer.Option(metavar="KIND", help="DoLP SNR that is compared: exact, or first-order as the paper.")
    ] = "exact",
    height_m: Annotated[
        float, typer.Option(metavar="H", help="Height of the camera where the paper states none [m].")
    ] = 3000.0,
    as_paper: Annotated[
        bool, typer.Option("--as-paper", help="Also as the authors computed, and what that costs in truth.")
    ] = False,
    search: Annotated[
        int, typer.Option(metavar="N", min=0, help="Try N random sets of materials within their uncertainties.")
    ] = 0,
    seed: Annotated[int, typer.Option(metavar="S", min=0, help="Of the search.")] = 1,
    digitised: Annotated[
        Path | None,
        typer.Option(metavar="CSV", help="Points of the paper's figures: figure,panel,label,x,y; drawn over ours."),
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for page, statements, pictures.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Compute the figures of Meng & Kerekes 2014 and judge every sentence of its text about them.

    Verdicts: holds, opposite, cannot be seen (all is detected, or their measured points are needed), noise floor,
    ambiguous (readings of the sentence differ). A statement that does not come out is a result: the exit code is 0.
    With --out: paper.html, statements.csv and .json, curves.csv, and a picture of each figure.

    Example: rigctl paper --out paper

    Example: rigctl paper --figure 9 --figure 13 --materials rough --as-paper --out paper
    """
    from rigctl.jobs.paper import SHIPPED, PaperRequest, check_paper
    from rigctl.paper import search_lines, statement_json, tally, terminal_statements
    from rigctl.report.table import terminal_table

    request = PaperRequest(
        figures=tuple(figures or ()),
        materials=tuple(materials or SHIPPED),
        snr=snr,
        height_m=height_m,
        as_paper=as_paper,
        search=search,
        seed=seed,
        digitised=digitised,
        out=out,
    )
    found = check_paper(request, progress=lambda text: progress().print(text, markup=False))
    if as_json:
        from rigctl.console.terminal import print_json_list

        print_json_list(statement_json(found.results))
    else:
        results().print(terminal_table(terminal_statements(found.results)))
        for one in found.sets:
            results().print(f"{one.name}: {tally(one.results)}")
        for line in search_lines(found.search):
            results().print(line)
    for remark in (*found.remarks, *dict.fromkeys(text for one in found.sets for text in one.assumed)):
        progress().print(remark, markup=False)
    if out is not None:
        progress().print(f"paper.html, statements.csv, statements.json, curves.csv and pictures in {out}", markup=False)
