"""The cells of the matrix of hard cases that cost little."""

import pytest

from tests.hard_cases.cases import HARD_CASES
from tests.hard_cases.matrix import COLUMNS, Cell, cell
from tests.hard_cases.page import PAGE, rows_of

_BY_NAME = {column.name: column for column in COLUMNS}
# The law of a singular covariance takes seconds; the page has it.
_GIVEN = [case for case in HARD_CASES if "material" not in case.text and "singular" not in case.name]
_REFUSED = [
    case for case in HARD_CASES if case.name in {"sun 85.1 deg", "sun 90 deg", "sun 96 deg, below", "view 90 deg"}
]


@pytest.fixture(autouse=True)
def _own_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def _cells(case, names, folder) -> dict[str, Cell]:
    return {name: cell(case, _BY_NAME[name], folder) for name in names}


@pytest.mark.parametrize("case", _GIVEN, ids=lambda case: case.name)
def test_a_given_radiance_is_answered_or_refused_with_words(case, tmp_path):
    found = _cells(case, ("predict", "--tolerance", "sweep", "effects"), tmp_path)
    assert not {name: one for name, one in found.items() if one.fault}


@pytest.mark.parametrize("case", _REFUSED, ids=lambda case: case.name)
def test_a_sun_or_view_that_no_plane_atmosphere_has_is_refused_by_every_command(case, tmp_path):
    found = _cells(case, ("predict", "--tolerance", "sweep", "uncertainty", "effects", "tradeoff"), tmp_path)
    assert {one.exit_code for one in found.values()} == {2}
    assert all("zenith" in one.words for one in found.values())


def test_a_region_without_noise_has_a_tolerance_and_a_tradeoff(tmp_path):
    case = next(one for one in HARD_CASES if one.name == "zero noise")
    found = _cells(case, ("--tolerance", "tradeoff"), tmp_path)
    assert [one.exit_code for one in found.values()] == [0, 0]


def test_the_page_holds_every_cell_and_no_fault():
    rows = rows_of(PAGE)
    assert set(rows) == {case.name for case in HARD_CASES}
    for line in rows.values():
        cells = [part.strip() for part in line.strip("|").split("|")]
        assert len(cells) == len(COLUMNS) + 1
        assert all(cells)
        assert "**" not in line
        assert "skipped" not in line
