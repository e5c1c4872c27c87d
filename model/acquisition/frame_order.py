"""Order of the frames: the mean place of each angle's frames, and the angle from which each is reached."""

from itertools import permutations
from math import pi
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

# cycles: as given, again and again; palindrome: every second cycle backwards; grouped: all frames of an angle together.
Pattern = Literal["cycles", "palindrome", "grouped"]
PATTERNS: tuple[Pattern, ...] = ("cycles", "palindrome", "grouped")

# All orders of so many angles are tried: 5040.
_MOST_ORDERED = 7


def mean_places(angles: int, *, cycles: int, pattern: Pattern) -> FloatArray:
    """Return the mean place of each angle's frames in the session, from the middle of the session.

    Parameters
    ----------
    angles
        Number of angles in a cycle, 1 or more.
    cycles
        How many times all are gone through, 1 or more.
    pattern
        Order of the frames.

    Returns
    -------
    ndarray, shape (angles,)
        In frames, in the order in which the angles are first taken; the sum is 0.

    Raises
    ------
    ValueError
        No angle, or no cycle.

    Notes
    -----
    Light that changes linearly in time moves the mean of an angle's counts by this place times the change in a frame.
    Going on in cycles leaves the places of one cycle; going back and forth an even number of times leaves none.
    """
    if angles < 1 or cycles < 1:
        raise ValueError(f"angles = {angles}, cycles = {cycles}; allowed is 1 or more of each")
    one_cycle = np.arange(angles, dtype=np.float64) - 0.5 * (angles - 1)
    factor = {"cycles": 1.0, "palindrome": (cycles % 2) / cycles, "grouped": float(cycles)}[pattern]
    return np.asarray(factor * one_cycle)


def mean_moves_rad(angles_rad: ArrayLike, *, cycles: int, pattern: Pattern) -> FloatArray:
    """Return by how much the polarizer was turned into each angle, in the mean over its frames.

    Parameters
    ----------
    angles_rad
        Shape (N,), in the order in which they are first taken [rad].
    cycles, pattern
        As in `mean_places`.

    Returns
    -------
    ndarray, shape (N,)
        [rad]; a frame that is taken where the one before was counts as 0, and so does the first of all.

    Raises
    ------
    ValueError
        No angle, or no cycle.

    Notes
    -----
    The way back to the first angle is taken to be as long as the way there, as of a stage that counts from its home.
    """
    angles = np.asarray(angles_rad, dtype=np.float64)
    if angles.size < 1 or cycles < 1:
        raise ValueError(f"angles = {angles.size}, cycles = {cycles}; allowed is 1 or more of each")
    forth = np.diff(angles, prepend=angles[0])
    if pattern == "grouped":
        return forth / cycles
    if pattern == "palindrome":
        back = np.diff(angles[::-1], prepend=angles[-1])[::-1]
        forward, backward = (cycles + 1) // 2, cycles // 2
        return (forward * forth + backward * back) / cycles
    back_to_first = np.zeros_like(angles)
    back_to_first[0] = angles[0] - angles[-1]
    return forth + back_to_first * (cycles - 1) / cycles


def least_drifting_order(angles_rad: ArrayLike) -> FloatArray:
    """Return angles in the order in which light that changes linearly shows the least false polarization in a cycle.

    Parameters
    ----------
    angles_rad
        Shape (N,), 3 to 7 angles that are equally spaced over 180 deg [rad].

    Raises
    ------
    ValueError
        Too few or too many.

    Notes
    -----
    All orders are tried; of equals the one that begins with the smallest angles. Of 0, 45, 90, 135 it is 0, 90, 45,
    135: false DoLP 0.2357 times the change of the light from the first to the last frame, in place of 0.4714.

    References
    ----------
    definition: false (S1, S2) / S0 = 2 / N times the sum over the frames of relative change times (cos 2psi, sin 2psi).
    """
    angles = np.sort(np.asarray(angles_rad, dtype=np.float64))
    if not 3 <= angles.size <= _MOST_ORDERED:
        raise ValueError(f"{angles.size} angles; allowed is 3 to {_MOST_ORDERED}")
    orders = np.array(list(permutations(range(angles.size))))
    places = mean_places(angles.size, cycles=1, pattern="cycles")
    false = np.abs(np.exp(2j * angles[orders]) @ places)
    # Rounding must not decide between equals.
    best = int(np.argmax(false <= np.min(false) + 1e-9))
    return np.asarray(angles[orders[best]])


def degrees_text(angles_rad: ArrayLike) -> str:
    """Return angles as people read them: "0 90 45 135"."""
    return " ".join(f"{angle * 180.0 / pi:.4g}" for angle in np.asarray(angles_rad, dtype=np.float64))
