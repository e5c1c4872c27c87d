"""Regions of a picture: their pixels, and the file that holds them."""

from pathlib import Path

import numpy as np
import pytest

from rigctl.errors import ConfigError
from rigctl.files.regions import (
    Marker,
    Markers,
    Rectangle,
    Region,
    RegionsFile,
    inner_masks,
    load_regions,
    masks,
    regions_text,
)
from rigctl.files.toml import load


def _only(region, *, width=10, height=8):
    return masks([region], width=width, height=height)[region.name]


def test_a_rectangle_holds_its_columns_and_rows():
    mask = _only(Region(name="a", rectangle=Rectangle(x=2, y=3, width=4, height=2)))
    expected = np.zeros((8, 10), dtype=bool)
    expected[3:5, 2:6] = True
    assert np.array_equal(mask, expected)


def test_a_rectangle_may_fill_the_picture():
    assert _only(Region(name="a", rectangle=Rectangle(x=0, y=0, width=10, height=8))).all()


def test_a_polygon_holds_the_pixels_whose_centres_lie_in_it():
    mask = _only(Region(name="a", polygon=[(0.5, 0.5), (3.5, 0.5), (0.5, 3.5)]))
    # Centres (1,1), (2,1), (1,2); (3,1), (2,2) and (1,3) lie on the slanted edge or beyond.
    assert {(int(x), int(y)) for y, x in zip(*np.nonzero(mask), strict=True)} >= {(1, 1), (2, 1), (1, 2)}
    assert not mask[3, 3]
    assert not mask[0].any()


def test_y_runs_down():
    mask = _only(Region(name="a", polygon=[(-0.5, -0.5), (9.5, -0.5), (9.5, 1.5), (-0.5, 1.5)]))
    assert mask[:2].all()
    assert not mask[2:].any()


def test_a_hollow_polygon_is_hollow():
    corners = [(0, 0), (9, 0), (9, 7), (0, 7), (0, 0), (3, 2), (3, 5), (6, 5), (6, 2), (3, 2)]
    mask = _only(Region(name="a", polygon=[(x - 0.4, y - 0.4) for x, y in corners]))
    assert not mask[3, 4]
    assert mask[1, 1]


def test_all_regions_that_do_not_fit_are_named():
    regions = [
        Region(name="wide", rectangle=Rectangle(x=8, y=0, width=3, height=1)),
        Region(name="fits", rectangle=Rectangle(x=0, y=0, width=3, height=1)),
        Region(name="low", polygon=[(0, 0), (1, 0), (1, 9)]),
        Region(name="thin", polygon=[(0.1, 0.1), (0.9, 0.1), (0.5, 0.9)]),
    ]
    with pytest.raises(ConfigError) as caught:
        masks(regions, width=10, height=8)
    text = str(caught.value)
    assert "wide" in text
    assert "low" in text
    assert "thin: contains no pixel centre" in text
    assert "fits" not in text


def test_a_region_needs_exactly_one_shape(tmp_path):
    path = tmp_path / "regions.toml"
    path.write_text('[[regions]]\nname = "a"\n[[regions]]\nname = "b"\nrectangle = {x=0, y=0, width=1, height=1}\n')
    with pytest.raises(ConfigError, match=r"first \[\[regions\]\]: needs exactly one"):
        load_regions(path)


def test_names_are_distinct(tmp_path):
    path = tmp_path / "regions.toml"
    path.write_text('[[regions]]\nname = "a"\nrectangle = {x=0, y=0, width=1, height=1}\n' * 2)
    with pytest.raises(ConfigError, match="more than once: a"):
        load_regions(path)


def test_the_border_of_a_region_is_left_out_to_the_width_that_is_asked():
    region = Region(name="a", rectangle=Rectangle(x=2, y=2, width=6, height=5), edge_px=1)
    outer = masks([region], width=12, height=9)
    expected = np.zeros((9, 12), dtype=bool)
    expected[3:6, 3:7] = True
    assert np.array_equal(inner_masks([region], outer)["a"], expected)


def test_a_marker_may_lead_only_regions_that_there_are(tmp_path):
    path = tmp_path / "regions.toml"
    path.write_text(
        '[[regions]]\nname = "a"\nrectangle = {x = 0, y = 0, width = 2, height = 2}\n[[markers.seen]]\nid = 1\n'
        'corners = [[0, 0], [9, 0], [9, 9], [0, 9]]\nregions = ["b"]\n'
    )
    with pytest.raises(ConfigError, match="no region is called b; there are a"):
        load_regions(path)


def test_it_is_read_back_as_it_was(tmp_path: Path) -> None:
    square = [(0.25, 0.0), (9.0, 0.5), (9.125, 9.0), (0.0, 9.0)]
    file = RegionsFile(
        regions=[
            Region(name="a", rectangle=Rectangle(x=1, y=2, width=3, height=4), edge_px=2),
            Region(name="b.2", polygon=[(0.5, 1.0), (10.0, 1.0), (5.0, 7.25)]),
        ],
        markers=Markers(
            dictionary="5x5_100",
            seen=[Marker(id=0, corners=square), Marker(id=4, corners=square, regions=("a", "b.2"))],
        ),
    )
    path = tmp_path / "regions.toml"
    path.write_text(regions_text(file))
    assert load(path, RegionsFile) == file
