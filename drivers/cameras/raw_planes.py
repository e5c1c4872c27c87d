"""Colours of RAW files, by the names that options have for them."""

from typing import Literal, get_args

Plane = Literal["red", "green-1", "green-2", "blue", "green", "sum", "all"]
PLANES: tuple[Plane, ...] = get_args(Plane)
