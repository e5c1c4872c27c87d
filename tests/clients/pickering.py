"""The sequence that every client drives, in the client's own environment: only the standard library is at hand."""

import sys
from collections.abc import Callable

ANGLES_DEG = (0.0, 90.0, 45.0, 135.0)


def drive(move_to: Callable[[float], object], position_deg: Callable[[], float]) -> None:
    """Go through the angles, print each readback, and wait at each for a line on standard input."""
    for angle_deg in ANGLES_DEG:
        move_to(angle_deg)
        sys.stdout.write(f"{angle_deg} {position_deg()}\n")
        sys.stdout.flush()
        sys.stdin.readline()
