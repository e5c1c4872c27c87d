"""Regions of interest: named rectangles and polygons, and their pixels.

x runs right, y down, (0, 0) is the centre of the top left pixel.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from rigctl.errors import ConfigError
from rigctl.files.choices import Dictionary
from rigctl.files.toml import Section, load


def _speakable(name: str) -> str:
    if not name[:1].isalnum() or not all(letter.isalnum() or letter in "_.-" for letter in name):
        raise ValueError(f"is {name!r}; a name has letters, digits, _ . and -, and begins with a letter or a digit")
    return name


Name = Annotated[str, AfterValidator(_speakable)]
_HEAD = "# Regions of interest. x runs right, y down, (0, 0) is the centre of the top left pixel.\n"


class Rectangle(Section):
    """A rectangle of whole pixels: its top left pixel and its size."""

    x: Annotated[int, Field(ge=0)]
    """Column of the top left pixel, from 0. Example: `100`."""
    y: Annotated[int, Field(ge=0)]
    """Row of the top left pixel, from 0. Example: `80`."""
    width: Annotated[int, Field(gt=0)]
    """Pixels to the right. Example: `60`."""
    height: Annotated[int, Field(gt=0)]
    """Pixels down. Example: `40`."""


Vertex = tuple[float, float]


class Region(Section):
    """A named part of the picture: exactly one of a rectangle and a polygon.

    `edge_px` pixels along its border are left out of every measurement, because the lens blurs in light from outside.
    """

    name: Name
    """Name of the region, in every table. Example: `"black-panel"`."""
    rectangle: Rectangle | None = None
    """Its place as a rectangle of whole pixels. Example: `{ x = 100, y = 80, width = 60, height = 40 }`."""
    polygon: Annotated[list[Vertex], Field(min_length=3)] | None = None
    """Its corners (x, y), in place of a rectangle. Example: `[[100, 80], [160, 80], [130, 120]]`."""
    edge_px: Annotated[int, Field(ge=0)] = 0
    """Pixels along its border that are left out of every measurement. Example: `2`."""

    @model_validator(mode="after")
    def _one_shape(self) -> "Region":
        if (self.rectangle is None) == (self.polygon is None):
            raise ValueError("needs exactly one of rectangle = {x, y, width, height} and polygon = [[x, y], ...]")
        return self

    def outline(self) -> list[Vertex]:
        """Return the corners (x, y); those of a rectangle are the outer corners of its corner pixels."""
        if self.polygon is not None:
            return self.polygon
        if self.rectangle is None:
            return []
        r = self.rectangle
        left, top, right, bottom = r.x - 0.5, r.y - 0.5, r.x + r.width - 0.5, r.y + r.height - 0.5
        return [(left, top), (right, top), (right, bottom), (left, bottom)]


class Marker(Section):
    """Place of an ArUco marker in the picture that the regions were drawn on.

    `corners` (x, y) run clockwise from the marker's own top left. It leads the named regions, or all.
    """

    id: Annotated[int, Field(ge=0)]
    """Number of the marker in its family. Example: `7`."""
    corners: Annotated[list[Vertex], Field(min_length=4, max_length=4)]
    """Its corners (x, y), clockwise from its own top left. Example: `[[10, 10], [30, 10], [30, 30], [10, 30]]`."""
    regions: tuple[Name, ...] = ()
    """Regions that it leads; all without. Example: `["black-panel"]`."""


class Markers(Section):
    """Markers on the panels, by which the regions are found again when the camera has moved."""

    dictionary: Dictionary = "4x4_50"
    """Family of ArUco markers. Example: `"4x4_50"`."""
    seen: Annotated[list[Marker], Field(min_length=1)]
    """The markers as they were in the picture that the regions were drawn on."""


class RegionsFile(Section):
    """Content of a regions file."""

    schema_version: Literal[1] = 1
    """Version of the layout. Example: `1`."""
    regions: Annotated[list[Region], Field(min_length=1)]
    """The regions."""
    markers: Markers | None = None
    """Markers by which the regions are found again when the camera has moved."""

    @model_validator(mode="after")
    def _distinct_names(self) -> "RegionsFile":
        names = [region.name for region in self.regions]
        require_distinct(names)
        if self.markers is not None:
            _require_known(self.markers, names)
        return self


def _require_known(markers: Markers, names: list[str]) -> None:
    ids = [marker.id for marker in markers.seen]
    if len(set(ids)) < len(ids):
        raise ValueError(f"markers.seen: an id occurs more than once, of {ids}")
    unknown = sorted({name for marker in markers.seen for name in marker.regions}.difference(names))
    if unknown:
        raise ValueError(f"markers.seen: no region is called {', '.join(unknown)}; there are {', '.join(names)}")


def require_distinct(names: list[str]) -> None:
    """Refuse names that occur twice (ValueError)."""
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"region names occur more than once: {', '.join(twice)}")


def load_regions(path: Path) -> list[Region]:
    """Return the regions of a regions file."""
    return load(path, RegionsFile).regions


def inner_masks(
    regions: list[Region], outer: Mapping[str, NDArray[np.bool_]], *, least_px: int = 0
) -> dict[str, NDArray[np.bool_]]:
    """Return the pixels of each region that are farther than its `edge_px` from any pixel outside of it."""
    return {region.name: _without_edge(outer[region.name], max(region.edge_px, least_px)) for region in regions}


def _without_edge(mask: NDArray[np.bool_], edge_px: int) -> NDArray[np.bool_]:
    if edge_px == 0:
        return mask
    import cv2  # needed for a border only

    distance = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(mask & (distance > edge_px))


def masks(regions: list[Region], *, width: int, height: int) -> dict[str, NDArray[np.bool_]]:
    """Return for each region the pixels (H, W) whose centres lie in it."""
    problems: list[str] = []
    found: dict[str, NDArray[np.bool_]] = {}
    for region in regions:
        beyond = [
            f"({x:g}, {y:g})"
            for x, y in region.outline()
            if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5)
        ]
        if beyond:
            problems.append(
                f"region {region.name}: {', '.join(beyond)} lies outside of the picture of {width} x {height}"
            )
            continue
        mask = _mask(region, width=width, height=height)
        if not mask.any():
            problems.append(f"region {region.name}: contains no pixel centre")
        found[region.name] = mask
    if problems:
        raise ConfigError("\n  ".join(["regions do not fit the pictures:", *problems]))
    return found


def _mask(region: Region, *, width: int, height: int) -> NDArray[np.bool_]:
    """Even-odd rule at pixel centres; OpenCV's filled polygon would include each pixel that an edge touches."""
    vertices = np.asarray(region.outline(), dtype=np.float64)
    mask = np.zeros((height, width), dtype=np.bool_)
    (left, top), (right, bottom) = np.floor(vertices.min(axis=0)), np.ceil(vertices.max(axis=0))
    inside = mask[max(int(top), 0) : int(bottom) + 1, max(int(left), 0) : int(right) + 1]
    x, y = np.arange(inside.shape[1]) + max(left, 0.0), np.arange(inside.shape[0])[:, None] + max(top, 0.0)
    for (x1, y1), (x2, y2) in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        crosses = (y1 > y) != (y2 > y)
        if y1 != y2:
            inside ^= crosses & (x < (x2 - x1) * (y - y1) / (y2 - y1) + x1)
    return mask


def regions_text(file: RegionsFile) -> str:
    """Return the TOML that `load_regions` reads back as the same regions."""
    blocks = [_HEAD + f"schema_version = {file.schema_version}\n", *map(_region, file.regions)]
    return "\n".join([*blocks, *([] if file.markers is None else _markers(file.markers))])


def _region(region: Region) -> str:
    lines = ["[[regions]]", f'name = "{region.name}"']
    if region.rectangle is not None:
        r = region.rectangle
        lines.append(f"rectangle = {{ x = {r.x}, y = {r.y}, width = {r.width}, height = {r.height} }}")
    if region.polygon is not None:
        lines.append(f"polygon = {_points(region.polygon)}")
    if region.edge_px:
        lines.append(f"edge_px = {region.edge_px}")
    return "\n".join(lines) + "\n"


def _markers(markers: Markers) -> Iterable[str]:
    yield f'[markers]\ndictionary = "{markers.dictionary}"\n'
    for marker in markers.seen:
        names = ", ".join(f'"{name}"' for name in marker.regions)
        led = f"regions = [{names}]\n" if names else ""
        yield f"[[markers.seen]]\nid = {marker.id}\ncorners = {_points(marker.corners)}\n{led}"


def _points(points: Iterable[Vertex]) -> str:
    return "[" + ", ".join(f"[{x:.10g}, {y:.10g}]" for x, y in points) + "]"
