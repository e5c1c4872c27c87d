"""Where a session stands, by its events."""

import pytest

from rigctl.runs.writer import RunWriter
from rigctl.session.status import state_of


@pytest.mark.parametrize(
    ("events", "state"),
    [
        ([], "interrupted"),
        (["homed"], "interrupted"),
        (["homed", "finished"], "finished"),
        (["homed", "finished", "camera tally"], "finished"),
        (["homed", "stopped", "camera tally"], "stopped"),
        (["homed", "stopped", "resumed", "homed", "interlock"], "interrupted"),
    ],
)
def test_without_a_process(tmp_path, events, state):
    with RunWriter.create(tmp_path / "run", {}) as writer:
        for name in events:
            writer.event(name)
    assert state_of(tmp_path / "run").state == state


@pytest.mark.parametrize(
    ("events", "state"),
    [
        (["homed"], "running"),
        (["homed", "hold", "interlock"], "holding"),
        (["homed", "hold", "go on"], "running"),
        (["homed", "hold", "devices opened again", "camera tally"], "running"),
        (["homed", "waiting"], "waiting"),
        (["homed", "waiting", "round"], "running"),
    ],
)
def test_while_a_process_writes(tmp_path, events, state):
    with RunWriter.create(tmp_path / "run", {}) as writer:
        for name in events:
            writer.event(name)
        assert state_of(tmp_path / "run").state == state
