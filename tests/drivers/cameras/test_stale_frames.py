"""The polarizer turns behind a camera that runs by itself: ten turns of the trial of a hundred."""

import pytest

from benchmarks.trial_stale_frames import driver_score, first_come_score, running_rig
from tests.sim_devices.cameras.gige_port import gige_port

BUSY_S = 0.3  # six pictures at 20 a second


@pytest.fixture
def stage():
    with gige_port(), running_rig(speed=20.0, width=64, height=48) as opened:
        yield opened


@pytest.mark.slow
def test_no_picture_of_the_old_angle_is_accepted(stage):
    score = driver_score(stage, turns=10, busy_s=BUSY_S)
    assert (score.turns, score.wrong) == (10, 0)


def test_whoever_takes_the_first_picture_takes_one_of_the_old_angle(stage):
    # So that the test above tests something.
    assert first_come_score(stage, turns=3, busy_s=BUSY_S).wrong == 3
