"""The page for drawing regions, and the file that is written."""

import json
import threading
from collections.abc import Iterator
from contextlib import closing
from http.client import HTTPConnection
from importlib.resources import files
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.errors import DataError
from rigctl.files.regions import Region, RegionsFile
from rigctl.files.toml import load
from rigctl.web.acts import RegionsPage, region_acts
from tests.rigctl.marked_pictures import panels

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
    waiting.thread.join(60.0)


def asked(address: str, path: str, content: object = None) -> tuple[int, bytes]:
    place = urlsplit(address)
    headers = {"Authorization": "Bearer " + place.query.removeprefix("token=")}
    with closing(HTTPConnection(place.hostname or "", place.port, timeout=60.0)) as connection:
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
    answer.thread.join(60.0)
    assert answer.regions == ["panel"]


def test_wrong_regions_are_refused_and_the_page_stays(page: RegionsPage, answer: Answer) -> None:
    status, text = asked(page.address, "/api/regions", {"regions": [REGION, REGION]})
    assert status == 409
    assert b"region names occur more than once: panel" in text
    assert answer.thread.is_alive()


def test_waiting_for_regions_ends_in_time() -> None:
    with pytest.raises(DataError, match=r"no regions were sent from http://127.0.0.1:.* within 0.001"):
        page_of([]).wait(seconds=0.06)


def write_regions(file: Path, body: bytes, picture: NDArray[np.uint16] | None) -> dict[str, str]:
    return region_acts(file, lambda: picture)["regions"]("", body)


BODY = b'{"regions": [{"name": "panel", "polygon": [[1, 1], [9, 1], [9, 9]]}]}'


def test_markers_of_the_live_picture_are_written_down_with_the_regions(tmp_path: Path) -> None:
    told = write_regions(tmp_path / "regions.toml", BODY, panels(markers={3: (60, 50), 7: (360, 260)}))
    assert told == {"file": "regions.toml"}
    written = load(tmp_path / "regions.toml", RegionsFile)
    assert [marker.id for marker in written.markers.seen] == [3, 7]


def test_an_existing_file_is_kept_and_wrong_regions_change_nothing(tmp_path: Path) -> None:
    file = tmp_path / "regions.toml"
    file.write_text("# by hand\n")
    for _ in range(3):
        write_regions(file, BODY, None)
    write_regions(file, BODY.replace(b"panel", b"other"), panels(markers={}))
    assert load(file, RegionsFile).markers is None
    kept = {path.name: path.read_text() for path in tmp_path.glob("regions.toml.bak*")}
    assert kept["regions.toml.bak"] == "# by hand\n"
    assert "panel" in kept["regions.toml.bak2"]
    assert len(kept) == 2
    with pytest.raises(DataError):
        write_regions(file, b'{"regions": [{"name": "<b>"}]}', None)
    assert "other" in file.read_text()
