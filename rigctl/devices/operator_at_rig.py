"""Asks the person at a real rig to cover the lens or to put a flat field before it."""

import sys

from rigctl.errors import ConfigError
from rigctl.runs.run_folder import FrameKind

_REQUESTS: dict[FrameKind, str] = {
    "scene": "Point the camera at the scene, nothing before the lens",
    "dark": "Cover the lens, so that no light comes in",
    "flat": "Put the flat field (integrating sphere) before the lens",
}


def ask_operator(kind: FrameKind) -> None:
    """Return once the person at the terminal says that it is done.

    Raises
    ------
    ConfigError
        There is nobody at a terminal: a lens cap does not put itself on. A scene needs nobody.
    """
    if not sys.stdin.isatty():
        if kind == "scene":
            return  # what a camera sees when nobody has put anything before it
        raise ConfigError(
            f"a take of kind {kind!r} needs somebody at the rig, and there is no terminal to ask at: "
            "run it by hand, or keep to takes of one kind"
        )
    sys.stderr.write(f"{_REQUESTS[kind]}, then press Enter: ")
    sys.stderr.flush()
    sys.stdin.readline()
