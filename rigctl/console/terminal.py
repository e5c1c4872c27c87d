"""The two consoles: results go to standard output, progress and remarks to standard error."""

import logging
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from threading import Timer
from typing import Any

from rich.console import Console
from rich.text import Text

from rigctl.console.anonymity import told_content
from rigctl.console.console_streams import visible
from rigctl.console.json_text import Json, json_text

_WIDTH_OF_FILES = 120
_LOG = logging.getLogger(__name__)
# A wavelength of deeper air takes seconds to minutes: worth a line where there is no terminal for a bar.
_DEEP = 12.0
# After which something is shown on a terminal [s].
_SILENT_S = 1.0


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
    # Words are kept whole on a terminal; in a file a sentence is one line.
    return _SafeConsole(soft_wrap=not sys.stdout.isatty(), highlight=False, markup=False, width=width)


def progress() -> Console:
    """Return the console for progress bars and remarks."""
    # In a file a remark is one line.
    return _SafeConsole(stderr=True, highlight=False, markup=False, soft_wrap=not sys.stderr.isatty())


@contextmanager
def solving_shown() -> Iterator[Callable[[float], None]]:
    """Show a bar with the time while a scene is computed; what is yielded is told each sky's optical depth.

    The bar is shown on a terminal, from the first sky on, or after a second: light of spheres, wide fields and laws of
    DoLP may take longer than skies. Elsewhere one line says that deep air takes long.
    """
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = progress()
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    bar, depths = Progress(*columns, console=console, transient=True, disable=not console.is_terminal), list[float]()
    task = bar.add_task("computing", total=None)
    begun = Timer(_SILENT_S, bar.start)
    begun.daemon = True

    def tell(depth: float) -> None:
        if not depths:
            bar.start()
        if depth > _DEEP and not console.is_terminal and max(depths, default=0.0) <= _DEEP:
            console.print(f"optical depth {depth:.3g}: each wavelength takes seconds to minutes")
        depths.append(depth)
        bar.update(task, description=f"sky {len(depths)}, of optical depth {depth:.3g}")

    if console.is_terminal:
        begun.start()
    try:
        yield tell
    finally:
        begun.cancel()
        if begun.is_alive():
            begun.join()
        bar.stop()


def warn(text: str) -> None:
    """Report a doubt: the command line prints it on standard error, in Python it goes to the logger ``rigctl``."""
    _LOG.warning("%s", text)


def note(text: str, *, below: bool = False) -> None:
    """Report a step, or below the answer which files were written; silent in Python unless its level is shown."""
    _LOG.info("%s", text, extra={"below": below})


def print_json_list(content: Sequence[Mapping[str, Json]]) -> None:
    """Write rows for other programs to read: a JSON list on standard output."""
    sys.stdout.write(json_text([told_content(row) for row in content]))


def print_json(content: Mapping[str, Json]) -> None:
    """Write a result for other programs: JSON on standard output, null with its reason for what is no number."""
    sys.stdout.write(json_text(told_content(content)))


@contextmanager
def steps_shown() -> Iterator[Callable[[str, int, int], None]]:
    """Show a bar on a terminal; what is yielded takes what is being done, the steps done and how many there are."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = progress()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None)
        yield lambda text, done, steps: bar.update(task, completed=done, total=steps, description=text)
