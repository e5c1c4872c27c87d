"""Numbers as text in a report."""

from math import isfinite

from rigctl.reports.table import NOTHING

NO_NUMBER = "does not exist"


def to_digits(value: float, error: float) -> str:
    """Return a number to two digits of its error, or to four digits where there is none."""
    if not isfinite(value):
        return NO_NUMBER
    if error == 0.0 or not isfinite(error):
        return f"{value:.4g}"
    exponent = int(f"{error:.1e}".partition("e")[2])
    return f"{value:.{max(0, 1 - exponent)}f}"


def signed(score: float | None) -> str:
    """Return a standard score."""
    return NOTHING if score is None else f"{score:+.2f}"
