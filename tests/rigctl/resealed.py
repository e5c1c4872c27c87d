"""Runs that say something else than they did, and whose checksums hold all the same; for tests."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from rigctl.runs.records import encode_description, first_link, read_description, read_lines, sealed_all


def with_session(run: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Change what the session file of a run says, and seal the run anew."""
    file = run / "session.json"
    before = read_description(file)
    session = json.loads(json.dumps(before.session))
    change(session)
    file.write_bytes(encode_description(replace(before, session=session)))
    after = read_description(file)
    for name in ("manifest.jsonl", "events.jsonl"):
        if (run / name).exists():
            lines = read_lines((run / name).read_bytes(), first_link(before)).lines
            (run / name).write_bytes(sealed_all([content for content, _ in lines], first_link(after)))


def with_line(run: Path, number: int, change: Callable[[dict[str, Any]], object]) -> None:
    """Change what a line of the manifest says, and seal the manifest anew."""
    first = first_link(read_description(run / "session.json"))
    contents = [content for content, _ in read_lines((run / "manifest.jsonl").read_bytes(), first).lines]
    content = json.loads(contents[number])
    change(content)
    contents[number] = json.dumps(content).encode()
    (run / "manifest.jsonl").write_bytes(sealed_all(contents, first))
