"""Flags: oddities that a calibration found in the frames that it was given."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Flag:
    """One remark on the frames.

    Attributes
    ----------
    name : str
        What it is, in ``lower_case_with_underscores``; names stay the same from version to version.
    level : str or None
        The level that is named; None where it is the whole set.
    message : str
        What was found, what is allowed, and what to try.
    refuses : bool
        The calibration cannot be right with it, so there is none.
    """

    name: str
    level: str | None = None
    message: str
    refuses: bool = False
