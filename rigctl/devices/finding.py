"""One line of a check-up."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What was looked at, what was found, and what to change.

    Attributes
    ----------
    what : str
        What was looked at.
    found : str
        What was found, with its unit.
    advice : str or None
        What to change; None where all is well.
    hint : str or None
        What may be changed, or left as it is.
    """

    what: str
    found: str
    advice: str | None = None
    hint: str | None = None
