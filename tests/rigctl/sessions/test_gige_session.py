"""A whole session over serial bytes and UDP packets, against the same session within one process."""

import numpy as np
import pytest

from rigctl.errors import ConfigError
from rigctl.files.rig_file import load_rig
from rigctl.sessions.rig import open_rig
from tests.rigctl.example_files import EXAMPLES
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


@pytest.mark.parametrize("lost", ["1.5", "much", "-0.1"])
def test_a_share_that_is_none_is_refused(lost):
    with pytest.raises(ConfigError, match="lost"):
        frames_of(f"sim:gige?lost={lost}")
