"""Regions that a page sends, written with the markers of the live picture."""

from pathlib import Path

import pytest

from rigctl.errors import DataError
from rigctl.files.regions import RegionsFile
from rigctl.files.toml import load
from rigctl.web.regions_page import write_regions
from tests.rigctl.marked_pictures import panels

BODY = b'{"regions": [{"name": "panel", "polygon": [[1, 1], [9, 1], [9, 9]]}]}'


def test_markers_of_the_live_picture_are_written_down_with_the_regions(tmp_path: Path) -> None:
    assert (
        write_regions(tmp_path / "regions.toml", BODY, panels(markers={3: (60, 50), 7: (360, 260)})) == "regions.toml"
    )
    written = load(tmp_path / "regions.toml", RegionsFile)
    assert [marker.id for marker in written.markers.seen] == [3, 7]


def test_without_a_picture_or_markers_there_are_regions_alone(tmp_path: Path) -> None:
    for picture in (None, panels(markers={})):
        write_regions(tmp_path / "regions.toml", BODY, picture)
        assert load(tmp_path / "regions.toml", RegionsFile).markers is None


def test_a_file_that_a_person_wrote_is_never_lost(tmp_path: Path) -> None:
    file = tmp_path / "regions.toml"
    file.write_text("# by hand\n")
    for _ in range(3):
        write_regions(file, BODY, None)
    write_regions(file, BODY.replace(b"panel", b"other"), None)
    kept = {path.name: path.read_text() for path in tmp_path.glob("regions.toml.bak*")}
    assert kept["regions.toml.bak"] == "# by hand\n"
    assert "panel" in kept["regions.toml.bak2"]
    assert len(kept) == 2


def test_what_is_no_region_is_refused_and_the_old_ones_stay(tmp_path: Path) -> None:
    write_regions(tmp_path / "regions.toml", BODY, None)
    with pytest.raises(DataError):
        write_regions(tmp_path / "regions.toml", b'{"regions": [{"name": "<b>"}]}', None)
    assert "panel" in (tmp_path / "regions.toml").read_text()
