"""Lattice over a grid of cases: cells whose corners are looked at closely, divided where that is too coarse."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise, product
from math import ceil

Index = tuple[int, ...]

# Steps of the grid between corners, by the number of its axes: corners are so few that looking at them closely is a
# fifth of the work, or less.
_STEPS = {1: 34, 2: 8}
_STEPS_OF_MORE = 4


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Part of a grid.

    Attributes
    ----------
    low, high
        Its corners of least and of greatest place along every axis; both belong to it.
    """

    low: Index
    high: Index

    @property
    def corners(self) -> tuple[Index, ...]:
        """All corners, each once."""
        return tuple(dict.fromkeys(product(*zip(self.low, self.high, strict=True))))

    @property
    def places(self) -> Iterator[Index]:
        """All cases, its corners among them."""
        return product(*(range(low, high + 1) for low, high in zip(self.low, self.high, strict=True)))

    @property
    def middle(self) -> Index:
        """The case in its middle."""
        return tuple((low + high) // 2 for low, high in zip(self.low, self.high, strict=True))

    @property
    def is_divisible(self) -> bool:
        """True if there are cases between its corners."""
        return any(high - low > 1 for low, high in zip(self.low, self.high, strict=True))

    def holds(self, place: Index) -> bool:
        """Return whether a case belongs to it."""
        return all(low <= one <= high for low, one, high in zip(self.low, place, self.high, strict=True))

    def divided(self, place: Index) -> tuple["Cell", ...]:
        """Return the parts that have a case of this one as a corner; along an axis at whose end it is, none is cut."""
        parts = [
            ((low, one), (one, high)) if low < one < high else ((low, high),)
            for low, one, high in zip(self.low, place, self.high, strict=True)
        ]
        return tuple(Cell(low=tuple(a for a, _ in ends), high=tuple(b for _, b in ends)) for ends in product(*parts))


def lattice(shape: Index) -> tuple[Cell, ...]:
    """Return the cells of a grid.

    Parameters
    ----------
    shape
        Cases along each axis, each 1 or more.
    """
    steps = _STEPS.get(sum(size > 1 for size in shape), _STEPS_OF_MORE)

    def ends(size: int) -> list[tuple[int, int]]:
        last = size - 1
        pieces = max(1, ceil(last / steps))
        places = [round(k * last / pieces) for k in range(pieces + 1)]
        return list(pairwise(places))

    return tuple(
        Cell(low=tuple(a for a, _ in each), high=tuple(b for _, b in each))
        for each in product(*(ends(size) for size in shape))
    )
