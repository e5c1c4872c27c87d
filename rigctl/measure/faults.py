"""Faults found in a run, as records and in words."""

from collections.abc import Sequence
from dataclasses import dataclass

# The size of a power law is its exponent less one.
_EXPONENT = "exponent - 1"
UNSEEN = "a dark level, gain or turn common to all frames acts like light and does not show in a run of equal exposures"


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One fault of a run, in the units of a report."""

    name: str  #: such as "throughput"
    angle_deg: float | None  #: of the frame; None for several
    value: float | None  #: its size; None if not testable
    std_error: float | None
    unit: str  #: "share", "deg", "DN", "pixel", ...
    testable: bool  #: whether the run determines it
    reason: str  #: reason if it is not testable
    confused_with: tuple[str, ...]  #: faults with the same effect on this run
    dolp_shift: float | None  #: largest change of the polarization of a region (or picture)
    aolp_shift_deg: float | None

    @property
    def title(self) -> str:
        """Name and angle."""
        return fault_title(self.name, self.angle_deg)


@dataclass(frozen=True, kw_only=True)
class FaultTerm(Fault):
    """A fault of a whole run, with its effect region by region."""

    named: bool  #: True for the causes that explain the run best
    by_region: dict[str, tuple[float | None, float | None]]  #: region to change of DoLP and of AoLP [deg]


def fault_lines(named: Sequence[Fault], reason: str, *, harmless: int = 0) -> list[str]:
    """Return the faults of a run, line by line, or the reason why none can be found.

    `harmless` is the number of omitted faults that move DoLP by less than its error.
    """
    if named:
        return [f"the run shows {term_text(term)}" for term in named]
    if reason:
        return [f"faults of the run: not testable, {reason}"]
    return [f"no fault of the run was found{' that moves DoLP by more than its error' if harmless else ''}"]


def term_text(term: Fault) -> str:
    """Return a fault in a line: its size, its effect, and faults with the same effect."""
    if term.value is None or term.std_error is None:
        return f"{term.title}: not testable, {term.reason}"
    size = f"{term.title}: {_number(term.value, term.unit)} +- {_number(term.std_error, term.unit).lstrip('+')}"
    moves = "" if term.dolp_shift is None else f"; moves DoLP by {_plain(term.dolp_shift, '.4f')}"
    if moves and term.aolp_shift_deg is not None:
        moves += f", AoLP by {_plain(term.aolp_shift_deg, '.2f')} deg"
    others = f"; cannot be distinguished from {_listed(term.confused_with)}" if term.confused_with else ""
    return size + moves + others


def _listed(titles: Sequence[str]) -> str:
    """Return faults in a few words, with the angles of each kind together."""
    by_name: dict[str, list[str]] = {}
    for title in titles:
        name, _, place = title.partition(" at ")
        by_name.setdefault(name, []).append(place.removesuffix(" deg"))
    return ", ".join(f"{name} at {', '.join(at)} deg" if at[0] else name for name, at in by_name.items())


def _plain(value: float, digits: str) -> str:
    """Return a number with its sign, without one if its digits are all 0."""
    text = format(value, "+" + digits)
    return text if float(text) else format(0.0, digits)


def _number(value: float, unit: str) -> str:
    if unit.startswith("share"):
        return f"{100.0 * value:+.2f} %"
    return f"{value:+.3g}" if unit == _EXPONENT else f"{value:+.3g} {unit}"


def fault_title(name: str, angle_deg: float | None) -> str:
    """Return the name of a fault with the angle of its frame."""
    return name if angle_deg is None else f"{name} at {angle_deg:g} deg"
