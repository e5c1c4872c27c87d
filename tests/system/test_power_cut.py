"""One simulated power cut; the long version is `make trials`."""

import pytest

from benchmarks.trials.loop_disk import why_not
from benchmarks.trials.power_cut import one_cut


def test_no_acknowledged_frame_is_lost_by_a_power_cut():
    reason = why_not()
    if reason is not None:
        pytest.skip(f"{reason}: run it as root where loop devices can be mounted")
    told, problems = one_cut(0.02, after_frames=3)
    assert problems == []
    assert told >= 3
