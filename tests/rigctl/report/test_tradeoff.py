from itertools import combinations

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Annotation

from rigctl.report.drawing import placed_axes
from rigctl.report.tradeoff import PointName, name_points

CROWDED = [(0.1, 0.1), (0.1, 0.1), (0.101, 0.1), (0.105, 0.1), (0.09, 0.102)]
AT_THE_CORNERS = [(0.01, 1e-6), (1.0, 1e-6), (1.0, 1.0), (0.01, 1.0)]


@pytest.mark.parametrize("points", [CROWDED, AT_THE_CORNERS], ids=["crowded", "at the corners"])
def test_no_name_lies_on_another_or_beyond_the_axes(points):
    figure, (axis,) = placed_axes(1, 1, size=(6.0, 6.0), margins=(0.5, 0.5, 0.5, 0.5))
    axis.loglog(*zip(*points, (0.01, 1e-6), (1.0, 1.0), strict=True), "o")
    names = [f"K = {k} midpoint tiles" for k in range(len(points))]
    name_points(figure, axis, [PointName(text=name, x=x, y=y) for name, (x, y) in zip(names, points, strict=True)])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    written = [one for one in axis.texts if isinstance(one, Annotation)]
    assert [one.get_text() for one in written] == names
    # Without the lines to far points, which a box of the whole annotation would take in.
    boxes = [one.get_bbox_patch().get_window_extent(canvas.get_renderer()) for one in written]
    assert not [pair for pair in combinations(boxes, 2) if pair[0].shrunk(0.9, 0.9).overlaps(pair[1].shrunk(0.9, 0.9))]
    assert all(axis.bbox.x0 <= box.x0 + 4 and box.x1 - 4 <= axis.bbox.x1 for box in boxes)
    assert all(axis.bbox.y0 <= box.y0 + 4 and box.y1 - 4 <= axis.bbox.y1 for box in boxes)
