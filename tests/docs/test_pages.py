import pytest

from tests.docs.blocks import ROOT, blocks_of, pages, problem_of


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_blocks_are_fenced_and_their_commands_and_options_are_those_of_the_program(page):
    problems = [f"{block.place}: {problem}" for block in blocks_of(page) if (problem := problem_of(block))]
    assert problems == []
