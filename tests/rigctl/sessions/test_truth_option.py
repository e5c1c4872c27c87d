"""Where a simulated rig is asked to note what it truly did."""

import pytest

from rigctl.errors import ConfigError
from rigctl.sessions.truth_option import split_truth


def test_the_option_is_taken_off_the_address(tmp_path):
    address, log = split_truth(f"sim:gige?lost=0.1&truth={tmp_path / 'truth.jsonl'}&retakes=2")
    assert address == "sim:gige?lost=0.1&retakes=2"
    assert log is not None
    assert split_truth("sim:gc780") == ("sim:gc780", None)


@pytest.mark.parametrize("tail", ["truth=", "truth=a&truth=b", "truth=/no/such/folder/truth.jsonl"])
def test_a_truth_that_cannot_be_written_is_refused(tail):
    with pytest.raises(ConfigError, match="truth="):
        split_truth(f"sim:gc780?{tail}")
