"""The page on which regions are drawn, as a browser meets it."""

import json
import threading
from collections.abc import Iterator
from contextlib import closing
from http.client import HTTPConnection
from urllib.parse import urlsplit

import pytest

from rigctl.errors import DataError
from rigctl.files.regions import Region
from rigctl.web.region_page import RegionPage

REGION = {"name": "panel", "edge_px": 2, "rectangle": {"x": 1, "y": 2, "width": 30, "height": 40}}


class Answer:
    """What `wait` gave, in another thread."""

    def __init__(self, page: RegionPage) -> None:
        self.regions: list[str] = []
        self.thread = threading.Thread(target=self._wait, args=(page,))
        self.thread.start()

    def _wait(self, page: RegionPage) -> None:
        self.regions = [region.name for region in page.wait(seconds=30.0).regions]


@pytest.fixture
def page() -> RegionPage:
    return RegionPage(b"PNG", drawn=[Region.model_validate(REGION)], title="runs/panels")


@pytest.fixture
def answer(page: RegionPage) -> Iterator[Answer]:
    waiting = Answer(page)
    yield waiting
    if waiting.thread.is_alive():
        asked(page.address, "/regions", {"regions": [REGION]})
    waiting.thread.join(10.0)


def asked(address: str, path: str, content: object = None) -> tuple[int, bytes]:
    place = urlsplit(address)
    headers = {"Authorization": "Bearer " + place.query.removeprefix("token=")}
    with closing(HTTPConnection(place.hostname or "", place.port, timeout=10.0)) as connection:
        body = None if content is None else json.dumps(content)
        connection.request("GET" if content is None else "POST", path, body=body, headers=headers)
        with connection.getresponse() as response:
            return response.status, response.read()


def test_page_picture_and_known_regions_are_served(page: RegionPage, answer: Answer) -> None:
    assert b"<canvas" in asked(page.address, "/")[1]
    assert asked(page.address, "/picture.png")[1] == b"PNG"
    assert json.loads(asked(page.address, "/regions.json")[1]) == {"title": "runs/panels", "regions": [REGION]}


def test_regions_that_are_sent_end_the_wait(page: RegionPage, answer: Answer) -> None:
    assert asked(page.address, "/regions", {"regions": [REGION]}) == (200, b"saved")
    answer.thread.join(10.0)
    assert answer.regions == ["panel"]


def test_wrong_regions_are_refused_and_the_page_stays(page: RegionPage, answer: Answer) -> None:
    status, text = asked(page.address, "/regions", {"regions": [REGION, REGION]})
    assert status == 422
    assert b"region names occur more than once: panel" in text
    assert answer.thread.is_alive()


def test_an_address_without_the_token_finds_nothing(page: RegionPage, answer: Answer) -> None:
    root = page.address.replace("token=", "token=x")
    assert asked(root, "/")[0] == 401
    assert asked(root, "/regions", {"regions": [REGION]})[0] == 401
    assert answer.thread.is_alive()


def test_nobody_draws() -> None:
    with pytest.raises(DataError, match=r"no regions were sent from http://127.0.0.1:.* within 0.001"):
        RegionPage(b"", drawn=[], title="").wait(seconds=0.06)
