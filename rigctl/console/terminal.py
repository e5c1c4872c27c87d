"""The two consoles: results go to standard output, progress and remarks to standard error."""

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.text import Text

from rigctl.console.anonymity import told_content
from rigctl.console.console_streams import visible
from rigctl.console.json_text import Json, json_text

_WIDTH_OF_FILES = 120


class _SafeConsole(Console):
    """A console that shows control characters of texts, which may come from files of others, and obeys none."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Return a text to be printed; those in tables come here too."""
        return super().render_str(visible(text), **options)


def results() -> Console:
    """Return the console for what a command was asked for."""
    # A table in a file or a pipe need not be squeezed into the width of a terminal.
    width = None if sys.stdout.isatty() else _WIDTH_OF_FILES
    # Without markup: "[deg]" is a unit here and no style.
    return _SafeConsole(soft_wrap=True, highlight=False, markup=False, width=width)


def progress() -> Console:
    """Return the console for progress bars and remarks."""
    # In a file a remark is one line.
    return _SafeConsole(stderr=True, highlight=False, markup=False, soft_wrap=not sys.stderr.isatty())


def warn(text: str) -> None:
    """Tell people something that they had better change."""
    progress().print(f"rigctl: warning: {text}", markup=False)


def print_json_list(content: Sequence[Mapping[str, Json]]) -> None:
    """Write rows for other programs to read: a JSON list on standard output."""
    sys.stdout.write(json_text([told_content(row) for row in content]))


def print_json(content: Mapping[str, Json]) -> None:
    """Write a result for other programs: JSON on standard output, null with its reason for what is no number."""
    sys.stdout.write(json_text(told_content(content)))
