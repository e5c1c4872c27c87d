"""Sessions killed at random moments and gone on with; the long version is `make trials`."""

import pytest

from benchmarks.trial_kills import killed_session, problems_after_resume, problems_of, undisturbed_run, write_files


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    files = write_files(tmp_path_factory.mktemp("undisturbed"))
    return files, undisturbed_run(files)


@pytest.mark.parametrize("delay_s", [0.05, 0.6, 1.4])
def test_a_killed_session_is_gone_on_with_until_it_is_the_undisturbed_one(tmp_path, undisturbed, delay_s):
    files, run = undisturbed
    killed_session(tmp_path / "run", files, delay_s=delay_s)
    assert problems_of(tmp_path / "run") == []
    assert problems_after_resume(tmp_path / "run", run) == []
