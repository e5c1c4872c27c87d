"""A failure as programs read it: ``{"error": {"code", "kind", "message", "key", "next"}}``."""

import json
import re

from rigctl.console.json_text import Json

# By exit code: what failed, and what to do next.
_KINDS: dict[int, tuple[str, str]] = {
    2: ("usage", "mend what the message names; `rigctl {verb} --help` has the options, docs/parameters.md the keys"),
    3: (
        "device",
        "look at cables, power, addresses; `rigctl devices` lists what answers, `rigctl doctor` checks it",
    ),
    4: ("data", "`rigctl verify RUN` names damaged frames; other data are mended where they were made"),
    5: ("disagrees", "read the report: it says where the disagreement points"),
    70: ("own_fault", "report it with the log that the message names"),
    75: ("incomplete", "`rigctl resume RUN` goes on; `rigctl log RUN` tells what happened"),
    130: ("interrupted", "call it again; a session goes on with `rigctl resume RUN`"),
}
# A problem begins with its key or option: "  camera.address: is missing", "--alpha: is 2".
_KEY = re.compile(r"^\s*(--[a-z][a-z-]*|(?:\w+ \[\[[\w.]+\]\], )?[A-Za-z_][\w.]*)(?=: )", re.MULTILINE)


def failure_json(code: int, message: str, *, verb: str) -> str:
    """Return a failure as a line of JSON, `failure_content` as text."""
    return json.dumps(failure_content(code, message, verb=verb), indent=2) + "\n"


def failure_content(code: int, message: str, *, verb: str) -> dict[str, Json]:
    """Return a failure as JSON holds it, under "error".

    Parameters
    ----------
    code : int
        Exit code.
    message : str
        What people are told.
    verb : str
        Of the command line.
    """
    kind, step = _KINDS.get(code, ("failure", "`rigctl {verb} --help`"))
    return {
        "error": {"code": code, "kind": kind, "message": message, "key": _key(message), "next": step.format(verb=verb)}
    }


def _key(message: str) -> str | None:
    """Return the first key or option that a message names; None where it names none."""
    keys = [found[1] for found in _KEY.finditer(message) if not found[1].endswith((".toml", ".json"))]
    if keys:
        return keys[0]
    option = re.search(r"--[a-z][a-z-]*", message)
    return None if option is None else option[0]
