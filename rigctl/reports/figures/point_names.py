"""Names beside points of a plot: none on another, on a point, or beyond the axes, as far as there is room."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

# From a point to its name, and the sides, in the order in which they are tried [points].
_RINGS = (6.0, 16.0, 28.0, 42.0, 58.0, 76.0, 96.0)
_SIDES = ((1, 1), (1, -1), (-1, 1), (-1, -1), (0, 1), (0, -1))
# A name that is farther has a line to its point.
_NEAR = 10.0
_MARKER_PX = 5.0
# Text that lies on lines stays readable.
_ON_LINES = {"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.75}


@dataclass(frozen=True, kw_only=True)
class PointName:
    """A name, the place of its point in the units of the axes, and whether it is bold."""

    text: str
    x: float
    y: float
    is_bold: bool = False


def name_points(figure: Figure, axis: Axes, names: Sequence[PointName], *, fontsize: float = 8.0) -> None:
    """Write names beside their points, each as near as there is room for it.

    Lines, limits and scales of the axes and their place in the figure must be as they are drawn.
    """
    axis.set_xlim(axis.get_xlim())
    axis.set_ylim(axis.get_ylim())
    canvas: Any = FigureCanvasAgg(figure)
    renderer = canvas.get_renderer()
    taken = [_marker(point) for line in axis.lines for point in axis.transData.transform(line.get_xydata())]
    pixels = figure.dpi / 72.0
    for name in names:
        weight = "bold" if name.is_bold else "normal"
        text = axis.text(name.x, name.y, name.text, fontsize=fontsize, fontweight=weight)
        size = text.get_window_extent(renderer)
        text.remove()
        place = axis.transData.transform((name.x, name.y))
        ring, box = _free(place, (size.width, size.height), taken, axis.bbox, pixels)
        taken.append(box)
        axis.annotate(
            name.text,
            (name.x, name.y),
            xytext=tuple((box.p0 - place) / pixels),
            textcoords="offset points",
            fontsize=fontsize,
            fontweight=weight,
            bbox=_ON_LINES,
            zorder=5,
            arrowprops={"arrowstyle": "-", "color": "0.4", "linewidth": 0.6} if ring > _NEAR else None,
        )


def _free(
    place: np.ndarray, size: tuple[float, float], taken: Sequence[Bbox], inside: Bbox, pixels: float
) -> tuple[float, Bbox]:
    """Nearest place for a box of some size that hides nothing; where there is none, the one that hides least."""
    tried = []
    for ring, side in product(_RINGS, _SIDES):
        left, bottom = (_start(way, ring * pixels, length) for way, length in zip(side, size, strict=True))
        box = Bbox.from_bounds(place[0] + left, place[1] + bottom, *size)
        hidden = sum(_common(box, other) for other in taken) + size[0] * size[1] - _common(box, inside)
        tried.append((round(hidden), ring, box))
        if tried[-1][0] <= 0:
            break
    _, ring, box = min(tried, key=lambda one: one[0])
    return ring, box


def _start(way: int, ring: float, length: float) -> float:
    """Where a name begins along one axis, from its point: after it, before it, or centred on it."""
    return (-0.5 * length, ring, -ring - length)[way]


def _common(one: Bbox, other: Bbox) -> float:
    """Area that two boxes have in common."""
    found = Bbox.intersection(one, other)
    return 0.0 if found is None else float(found.width * found.height)


def _marker(point: np.ndarray) -> Bbox:
    return Bbox.from_bounds(point[0] - _MARKER_PX, point[1] - _MARKER_PX, 2.0 * _MARKER_PX, 2.0 * _MARKER_PX)
