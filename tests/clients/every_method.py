"""Sees to it that every public method of a client is called, or left out by name. Needs the standard library alone."""

import sys
from typing import Any


class Every:
    """Stands before an object, hands calls on, and remembers their names.

    Parameters
    ----------
    subject : object
        What is called.
    left_out : dict of str to str
        Methods that are not called, and why not.
    """

    def __init__(self, subject: object, left_out: dict[str, str]) -> None:
        self._subject, self._left_out = subject, left_out
        self._called: set[str] = set()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        self._called.add(name)
        return getattr(self._subject, name)

    def finish(self) -> None:
        """End the program unless all was called; write how many there were."""
        public = {name for name in dir(self._subject) if not name.startswith("_")}
        methods = {name for name in public if self._is_method(name)}
        if missing := methods - self._called - self._left_out.keys():
            sys.exit(f"{type(self._subject).__name__}: not called: {', '.join(sorted(missing))}")
        if unknown := self._left_out.keys() - methods:
            sys.exit(f"{type(self._subject).__name__}: there is no {', '.join(sorted(unknown))}")
        sys.stdout.write(f"{type(self._subject).__name__}: {len(methods & self._called)} of {len(methods)} methods\n")

    def _is_method(self, name: str) -> bool:
        kind = getattr(type(self._subject), name, None)
        return callable(kind) and not isinstance(kind, type)


def near(value: float, wanted: float, tolerance: float = 0.05) -> None:
    """End the program unless two numbers agree."""
    if abs(value - wanted) > tolerance:
        sys.exit(f"{value} is not {wanted}")
