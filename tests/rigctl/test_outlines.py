"""Regions found again by printed markers, in Python and with `rigctl regions`."""

import json
from pathlib import Path

import numpy as np
import pytest

from rigctl.cli import main
from rigctl.console import EXIT_DATA, EXIT_USAGE
from rigctl.errors import DataError
from rigctl.files.regions import Marker, Markers, Rectangle, Region, RegionsFile, load_regions
from rigctl.outlines import follow_markers, grey_picture, moved_markers, search_markers
from tests.rigctl.marked_pictures import MOVED, panels, run_of, seen_after_move

MARKERS = {3: (60, 50), 7: (360, 260)}
PANEL = Region(name="panel", rectangle=Rectangle(x=150, y=120, width=180, height=120), edge_px=2)


def drawn(seen: list[Marker]) -> RegionsFile:
    return RegionsFile(regions=[PANEL], markers=Markers(seen=seen))


def test_markers_are_found_where_they_are(tmp_path: Path) -> None:
    found = search_markers(grey_picture(run_of(panels(markers=MARKERS), tmp_path / "run")), "4x4_50")
    assert [marker.id for marker in found] == [3, 7]
    for marker in found:
        x, y = MARKERS[marker.id]
        outer = [(x - 0.5, y - 0.5), (x + 47.5, y - 0.5), (x + 47.5, y + 47.5), (x - 0.5, y + 47.5)]
        # The refinement of corners finds a blurred, noisy corner to a third of a pixel.
        np.testing.assert_allclose(marker.corners, outer, atol=0.6)


def test_a_marker_seen_twice_is_not_taken(tmp_path: Path) -> None:
    picture = panels(markers={3: (60, 50)})
    picture[240:308, 340:408] = picture[40:108, 50:118]
    assert search_markers(grey_picture(run_of(picture, tmp_path / "run")), "4x4_50") == []


def test_region_is_found_again_after_the_camera_moved(tmp_path: Path) -> None:
    picture = panels(markers=MARKERS)
    before = search_markers(grey_picture(run_of(picture, tmp_path / "noon")), "4x4_50")
    now = search_markers(grey_picture(run_of(seen_after_move(picture), tmp_path / "late")), "4x4_50")
    (found,) = follow_markers(drawn(before), now)
    truth = np.column_stack([PANEL.outline(), np.ones(4)]) @ MOVED.T
    assert found.region.polygon is not None
    # Corners of markers are good to a third of a pixel; the panel lies between them.
    np.testing.assert_allclose(found.region.polygon, truth, atol=0.5)
    assert found.region.edge_px >= PANEL.edge_px + 1
    assert found.shift_px == pytest.approx(np.hypot(*(truth.mean(axis=0) - np.mean(PANEL.outline(), axis=0))), abs=0.5)


def test_a_lost_marker_is_an_error_that_names_region_and_marker() -> None:
    square = [(0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0)]
    with pytest.raises(DataError, match=r"region panel: none of its markers is visible .number 3 of 4x4_50"):
        follow_markers(drawn([Marker(id=3, corners=square)]), [Marker(id=5, corners=square)])


def test_markers_that_moved_apart_are_refused() -> None:
    square = np.array([(0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0)])
    places = [square + np.array(shift) for shift in ((0.0, 0.0), (300.0, 0.0), (0.0, 200.0), (300.0, 200.0))]
    before = [Marker(id=k, corners=place.tolist()) for k, place in enumerate(places)]
    now = [*before[:3], Marker(id=3, corners=(places[3] + 20.0).tolist())]
    with pytest.raises(DataError, match="did not move as a plane"):
        follow_markers(drawn(before), now)


def test_a_file_without_markers_says_how_to_add_them() -> None:
    with pytest.raises(DataError, match="rigctl regions mark"):
        follow_markers(RegionsFile(regions=[PANEL]), [])


def test_only_the_markers_that_lead_a_region_move_it() -> None:
    square = np.array([(0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0)])
    before = [
        Marker(id=1, corners=square.tolist(), regions=("panel",)),
        Marker(id=2, corners=(square + 100.0).tolist(), regions=("panel_b",)),
    ]
    other = Region(name="panel_b", rectangle=Rectangle(x=50, y=50, width=9, height=9))
    file = RegionsFile(regions=[PANEL, other], markers=Markers(seen=before))
    now = [
        before[0].model_copy(update={"corners": (square + 2.0).tolist(), "regions": ()}),
        before[1].model_copy(update={"corners": (square + 107.0).tolist(), "regions": ()}),
    ]
    shifts = [found.shift_px for found in follow_markers(file, now)]
    assert shifts == pytest.approx([np.hypot(2.0, 2.0), np.hypot(7.0, 7.0)])
    kept = moved_markers(file, now)
    assert kept is not None
    assert [marker.regions for marker in kept.seen] == [("panel",), ("panel_b",)]


REGIONS = '[[regions]]\nname = "panel"\nrectangle = { x = 150, y = 120, width = 180, height = 120 }\n'


@pytest.fixture
def afternoon(tmp_path: Path) -> Path:
    picture = panels(markers={3: (60, 50), 7: (360, 260)})
    run_of(picture, tmp_path / "noon")
    run_of(seen_after_move(picture), tmp_path / "evening")
    (tmp_path / "regions.toml").write_text(REGIONS)
    return tmp_path


def run(*arguments: object) -> int:
    return main(["regions", *map(str, arguments)])


def test_regions_follow_the_markers_from_run_to_run(afternoon: Path, capsys: pytest.CaptureFixture[str]) -> None:
    marked, evening = afternoon / "marked.toml", afternoon / "evening.toml"
    assert run("mark", afternoon / "noon", afternoon / "regions.toml", "--out", marked) == 0
    assert "1 regions, 2 markers" in capsys.readouterr().out
    assert run("find", afternoon / "evening", marked, "--out", evening, "--json") == 0
    (found,) = json.loads(capsys.readouterr().out)["regions"]
    assert found["markers"] == [3, 7]
    centre = np.array([239.5, 179.5])
    # Corners of markers are good to a third of a pixel.
    assert found["shift_px"] == pytest.approx(np.hypot(*(MOVED @ [*centre, 1.0] - centre)), abs=0.4)
    (region,) = load_regions(evening)
    assert region.edge_px == found["edge_px"] >= 1


def test_a_picture_without_markers_says_what_to_print(afternoon: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = afternoon / "marked.toml"
    given = ("mark", afternoon / "noon", afternoon / "regions.toml", "--out", out, "--dictionary", "6x6_250")
    assert run(*given) == EXIT_DATA
    assert "no marker of 6x6_250 was found" in capsys.readouterr().err
    assert not out.exists()


def test_an_unknown_family_is_answered_with_those_there_are(
    afternoon: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ("mark", afternoon / "noon", afternoon / "regions.toml", "--out", afternoon / "x", "--dictionary", "9x9")
    assert run(*given) == EXIT_USAGE
    assert "4x4_50" in capsys.readouterr().err
