"""The page on the paper's statements, from the program (python -m tests.rigctl.paper.statements_page)."""

import sys
from collections.abc import Sequence

from rigctl.paper.statements import IN_WORDS, Judged, descriptions, statements
from rigctl.verbs.paper import SHIPPED, PaperResult, paper

_HEAD = """# What [MK14] says of its figures, and what comes out

Every sentence of sections II-C to VI about what a figure shows, checked through the whole chain with two sets of
materials, for the optical properties of the paper stand in a reference that is not at hand. Written by `rigctl paper`
(`python -m tests.rigctl.paper.statements_page > docs/paper-statements.md`); a test fails when page and program differ.

- **library**: black paint (slope 0.15) and asphalt (slope 0.30) of the material library, with a texture that
  multiplies all Stokes parameters of the asphalt alike (`examples/paper/library.toml`);
- **rough**: paint of slope 0.30, asphalt of slope 0.40, and the diagonal texture of eq. (10), 5 % of the reflected S0
  in S0, S1 and S2 each (`examples/paper/rough.toml`). Nothing was tuned beyond these two sets.

| verdict | means |
|---|---|
| holds | every inequality of the sentence holds, by more than three numerical errors |
| opposite | at least one is reversed, by more than three numerical errors |
| cannot be seen | every P_D compared is above .999; or it needs the authors' measured points, which nobody here has |
| noise floor | exact DoLP SNRs compared lie below 2.1: those of light without polarization are 1.913 |
| ambiguous | readings of the sentence differ, each is named; or the margin is within the numerical error |

"""
_NOTES = """
**What brings them about.** Fig. 9a: at a view of 10 deg and phi 0 all these ratios lie near 1.913, the exact SNR of
unpolarised light; to first order (`--snr first-order`) they may be any number down to 0. Fig. 10: near the glint the
smooth paint of the library is so bright that the path dilutes its polarization more than it adds; rougher paint is
darker there, and the path's own polarization, which grows with altitude, makes up for it. Fig. 13: with the library's
slopes the paint is 1.5 times as bright as the asphalt at a view of 40 deg (S0 2408 to 1642 DN) and is found by its
brightness; with those of the rough set the two are alike there (1346 to 1409 DN). How model and data agree cannot be
judged without the authors' points.
"""
_SAID = """
## Sentences that say what is drawn

The other sentences of the text about these figures claim nothing that could hold or not. (Figs 1, 3 and 4 are drawings
of the model.)

| figure | sentence | here |
|---|---|---|
"""


def page() -> str:
    """Return the page; some forty seconds."""
    found = paper()
    assert isinstance(found, PaperResult)
    return _page(found.found.results, SHIPPED)


def _page(found: Sequence[Judged], materials: Sequence[str]) -> str:
    by_key = {(one.materials, one.statement.id): one for one in found}
    head = "| figure | id | sentence | where | check | " + " | ".join(materials) + " |\n"
    rule = "|---" * (5 + len(materials)) + "|\n"
    rows = []
    for one in statements():
        cells = [verdict_cell(by_key[name, one.id]) for name in materials]
        rows.append(
            f"| {one.figure} | {one.id} | {one.sentence} | {one.geometry} | {one.check} | {' | '.join(cells)} |\n"
        )
    said = "".join(f"| {one.figure} | {one.sentence} | {one.here} |\n" for one in descriptions())
    return _HEAD + head + rule + "".join(rows) + _NOTES + _SAID + said


def verdict_cell(one: Judged) -> str:
    """Return verdict and deciding numbers of a statement, as a cell of the page."""
    text = IN_WORDS[one.verdict]
    if len({reading.verdict for reading in one.readings}) > 1:
        text += ": " + "; ".join(f"{reading.name}: {IN_WORDS[reading.verdict]}" for reading in one.readings)
    test = one.readings[0].deciding
    numbers = ", ".join(f"{number.label} {number.value:.3g}" for number in (() if test is None else test.numbers[:2]))
    return f"**{text}**. {numbers}".rstrip(". ") if numbers else f"**{text}**"


if __name__ == "__main__":
    sys.stdout.write(page())
