"""Verdicts on the paper's statements with one set of materials."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rigctl.paper.numbers import Number, Reading, Verdict
from rigctl.paper.statement import PaperScenes, Statement
from rigctl.paper.statements import STATEMENTS

IN_WORDS: dict[Verdict, str] = {
    "holds": "holds",
    "opposite": "opposite",
    "cannot_be_seen": "cannot be seen",
    "noise_floor": "noise floor",
    "ambiguous": "ambiguous",
}


@dataclass(frozen=True, kw_only=True)
class Result:
    """A statement and what comes out.

    Attributes
    ----------
    statement : Statement
        The sentence.
    materials : str
        Which set.
    readings : tuple of Reading
        Each with its numbers.
    as_paper : tuple of Reading
        The same, computed as the authors did; empty where that was not asked for.
    """

    statement: Statement
    materials: str
    readings: tuple[Reading, ...]
    as_paper: tuple[Reading, ...] = ()

    @property
    def id(self) -> str:
        """Its name among all results: set of materials and statement."""
        return f"{self.materials}/{self.statement.id}"

    @property
    def verdict(self) -> Verdict:
        """That of all readings; ambiguous where they differ."""
        return _joint(self.readings)

    @property
    def as_paper_verdict(self) -> Verdict | None:
        """The verdict on the numbers as the authors computed them."""
        return _joint(self.as_paper) if self.as_paper else None

    @property
    def margin(self) -> float | None:
        """Of the test that decides the first reading."""
        test = self.readings[0].deciding
        return None if test is None else test.margin

    @property
    def numerical_error(self) -> float | None:
        """Of that margin."""
        test = self.readings[0].deciding
        return None if test is None else test.error

    @property
    def numbers(self) -> tuple[tuple[str, Number], ...]:
        """Label and number of every reading; that of a reading beside the first is named before it."""
        return tuple(_labelled(self.readings))

    @property
    def as_paper_numbers(self) -> tuple[tuple[str, Number], ...]:
        """The same as the authors computed them."""
        return tuple(_labelled(self.as_paper))


def _joint(readings: Sequence[Reading]) -> Verdict:
    verdicts = {reading.verdict for reading in readings}
    return verdicts.pop() if len(verdicts) == 1 else "ambiguous"


def _labelled(readings: Sequence[Reading]) -> Iterable[tuple[str, Number]]:
    seen: set[tuple[str, float]] = set()
    for k, reading in enumerate(readings):
        for number in reading.numbers:
            if (number.label, number.value) not in seen:
                seen.add((number.label, number.value))
                yield (number.label if k == 0 else f"{number.label} ({reading.name})"), number


def chosen(figures: Sequence[int]) -> tuple[Statement, ...]:
    """Return the statements about some figures; about all where none is named."""
    wanted = set(figures)
    return tuple(one for one in STATEMENTS if not wanted or wanted & set(figures_of(one)))


def figures_of(statement: Statement) -> tuple[int, ...]:
    """Return the numbers of the figures that a statement is about."""
    if " to " in statement.figure:
        first, last = statement.figure.split(" to ")
        return tuple(range(int(first), int(last) + 1))
    return tuple(int(part.strip().rstrip("ab")) for part in statement.figure.split(","))


def results(
    scenes: PaperScenes,
    materials: str,
    statements: Iterable[Statement] = STATEMENTS,
    *,
    as_paper: PaperScenes | None = None,
) -> tuple[Result, ...]:
    """Return what comes out of statements.

    Parameters
    ----------
    scenes : PaperScenes
        Of one set of materials.
    materials : str
        Its name.
    statements : iterable of Statement
        Which.
    as_paper : PaperScenes or None
        The same set, computed as the authors did.
    """
    # What is said of all geometries is asked last, when they are there.
    ordered = sorted(statements, key=lambda one: " to " in one.figure)
    found = {
        one.id: Result(
            statement=one,
            materials=materials,
            readings=one.readings(scenes),
            as_paper=() if as_paper is None else one.readings(as_paper),
        )
        for one in ordered
    }
    return tuple(found[one.id] for one in statements if one.id in found)
