"""``rigctl archive health``: what moves, what is lost and what was changed, over many runs."""

import json

import numpy as np
import pytest

from rigctl import cli
from rigctl.runs.records import FrameRecord
from rigctl.runs.writer import RunWriter
from rigctl.verbs.archive import health

DARK_DN = (60.0, 61.0, 60.0, 60.0, 95.0, 60.0)


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    root = tmp_path_factory.mktemp("archive")
    draws = np.random.default_rng(1)
    for place, dark_dn in enumerate(DARK_DN):
        rig = {"polarizer": {"sense": 1, "offset_deg": 12.0 if place < 3 else 12.5}}
        with RunWriter.create(root / f"{place}", {"origin": "simulated", "rig": rig}) as writer:
            for sequence, kind in enumerate(("dark", "scene", "scene")):
                record = FrameRecord(
                    kind=kind,
                    sequence=sequence,
                    bit_depth=12,
                    saturation_dn=4095.0,
                    stage_angle_target_deg=359.999,
                    stage_angle_deg=0.009 if place == 2 else 0.001,
                    stage_tries=1,
                    camera_serial="A" if place < 5 else "B",
                    stage_serial="S",
                    start_utc=f"2026-0{place + 1}-01T10:00:0{sequence}.000000000Z",
                )
                writer.write_frame(record, draws.poisson(dark_dn, (8, 8)).astype(np.uint16))
            writer.event("camera tally", accepted=3, damaged=place // 4, never_came=0)
            writer.closing_event("finished", frames=3)
    (root / "broken").mkdir()
    (root / "broken" / "session.json").write_text("{")
    return root


def test_what_changed_is_told_with_its_time(archive):
    found = health(archive).found
    assert [one.run for one in found.runs] == ["0", "1", "2", "3", "4", "5"]
    changes = {(one.run, one.what): (one.before, one.after) for one in found.changes}
    assert changes["3", "axis"] == ("sense 1, offset 12.0", "sense 1, offset 12.5")
    assert changes["5", "camera"] == ("A", "B")
    assert len(changes) == 2
    assert list(found.unread) == ["broken"]


def test_what_stands_out_is_named(archive):
    outlying = {(one.run, one.what) for one in health(archive).found.outlying}
    assert ("4", "dark_dn") in outlying
    assert ("2", "stage_error_deg") in outlying
    assert ("4", "lost_frames") in outlying
    assert not any(run in ("0", "1", "3", "5") for run, _ in outlying)


def test_the_command_tells_it(archive, capsys):
    assert cli.main(["archive", "health", str(archive)]) == 0
    said = capsys.readouterr().out
    assert "camera: A -> B" in said
    assert "stands out: 4: dark_dn" in said
    assert cli.main(["archive", "health", str(archive), "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["runs"]) == 6
    assert cli.main(["archive", "health", str(archive / "none")]) == 2
