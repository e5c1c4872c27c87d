"""Places and names in a report that is given to others: paths relative to the working folder, or left out."""

import os
from pathlib import PurePath
from typing import Any

# Parts of keys whose values say whose rig it is, or where it stands.
_PERSONAL = ("serial", "site", "latitude", "longitude", "host", "port")
_LEFT_OUT = "left out"


def told_places(content: Any, *, anonymous: bool) -> Any:
    """Return the content of a report without absolute paths.

    Parameters
    ----------
    content : tables, lists and values
        As JSON holds them.
    anonymous : bool
        Leave the last name only of each path, and say "left out" for serial numbers, ports and the site.
    """
    if isinstance(content, dict):
        return {
            key: _LEFT_OUT
            if anonymous and value is not None and any(part in key for part in _PERSONAL)
            else told_places(value, anonymous=anonymous)
            for key, value in content.items()
        }
    if isinstance(content, list | tuple):
        return [told_places(value, anonymous=anonymous) for value in content]
    return _told_path(content, anonymous=anonymous) if isinstance(content, str) else content


def _told_path(text: str, *, anonymous: bool) -> str:
    if anonymous and "/" in text and "\n" not in text and "://" not in text:
        return PurePath(text).name
    if text.startswith("/") and "\n" not in text and len(text) < os.pathconf("/", "PC_PATH_MAX"):
        return os.path.relpath(text)
    return text
