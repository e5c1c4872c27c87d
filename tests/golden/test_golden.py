"""What every verb gives is what is stored; how to accept an intended difference stands in the package's docstring."""

import pytest

from tests.golden.cases import CHAPTERS
from tests.golden.harness import check
from tests.golden.run import why_not

_SHOWN = 40


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("name", [name for name, chapter in CHAPTERS.items() if not chapter.is_long])
def test_a_chapter_gives_what_is_stored(name, tmp_path):
    reason = why_not(CHAPTERS[name])
    if reason is not None:
        pytest.skip(reason)
    found = check(name, CHAPTERS[name], tmp_path / name)
    assert not found, "\n".join([f"{len(found)} differences:", *found[:_SHOWN]])
