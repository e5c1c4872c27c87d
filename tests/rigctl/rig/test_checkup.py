"""What the doctor finds, with the number that each advice hangs on."""

from pathlib import Path

import pytest

from drivers.cameras.gige import open_gige
from drivers.errors import NotConnectedError
from drivers.interfaces import FrameTally
from rigctl.cli import main
from rigctl.errors import DataError
from rigctl.files.session_file import SessionFile
from rigctl.rig.checkup import (
    Finding,
    adapter_wait,
    camera_frames,
    disk,
    receive_buffer,
    room,
    timed_frames,
)
from rigctl.rig.simulation import serve_rig_camera
from rigctl.session.plan import demand_of
from rigctl.verbs.doctor import most_important_first
from tests.rigctl.example_files import EXAMPLES, small_rig
from tests.sim_devices.camera_builders import small_camera
from tests.sim_devices.cameras.gige_port import ADDRESS, gige_port


def test_a_receive_buffer_of_two_pictures_is_enough():
    assert receive_buffer(frame_bytes=1000, largest_bytes=2000).advice is None


def test_a_smaller_one_has_to_be_raised_to_two_pictures():
    advice = receive_buffer(frame_bytes=1000, largest_bytes=1999).advice
    assert advice is not None
    assert "net.core.rmem_max=2000" in advice


def test_a_disk_is_measured_and_left_as_it_was(tmp_path):
    finding = disk(tmp_path, frame_bytes=1000, period_s=100.0)
    assert "MB/s" in finding.found
    assert finding.advice is None
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_reported():
    with pytest.raises(DataError, match="cannot be written"):
        disk(Path("/no/such/folder"), frame_bytes=10, period_s=1.0)


def test_pictures_are_timed_and_the_counts_of_the_camera_reported():
    camera = small_camera()
    timed, stamps, samples, loss = camera_frames(camera, *timed_frames(camera, frames=3, timeout_s=1.0))
    assert timed.found.startswith("3 frames")
    assert stamps.found == "start of an exposure as simulated, off by 0 us at most"
    assert "right-justified" in samples.found
    assert loss.found == "0 damaged, 0 never came"


@pytest.mark.parametrize(("free_bytes", "is_enough"), [(1000, True), (999, False)])
def test_room_is_enough_for_all_frames_or_more_is_asked_for(tmp_path, free_bytes, is_enough):
    assert (room(tmp_path, total_bytes=1000, free_bytes=free_bytes).advice is None) == is_enough


def session(*takes):
    return SessionFile.model_validate({"name": "s", "take": list(takes)})


def test_the_disk_must_be_as_fast_as_the_fastest_stretch(tmp_path):
    # Eight dark frames of 5 ms one after the other; scene frames take a turn of 0.2 s each.
    dark, scene = ({"kind": kind, "exposure_ms": 5, "cycles": 8} for kind in ("dark", "scene"))
    frame_bytes, period_s, total_bytes = demand_of(
        small_rig(tmp_path), session(scene, dark), pixels=1000, now_ns=0, camera_s=0.0
    )
    assert period_s == pytest.approx(0.005)
    assert total_bytes == 40 * frame_bytes
    assert 2000 < frame_bytes < 2000 + 10_000


def test_turns_make_a_session_slower(tmp_path):
    scene = {"kind": "scene", "exposure_ms": 5, "cycles": 8}
    _, period_s, _ = demand_of(small_rig(tmp_path), session(scene), pixels=1000, now_ns=0, camera_s=0.0)
    # The first of all frames has no turn before it, so the fastest eight have seven.
    assert period_s == pytest.approx((8 * 0.005 + 7 * 0.2) / 8)


@pytest.mark.parametrize(("camera_s", "period_s"), [(0.03, 0.03003), (None, 0.00703)])
def test_short_exposures_are_no_faster_than_the_camera(tmp_path, camera_s, period_s):
    dark = {"kind": "dark", "exposure_ms": 0.03, "cycles": 8}
    found_s = demand_of(small_rig(tmp_path), session(dark), pixels=1000, now_ns=0, camera_s=camera_s)[1]
    assert found_s == pytest.approx(period_s)


@pytest.mark.parametrize(("wait", "is_well"), [("1\n", True), ("16\n", False)])
def test_an_adapter_that_waits_is_found(tmp_path, wait, is_well):
    (tmp_path / "ttyUSB7").mkdir()
    (tmp_path / "ttyUSB7" / "latency_timer").write_text(wait)
    finding = adapter_wait("/dev/ttyUSB7", devices=tmp_path)
    assert (finding.advice is None) == is_well


def test_a_port_that_tells_of_no_wait_is_passed_over(tmp_path):
    assert adapter_wait("/dev/ttyACM0", devices=tmp_path) is None


def test_devices_that_fail_are_a_line_and_the_machine_is_looked_at_all_the_same(tmp_path, capsys):
    rig = tmp_path / "rig.toml"
    text = (EXAMPLES / "rig-sim.toml").read_text().replace("sim:gc780", "files:/no/such/folder")
    rig.write_text(text.replace('scene = "', f'scene = "{EXAMPLES}/'))
    assert main(["doctor", str(rig), "--folder", str(tmp_path)]) == 3
    told = capsys.readouterr().out
    assert "devices: camera files:/no/such/folder: there is no such folder" in told
    assert "clock:" in told


def test_the_demand_on_the_disk_follows_from_the_session(tmp_path, capsys):
    files = [str(EXAMPLES / name) for name in ("rig-sim.toml", "session.toml")]
    assert main(["doctor", *files, "--frames", "2", "--folder", str(tmp_path)]) in (0, 3)
    told = capsys.readouterr().out
    assert "the session needs" in told
    assert "every 16.7 ms" not in told


def test_necessary_changes_come_first():
    findings = [
        Finding(what="clock", found="-", advice="set it"),
        Finding(what="MTU", found="-"),
        Finding(what="loss", found="-", advice="mend the cable"),
        Finding(what="disk of /data", found="-", advice="another"),
        Finding(what="devices", found="-", advice="plug it in"),
        Finding(what="something else", found="-", advice="look"),
    ]
    order = [finding.what for finding in most_important_first(findings)]
    assert order == ["devices", "loss", "disk of /data", "clock", "something else"]


def test_lost_packets_are_reported_with_their_share(monkeypatch):
    camera = small_camera()
    monkeypatch.setattr(
        camera, "tally", lambda: FrameTally(accepted=20, packets=10000, packets_lost=50, packets_resent=49)
    )
    findings = camera_frames(camera, [0.1], camera.take_frame(timeout_s=1.0))
    loss = next(finding for finding in findings if finding.what == "loss")
    assert "0.5 % of 10000 packets lost, 49 of them came" in loss.found
    assert loss.advice is not None


def test_the_doctor_answers_on_the_command_line(tmp_path, capsys):
    status = main(["doctor", "--folder", str(tmp_path), "--json"])
    assert status in (0, 3)
    assert '"what": "clock"' in capsys.readouterr().out


def test_any_program_can_take_pictures_of_the_served_camera():
    with gige_port(), serve_rig_camera(ADDRESS, rig_path=None, lost_share=0.0) as stage_port:
        assert Path(stage_port).exists()
        with open_gige(ADDRESS) as camera:
            assert camera.take_frame(timeout_s=10.0).counts.shape == (582, 782)


def test_an_address_of_another_machine_cannot_be_served():
    served = serve_rig_camera("192.0.2.1", rig_path=None, lost_share=0.0)
    with gige_port(), pytest.raises(NotConnectedError, match=r"192\.0\.2\.1"), served:
        pass
