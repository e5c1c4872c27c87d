"""``rigctl regions``: markers written down at noon lead the regions in the evening."""

import json
from pathlib import Path

import numpy as np
import pytest

from rigctl.cli import main
from rigctl.console.failures import EXIT_DATA, EXIT_USAGE
from rigctl.files.regions import load_regions
from tests.rigctl.outlines.marked_pictures import MOVED, panels, run_of, seen_after_move

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
    assert "no marker of 6x6_250 is seen" in capsys.readouterr().err
    assert not out.exists()


def test_an_unknown_family_is_answered_with_those_there_are(
    afternoon: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ("mark", afternoon / "noon", afternoon / "regions.toml", "--out", afternoon / "x", "--dictionary", "9x9")
    assert run(*given) == EXIT_USAGE
    assert "4x4_50" in capsys.readouterr().err
