import re
import shutil
from dataclasses import fields
from typing import get_args

import pytest

from model.prediction.quantity_table import QUANTITIES
from rigctl.files.interlock_section import InterlockSection
from rigctl.runs.fits.frame_header import _KEYWORDS
from rigctl.runs.frame_record import FrameRecord
from rigctl.session.interlocks import Name
from tests.docs.blocks import ROOT, blocks_of, pages, problem_of
from tests.docs.reference import DOCS, PAGES
from tests.docs.run_pages import run_blocks, runs


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_blocks_are_fenced_and_their_commands_and_options_are_those_of_the_program(page):
    problems = [f"{block.place}: {problem}" for block in blocks_of(page) if (problem := problem_of(block))]
    assert problems == []


@pytest.mark.parametrize("page", PAGES)
def test_a_page_made_from_the_code_is_as_the_code_is(page):
    assert (DOCS / page).read_text() == PAGES[page](), "write it again: python -m tests.docs.reference"


def test_every_interlock_is_told_with_what_trips_it():
    text = (DOCS / "rooftop.md").read_text()
    for name in get_args(Name):
        default = InterlockSection.model_fields[name].default
        assert re.search(rf"^\| {name} \| .+ \| {default} \| ", text, re.MULTILINE), name


def test_every_quantity_and_every_card_of_a_frame_is_told():
    text = (DOCS / "outputs.md").read_text()
    told = set(re.findall(r"`([^`]+)`", text))
    assert {name for name in QUANTITIES if name not in told} == set()
    assert {name for name in (one.name for one in _KEYWORDS) if name not in told} == set()
    assert {one.name for one in fields(FrameRecord) if one.name not in told} == set()


@pytest.mark.timeout(600)
def test_the_tutorial_runs_word_for_word(tmp_path):
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    assert run_blocks([block for block in blocks_of(DOCS / "tutorial.md") if runs(block)], tmp_path) == []
