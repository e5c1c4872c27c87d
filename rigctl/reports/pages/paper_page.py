"""The page on the paper: its statements with their verdicts, its figures, what was assumed."""

from collections.abc import Iterable, Mapping

from rigctl.paper.paper_result import PaperResult
from rigctl.paper.results import figures_of
from rigctl.reports.report import Bullets, Paragraph, Picture, Report, Section
from rigctl.reports.tables.paper_tables import description_table, search_lines, statement_table, tally

NOTHING_STATED = "The text says what is drawn, and nothing of it that could be held or not."
_MEANING = (
    "holds, opposite: margins above three numerical errors. Cannot be seen: every P_D compared above .999, or the "
    "authors' measured points are needed. Noise floor: exact DoLP SNRs below 2.1, that of unpolarised light is 1.913. "
    "Ambiguous: readings of the sentence differ, each is named. A statement that does not come out is a result: the "
    "optical properties of the paper are not at hand."
)


def paper_report(found: PaperResult, pictures: Mapping[str, bytes]) -> Report:
    """Return the report on the paper.

    Parameters
    ----------
    found : PaperResult
        What came out.
    pictures : mapping
        File name to picture, as `rigctl.reports.outputs.paper_files` has them.
    """
    return Report(
        title="[MK14] figure by figure and sentence by sentence",
        source="Meng & Kerekes, An Analytical Model for Optical Polarimetric Imaging Systems, IEEE TGRS 2014",
        sections=[_summary(found), *_figures(found, pictures), *_search(found), *_assumed(found)],
    )


def _summary(found: PaperResult) -> Section:
    lines = tuple(f"{one.name}: {tally(one.results)}" for one in found.sets)
    return Section(title="What comes out", blocks=(Bullets(items=lines), Paragraph(text=_MEANING)))


def _figures(found: PaperResult, pictures: Mapping[str, bytes]) -> Iterable[Section]:
    for number in found.figures:
        shown = [Picture(png=png, caption=name) for name, png in pictures.items() if name.startswith(f"fig{number}-")]
        rows = [one for one in found.results if number in figures_of(one.statement)]
        judged = [statement_table(rows)] if rows else [Paragraph(text=NOTHING_STATED)]
        blocks = (*shown, *judged, description_table(number))
        yield Section(title=f"Fig. {number}", blocks=blocks)


def _search(found: PaperResult) -> Iterable[Section]:
    if found.search is None:
        return
    note = "Without a tolerance: to be confirmed with --materials."
    yield Section(title="Search", blocks=(Bullets(items=(*search_lines(found.search), note)),))


def _assumed(found: PaperResult) -> Iterable[Section]:
    yield Section(title="Assumed", blocks=(Bullets(items=found.remarks),))
    for one in found.sets:
        yield Section(title=f"Assumed in {one.name}", blocks=(Bullets(items=one.assumed),), folded=True)
