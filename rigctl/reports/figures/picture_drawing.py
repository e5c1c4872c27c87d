"""Pictures with axes in pixels and a bar of values, without matplotlib: importing it takes longer than drawing them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from rigctl.files.regions import Region

FloatArray = NDArray[np.floating]
ByteArray = NDArray[np.uint8]

# As matplotlib would have them: pixels of an inch, and sizes of text [point].
_INCH = 110.0
_POINT = _INCH / 72.0
_TITLE, _TEXT, _NAME = 12.0, 10.0, 8.0
# The largest picture; less high than the least, its bar is higher than it.
_WIDEST, _HIGHEST, _LEAST_BAR = 385, 902, 110
_LEFT, _ABOVE, _BELOW = 82, 38, 60
_GAP, _BAR, _TICK, _PAD = 13, 15, 5, 4
# From tick to tick at least.
_TICKS_APART_X, _TICKS_APART_Y = 55, 30
_PNG_LEVEL = 3
# Lines are placed to a 16th of a pixel.
_SHIFT = 4
_BLACK, _WHITE = (0, 0, 0), (255, 255, 255)
_VEIL = (255, 255, 255, 191)
# Of ColorBrewer's RdBu, from blue to red, as (red, green, blue).
_RED_BLUE = (
    *((5, 48, 97), (33, 102, 172), (67, 147, 195), (146, 197, 222), (209, 229, 240), (247, 247, 247)),
    *((253, 219, 199), (244, 165, 130), (214, 96, 77), (178, 24, 43), (103, 0, 31)),
)
_OF_OPENCV = {"viridis": "COLORMAP_VIRIDIS", "cividis": "COLORMAP_CIVIDIS", "twilight": "COLORMAP_TWILIGHT"}

Colours = Literal["gray", "viridis", "cividis", "twilight", "red-blue"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """A picture that is to be shown.

    Attributes
    ----------
    values : array_like of float, shape (H, W)
        NaN: the ground is seen.
    low, high : float
        Values of the bar's ends.
    colours : str
        Between them.
    title, label : str
        Above the picture, and beside the bar.
    opacity : array_like of float, shape (H, W), or None
        From 0, where the ground is seen, to 1.
    ground : int
        Grey behind the picture, 0 to 255.
    """

    values: FloatArray
    low: float
    high: float
    colours: Colours
    title: str
    label: str
    opacity: FloatArray | None = None
    ground: int = 255


def pictures_png(pictures: Sequence[Picture], *, regions: Sequence[Region] = ()) -> bytes:
    """Return pictures beside each other, each with the outlines of regions, as the bytes of a PNG file."""
    panels = [_panel(picture, regions) for picture in pictures]
    high = max(len(panel) for panel in panels)
    padded = [np.pad(p, ((0, high - len(p)), (0, 0), (0, 0)), constant_values=255) for p in panels]
    encoded = cv2.imencode(".png", np.hstack(padded), (cv2.IMWRITE_PNG_COMPRESSION, _PNG_LEVEL))[1]
    return encoded.tobytes()


def _panel(picture: Picture, regions: Sequence[Region]) -> ByteArray:
    """Return a picture with all that stands about it, blue first."""
    rows, columns = picture.values.shape
    scale = min(_WIDEST / columns, _HIGHEST / rows)
    width, height = max(1, round(columns * scale)), max(1, round(rows * scale))
    bar_height = max(height, _LEAST_BAR, _length(picture.label, _TEXT))
    at, texts = _ticks(picture.low, picture.high, bar_height // _TICKS_APART_Y)
    bar_left = _LEFT + width + _GAP
    label_left = bar_left + _BAR + _TICK + 2 * _PAD + max((_length(text, _TEXT) for text in texts), default=0)
    whole_width = max(label_left + round(2 * _TEXT * _POINT), _LEFT + _length(picture.title, _TITLE) + _PAD)
    canvas = np.full((_ABOVE + bar_height + _BELOW, whole_width, 3), 255, np.uint8)
    coloured = _outlined(_coloured(picture, (width, height)), regions, (width / columns, height / rows))
    canvas[_ABOVE : _ABOVE + height, _LEFT : _LEFT + width] = coloured
    steps = np.linspace(255.0, 0.0, bar_height).round().astype(np.intp)
    canvas[_ABOVE : _ABOVE + bar_height, bar_left : bar_left + _BAR] = _table(picture.colours)[steps][:, None]
    image = Image.fromarray(canvas)
    draw = ImageDraw.Draw(image, "RGBA")
    _frame(image, draw, picture, (width, height))
    draw.rectangle((bar_left, _ABOVE, bar_left + _BAR, _ABOVE + bar_height), outline=_BLACK)
    for value, text in zip(at, texts, strict=True):
        y = _ABOVE + bar_height * (picture.high - value) / (picture.high - picture.low)
        draw.line((bar_left + _BAR, y, bar_left + _BAR + _TICK, y), fill=_BLACK)
        draw.text((bar_left + _BAR + _TICK + _PAD, y), text, fill=_BLACK, font=_font(_TEXT), anchor="lm")
    _write_upwards(image, (label_left, _ABOVE + bar_height // 2), picture.label)
    _name(draw, regions, (width / columns, height / rows))
    return np.asarray(image)


def _frame(image: Image.Image, draw: ImageDraw.ImageDraw, picture: Picture, size: tuple[int, int]) -> None:
    """Draw the axes about a picture of a size [pixels of the figure], and its title."""
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


def _coloured(picture: Picture, size: tuple[int, int]) -> ByteArray:
    """Return the values of a picture in a size (width, height) as colours."""
    small = cv2.resize(np.asarray(picture.values), size, interpolation=cv2.INTER_NEAREST)
    seen = 1.0 - np.isnan(small)
    if picture.opacity is not None:
        seen *= np.nan_to_num(cv2.resize(picture.opacity, size, interpolation=cv2.INTER_NEAREST))
    share = np.nan_to_num(np.clip((small - picture.low) / (picture.high - picture.low), 0.0, 1.0))
    colours = _table(picture.colours)[np.minimum(256.0 * share, 255.0).astype(np.intp)]
    return np.asarray(np.round(picture.ground + seen[..., None] * (colours - float(picture.ground))), dtype=np.uint8)


@cache
def _table(colours: Colours) -> ByteArray:
    """Return 256 colours, blue first."""
    steps = np.arange(256, dtype=np.uint8)
    if colours in _OF_OPENCV:
        return np.asarray(cv2.applyColorMap(steps[:, None], getattr(cv2, _OF_OPENCV[colours]))[:, 0], dtype=np.uint8)
    known = np.array(((0, 0, 0), (255, 255, 255)) if colours == "gray" else _RED_BLUE, dtype=float)
    places = np.linspace(0.0, 255.0, len(known))
    table = [np.interp(steps, places, known[:, k]).round() for k in (2, 1, 0)]
    return np.stack(table, axis=-1).astype(np.uint8)


def _outlined(coloured: ByteArray, regions: Sequence[Region], scale: tuple[float, float]) -> ByteArray:
    """Return a picture with the outlines of regions, a black line on a white one."""
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
    line = Image.new("RGB", (_length(text, _TEXT) + 2, round(1.6 * _TEXT * _POINT)), _WHITE)
    ImageDraw.Draw(line).text((1, line.height / 2.0), text, fill=_BLACK, font=_font(_TEXT), anchor="lm")
    turned = line.transpose(Image.Transpose.ROTATE_90)
    image.paste(turned, (place[0], max(0, place[1] - turned.height // 2)))


def _ticks(low: float, high: float, most: int, *, least: float = 0.0) -> tuple[list[float], list[str]]:
    """Return round values between two, at most so many and at least so far apart, and how they are written."""
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
    """Return the font of the other figures in a size [point]; matplotlib brings it, and is not imported for it."""
    found = find_spec("matplotlib")
    if found is None or found.origin is None:
        raise ModuleNotFoundError("No module named 'matplotlib'", name="matplotlib")
    path = Path(found.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"
    return ImageFont.truetype(str(path), size * _POINT)
