"""The hard cases: what costs little is computed anew, and held against the page; of the page itself, no fault."""

import random

import pytest

from tests.hard_cases import page
from tests.hard_cases.cases import HARD_CASES, MET_CASES, HardCase
from tests.hard_cases.matrix import COMMANDS, cell, row_of
from tests.hard_cases.page import PAGE, page_lines, stored_rows

# The law of a singular covariance takes seconds; the page has it.
_GIVEN = [case for case in HARD_CASES if "material" not in case.text and "singular" not in case.name]
_REFUSED = ["sun 85.1 deg", "sun 90 deg", "sun 96 deg, below", "view 90 deg"]
_DEAR = {"aerosol of depth 50", "field 60 x 40 deg", "field 170 x 60 deg", "sun in the field of view"}
# Of the scenes under a sky, few are held against the page each time; `python -m tests.hard_cases.page` makes all anew.
_SEEN = random.Random(23).sample([case for case in HARD_CASES if "material" in case.text], 8)
# Digits that the page has, and what is left of numbers that would be nothing but for rounding.
_DIGITS, _ROUNDING = 2e-5, 1e-12


@pytest.fixture(autouse=True)
def _own_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def rows():
    return {row.name: row for row in stored_rows()}


def _case(name) -> HardCase:
    return next(case for case in HARD_CASES if case.name == name)


@pytest.mark.parametrize("case", _GIVEN, ids=lambda case: case.name)
def test_a_given_radiance_is_answered_as_the_page_says_and_its_own_run_agrees(case, rows, tmp_path):
    found, stored = row_of(case, tmp_path), rows[case.name]
    assert not found.faults
    assert (found.refused, found.exit_code, found.verdict) == (stored.refused, stored.exit_code, stored.verdict)
    assert found.ours == pytest.approx(stored.ours, rel=_DIGITS, abs=_ROUNDING)
    assert found.verdict != "disagrees"


@pytest.mark.parametrize("case", [case for case in _SEEN if case.name not in _DEAR], ids=lambda case: case.name)
def test_a_scene_under_a_sky_is_predicted_as_the_page_says(case, rows, tmp_path):
    found, stored = cell(case, COMMANDS["predict"], tmp_path), rows[case.name]
    assert (found.fault, found.exit_code) == ("", stored.exit_code)
    if not stored.refused:
        dolp = found.answer["regions"]["black"]["dolp"]["mean"]
        assert dolp == pytest.approx(stored.ours["dolp"], rel=_DIGITS, abs=_ROUNDING)


@pytest.mark.parametrize("name", _REFUSED)
def test_a_sun_or_view_that_no_plane_atmosphere_has_is_refused_by_every_command(name, tmp_path):
    found = [cell(_case(name), command, tmp_path) for command in COMMANDS.values()]
    assert {one.exit_code for one in found} == {2}
    assert all("zenith" in one.words for one in found)


@pytest.mark.parametrize(
    ("case", "command", "exit_code"), MET_CASES, ids=lambda one: one.name if isinstance(one, HardCase) else ""
)
def test_what_a_trial_met_is_answered_or_refused_with_words(case, command, exit_code, tmp_path):
    found = cell(case, command, tmp_path)
    assert (found.exit_code, found.fault) == (exit_code, "")


def test_the_page_shows_every_case_with_no_fault_and_no_run_that_disagrees_with_its_own_scene(rows, monkeypatch):
    assert list(rows) == [case.name for case in HARD_CASES]
    assert not [row.name for row in rows.values() if row.faults or row.verdict == "disagrees"]
    assert all(row.reason for row in rows.values() if row.verdict in ("cannot be judged", "not drawn"))
    assert [row.name for row in rows.values() if not (row.error_to_tolerance or 0.0) <= 0.01] == []
    # Without the round earth, which takes another solver a minute.
    monkeypatch.setattr(page, "round_earth_lines", lambda: iter(()))
    lines = [line for line in page_lines(list(rows.values())) if line.startswith("| ")]
    text = PAGE.read_text(encoding="utf-8")
    assert not [line for line in lines if line not in text]
