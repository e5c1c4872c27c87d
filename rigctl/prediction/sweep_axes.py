"""Axes of a sweep: the numbers of a scene that change, and their values, from requests of a user."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import ConfigError

FloatArray = NDArray[np.float64]

MOST_STEPS = 10_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """A number of the scene, and the values that it takes, in the unit of the file."""

    key: str
    values: FloatArray


def parse_sweeps(requests: Sequence[str]) -> tuple[Axis, ...]:
    """Return the axes of a grid.

    Raises
    ------
    ConfigError
        One cannot be read, two are of one number, or there are too many points.
    """
    axes = tuple(Axis(key=key, values=values) for key, values in map(parse_sweep, requests))
    for key, times in Counter(axis.key for axis in axes).items():
        if times > 1:
            raise ConfigError(f"RANGES: {key} is given {times} times; a number has one range")
    points = math.prod(axis.values.size for axis in axes)
    if points > MOST_STEPS:
        raise ConfigError(f"RANGES: the grid has {points} points, allowed is {MOST_STEPS}")
    return axes


def parse_sweep(request: str) -> tuple[str, FloatArray]:
    """Return name and values of a request ``KEY=start:stop:n``.

    Raises
    ------
    ConfigError
        It cannot be read.
    """
    key, _, span = request.partition("=")
    parts = span.split(":")
    wanted = f"RANGES: is {request!r}, must be KEY=start:stop:n, for instance sun.zenith_deg=10:80:8"
    try:
        start, stop, steps = float(parts[0]), float(parts[1]), int(parts[2])
    except (IndexError, ValueError) as error:
        raise ConfigError(wanted) from error
    if len(parts) != 3 or not key.strip() or not (math.isfinite(start) and math.isfinite(stop)):
        raise ConfigError(wanted)
    if not 1 <= steps <= MOST_STEPS:
        raise ConfigError(f"RANGES: has {steps} steps, allowed is 1 to {MOST_STEPS}")
    return key.strip(), np.linspace(start, stop, steps)
