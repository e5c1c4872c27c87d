"""Options that are more than one number: lists and choices, every problem of them kept for one message."""

from collections.abc import Iterable
from typing import TypeVar

from rigctl.number_range import range_problem

Choice = TypeVar("Choice", bound=str)


class OptionTexts:
    """Reads the texts of options.

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
