"""Look of the figures: colours, sizes, and their way into PNG bytes."""

from collections.abc import Sequence
from textwrap import fill
from typing import Any, Literal, cast

import cv2
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Two colours that a colour-blind reader tells apart, and that differ in grey.
MEASURED, PREDICTED = "#d55e00", "#0072b2"
# After Okabe and Ito, for lines that are many; styles tell them apart in grey, and where they lie on one another.
LINE_STYLES = ("-", "--", "-.", ":")
COLOURS = cycler(color=["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000"])
_DPI = 110
# Twice as fast as the usual 6, and hardly larger.
_PNG_LEVEL = 3
_KNOWN, _ROOM = 10.0, 1.3
# From the axes to a legend below them.
_NAMES_INCH = 0.55
# Of words beneath a figure of 14 inch [characters].
_LINE_LENGTH = 150


def subplots(rows: int, columns: int, *, size: tuple[float, float]) -> tuple[Figure, list[Axes]]:
    """Return a figure of the given size [inch] and its axes, row by row."""
    # Without pyplot: its backend and its settings are those of whoever calls, such as a notebook.
    figure = Figure(figsize=size, layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for one in axes:
        one.set_prop_cycle(COLOURS)
    return figure, axes


def placed_axes(
    rows: int,
    columns: int,
    *,
    size: tuple[float, float],
    margins: tuple[float, float, float, float],
    apart: tuple[float, float] = (0.0, 0.0),
) -> tuple[Figure, list[Axes]]:
    """Return a figure and its axes, row by row, in places that are counted out [inch].

    A layout engine looks for them by measuring all that is written, which takes as long as drawing it.

    Parameters
    ----------
    rows, columns : int
        How many axes.
    size : tuple of float
        Width and height of the figure.
    margins : tuple of float
        Left of all axes, right, below and above.
    apart : tuple of float
        From the axes to those beside and below them.
    """
    figure = Figure(figsize=size, dpi=_DPI)
    left, right, below, above = margins
    wide = (size[0] - left - right - (columns - 1) * apart[0]) / columns
    high = (size[1] - below - above - (rows - 1) * apart[1]) / rows
    axes = []
    for row, column in np.ndindex(rows, columns):
        x, y = left + column * (wide + apart[0]), below + (rows - 1 - row) * (high + apart[1])
        axes.append(figure.add_axes((x / size[0], y / size[1], wide / size[0], high / size[1])))
        axes[-1].set_prop_cycle(COLOURS)
    return figure, axes


def legend_beside(axes: Axes) -> None:
    """Set a legend to the right of the axes, where it hides no point; none where nothing has a name."""
    if not axes.get_legend_handles_labels()[0]:
        return
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)


def legend_below(axes: Axes, *, columns: int = 1) -> None:
    """Set a legend below the axes, where there are other axes beside them; none where nothing has a name."""
    if not axes.get_legend_handles_labels()[0]:
        return
    # By a fixed way, past tick labels and the axis's name: by a share of the axes the layout would not come to rest.
    below = axes.transAxes + ScaledTranslation(0.0, -_NAMES_INCH, axes.figure.dpi_scale_trans)
    axes.legend(
        fontsize=8,
        ncols=columns,
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
        bbox_transform=below,
        borderaxespad=0.0,
    )


def legend_of_all(figure: Figure, axes: Axes, *, place: Literal["lower", "upper"] = "lower") -> None:
    """Set one legend for all panels below ("lower") or above ("upper") them; none where nothing has a name."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        # In places that are counted out there is room for it; elsewhere it takes its room.
        side = f"{place} center" if figure.get_layout_engine() is None else f"outside {place} center"
        figure.legend(handles, labels, loc=cast("Any", side), ncols=min(len(labels), 5), fontsize=8)


def few_log_labels(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers, at 1, 2 and 5 of a decade alone: more would lie on one another."""
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:.0e}"[0] in "25" else "")


def mark_beyond(
    axes: Axes, x: FloatArray, y: FloatArray, errors: FloatArray, *, trusted: NDArray[np.bool_] | None = None
) -> None:
    """Fit the y axis to the points that are known best, and mark those beyond it at its edge.

    A point whose error is ten times the median's says little, and is not to hide what the others say.
    """
    known = errors <= _KNOWN * float(np.median(errors))
    known = known & trusted if trusted is not None and np.any(known & trusted) else known
    half = _ROOM * float(np.max(np.abs(y[known]) + errors[known]))
    if not np.isfinite(half) or half <= 0.0:
        return
    axes.set_ylim(-half, half)
    low, high = axes.get_xlim()
    beyond = (np.abs(y) > half) | (x < low) | (x > high)
    if beyond.any():
        edge = np.clip(y[beyond], -0.96 * half, 0.96 * half)
        label = f"{beyond.sum()} beyond these axes"
        axes.plot(np.clip(x[beyond], low, high), edge, "^", ms=6, color="black", clip_on=False, label=label)
        axes.set_xlim(low, high)


def finish_picture(figure: Figure, ax: Axes, shown: ScalarMappable, *, title: str, label: str) -> None:
    """Give a picture its title, its axes in pixels and a bar that tells its values."""
    ax.set_title(title)
    ax.set_xlabel("x [pixel]")
    ax.set_ylabel("y [pixel]")
    figure.colorbar(shown, ax=ax, label=label, shrink=0.85)


def say_beneath(figure: Figure, lines: Sequence[str]) -> None:
    """Put words under a figure."""
    if lines:
        width = int(_LINE_LENGTH * figure.get_figwidth() / 14.0)
        figure.supxlabel("\n".join(fill(line, width) for line in lines), fontsize=7.5, x=0.01, ha="left")


def png(figure: Figure, *, dpi: float = _DPI) -> bytes:
    """Return a figure as the bytes of a PNG file, without a date: the same numbers give the same bytes.

    Drawn once: `Figure.savefig` draws twice, the first time for the layout, which `draw` finds itself.
    """
    figure.set_dpi(dpi)
    for ax in figure.axes:
        _keep_title(ax)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = cv2.cvtColor(np.asarray(canvas.buffer_rgba()), cv2.COLOR_RGBA2BGR)
    encoded = cv2.imencode(".png", pixels, (cv2.IMWRITE_PNG_COMPRESSION, _PNG_LEVEL))[1]
    return encoded.tobytes()


def _keep_title(ax: Axes) -> None:
    """Set a title where it belongs, which matplotlib would otherwise look for among all labels at every drawing."""
    if ax.get_title() and ax.name == "rectilinear":
        ax.set_title(ax.get_title(), fontsize=ax.title.get_fontsize(), y=1.0)
