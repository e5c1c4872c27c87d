"""The power of a simulated GigE camera goes and comes back when it is to, told by what was done to it."""

import queue
import threading

import pytest

from sim_devices.cameras.gige_server import FaultyPower, GigeFaults

TIMEOUT_S = 10.0


class Told:
    """What was done to the camera, in order."""

    def __init__(self, faults):
        self._done = queue.SimpleQueue()
        self.power = FaultyPower(
            faults,
            power_down=lambda: self._done.put("down"),
            power_up=lambda: self._done.put("up"),
            forget=lambda: self._done.put("forget"),
            cut=lambda: self._done.put("cut"),
        )

    def take(self, pictures):
        for _ in range(pictures):
            self.power.before_picture()
            self.power.after_picture()

    def next(self):
        return self._done.get(timeout=TIMEOUT_S)

    def is_all(self):
        return self._done.empty()


def test_it_dies_at_its_picture_and_stays_so():
    told = Told(GigeFaults(die=3))
    with told.power:
        told.take(2)
        assert told.is_all()
        told.take(2)  # one more is counted before the power goes
        # The picture itself is not sent, however slow the machine is to let the power go.
        assert [told.next(), told.next()] == ["cut", "down"]
    assert told.is_all()


def test_it_restarts_again_and_again():
    told = Told(GigeFaults(restart=2, off_s=0.0))
    with told.power:
        for _ in range(3):
            told.take(2)
            assert [told.next(), told.next(), told.next()] == ["cut", "down", "up"]
    assert told.is_all()


def test_it_forgets_after_its_picture_and_once():
    told = Told(GigeFaults(forget=2))
    with told.power:
        told.take(5)
    assert told.next() == "forget"
    assert told.is_all()


def test_a_hang_ends_where_nobody_serves_it_any_more():
    told = Told(GigeFaults(hang=1, hang_s=3600.0))
    with told.power:
        picture = threading.Thread(target=told.take, args=(1,))
        picture.start()
        assert picture.is_alive()
    picture.join(TIMEOUT_S)
    assert not picture.is_alive()


@pytest.mark.parametrize("pictures", [1, 50])
def test_without_faults_nothing_is_done(pictures):
    told = Told(GigeFaults())
    with told.power:
        told.take(pictures)
    assert told.is_all()
