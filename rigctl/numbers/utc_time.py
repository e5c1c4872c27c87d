"""Points in time as text, the one way this project writes them."""

from datetime import UTC, datetime, timedelta

from rigctl.errors import ConfigError
from rigctl.numbers.number_range import FIRST_YEAR, LAST_YEAR

NS_PER_S = 1_000_000_000
_EPOCH = datetime.fromisoformat("1970-01-01T00:00:00Z")


def utc_text(unix_ns: int) -> str:
    """Return a point in time as ISO 8601 text in UTC, with all nine digits of its nanoseconds.

    Parameters
    ----------
    unix_ns : int
        Nanoseconds since 1970-01-01T00:00:00Z, leap seconds not counted.

    Notes
    -----
    The text ends in ``Z`` and sorts as the times do: ``2026-05-04T10:00:00.250000000Z``.
    """
    seconds, nanoseconds = divmod(unix_ns, NS_PER_S)
    moment = datetime.fromtimestamp(seconds, tz=UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{nanoseconds:09d}Z"


def unix_ns(time: datetime) -> int:
    """Return a time with a zone in nanoseconds since 1970 (UTC)."""
    return (time - _EPOCH) // timedelta(microseconds=1) * 1000


def utc_moment(text: str) -> datetime:
    """Return the time that a UTC text says, to the second.

    Raises
    ------
    ValueError
        It is no time.
    """
    # Nanoseconds are more than the standard library reads.
    return datetime.fromisoformat(text[:19] + "+00:00")


def is_utc_text(text: str) -> bool:
    """Return whether a text says a time; header keywords of others hold all kinds of things."""
    try:
        utc_moment(text)
    except ValueError:
        return False
    return True


def time_option(name: str, text: str | None) -> int | None:
    """Return the time that an option states [ns since 1970 UTC]; ConfigError unless it is a time with a zone."""
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
