"""A whole session over serial bytes and UDP packets, against the same session within one process."""

import numpy as np
import pytest

from drivers.errors import DeviceError
from rigctl.errors import ConfigError
from rigctl.files.rig_file import load_rig
from rigctl.files.session_file import SessionFile
from rigctl.rig.rig import open_rig
from rigctl.rig.simulated_parts import split_faults
from rigctl.runs.folder import read_run
from rigctl.session.take import resume_session, take_session
from sim_devices.cameras.gige_server import GigeFaults
from tests.rigctl.example_files import EXAMPLES, small_rig
from tests.sim_devices.cameras.gige_port import gige_port


def frames_of(address):
    """Turn the stage three times, and take a picture at each place."""
    rig_file = load_rig(EXAMPLES / "rig-sim.toml")
    rig_file = rig_file.model_copy(update={"camera": rig_file.camera.model_copy(update={"address": address})})
    with open_rig(rig_file, session_name="network") as rig:
        rig.stage.home()
        rig.camera.configure(exposure_s=30e-6, gain_db=0.0)
        frames = []
        for angle_deg in (0.0, 45.0, 90.0):
            rig.stage.move_to(angle_deg)
            frames.append(rig.camera.take_frame(timeout_s=10.0).counts)
        return rig.camera_identity, frames


def test_the_network_changes_nothing_but_the_noise():
    with gige_port():
        identity, far = frames_of("sim:gige?pixel_format=Mono12Packed")
    same_identity, near = frames_of("sim:gc780")
    assert identity.serial_number == same_identity.serial_number
    for one, other in zip(far, near, strict=True):
        # Noise below 100 DN a pixel: means of 4462 pixels differ by 100 sqrt(2 / 4462) = 2.1 DN at most; five sigma 11.
        np.testing.assert_allclose(block_means(one), block_means(other), atol=11.0)


def block_means(counts):
    return counts.reshape(6, 97, 17, 46).mean(axis=(1, 3))


@pytest.mark.parametrize("option", ["lost=1.5", "lost=much", "lost=-0.1", "die=1", "hang_s=-1", "hang=3&hang=4"])
def test_a_wrong_fault_is_refused_with_the_allowed_values(option):
    with pytest.raises(ConfigError, match=f"{option.split('=')[0]}=.*must be one"):
        split_faults(option)


def test_faults_are_for_the_simulation_and_the_rest_is_for_the_driver():
    faults, rest = split_faults("lost=0.01&pixel_format=Mono12&restart=9&off_s=2&trigger=free")
    assert faults == GigeFaults(lost_share=0.01, restart=9, off_s=2.0)
    assert rest == "pixel_format=Mono12&trigger=free"


@pytest.mark.slow
def test_a_resumed_part_of_a_run_has_new_noise(tmp_path):
    # In the dark nothing but noise tells one frame from another. The camera dies at its fifth picture, twice.
    rig_file = small_rig(tmp_path)
    address = "sim:gige?pixel_format=Mono12&die=5"
    rig_file = rig_file.model_copy(update={"camera": rig_file.camera.model_copy(update={"address": address})})
    session = SessionFile.model_validate(
        {
            "name": "dark",
            "take": [{"kind": "dark", "exposure_ms": 1, "cycles": 6}],
            "interlocks": {"gone": "stop", "identical": "off"},
        }
    )
    with gige_port():
        with pytest.raises(DeviceError):
            take_session(rig_file, session, tmp_path / "run", files={})
        assert resume_session(tmp_path / "run").is_finished
    run = read_run(tmp_path / "run")
    assert len(run.frames) == 6
    assert len({run.counts(record).tobytes() for record in run.frames}) == 6
