"""Pictures drawn without matplotlib: colours, what is not known, outlines, and room for all that is written."""

import cv2
import numpy as np
import pytest

from rigctl.files.regions import Region
from rigctl.report.drawing import DrawnPicture, colour_table, pictures_png


def drawn(values, *, regions=(), **changed):
    """Return a picture as pixels (red first) of the file."""
    given = {"low": 0.0, "high": 1.0, "colours": "gray", "title": "T", "label": "what [unit]"} | changed
    png = pictures_png((DrawnPicture(values=np.asarray(values, dtype=float), **given),), regions=regions)
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


def colours_of(pixels):
    return {tuple(int(part) for part in pixel) for pixel in pixels.reshape(-1, 3)}


@pytest.mark.parametrize(
    ("colours", "low", "high"),
    [
        ("viridis", (68, 1, 84), (253, 231, 37)),
        ("cividis", (0, 34, 78), (254, 232, 56)),
        ("red-blue", (5, 48, 97), (103, 0, 31)),
        ("gray", (0, 0, 0), (255, 255, 255)),
    ],
)
def test_values_beyond_the_bar_have_the_colours_of_its_ends(colours, low, high):
    # As matplotlib has them; of four pixels the upper two are low.
    pixels = drawn([[-5.0, 0.0], [1.0, np.inf]], colours=colours)
    assert tuple(pixels[100, 250]) == low
    assert tuple(pixels[350, 250]) == high


def test_what_is_not_a_number_and_what_is_not_seen_show_the_ground():
    pixels = drawn([[np.nan, 0.0], [0.0, 0.0]], ground=153, opacity=np.array([[1.0, 1.0], [0.0, np.nan]]))
    corners = [pixels[y, x, 0] for y, x in ((100, 150), (100, 400), (350, 150), (350, 400))]
    assert corners == [153, 0, 153, 153]


def test_a_region_is_outlined_where_it_lies():
    region = Region.model_validate({"name": "panel", "polygon": [[20, 20], [60, 20], [60, 60], [20, 60]]})
    bare, outlined = drawn(np.full((100, 100), 0.5)), drawn(np.full((100, 100), 0.5), regions=(region,))
    y, x = np.nonzero(np.any(bare != outlined, axis=-1))
    # 385 pixels for 100, from the 82nd on; its name stands above it.
    assert abs(x.min() - (82 + 20 * 3.85)) < 6.0
    assert abs(x.max() - (82 + 60 * 3.85)) < 6.0
    assert abs(y.max() - (38 + 60 * 3.85)) < 6.0


@pytest.mark.parametrize("shape", [(1, 1), (4, 900), (900, 40), (30, 50)])
@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (1234567.0, 1234568.5), (-3e-9, 2e-9), (-4e7, 5e7)])
def test_nothing_that_is_written_touches_the_edge(shape, low, high):
    pixels = drawn(
        np.full(shape, low), low=low, high=high, title="A title wider than some", label="a name of the values [unit]"
    )
    edges = (pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1])
    assert set().union(*map(colours_of, edges)) == {(255, 255, 255)}
    # Below the title and right of the picture: the bar and what is written beside it.
    assert (pixels[60:, -150:] < 100).any()


def test_angles_have_a_wheel_of_colours_that_come_round():
    pixels = drawn([[0.0, 180.0], [90.0, 45.0]], colours="aolp", low=0.0, high=180.0, label="AoLP [deg]")
    at_0, at_180, at_90 = (pixels[place] for place in ((100, 250), (100, 420), (350, 250)))
    assert np.abs(at_0.astype(int) - at_180).max() <= 3
    assert at_0.sum() > at_90.sum() + 50
    table = colour_table("aolp").astype(int)
    steps = np.abs(np.diff(table, axis=0, append=table[:1])).max(axis=1)
    assert steps.max() <= 6  # no step that were a line in a picture
    assert np.ptp(table, axis=1).min() > 40  # none is grey, to which pictures fade
    # The wheel, right of the picture: 0 deg to its right and to its left, 90 deg above and below.
    wheel = pixels[:, 82 + 385 + 13 :]
    assert (np.abs(wheel.astype(int) - at_90).max(axis=-1) <= 3).sum() > 20
