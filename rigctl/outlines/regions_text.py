"""A regions file as text."""

from collections.abc import Iterable

from rigctl.files.regions import Markers, Region, RegionsFile, Vertex

_HEAD = "# Regions of interest. x runs right, y down, (0, 0) is the centre of the top left pixel.\n"


def regions_text(file: RegionsFile) -> str:
    """Return the TOML that `rigctl.files.regions.load_regions` reads back as the same regions."""
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
