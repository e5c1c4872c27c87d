"""Style of figures, and PNG output.

Curves and bars are drawn by matplotlib (`subplots`, `png`). Maps of pixels (`DrawnPicture`) are drawn here without it:
importing matplotlib takes longer than drawing them. AoLP has one cyclic colour map everywhere (`colour_table("aolp")`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from cycler import cycler
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure
    from PIL import Image, ImageDraw, ImageFont

    from rigctl.files.regions import Region


FloatArray = NDArray[np.float64]

# Two colours that differ for colour-blind readers and in grey.
MEASURED, PREDICTED = "#d55e00", "#0072b2"
# After Okabe and Ito, for many lines; styles distinguish them in grey and where they coincide.
LINE_STYLES = ("-", "--", "-.", ":")
COLOURS = cycler(color=["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000"])
_DPI = 110
# Twice as fast as the usual 6, and hardly larger.
_PNG_LEVEL = 3
_KNOWN, _ROOM = 10.0, 1.3
# From the axes to a legend below them.
_NAMES_INCH = 0.55
# Of text below a figure of 14 inch [characters].
_LINE_LENGTH = 150


def subplots(rows: int, columns: int, *, size: tuple[float, float]) -> tuple[Figure, list[Axes]]:
    """Return a figure of the given size [inch] and its axes, row by row."""
    # Without pyplot: its backend and its settings are those of whoever calls, such as a notebook.
    from matplotlib.figure import Figure

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
    """
    from matplotlib.figure import Figure

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
    from matplotlib.transforms import ScaledTranslation

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
        # Fixed layouts have room for it; others make room.
        side = f"{place} center" if figure.get_layout_engine() is None else f"outside {place} center"
        figure.legend(handles, labels, loc=cast("Any", side), ncols=min(len(labels), 5), fontsize=8)


def few_log_labels(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers, at 1, 2 and 5 of a decade, to avoid overlaps."""
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:.0e}"[0] in "25" else "")


def mark_beyond(
    axes: Axes, x: FloatArray, y: FloatArray, errors: FloatArray, *, trusted: NDArray[np.bool_] | None = None
) -> None:
    """Fit the y axis to the most certain points, and mark others at its edge.

    Points with errors above ten times the median do not affect the axis.
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
    """Give a picture its title, axes in pixels and a colour bar."""
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
    import cv2
    from matplotlib.backends.backend_agg import FigureCanvasAgg

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


AnyFloatArray = NDArray[np.floating]
ByteArray = NDArray[np.uint8]

# As in matplotlib: pixels per inch, and sizes of text [point].
_INCH = 110.0
_POINT = _INCH / 72.0
_TITLE, _TEXT, _NAME = 12.0, 10.0, 8.0
# Largest size of a picture, and least height of its bar.
_WIDEST, _HIGHEST, _LEAST_BAR = 385, 902, 110
_LEFT, _ABOVE, _BELOW = 82, 38, 60
_GAP, _BAR, _TICK, _PAD = 13, 15, 5, 4
# Least distance between ticks.
_TICKS_APART_X, _TICKS_APART_Y = 55, 30
# Lines are placed to a 16th of a pixel.
_SHIFT = 4
_BLACK, _WHITE = (0, 0, 0), (255, 255, 255)
_VEIL = (255, 255, 255, 191)
# Of ColorBrewer's RdBu, from blue to red, as (red, green, blue).
_RED_BLUE = (
    *((5, 48, 97), (33, 102, 172), (67, 147, 195), (146, 197, 222), (209, 229, 240), (247, 247, 247)),
    *((253, 219, 199), (244, 165, 130), (214, 96, 77), (178, 24, 43), (103, 0, 31)),
)
# Cyclic, every 15 degrees of AoLP from 0: a circle about the axis of CIE L*a*b*, light yellow at 0, dark blue at 90
# degrees, which colour-blind readers distinguish. None is grey, to which pictures fade.
_ANGLES = (
    *((209, 182, 110), (166, 189, 115), (109, 183, 130), (22, 168, 149), (0, 150, 167), (0, 133, 179)),
    *((51, 120, 184), (123, 112, 180), (176, 111, 168), (215, 121, 151), (235, 142, 133), (233, 165, 117)),
)
_STOPS = {"gray": (_BLACK, _WHITE), "red-blue": _RED_BLUE, "aolp": (*_ANGLES, _ANGLES[0])}
_OF_OPENCV = {"viridis": "COLORMAP_VIRIDIS", "cividis": "COLORMAP_CIVIDIS"}
# The wheel of angles: its outer and inner radius, and room for the numbers about it.
_WHEEL, _HUB, _ABOUT = 40, 22, 24

Colours = Literal["gray", "viridis", "cividis", "aolp", "red-blue"]


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnPicture:
    """A picture that is to be shown."""

    values: AnyFloatArray  #: NaN shows the background.
    low: float  #: Values of the bar's ends.
    high: float
    colours: Colours  #: Between them.
    title: str  #: Above the picture, and beside the bar.
    label: str
    opacity: AnyFloatArray | None = None  #: From 0 (background) to 1.
    ground: int = 255  #: Grey behind the picture, 0 to 255.


def pictures_png(pictures: Sequence[DrawnPicture], *, regions: Sequence[Region] = ()) -> bytes:
    """Return pictures next to each other, with outlines of regions, as the bytes of a PNG file."""
    return _png_of(np.hstack(_padded([_panel(picture, regions) for picture in pictures], is_wide=False)))


def picture_pngs(pictures: Sequence[DrawnPicture], *, regions: Sequence[Region] = ()) -> tuple[bytes, ...]:
    """Return pictures of one size, each as the bytes of a PNG file."""
    return tuple(map(_png_of, _padded([_panel(picture, regions) for picture in pictures], is_wide=True)))


def _padded(panels: Sequence[ByteArray], *, is_wide: bool) -> list[ByteArray]:
    high, wide = (max(panel.shape[k] for panel in panels) for k in (0, 1))
    room = [(high - len(panel), wide - panel.shape[1] if is_wide else 0) for panel in panels]
    return [
        np.pad(panel, ((0, below), (0, right), (0, 0)), constant_values=255)
        for panel, (below, right) in zip(panels, room, strict=True)
    ]


def _png_of(panel: ByteArray) -> bytes:
    import cv2

    return cv2.imencode(".png", panel, (cv2.IMWRITE_PNG_COMPRESSION, _PNG_LEVEL))[1].tobytes()


def _panel(picture: DrawnPicture, regions: Sequence[Region]) -> ByteArray:
    """Return a picture with title, axes and key, blue first."""
    from PIL import Image, ImageDraw

    rows, columns = picture.values.shape
    scale = min(_WIDEST / columns, _HIGHEST / rows)
    width, height = max(1, round(columns * scale)), max(1, round(rows * scale))
    key = _wheel(picture) if picture.colours == "aolp" else _bar(picture, max(height, _LEAST_BAR))
    key_left = _LEFT + width + _GAP
    whole_width = max(key_left + key.width, _LEFT + _length(picture.title, _TITLE) + _PAD)
    canvas = np.full((_ABOVE + max(height, key.height - _BELOW) + _BELOW, whole_width, 3), 255, np.uint8)
    coloured = _outlined(_coloured(picture, (width, height)), regions, (width / columns, height / rows))
    canvas[_ABOVE : _ABOVE + height, _LEFT : _LEFT + width] = coloured
    image = Image.fromarray(canvas)
    draw = ImageDraw.Draw(image, "RGBA")
    _frame(image, draw, picture, (width, height))
    image.paste(key, (key_left, _ABOVE - _PAD))
    _name(draw, regions, (width / columns, height / rows))
    return np.asarray(image)


def _bar(picture: DrawnPicture, height: int) -> Image.Image:
    """Return the key of a picture: a bar of its colours with values and a label."""
    from PIL import Image, ImageDraw

    height = max(height, _length(picture.label, _TEXT))
    at, texts = _ticks(picture.low, picture.high, height // _TICKS_APART_Y)
    label_left = _BAR + _TICK + 2 * _PAD + max((_length(text, _TEXT) for text in texts), default=0)
    canvas = np.full((height + 4 * _PAD, label_left + round(2 * _TEXT * _POINT), 3), 255, np.uint8)
    steps = np.linspace(255.0, 0.0, height).round().astype(np.intp)
    canvas[_PAD : _PAD + height, :_BAR] = colour_table(picture.colours)[steps][:, None]
    image = Image.fromarray(canvas)
    draw = ImageDraw.Draw(image)
    draw.rectangle((0, _PAD, _BAR, _PAD + height), outline=_BLACK)
    for value, text in zip(at, texts, strict=True):
        y = _PAD + height * (picture.high - value) / (picture.high - picture.low)
        draw.line((_BAR, y, _BAR + _TICK, y), fill=_BLACK)
        draw.text((_BAR + _TICK + _PAD, y), text, fill=_BLACK, font=_font(_TEXT), anchor="lm")
    _write_upwards(image, (label_left, _PAD + height // 2), picture.label)
    return image


def _wheel(picture: DrawnPicture) -> Image.Image:
    """Return the key of a picture of angles: each direction in its colour, 0 to the right, counter-clockwise."""
    from PIL import Image, ImageDraw

    half = _WHEEL + _ABOUT
    y, x = np.mgrid[half:-half:-1, -half:half]
    radius = np.hypot(x, y)
    colours = colour_table(picture.colours)[(256.0 * np.mod(np.arctan2(y, x), np.pi) / np.pi).astype(np.intp) % 256]
    ring = (radius <= _WHEEL) & (radius >= _HUB)
    canvas = np.full((2 * half + round(2 * _TEXT * _POINT), 2 * half, 3), 255, np.uint8)
    canvas[: 2 * half] = np.where(ring[..., None], colours, 255)
    image = Image.fromarray(canvas)
    draw = ImageDraw.Draw(image)
    for angle_deg in (0, 45, 90, 135):
        along, up = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
        place = half + (_WHEEL + 0.55 * _ABOUT) * along, half - (_WHEEL + 0.55 * _ABOUT) * up
        draw.text(place, str(angle_deg), fill=_BLACK, font=_font(_NAME), anchor="mm")
    draw.text((half, 2 * half), picture.label, fill=_BLACK, font=_font(_TEXT), anchor="ma")
    return image


def _frame(image: Image.Image, draw: ImageDraw.ImageDraw, picture: DrawnPicture, size: tuple[int, int]) -> None:
    """Draw the axes around a picture of a size [pixels of the figure], and its title."""
    (width, height), (rows, columns) = size, picture.values.shape
    below = _ABOVE + height
    draw.rectangle((_LEFT - 1, _ABOVE - 1, _LEFT + width, below), outline=_BLACK)
    for value, text in zip(*_ticks(-0.5, columns - 0.5, width // _TICKS_APART_X, least=1.0), strict=True):
        x = _LEFT + (value + 0.5) * width / columns
        draw.line((x, below, x, below + _TICK), fill=_BLACK)
        draw.text((x, below + _TICK + _PAD), text, fill=_BLACK, font=_font(_TEXT), anchor="ma")
    for value, text in zip(*_ticks(-0.5, rows - 0.5, height // _TICKS_APART_Y, least=1.0), strict=True):
        y = _ABOVE + (value + 0.5) * height / rows
        draw.line((_LEFT - _TICK, y, _LEFT, y), fill=_BLACK)
        draw.text((_LEFT - _TICK - _PAD, y), text, fill=_BLACK, font=_font(_TEXT), anchor="rm")
    middle = _LEFT + width / 2.0
    draw.text((middle, below + _BELOW - _PAD), "x [pixel]", fill=_BLACK, font=_font(_TEXT), anchor="md")
    _write_upwards(image, (2 * _PAD, _ABOVE + height // 2), "y [pixel]")
    half = _length(picture.title, _TITLE) / 2.0
    middle = min(max(middle, half + _PAD), image.width - half - _PAD)
    draw.text((middle, _ABOVE - 2 * _PAD), picture.title, fill=_BLACK, font=_font(_TITLE), anchor="ms")


def _coloured(picture: DrawnPicture, size: tuple[int, int]) -> ByteArray:
    """Return the values of a picture as colours, in a size (width, height)."""
    import cv2

    small = cv2.resize(np.asarray(picture.values), size, interpolation=cv2.INTER_NEAREST)
    seen = 1.0 - np.isnan(small)
    if picture.opacity is not None:
        seen *= np.nan_to_num(cv2.resize(picture.opacity, size, interpolation=cv2.INTER_NEAREST))
    share = np.nan_to_num(np.clip((small - picture.low) / (picture.high - picture.low), 0.0, 1.0))
    colours = colour_table(picture.colours)[np.minimum(256.0 * share, 255.0).astype(np.intp)]
    return np.asarray(np.round(picture.ground + seen[..., None] * (colours - float(picture.ground))), dtype=np.uint8)


@cache
def colour_table(colours: Colours) -> ByteArray:
    """Return 256 colours, blue first, shape (256, 3)."""
    import cv2

    steps = np.arange(256, dtype=np.uint8)
    if colours in _OF_OPENCV:
        return np.asarray(cv2.applyColorMap(steps[:, None], getattr(cv2, _OF_OPENCV[colours]))[:, 0], dtype=np.uint8)
    known = np.array(_STOPS[colours], dtype=float)
    places = np.linspace(0.0, 255.0, len(known))
    table = [np.interp(steps, places, known[:, k]).round() for k in (2, 1, 0)]
    return np.stack(table, axis=-1).astype(np.uint8)


def _outlined(coloured: ByteArray, regions: Sequence[Region], scale: tuple[float, float]) -> ByteArray:
    """Return a picture with the outlines of regions, a black line on a white one."""
    import cv2

    for region in regions:
        corners = (np.array(region.outline(), dtype=float) + 0.5) * scale - 0.5
        points = [np.round(corners * 2**_SHIFT).astype(np.int32)]
        for colour, width in ((_WHITE, 3), (_BLACK, 1)):
            cv2.polylines(coloured, points, True, colour, width, cv2.LINE_AA, _SHIFT)
    return coloured


def _name(draw: ImageDraw.ImageDraw, regions: Sequence[Region], scale: tuple[float, float]) -> None:
    """Write the names of regions above their corners."""
    for region in regions:
        x, y = (
            round(start + (min(corner[k] for corner in region.outline()) + 0.5) * scale[k])
            for k, start in enumerate((_LEFT, _ABOVE))
        )
        place = x, y - _PAD
        left, top, right, bottom = draw.textbbox(place, region.name, font=_font(_NAME), anchor="ld")
        draw.rectangle((left - 2, top - 2, right + 1, bottom + 1), fill=_VEIL)
        draw.text(place, region.name, fill=_BLACK, font=_font(_NAME), anchor="ld")


def _write_upwards(image: Image.Image, place: tuple[int, int], text: str) -> None:
    """Write text from below upwards, from its left edge and its middle on."""
    from PIL import Image, ImageDraw

    line = Image.new("RGB", (_length(text, _TEXT) + 2, round(1.6 * _TEXT * _POINT)), _WHITE)
    ImageDraw.Draw(line).text((1, line.height / 2.0), text, fill=_BLACK, font=_font(_TEXT), anchor="lm")
    turned = line.transpose(Image.Transpose.ROTATE_90)
    image.paste(turned, (place[0], max(0, place[1] - turned.height // 2)))


def _ticks(low: float, high: float, most: int, *, least: float = 0.0) -> tuple[list[float], list[str]]:
    """Return round values between two, with limits on their number and distance, and their format."""
    span = (high - low) / max(most, 1)
    decade = 10.0 ** np.floor(np.log10(span))
    step = max(next(decade * factor for factor in (1.0, 2.0, 2.5, 5.0, 10.0) if decade * factor >= span), least)
    at = [float(step * k) for k in range(int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9)) + 1)]
    if not 1e-5 < step < 1e6:
        return at, [f"{value:g}" for value in at]
    digits = next(n for n in range(8) if abs(step * 10**n - round(step * 10**n)) < 1e-6 * step * 10**n)
    return at, [f"{value:.{digits}f}" for value in at]


def _length(text: str, size: float) -> int:
    return int(np.ceil(_font(size).getlength(text)))


@cache
def _font(size: float) -> ImageFont.FreeTypeFont:
    """Return the font of the other figures in a size [point], from matplotlib's files without importing it."""
    from PIL import ImageFont

    found = find_spec("matplotlib")
    if found is None or found.origin is None:
        raise ModuleNotFoundError("No module named 'matplotlib'", name="matplotlib")
    path = Path(found.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"
    return ImageFont.truetype(str(path), size * _POINT)
