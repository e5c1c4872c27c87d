"""The writer's thread: order, waiting, and failures that are not swallowed; who watches costs no frame."""

import threading
import time
from contextlib import suppress

import numpy as np
import pytest

from rigctl.base.durable import DiskCalls
from rigctl.errors import RunFolderError
from rigctl.session import acquisition as frame_store
from rigctl.session.acquisition import QUEUE_FRAMES, StoredFrame, WriterThread
from rigctl.session.numbers import LiveNumbers
from rigctl.session.plan import plan_steps
from rigctl.session.status import read_status
from rigctl.session.take import Watch
from rigctl.session.timing import SessionClock
from tests.rigctl.example_files import small_session
from tests.rigctl.run_samples import make_record

_COUNTS = np.zeros((2, 2), dtype=np.uint16)
_PATIENCE_S = 30


def made_frame(sequence):
    return StoredFrame(record=make_record(sequence), counts=_COUNTS)


def test_frames_are_stored_in_their_order_and_all_are_there_at_the_end():
    stored = []
    with WriterThread(lambda frames: stored.append(frames[0].record.sequence)) as thread:
        for k in range(50):
            thread.put(made_frame(k))
    assert stored == list(range(50))


def test_a_slow_disk_makes_the_session_wait_and_drops_nothing():
    stored, gate, put = [], threading.Event(), []

    def slow(frames):
        gate.wait(_PATIENCE_S)
        stored.append(frames[0].record.sequence)

    with WriterThread(slow) as thread:
        # One is with the disk and the queue holds its frames; the next has to wait.
        waiter = threading.Thread(target=lambda: [put.append(thread.put(made_frame(k))) for k in range(10)])
        waiter.start()
        while not thread.is_full:
            pass
        assert QUEUE_FRAMES <= len(put) <= QUEUE_FRAMES + 1
        gate.set()
        waiter.join(_PATIENCE_S)
    assert stored == list(range(10))


def test_a_failure_reaches_the_session_and_nothing_is_stored_after_it():
    stored = []

    def failing(frames):
        if frames[0].record.sequence == 1:
            raise OSError("no")
        stored.append(frames[0].record.sequence)

    thread = WriterThread(failing)
    with pytest.raises(OSError, match="no"):
        _put_and_flush(thread, 2)
    with pytest.raises(OSError, match="no"):
        thread.put(made_frame(2))
    assert stored == [0]


def _put_and_flush(thread, frames):
    with thread:
        for k in range(frames):
            thread.put(made_frame(k))
        thread.flush()


def test_an_error_of_the_session_still_stores_what_was_taken():
    stored = []
    with pytest.raises(KeyError):
        _put_and_fail(WriterThread(lambda frames: stored.append(frames[0].record.sequence)))
    assert stored == [0]


def _put_and_fail(thread):
    with thread:
        thread.put(made_frame(0))
        raise KeyError


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


class HangingStore:
    """A disk that takes one frame and then hangs, until a test lets it go on."""

    def __init__(self):
        self.goes_on, self.stored = threading.Event(), []

    def __call__(self, frames):
        if self.stored:
            assert self.goes_on.wait(_PATIENCE_S)
        self.stored.append(frames[0].record.sequence)


@pytest.fixture
def hanging():
    store = HangingStore()
    yield store
    store.goes_on.set()


@pytest.mark.parametrize("frames", [3, QUEUE_FRAMES + 3], ids=["while flushing", "while taking"])
def test_a_disk_that_hangs_ends_the_session_in_time(hanging, frames, monkeypatch):
    told = []
    monkeypatch.setattr(frame_store, "warn", told.append)
    start_s = time.monotonic()
    thread = WriterThread(hanging, disk=DiskCalls(stalled_s=0.3))

    def store_all():
        with thread:
            for k in range(frames):
                thread.put(made_frame(k))
            thread.flush()

    with pytest.raises(RunFolderError, match="the disk hangs"):
        store_all()
    assert time.monotonic() - start_s < _PATIENCE_S  # as long as the disk hangs here
    assert thread.is_stalled
    assert len(told) <= 1


def test_somebody_says_it_even_where_the_session_itself_is_held(hanging, monkeypatch):
    told = threading.Event()
    monkeypatch.setattr(frame_store, "warn", lambda text: told.set())
    with suppress(RunFolderError), WriterThread(hanging, disk=DiskCalls(stalled_s=0.1)) as thread:
        thread.put(made_frame(0))
        thread.put(made_frame(1))
        assert told.wait(_PATIENCE_S)  # the session does nothing more


def test_a_disk_that_hangs_for_a_while_costs_no_frame(hanging):
    threading.Timer(0.2, hanging.goes_on.set).start()
    with WriterThread(hanging, disk=DiskCalls(stalled_s=5.0)) as thread:
        for k in range(3):
            thread.put(made_frame(k))
    assert hanging.stored == [0, 1, 2]


def test_waiting_for_a_full_disk_is_no_hanging(hanging):
    threading.Timer(0.5, hanging.goes_on.set).start()
    with WriterThread(hanging, disk=DiskCalls(stalled_s=0.2), last_sign_s=time.monotonic) as thread:
        for k in range(3):
            thread.put(made_frame(k))
        thread.flush()
    assert hanging.stored == [0, 1, 2]
