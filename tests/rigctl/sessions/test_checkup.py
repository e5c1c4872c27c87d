"""What the doctor finds, with the number that each advice hangs on."""

from pathlib import Path

import pytest

from drivers.cameras.gige import open_gige
from drivers.errors import NotConnectedError
from rigctl.cli import main
from rigctl.errors import DataError
from rigctl.sessions.device_checkup import camera_frames, interface_mtu
from rigctl.sessions.host_checkup import clock, disk, receive_buffer
from rigctl.sessions.serve_camera import serve_rig_camera
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


def test_a_disk_that_is_too_slow_is_said_so(tmp_path):
    assert disk(tmp_path, frame_bytes=1000, period_s=0.0).advice is not None


def test_a_folder_that_cannot_be_written_is_said_so():
    with pytest.raises(DataError, match="cannot be written"):
        disk(Path("/no/such/folder"), frame_bytes=10, period_s=1.0)


def test_the_clock_is_asked():
    finding = clock()
    assert (finding.advice is None) == finding.found.startswith("synchronised")


def test_the_way_to_oneself_is_wide():
    assert interface_mtu("127.0.0.1").advice is None


def test_pictures_are_timed():
    (finding,) = camera_frames(small_camera(), frames=3, timeout_s=1.0)
    assert finding.found.startswith("3 frames")


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
