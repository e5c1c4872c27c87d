import re
import shutil
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest

from model.quantities import QUANTITIES
from rigctl.files.session_file import InterlockSection
from rigctl.paper import check as paper_files
from rigctl.paper.check import statement_table
from rigctl.report.comparison import row_table
from rigctl.report.detection import measured_roc_table, roc_points
from rigctl.report.series import series_rows
from rigctl.report.sweep import sweep_table
from rigctl.report.tradeoff import curve_table, points_table
from rigctl.session.interlocks import Name
from rigctl.verbs.predict import _csv_table
from tests.docs.blocks import ROOT, blocks_of, pages, problem_of
from tests.docs.run_pages import run_blocks, runs

DOCS = ROOT / "docs"


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_blocks_are_fenced_and_their_commands_and_options_are_those_of_the_program(page):
    problems = [f"{block.place}: {problem}" for block in blocks_of(page) if (problem := problem_of(block))]
    assert problems == []


def test_every_interlock_is_told_with_what_trips_it():
    text = (DOCS / "rooftop.md").read_text()
    for name in get_args(Name):
        default = InterlockSection.model_fields[name].default
        assert re.search(rf"^\| {name} \| .+ \| {default} \| ", text, re.MULTILINE), name


def test_every_quantity_is_explained():
    text = (DOCS / "outputs.md").read_text()
    assert {name for name in QUANTITIES if f"`{name}`" not in text} == set()


_NOTHING = SimpleNamespace(
    axes=(),
    regions=(),
    pairs=(),
    warnings=(),
    missing=(),
    quantities=(),
    points=(),
    comparisons=(),
    front=(),
    shape=(0,),
)
_NO_POINTS = SimpleNamespace(p_false_alarm=np.empty(0))
_CSV_FILES = {
    "comparison.csv": row_table(()),
    "series.csv": series_rows(_NOTHING),
    "prediction.csv": _csv_table((), ()),
    "sweep.csv": sweep_table(_NOTHING),
    "roc.csv` of `predict": roc_points({}),
    "roc.csv` of `detect": measured_roc_table(_NO_POINTS),
    "tradeoff.csv": curve_table(_NOTHING),
    "acquisition.csv": points_table(_NOTHING),
    "statements.csv": statement_table(()),
    "curves.csv": paper_files._points_table({}),
}


@pytest.mark.parametrize("name", _CSV_FILES)
def test_every_column_of_a_csv_file_is_told(name):
    row = re.search(rf"^\| `{re.escape(name)}` \| (.+?) \| ", (DOCS / "outputs.md").read_text(), re.MULTILINE)
    assert row is not None, f"docs/outputs.md lacks {name}"
    told = re.findall(r"`([^`]+)`", row[1])
    own = [column for column in told if not (column.isupper() or "." in column)]
    columns = _CSV_FILES[name].csv().split("\n")[0].strip().split(",")
    after = [] if name != "series.csv" else _CSV_FILES["comparison.csv"].csv().split("\n")[0].split(",")
    assert [*own, *after] == columns


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_tutorial_runs_word_for_word(tmp_path):
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    assert run_blocks([block for block in blocks_of(DOCS / "tutorial.md") if runs(block)], tmp_path) == []


@pytest.mark.parametrize(("page", "least"), [("architecture.md", 50), ("paper.md", 20)])
def test_pages_name_modules_that_exist(page, least):
    text = (DOCS / page).read_text()
    named = re.findall(r"`((?:[\w.]+/)*\w+(?:\.py|/))`", text)
    roots = [ROOT, ROOT / "rigctl", ROOT / "calibration" / "sensor"]
    assert len(named) > least
    assert [name for name in named if not any((root / name).exists() for root in roots)] == []
