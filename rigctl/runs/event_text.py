"""One event of a run in words."""

from collections.abc import Mapping
from typing import Any

_UTC_DIGITS = 19


def event_line(event: Mapping[str, Any]) -> str:
    """Return an event as a line that a person reads: when, what, and what is known of it."""
    return f"{event['utc'][:_UTC_DIGITS]}Z  {event['event']:<14}  {event_facts(event)}".rstrip()


def event_facts(event: Mapping[str, Any]) -> str:
    """Return what is known of an event in words."""
    return "; ".join(f"{name.replace('_', ' ')}: {_said(value)}" for name, value in event["facts"].items())


def _said(value: object) -> str:
    if value is None:
        return "not known"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_said(one)}" for name, one in value.items()) or "none"
    if isinstance(value, list):
        return ", ".join(map(_said, value)) or "none"
    return str(value)
