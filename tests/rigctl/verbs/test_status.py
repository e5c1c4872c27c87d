"""`rigctl status --contents`: what a run contains."""

import json

import pytest

from rigctl import cli
from rigctl.runs.folder import read_run
from rigctl.runs.writer import RunWriter
from rigctl.verbs.status import contents_of
from tests.rigctl.run_samples import FULL_RECORD, make_record, noisy_counts


@pytest.fixture
def run_path(tmp_path):
    path = tmp_path / "run"
    with RunWriter.create(path, {"origin": "simulated"}) as writer:
        for i, (angle_deg, readback_deg) in enumerate([(0.0, 0.01), (90.0, 89.99), (0.0, -0.02), (90.0, 90.0)]):
            record = make_record(
                i,
                cycle=i // 2,
                polarizer_angle_target_deg=angle_deg,
                polarizer_angle_deg=readback_deg,
                exposure_s=0.002,
                remarks=("button pressed",) if i == 1 else (),
            )
            writer.write_frame(record, noisy_counts(i))
        writer.write_frame(make_record(4, kind="dark", exposure_s=0.002), noisy_counts(4))
        writer.write_frame(FULL_RECORD, noisy_counts(7))
        writer.event("paused")
        writer.event("paused")
    return path


def test_the_contents_of_a_run_are_counted_and_printed(run_path, capsys):
    contents = contents_of(read_run(run_path))
    table = [(g.kind, g.polarizer_angle_target_deg, g.frames, g.cycles) for g in contents.groups]
    assert table == [("scene", 0.0, 2, 2), ("scene", 90.0, 2, 2), ("dark", None, 1, 0), ("scene", 45.0, 1, 1)]
    assert contents.groups[0].polarizer_angle_deg == pytest.approx((-0.02, 0.01), abs=1e-9)
    assert (contents.remarks["button pressed"], contents.events) == (2, {"paused": 2})
    assert (contents.stages, contents.sizes) == (("ELL14 11400001",), ((7, 5),))
    assert contents.start_utc == FULL_RECORD.start_utc
    assert cli.main(["status", "--contents", str(run_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    head = next(line for line in lines if line.startswith("kind"))
    dark = next(line for line in lines if line.startswith("dark"))
    assert "angle [deg]" in head
    # Numbers are right-aligned under their title.
    assert dark[: head.index("exposure [s]") + len("exposure [s]")].endswith(" 0.002")


@pytest.mark.parametrize(
    ("error_s", "told"), [(0.012, "within 12 ms of UTC"), (None, "was not synchronised")], ids=["good", "none"]
)
def test_errors_of_starts_are_printed_by_their_source(tmp_path, capsys, error_s, told):
    path = tmp_path / "run"
    starts = [("ptp", 2.5e-7), ("trigger", 0.004), ("ptp", 1.2e-6), ("driver", None), ("driver", 0.033), ("file", None)]
    with RunWriter.create(path, {"origin": "device"}) as writer:
        writer.event("host clock", utc_error_s=error_s)
        for i, (source, uncertainty_s) in enumerate(starts):
            record = make_record(i, start_source=source, start_uncertainty_s=uncertainty_s)
            writer.write_frame(record, noisy_counts(i))
    assert contents_of(read_run(path)).start_times == (
        "by the camera's clock, which follows a PTP master: 2 frames, off by 1.2 us at most",
        "between the trigger and the first packet: 1 frames, off by 4 ms at most",
        "by the time stamp of the video driver: 2 frames, off by 33 ms at most (not known of 1)",
        "by the last change of the file: 1 frames, error not known",
    )
    assert cli.main(["status", "--contents", str(path)]) == 0
    assert told in " ".join(capsys.readouterr().out.split())


def test_run_without_its_frames_ends_with_4(run_path, capsys):
    (run_path / "frames" / "000004_dark.fits").unlink()
    assert cli.main(["status", "--contents", str(run_path)]) == 4
    assert "000004_dark.fits: missing" in capsys.readouterr().err


def test_a_readback_on_the_other_side_of_0_is_near_its_target(tmp_path):
    with RunWriter.create(tmp_path / "run", {"origin": "simulated"}) as writer:
        for i, readback_deg in enumerate((0.002, 179.999)):
            writer.write_frame(
                make_record(i, polarizer_angle_target_deg=0.0, polarizer_angle_deg=readback_deg), noisy_counts(i)
            )
    (group,) = contents_of(read_run(tmp_path / "run")).groups
    assert group.polarizer_angle_deg == pytest.approx((-0.001, 0.002), abs=1e-9)


@pytest.mark.parametrize("command", [["status", "--contents"], ["status", "--page", "page.html"]])
def test_placeholders_of_sense_and_offset_give_a_warning(tmp_path, monkeypatch, capsys, command):
    monkeypatch.chdir(tmp_path)
    rig = {"polarizer": {"sense": 1, "offset_deg": 0.0, "placeholder": True}}
    with RunWriter.create(tmp_path / "run", {"origin": "simulated", "rig": rig}) as writer:
        writer.write_frame(make_record(0, polarizer_angle_target_deg=0.0, polarizer_angle_deg=0.0), noisy_counts(0))
    assert cli.main([*command, "run"]) == 0
    assert "sense and offset of the polarizer are placeholders" in " ".join(capsys.readouterr().err.split())
    assert cli.main([*command, "run", "--json"]) == 0
    assert "are placeholders" in json.loads(capsys.readouterr().out)["doubts"][0]
    assert cli.main(["export", "run", "--to", "hdf5", "--out", "run.h5"]) == 0
    assert "are placeholders" in " ".join(capsys.readouterr().err.split())
    if "--page" in command:
        assert "Sense and offset of the polarizer are placeholders" in (tmp_path / "page.html").read_text()
