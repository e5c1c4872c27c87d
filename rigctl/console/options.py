"""Options that several commands read: calibrations, lists, choices, times and sizes."""

import inspect
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from rigctl.base.numbers import range_problem

Choice = TypeVar("Choice", bound=str)
_BYTES_PER_MB = 1_000_000
_MOST_MB = 100_000

MaxFrameMb = Annotated[
    int,
    typer.Option(
        metavar="MB", min=1, max=_MOST_MB, help="Refuse a picture of more MB of samples before memory is taken for it."
    ),
]


CalibrationStore = Annotated[
    Path | None,
    typer.Option(
        "--calibrations",
        metavar="DIR",
        help="Store to pick calibrations from; else the folder calibrations beside the rig file. none: pick none.",
    ),
]

# Calibrations that frames of a run are corrected by, and what the run itself shows.
RegistrationFile = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Registration: move frames to lie on one another. none: pick none.")
]
ForceRegistration = Annotated[
    bool, typer.Option("--force-registration", help="Move frames even where edges lie no better for it.")
]
PolarizerFile = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Polarizer calibration: divide by each angle's throughput. none: pick none."),
]
FlatFile = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Flat fields: divide frames by them. none: pick none.")
]
Faults = Annotated[
    str | None,
    typer.Option(metavar="NAME,...", help="Correct by what the run itself shows: throughput, dark-level, shift."),
]


class OptionTexts:
    """Reads the texts of options; every problem of them is kept for one message.

    Attributes
    ----------
    problems : list of str
        What could not be read, each with the option's name.
    """

    def __init__(self) -> None:
        self.problems: list[str] = []

    def choice(self, option: str, text: str | None, allowed: Iterable[Choice]) -> Choice | None:
        """Return the one of the allowed words that was given; None where it was not given or is none of them."""
        words = {str(word): word for word in allowed}
        if text is not None and text not in words:
            self.problems.append(f"{option}: is {text!r}, must be one of {', '.join(words)}")
        return words.get(text or "")

    def number(self, option: str, text: str | None) -> float | None:
        """Return a number; None where it was not given or is none."""
        numbers = self.numbers(option, text)
        if numbers is not None and len(numbers) != 1:
            self.problems.append(f"{option}: is {text!r}, must be one number")
        return numbers[0] if numbers else None

    def numbers(self, option: str, text: str | None) -> tuple[float, ...] | None:
        """Return the numbers of a list with commas; None where it was not given or is none."""
        if text is None:
            return None
        try:
            # Adding 0 makes 0 of -0.
            numbers = tuple(float(word) + 0.0 for word in text.split(","))
        except ValueError:
            self.problems.append(f"{option}: is {text!r}, must be numbers with commas between them")
            return None
        wild = [problem for number in numbers if (problem := range_problem(number)) is not None]
        self.problems += [f"{option}: is {text!r}, {problem}" for problem in wild[:1]]
        return None if wild else numbers


def frame_bytes(max_frame_mb: int) -> int:
    """Return the largest picture that is read, in bytes."""
    return max_frame_mb * _BYTES_PER_MB


def options_of(taking: Callable[..., None]) -> list[Any]:
    """Return the options of a function as the command line library makes them, to be added to other commands."""
    app = typer.Typer(add_completion=False)
    app.command()(taking)
    names = inspect.signature(taking).parameters
    return [one for one in typer.main.get_command(app).params if one.name in names]
