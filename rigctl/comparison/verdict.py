"""The verdict of a comparison, by region and of all of it: no two parts of a report contradict one another."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
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
    rows: Sequence["Row"], checks: Sequence["Check"], unjudged: Mapping[str, str]
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


def verdict_of(rows: Sequence["Row"], checks: Sequence["Check"], unjudged: Mapping[str, str]) -> VerdictName:
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


def refused_regions(checks: Sequence["Check"]) -> dict[str, str]:
    """Return the regions that a check of their own refused, and why."""
    return {
        check.region: f"{check.name}: {check.text}"
        for check in checks
        if check.verdict == "refused" and check.region is not None
    }


def refusals(checks: Sequence["Check"]) -> tuple[str, ...]:
    """Return why a run or some of its regions are unsound, what they have in common once."""
    return tuple(f"{title.removeprefix('refused, ')}: {text}" for title, text in said_of(checks, "refused"))


def reservations(checks: Sequence["Check"], regions: Mapping[str, RegionVerdict]) -> str:
    """Return what an agreement is held with: flags, and regions that cannot be judged; empty where there is nothing."""
    flags = titles(checks, "flagged")
    unjudged = [name for name, found in regions.items() if found.verdict == "cannot_be_judged"]
    parts = [f"flagged: {flags}"] if flags else []
    return "; ".join([*parts, f"cannot be judged: {', '.join(unjudged)}"] if unjudged else parts)


def not_judged(checks: Sequence["Check"]) -> str:
    """Return the verdict of a comparison that cannot be judged, in a sentence without its point."""
    why = "the run is unsound" if any(check.verdict == "refused" for check in checks) else "no region gives its numbers"
    return f"model and measurement cannot be judged: {why}"


def unjudged_lines(regions: Mapping[str, RegionVerdict], checks: Sequence["Check"]) -> list[str]:
    """Return why regions cannot be judged, those of one reason together; those that a check refused are said there."""
    refused = refused_regions(checks)
    by_reason: dict[str, list[str]] = {}
    for name, found in regions.items():
        if found.verdict == "cannot_be_judged" and name not in refused:
            by_reason.setdefault(found.reason, []).append(name)
    return [f"{', '.join(names)} cannot be judged: {reason}" for reason, names in by_reason.items()]


def said_of(checks: Sequence["Check"], *verdicts: str) -> list[tuple[str, str]]:
    """Return checks of some verdicts as a heading and a text; what many regions have in common is said once."""
    groups: dict[tuple[str, str], list[Check]] = {}
    for check in checks:
        if check.verdict in verdicts:
            groups.setdefault((check.verdict, check.kind), []).append(check)
    return [(f"{verdict}, {_title(group)}", _text(group)) for (verdict, _), group in groups.items()]


def titles(checks: Sequence["Check"], *verdicts: str) -> str:
    """Return the names of checks of some verdicts, those of one kind together."""
    groups: dict[str, list[Check]] = {}
    for check in checks:
        if check.verdict in verdicts:
            groups.setdefault(check.kind, []).append(check)
    return ", ".join(_title(group) for group in groups.values())


def _title(group: Sequence["Check"]) -> str:
    regions = [check.region for check in group if check.region is not None]
    return f"{group[0].kind} of {', '.join(regions)}" if len(regions) > 1 else group[0].name


def _text(group: Sequence["Check"]) -> str:
    if len(group) == 1:
        return group[0].text
    if all(check.size for check in group):
        return f"{'; '.join(f'{check.region} {check.size}' for check in group)}: {group[0].rule}"
    return "; ".join(dict.fromkeys(check.text for check in group))


def without_decisions(rows: Iterable["Row"], unjudged: Mapping[str, str]) -> tuple["Row", ...]:
    """Return rows without a decision where their region cannot be judged."""
    return tuple(replace(row, agrees=None) if row.region in unjudged else row for row in rows)


def _refuses_run(check: "Check") -> bool:
    return check.verdict == "refused" and check.region is None


def _of_region(
    name: str, rows: Sequence["Row"], checks: Sequence["Check"], unjudged: Mapping[str, str]
) -> RegionVerdict:
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
    if not any(row.agrees is not None for row in rows if row.region == name):
        return RegionVerdict(verdict="agrees_with_reservations", reason="nothing of it was tested")
    return RegionVerdict(verdict="agrees", reason="")
