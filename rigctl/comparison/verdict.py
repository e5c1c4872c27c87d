"""The verdict of a comparison, by region and of all of it: no two parts of a report contradict one another."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from rigctl.comparison.checks import Check
from rigctl.comparison.rows import Row

VerdictName = Literal["agrees", "agrees_with_reservations", "disagrees", "cannot_be_judged"]

# As a person reads it.
VERDICT_WORDS: dict[VerdictName, str] = {
    "agrees": "agree",
    "agrees_with_reservations": "agree, with reservations",
    "disagrees": "DISAGREE",
    "cannot_be_judged": "cannot be judged",
}


# With reservations is agreement; what cannot be judged is neither.
AGREES: dict[VerdictName, bool | None] = {
    "agrees": True,
    "agrees_with_reservations": True,
    "disagrees": False,
    "cannot_be_judged": None,
}


@dataclass(frozen=True, kw_only=True)
class RegionVerdict:
    """Verdict of a region, and why it cannot be judged or is held with reservations."""

    verdict: VerdictName
    reason: str


def region_verdicts(
    rows: Sequence[Row], checks: Sequence[Check], unjudged: Mapping[str, str]
) -> dict[str, RegionVerdict]:
    """Return the verdict of every region.

    Parameters
    ----------
    rows : sequence of Row
        With their decisions.
    checks : sequence of Check
        What the run says of itself.
    unjudged : mapping
        Region to why nothing can be said of it.
    """
    names = dict.fromkeys([*(row.region for row in rows), *unjudged])
    return {name: _of_region(name, rows, checks, unjudged) for name in names}


def verdict_of(rows: Sequence[Row], checks: Sequence[Check], unjudged: Mapping[str, str]) -> VerdictName:
    """Return the verdict of a comparison: that of a run that can be judged is taken from the regions that can."""
    regions = region_verdicts(rows, checks, unjudged)
    if any(_refuses_run(check) for check in checks):
        return "cannot_be_judged"
    if regions and all(found.verdict == "cannot_be_judged" for found in regions.values()):
        return "cannot_be_judged"
    if any(row.agrees is False for row in rows):
        return "disagrees"
    is_reserved = any(check.verdict in ("flagged", "refused") for check in checks) or bool(unjudged)
    return "agrees_with_reservations" if is_reserved else "agrees"


def refused_regions(checks: Sequence[Check]) -> dict[str, str]:
    """Return the regions that a check of their own refused, and why."""
    return {
        check.region: f"{check.name}: {check.text}"
        for check in checks
        if check.verdict == "refused" and check.region is not None
    }


def refusals(checks: Sequence[Check]) -> tuple[str, ...]:
    """Return why a run is unsound, once each."""
    return tuple(dict.fromkeys(f"{check.name}: {check.text}" for check in checks if check.verdict == "refused"))


def without_decisions(rows: Iterable[Row], unjudged: Mapping[str, str]) -> tuple[Row, ...]:
    """Return rows without a decision where their region cannot be judged."""
    return tuple(replace(row, agrees=None) if row.region in unjudged else row for row in rows)


def _refuses_run(check: Check) -> bool:
    return check.verdict == "refused" and check.region is None


def _of_region(name: str, rows: Sequence[Row], checks: Sequence[Check], unjudged: Mapping[str, str]) -> RegionVerdict:
    if name in unjudged:
        return RegionVerdict(verdict="cannot_be_judged", reason=unjudged[name])
    run = [check for check in checks if _refuses_run(check)]
    if run:
        return RegionVerdict(verdict="cannot_be_judged", reason="; ".join(f"{one.name}: {one.text}" for one in run))
    if any(row.agrees is False for row in rows if row.region == name):
        return RegionVerdict(verdict="disagrees", reason="")
    flags = [check.name for check in checks if check.verdict == "flagged" and check.region in (None, name)]
    if flags:
        return RegionVerdict(verdict="agrees_with_reservations", reason="flagged: " + ", ".join(flags))
    return RegionVerdict(verdict="agrees", reason="")
