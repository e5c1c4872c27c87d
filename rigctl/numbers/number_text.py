"""Numbers as people write them: to the digits that are known, no power of ten that means nothing, no bare nan."""

from math import floor, isfinite, log10

# Where there is no number.
NOTHING = "–"
NO_NUMBER = "does not exist"

# Nothing here is known so well that less than this were different from 0.
_ROUNDING = 1e-12
# Chances below this rest on how far out a law holds, which nobody knows.
_LEAST_CHANCE = 1e-6


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


def size(value: float) -> str:
    """Return an error or a limit by its power of ten; 0 for what is left of rounding."""
    if not isfinite(value):
        return NOTHING
    return "0" if abs(value) < _ROUNDING else f"{value:.1e}"


def chance(probability: float) -> str:
    """Return a probability to two digits; how small one is that is very small means nothing."""
    if not isfinite(probability):
        return NO_NUMBER
    return f"{probability:.2g}" if probability >= _LEAST_CHANCE else "< 1e-6"


def p_value(probability: float) -> str:
    """Return a probability behind its name, as in "p = 0.03"."""
    found = chance(probability)
    return f"p {found}" if found.startswith("<") else f"p = {found}"


def percent(share: float, *, digits: int = 2, sign: bool = False) -> str:
    """Return a share in per cent to some digits, without a power of ten: "100 %", "0.013 %"."""
    if not isfinite(share):
        return NO_NUMBER
    value = 100.0 * share
    if abs(value) < _ROUNDING:
        return "0 %"
    decimals = min(max(0, digits - 1 - floor(log10(abs(value)))), 6)
    return f"{value:{'+' if sign else ''}.{decimals}f} %"
