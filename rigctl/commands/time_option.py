"""Times on the command line."""

from datetime import UTC, datetime

from rigctl.errors import ConfigError
from rigctl.number_range import FIRST_YEAR, LAST_YEAR
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
    if not FIRST_YEAR <= moment.year <= LAST_YEAR:
        raise ConfigError(f"{name}: {text!r}: the year must lie between {FIRST_YEAR} and {LAST_YEAR}")
    return unix_ns(moment.astimezone(UTC))
