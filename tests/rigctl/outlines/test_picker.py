"""The page on which regions are drawn, as a browser meets it."""

import json
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator

import pytest

from rigctl.errors import DataError
from rigctl.files.regions import Region
from rigctl.outlines.picker import Picker

REGION = {"name": "panel", "edge_px": 2, "rectangle": {"x": 1, "y": 2, "width": 30, "height": 40}}


class Answer:
    """What `wait` gave, in another thread."""

    def __init__(self, picker: Picker) -> None:
        self.regions: list[str] = []
        self.thread = threading.Thread(target=self._wait, args=(picker,))
        self.thread.start()

    def _wait(self, picker: Picker) -> None:
        self.regions = [region.name for region in picker.wait(seconds=30.0).regions]


@pytest.fixture
def picker() -> Picker:
    return Picker(b"PNG", drawn=[Region.model_validate(REGION)], title="runs/panels")


@pytest.fixture
def answer(picker: Picker) -> Iterator[Answer]:
    waiting = Answer(picker)
    yield waiting
    if waiting.thread.is_alive():
        send(picker.address, {"regions": [REGION]})
    waiting.thread.join(10.0)


def send(address: str, content: object) -> tuple[int, str]:
    request = urllib.request.Request(address, data=json.dumps(content).encode(), method="POST")
    try:
        with urllib.request.urlopen(request, timeout=10.0) as reply:
            return reply.status, reply.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


def get(address: str) -> bytes:
    with urllib.request.urlopen(address, timeout=10.0) as reply:
        return bytes(reply.read())


def test_page_picture_and_known_regions_are_served(picker: Picker, answer: Answer) -> None:
    assert b"<canvas" in get(picker.address)
    assert get(picker.address + "picture.png") == b"PNG"
    assert json.loads(get(picker.address + "regions.json")) == {"title": "runs/panels", "regions": [REGION]}


def test_regions_that_are_sent_end_the_wait(picker: Picker, answer: Answer) -> None:
    assert send(picker.address, {"regions": [REGION]}) == (200, "saved")
    answer.thread.join(10.0)
    assert answer.regions == ["panel"]


def test_wrong_regions_are_refused_and_the_page_stays(picker: Picker, answer: Answer) -> None:
    status, text = send(picker.address, {"regions": [REGION, REGION]})
    assert status == 422
    assert "region names occur more than once: panel" in text
    assert answer.thread.is_alive()


def test_an_address_without_the_token_finds_nothing(picker: Picker, answer: Answer) -> None:
    root = picker.address.rsplit("/", 2)[0] + "/"
    with pytest.raises(urllib.error.HTTPError) as raised:
        get(root)
    raised.value.close()
    assert send(root, {"regions": [REGION]})[0] == 400
    assert answer.thread.is_alive()


def test_nobody_draws() -> None:
    seconds = iter([0.0, 61.0])
    with pytest.raises(DataError, match=r"no regions were sent from http://127.0.0.1:.* within 1 minutes"):
        Picker(b"", drawn=[], title="").wait(seconds=60.0, clock_s=lambda: next(seconds))
