"""A session killed at a random moment; the long version is `make trials`."""

import pytest

from benchmarks.trial_kills import killed_session, problems_of


@pytest.mark.parametrize("delay_s", [0.05, 0.9, 2.3])
def test_a_killed_session_leaves_only_whole_frames(tmp_path, delay_s):
    killed_session(tmp_path / "run", delay_s=delay_s)
    assert problems_of(tmp_path / "run") == []
