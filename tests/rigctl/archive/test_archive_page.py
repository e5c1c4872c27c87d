from pathlib import Path

from rigctl.archive.index import COLUMNS

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "archives.md"


def test_the_page_has_every_column_of_the_index():
    rows = [line for line in PAGE.read_text().splitlines() if line.startswith("| `")]
    assert rows == [f"| `{one.name}` | {one.kind} | {one.level} | {one.meaning} |" for one in COLUMNS]
