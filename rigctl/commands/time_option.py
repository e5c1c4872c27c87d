"""Times on the command line."""

from datetime import UTC, datetime

from rigctl.errors import ConfigError
from rigctl.utc_time import unix_ns


def time_option(name: str, text: str | None) -> int | None:
    """Return a time that was given on the command line [ns since 1970 UTC].

    Raises
    ------
    ConfigError
        It is no time, or has no zone.
    """
    if text is None:
        return None
    try:
        moment = datetime.fromisoformat(text)
    except ValueError as error:
        raise ConfigError(f"{name}: {text!r} is no time; write it like 2026-05-04T10:00Z") from error
    if moment.tzinfo is None:
        raise ConfigError(f"{name}: {text!r} has no zone; write {text}Z for UTC, or {text}+02:00")
    return unix_ns(moment.astimezone(UTC))
