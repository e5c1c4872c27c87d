"""Requests to a session: none overwrites another, and each is answered by an event."""

import itertools

import pytest

from rigctl.session.control import Control, ask
from tests.rigctl.session.made_rig import MadeWorld, events_of, take_watched

REQUESTS = ("hold", "continue", "stop")


def test_requests_of_one_moment_are_answered_in_their_order(tmp_path):
    for request in REQUESTS:
        ask(tmp_path, request)
    control = Control(tmp_path)
    assert control.is_stop_asked()
    assert [control.poll() for _ in range(4)] == [*REQUESTS, None]
    assert control.is_stop_asked()
    assert list((tmp_path / "requests").iterdir()) == []


def test_a_request_that_cannot_be_taken_away_is_answered_once(tmp_path, monkeypatch):
    ask(tmp_path, "hold")
    control = Control(tmp_path)
    monkeypatch.setattr("pathlib.Path.unlink", lambda *_, **__: (_ for _ in ()).throw(OSError(30, "read-only")))
    assert [control.poll(), control.poll()] == ["hold", None]


@pytest.mark.parametrize("order", list(itertools.permutations(REQUESTS)))
def test_each_request_of_a_session_is_answered_by_an_event(tmp_path, order):
    world = MadeWorld()

    def ask_all():
        if world.camera.taken == 3:
            world.time.wakes.clear()
            for request in order:
                ask(tmp_path / "run", request)

    world.time.wakes.append(ask_all)
    assert not take_watched(world, tmp_path).is_finished
    events = events_of(tmp_path / "run")
    assert [event["facts"]["request"] for event in events if event["event"] == "asked"] == list(order)
    assert "stopped" in [event["event"] for event in events]


def test_a_request_during_the_last_frame_is_answered_too(tmp_path):
    world = MadeWorld()

    def ask_hold():
        if world.camera.taken == 8:
            world.time.wakes.clear()
            ask(tmp_path / "run", "hold")

    world.time.wakes.append(ask_hold)
    outcome = take_watched(world, tmp_path)
    assert (outcome.frames, outcome.is_finished) == (8, True)
    asked = [event["facts"] for event in events_of(tmp_path / "run") if event["event"] == "asked"]
    assert asked == [{"request": "hold", "answer": "the session has finished"}]
