"""What a scene file calls assumed, in words."""

import re
from pathlib import Path

_LINE = re.compile(r"^\s*(?P<key>[A-Za-z_]+)\s*=\s*(?P<value>[^#]*?)\s*#\s*assumed:?\s*(?P<why>.*)$")
_TABLE = re.compile(r"^\s*\[+(?P<name>[\w.]+)\]+")
_NAME = re.compile(r'^\s*name\s*=\s*"(?P<name>[^"]*)"')


def assumed_lines(path: Path) -> tuple[str, ...]:
    """Return a text for each number of a scene file whose line says in a comment that it is assumed."""
    table, found = "", []
    for line in path.read_text(encoding="utf-8").splitlines():
        head, name, one = _TABLE.match(line), _NAME.match(line), _LINE.match(line)
        if head is not None:
            table = f"{head['name']}."
        elif name is not None and table.startswith("regions."):
            table = f"regions.{name['name']}."
        if one is not None:
            why = f" ({one['why']})" if one["why"] else ""
            found.append(f"assumed: {table}{one['key']} = {one['value']}{why}")
    return tuple(found)
