"""What a verb gives back: one content for the terminal, a notebook and programs."""

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, TypeAlias

from rigctl.console import Json, json_text, results, told_content

if TYPE_CHECKING:
    from rigctl.report.table import AnyTable

# A sentence, a table, or what draws a picture as PNG; a terminal leaves pictures out.
Part: TypeAlias = "str | AnyTable | Callable[[], bytes]"


class Result:
    """Base of what verbs return. A subclass says what people read, what programs read and how the command ends."""

    def content(self) -> Iterable[Part]:
        """Return what people read, the answer first."""
        return ()

    def as_json(self) -> Mapping[str, Json] | Sequence[Mapping[str, Json]]:
        """Return what programs read."""
        return {}

    @property
    def notes(self) -> Sequence[str]:
        """Return what a notebook shows below the content; the command line has reported it while it worked."""
        return ()

    @property
    def exit_code(self) -> int:
        """How the command ends: 0, or a code of docs/codes.md."""
        return 0

    def show(self) -> None:
        """Print the content on standard output."""
        for part in self.content():
            if not callable(part):
                results().print(part, markup=False)

    def show_json(self) -> None:
        """Print what programs read on standard output."""
        sys.stdout.write(json_text(told_content(self.as_json())))

    def follow(self) -> None:
        """Go on after the content was shown: a page answers until Ctrl-C."""

    def _repr_html_(self) -> str:
        from rigctl.report.output import lines_fragment, picture_fragment, table_fragment

        def fragment(part: Part) -> str:
            if isinstance(part, str):
                return lines_fragment([part])
            return picture_fragment(part()) if callable(part) else table_fragment(part)

        return "".join(map(fragment, (*self.content(), *self.notes)))
