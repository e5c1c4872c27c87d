"""The writer's thread: order, waiting, and failures that are not swallowed; a watcher costs no frame."""

import threading
import time
from contextlib import suppress

import numpy as np
import pytest

from rigctl.base.durable import DiskCalls
from rigctl.errors import RunFolderError
from rigctl.session import acquisition
from rigctl.session.acquisition import QUEUE_FRAMES, WriterThread
from rigctl.session.numbers import LiveNumbers
from rigctl.session.plan import plan_steps
from rigctl.session.status import read_status
from rigctl.session.take import Watch
from rigctl.session.timing import SessionClock
from tests.rigctl.example_files import small_session
from tests.rigctl.run_samples import make_record

_COUNTS = np.zeros((2, 2), dtype=np.uint16)
_PATIENCE_S = 30


def put_and_flush(thread, frames):
    with thread:
        for sequence in range(frames):
            thread.put((make_record(sequence), _COUNTS))
        thread.flush()


class Store:
    """A disk that notes what it stores; from the second frame on it does what a test says before."""

    def __init__(self, then=lambda: None):
        self.stored, self._then = [], then

    def __call__(self, frames):
        if self.stored:
            self._then()
        self.stored.append(frames[0][0].sequence)


def test_frames_are_stored_in_their_order_and_all_are_there_at_the_end():
    store = Store()
    put_and_flush(WriterThread(store), 50)
    assert store.stored == list(range(50))


def test_a_slow_disk_makes_the_session_wait_and_drops_nothing():
    gate, put = threading.Event(), []
    store = Store(lambda: gate.wait(_PATIENCE_S))

    def put_all():
        for sequence in range(10):
            thread.put((make_record(sequence), _COUNTS))
            put.append(sequence)

    with WriterThread(store) as thread:
        # One is stored, one is with the disk and the queue holds its frames; the next has to wait.
        waiter = threading.Thread(target=put_all)
        waiter.start()
        while not thread.is_full:
            pass
        assert len(put) <= QUEUE_FRAMES + 2
        gate.set()
        waiter.join(_PATIENCE_S)
    assert store.stored == list(range(10))


def test_a_failure_reaches_the_session_and_nothing_is_stored_after_it():
    def fail():
        raise OSError("no")

    store = Store(fail)
    thread = WriterThread(store)
    with pytest.raises(OSError, match="no"):
        put_and_flush(thread, 2)
    with pytest.raises(OSError, match="no"):
        thread.put((make_record(2), _COUNTS))
    assert store.stored == [0]


def test_after_an_error_of_the_session_taken_frames_are_still_stored():
    store = Store()

    def put_and_fail():
        with WriterThread(store) as thread:
            thread.put((make_record(0), _COUNTS))
            raise KeyError

    with pytest.raises(KeyError):
        put_and_fail()
    assert store.stored == [0]


def test_live_numbers_that_cannot_be_computed_stop_nothing(tmp_path, monkeypatch, caplog):
    def broken(_self):
        raise AttributeError("a fault of ours")

    monkeypatch.setattr(LiveNumbers, "content", broken)
    steps = plan_steps(small_session())
    with Watch(tmp_path, steps, title="small", clock=SessionClock(), live=LiveNumbers()) as watch:
        watch.begin(left=len(steps))
        for step in steps:
            watch.stored(step)
    assert read_status(tmp_path).frames == len(steps)
    assert caplog.text.count("no live numbers: AttributeError") == 1


@pytest.fixture
def goes_on():
    """When a disk that hangs goes on."""
    event = threading.Event()
    yield event
    event.set()


def hanging(goes_on):
    return Store(lambda: goes_on.wait(_PATIENCE_S))


@pytest.mark.parametrize("frames", [3, QUEUE_FRAMES + 3], ids=["while flushing", "while taking"])
def test_a_disk_that_hangs_ends_the_session_in_time(goes_on, frames, monkeypatch):
    told = []
    monkeypatch.setattr(acquisition, "warn", told.append)
    thread = WriterThread(hanging(goes_on), disk=DiskCalls(stalled_s=0.3))
    with pytest.raises(RunFolderError, match="the disk hangs"):
        put_and_flush(thread, frames)
    assert thread.is_stalled
    assert len(told) <= 1


def test_a_hanging_disk_is_reported_even_if_the_session_itself_is_blocked(goes_on, monkeypatch):
    told = threading.Event()
    monkeypatch.setattr(acquisition, "warn", lambda text: told.set())
    with suppress(RunFolderError), WriterThread(hanging(goes_on), disk=DiskCalls(stalled_s=0.1)) as thread:
        thread.put((make_record(0), _COUNTS))
        thread.put((make_record(1), _COUNTS))
        assert told.wait(_PATIENCE_S)  # the session does nothing more


@pytest.mark.parametrize(
    ("stalled_s", "last_sign_s"), [(5.0, lambda: 0.0), (0.2, time.monotonic)], ids=["a while", "a full disk"]
)
def test_a_disk_that_hangs_for_a_while_or_is_waited_for_costs_no_frame(goes_on, stalled_s, last_sign_s):
    threading.Timer(0.5, goes_on.set).start()
    store = hanging(goes_on)
    put_and_flush(WriterThread(store, disk=DiskCalls(stalled_s=stalled_s), last_sign_s=last_sign_s), 3)
    assert store.stored == [0, 1, 2]
