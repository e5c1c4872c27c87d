import numpy as np
import pytest

from rigctl.report.comparison import light_section
from rigctl.report.document import Picture
from rigctl.report.table import Shown, Table


class MadeLight:
    """Light of three known parts."""

    def __init__(self, sun, sky, path):
        reflected = np.add(sun, sky)
        total = reflected + path
        self._parts = {
            "reflected_sun": np.array(sun),
            "reflected_sky": np.array(sky),
            "path": np.array(path),
            "reflected": reflected,
            "total": total,
        }

    def mean(self, part):
        return self._parts[part]


@pytest.fixture(scope="module")
def section():
    lights = {
        "paint": MadeLight([6.0, 3.0, 0.0], [3.0, -1.0, 0.0], [1.0, 0.0, 0.0]),
        "road": MadeLight([20.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    }
    return light_section(lights)


def test_every_part_of_every_region_has_its_row_and_share(section):
    (table,) = (block for block in section.blocks if isinstance(block, Table))
    assert len(table.rows) == 10
    shares = {(row[0], row[1]): row[-1] for row in table.texts()}
    assert shares["paint", "reflected sun"] == "60.0%"
    assert shares["paint", "path"] == "10.0%"
    assert shares["road", "total at the aperture"] == "100.0%"
    assert all(len(row) == len(table.shown(Shown.PAGE)) for row in table.texts())


def test_dark_parts_have_no_angle(section):
    (table,) = (block for block in section.blocks if isinstance(block, Table))
    (row,) = (row for row in table.texts() if row[:2] == ("road", "path"))
    assert row[5:7] == ("-", "-")


def test_there_is_a_picture(section):
    (picture,) = (block for block in section.blocks if isinstance(block, Picture))
    assert picture.png.startswith(b"\x89PNG")
