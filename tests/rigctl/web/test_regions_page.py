"""The page on which regions are drawn, as a browser meets it."""

import json
import threading
from collections.abc import Iterator
from contextlib import closing
from http.client import HTTPConnection
from importlib.resources import files
from urllib.parse import urlsplit

import numpy as np
import pytest

from rigctl.errors import DataError
from rigctl.files.regions import Region
from rigctl.web.regions_page import RegionsPage

REGION = {"name": "panel", "edge_px": 2, "rectangle": {"x": 1, "y": 2, "width": 30, "height": 40}}


def page_of(drawn: list[Region]) -> RegionsPage:
    return RegionsPage(np.zeros((60, 80), dtype=np.uint8), drawn=drawn, title="draw regions", file="r.toml")


class Answer:
    """What `wait` gave, in another thread."""

    def __init__(self, page: RegionsPage) -> None:
        self.regions: list[str] = []
        self.thread = threading.Thread(target=self._wait, args=(page,))
        self.thread.start()

    def _wait(self, page: RegionsPage) -> None:
        self.regions = [region.name for region in page.wait(seconds=30.0).regions]


@pytest.fixture
def page() -> RegionsPage:
    return page_of([Region.model_validate(REGION)])


@pytest.fixture
def answer(page: RegionsPage) -> Iterator[Answer]:
    waiting = Answer(page)
    yield waiting
    if waiting.thread.is_alive():
        asked(page.address, "/api/regions", {"regions": [REGION]})
    waiting.thread.join(10.0)


def asked(address: str, path: str, content: object = None) -> tuple[int, bytes]:
    place = urlsplit(address)
    headers = {"Authorization": "Bearer " + place.query.removeprefix("token=")}
    with closing(HTTPConnection(place.hostname or "", place.port, timeout=10.0)) as connection:
        body = None if content is None else json.dumps(content)
        connection.request("GET" if content is None else "POST", path, body=body, headers=headers)
        with connection.getresponse() as response:
            return response.status, response.read()


def test_it_is_the_page_of_serve_with_a_picture_alone(page: RegionsPage, answer: Answer) -> None:
    assert asked(page.address, "/")[1] == files("rigctl").joinpath("data", "web", "index.html").read_bytes()
    state = json.loads(asked(page.address, "/api/state")[1])
    told = {name: state[name] for name in ("title", "acts", "drawn", "regions_file", "is_once", "runs")}
    assert told == {
        "title": "draw regions",
        "acts": ["regions"],
        "drawn": [REGION],
        "regions_file": "r.toml",
        "is_once": True,
        "runs": [],
    }
    assert (state["rig"]["width"], state["rig"]["height"]) == (80, 60)
    assert asked(page.address, "/api/task", {"kind": "preview"})[0] == 404


def test_regions_that_are_sent_end_the_wait(page: RegionsPage, answer: Answer) -> None:
    assert asked(page.address, "/api/regions", {"regions": [REGION]}) == (200, b'{"file":"r.toml"}')
    answer.thread.join(10.0)
    assert answer.regions == ["panel"]


def test_wrong_regions_are_refused_and_the_page_stays(page: RegionsPage, answer: Answer) -> None:
    status, text = asked(page.address, "/api/regions", {"regions": [REGION, REGION]})
    assert status == 409
    assert b"region names occur more than once: panel" in text
    assert answer.thread.is_alive()


def test_an_address_without_the_token_finds_nothing(page: RegionsPage, answer: Answer) -> None:
    root = page.address.replace("token=", "token=x")
    assert asked(root, "/")[0] == 401
    assert asked(root, "/api/regions", {"regions": [REGION]})[0] == 401
    assert answer.thread.is_alive()


def test_nobody_draws() -> None:
    with pytest.raises(DataError, match=r"no regions were sent from http://127.0.0.1:.* within 0.001"):
        page_of([]).wait(seconds=0.06)
