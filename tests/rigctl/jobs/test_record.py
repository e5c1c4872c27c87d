"""A session's devices are written down, and replayed through the same drivers without them."""

import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

from drivers.cameras.replay import open_replay
from drivers.errors import DeviceError, LimitError, NotConnectedError
from drivers.recording import read_recording
from rigctl.base.numbers import wrapped
from rigctl.files.rig_file import load_rig
from rigctl.files.session_file import load_session
from rigctl.jobs.record import Recorder, record, replay_rig
from rigctl.runs.folder import Run, read_run
from rigctl.session.take import take_session
from rigctl.verbs.verify import verification_of
from sim_devices.clock import SimClock
from sim_devices.stages.replayed_device import ReplayedDevice, exchanges_of
from tests.rigctl.example_files import EXAMPLES, SHORT_SESSION, small_rig_text
from tests.rigctl.session.test_mosaic_session import mosaic_rig

SESSION = f"""{SHORT_SESSION}
[interlocks]
fault = "stop"
gone = "stop"
"""
DRIVERS = {
    "ellx": ('driver = "ellx"', "sim:ellx?speed=50"),
    "apt": ('driver = "apt"', "sim:apt?speed=50"),
    "zaber": ('driver = "zaber"', "sim:zaber?speed=50"),
}


def files(folder: Path, *, stage: str = "ellx", port: str | None = None) -> tuple[Path, Path]:
    """Write rig and session file of the small rig with a stage."""
    driver, simulated = DRIVERS[stage]
    text = small_rig_text(folder)
    text = text.replace('driver = "ellx"', driver)
    text = text.replace('port = "sim:ellx?speed=20"', f'port = "{port or simulated}"')
    text = text if stage == "ellx" else text.replace('address = "0"\n', "")
    (folder / "rig.toml").write_text(text)
    (folder / "session.toml").write_text(SESSION)
    return folder / "rig.toml", folder / "session.toml"


def replayed(folder: Path, recording: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Take the session out of a recording, with the files that are in it."""
    with zipfile.ZipFile(recording) as archive:
        archive.extractall(folder / "inside", ["rig.toml", "session.toml"])
    monkeypatch.chdir(recording.parent)
    rig, session = load_rig(folder / "inside" / "rig.toml"), load_session(folder / "inside" / "session.toml")
    assert not rig.is_simulated
    assert rig.simulation is None
    take_session(rig, session, folder / "replayed", files={})
    return read_run(folder / "replayed")


@pytest.mark.parametrize("stage", sorted(DRIVERS))
def test_the_same_bytes_and_frames_come_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str) -> None:
    rig, session = files(tmp_path, stage=stage)
    found = record(rig, session, out=tmp_path / "seen.rec")
    assert found.failure is None
    assert found.frames == 5
    assert found.line_bytes > 50
    recording = read_recording(tmp_path / "seen.rec")
    run = replayed(tmp_path, tmp_path / "seen.rec", monkeypatch)
    assert run.session.origin == "replay"
    assert verification_of(run.path).state == "whole"
    frames = [call.frame for call in recording.opened[0].calls if call.frame is not None]
    for record_again, frame in zip(run.frames, frames, strict=True):
        np.testing.assert_array_equal(run.counts(record_again), frame.counts)
        assert record_again.camera_frame == frame.sequence
    assert run.session.camera.serial_number == "sim-1"
    scenes = [one for one in run.frames if one.kind == "scene"]
    assert [one.polarizer_angle_target_deg for one in scenes] == [0.0, 90.0, 45.0, 135.0]
    for one in scenes:
        off_deg = (one.polarizer_angle_deg or 0.0) - (one.polarizer_angle_target_deg or 0.0)
        assert abs(wrapped(off_deg, turn=180.0)) < 0.06


def test_a_fault_is_recorded_and_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig, session = files(tmp_path, port="sim:ellx?speed=50&stall=2")
    found = record(rig, session, out=tmp_path / "fault.rec")
    assert found.failure is not None
    with pytest.raises(DeviceError) as raised:
        replayed(tmp_path, tmp_path / "fault.rec", monkeypatch)
    of_port = found.failure.partition(": ")[2].partition(": ")[2]
    assert of_port[-40:] in str(raised.value)


def test_a_camera_without_a_stage_is_recorded_and_a_sensor_beside_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mosaic_rig(tmp_path)
    (tmp_path / "session.toml").write_text(SESSION)
    ours, theirs = os.openpty()
    table = (
        f'[[monitors]]\nname = "air"\ndriver = "serial"\noptions = {{ port = "{os.ttyname(theirs)}", unit = "K" }}\n'
    )
    (tmp_path / "rig.toml").write_text((tmp_path / "rig.toml").read_text() + table)
    os.write(ours, b"1\n2\n3\n")
    found = record(tmp_path / "rig.toml", tmp_path / "session.toml", out=tmp_path / "seen.rec")
    assert found.failure is None
    assert found.frames == 2
    run = replayed(tmp_path, tmp_path / "seen.rec", monkeypatch)
    assert len(run.frames) == 8
    assert {one.exposure_id for one in run.frames} == {0, 4}
    os.close(ours)
    os.close(theirs)


def test_the_bytes_of_another_port_are_not_the_stages() -> None:
    recorder = Recorder()
    recorder.begin()
    recorder.hear(b"0in", port="/dev/stage", from_host=True)
    recorder.hear(b"20.5\n", port="/dev/air", from_host=False)
    recorder.hear(b"0IN", port="/dev/stage", from_host=False)
    assert [event.data for event in recorder.opened()[0].line] == [b"0in", b"0IN"]


def test_a_rig_for_the_replay_has_devices_only() -> None:
    text = (EXAMPLES / "rig-sim.toml").read_text() + '[notify]\nwebhook = "https://example.org/T0P"\n'
    told = replay_rig(text, "a.rec")
    assert 'port = "replay:a.rec"' in told
    assert 'address = "replay:a.rec"' in told
    assert "[polarizer]" in told
    assert "\n[simulation" not in told
    assert "T0P" not in told


def test_a_camera_gives_only_what_was_recorded(tmp_path: Path) -> None:
    rig, session = files(tmp_path)
    session.write_text(SESSION + "# ask jane.doe@example.org, https://example.org/T0P\n")
    record(rig, session, out=tmp_path / "seen.rec")
    with zipfile.ZipFile(tmp_path / "seen.rec") as archive:
        told = archive.read("rig.toml") + archive.read("session.toml")
    assert b"jane.doe" not in told
    assert b"T0P" not in told
    camera = open_replay(str(tmp_path / "seen.rec"))
    with pytest.raises(LimitError, match="were not recorded"):
        camera.configure(exposure_s=0.5, gain_db=0.0)
    settings = camera.configure(exposure_s=3e-5, gain_db=0.0)
    starts = []
    for number in range(5):
        frame = camera.take_frame(timeout_s=1.0)
        assert (frame.sequence, frame.settings) == (number, settings)
        starts.append(frame.start_monotonic_ns)
    assert starts == sorted(starts)
    with pytest.raises(NotConnectedError, match="no more pictures"):
        camera.take_frame(timeout_s=1.0)
    camera.close()
    with pytest.raises(NotConnectedError, match="was closed"):
        camera.identify()


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"nothing of the kind"])
def test_other_files_are_no_recordings(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.rec").write_bytes(content)
    with pytest.raises(LimitError, match="is no recording"):
        open_replay(str(tmp_path / "a.rec"))
    with pytest.raises(LimitError, match="is no recording"):
        read_recording(tmp_path / "missing.rec")


def test_a_line_answers_in_order_again_and_not_at_all() -> None:
    clock = SimClock(speed=1000.0)
    events = [
        (0.0, "host", b"a"),
        (0.1, "device", b"1"),
        (0.2, "host", b"p"),
        (0.3, "device", b"busy"),
        (0.4, "host", b"p"),
        (0.5, "device", b"idle"),
        (0.6, "host", b"z"),
        (0.7, "gone", b""),
    ]
    device = ReplayedDevice(exchanges_of(events), clock=clock)

    def said(request: bytes) -> bytes:
        device.receive(request)
        came, end_s = b"", clock.now_s() + 5.0
        while clock.now_s() < end_s and not came:
            came = device.transmit()
        return came

    assert [said(one) for one in (b"a", b"p", b"p", b"p")] == [b"1", b"busy", b"idle", b"idle"]
    assert said(b"q") == b""
    assert device.not_understood == [b"q"]
    assert said(b"a") == b"1"
    assert device.is_plugged_in()
    assert said(b"z") == b""
    assert not device.is_plugged_in()
