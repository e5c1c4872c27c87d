"""A rig worked over the network: devices, regions, and a session that runs in a process of its own."""

import json
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from tests.rigctl.example_files import EXAMPLES, SHORT_SESSION
from tests.system.programs import DEADLINE_S, served, wait_for


class Page:
    """The page as a program asks it."""

    def __init__(self, url: str) -> None:
        self._place = urlsplit(url)

    def ask(self, path: str, content: Any = None, *, method: str | None = None) -> tuple[int, Any]:
        method = method or ("GET" if content is None else "POST")
        body = content if isinstance(content, bytes) else None if content is None else json.dumps(content).encode()
        headers = {"Authorization": "Bearer " + self._place.query.removeprefix("token=")}
        with closing(HTTPConnection(self._place.hostname, self._place.port, timeout=DEADLINE_S)) as connection:
            connection.request(method, path, body=body, headers=headers)
            with connection.getresponse() as response:
                data = response.read()
                return response.status, json.loads(data) if data.startswith(b"{") else data

    def ask_raw(self, path: str, headers: dict[str, str], body: bytes) -> int:
        """Return the status of a post whose body does not come to its end."""
        token = self._place.query.removeprefix("token=")
        with closing(HTTPConnection(self._place.hostname, self._place.port, timeout=DEADLINE_S)) as connection:
            connection.putrequest("POST", path)
            for name, value in {"Authorization": f"Bearer {token}", **headers}.items():
                connection.putheader(name, value)
            connection.endheaders(body)
            with connection.getresponse() as response:
                return response.status

    def until(self, path: str, is_so: Callable[[Any], bool]) -> Any:
        deadline_s = time.monotonic() + DEADLINE_S
        while not is_so(answer := self.ask(path)[1]):
            assert time.monotonic() < deadline_s, answer
            time.sleep(0.05)
        return answer


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("serve")
    (folder / "rig.toml").write_text((EXAMPLES / "rig-sim.toml").read_text().replace("speed=20", "speed=200"))
    (folder / "scene-panels.toml").write_text((EXAMPLES / "scene-panels.toml").read_text())
    (folder / "short.toml").write_text(SHORT_SESSION)
    (folder / "runs").mkdir()
    return folder


@pytest.fixture(scope="module")
def pages(folder: Path) -> Iterator[tuple[Page, Page]]:
    words = ("serve", folder / "rig.toml", "--sessions", folder, "--runs", folder / "runs")
    with served(*words) as told:
        yield Page(told["act_url"]), Page(told["look_url"])


@pytest.fixture
def act(pages: tuple[Page, Page]) -> Page:
    return pages[0]


def test_the_looking_token_does_not_act(pages: tuple[Page, Page]) -> None:
    for name in ("hold", "resume", "stop", "task", "turn", "dark", "plan", "start", "regions"):
        assert pages[1].ask(f"/api/{name}", {})[0] == 403


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("task", {"kind": "preview", "exposure_ms": -1}),
        ("task", {"kind": "dance"}),
        ("task", b"[" * 3000),
        ("task", b'{"kind": "preview", "gain_db": 1e999}'),
        ("turn", {"angle_deg": "x"}),
        ("plan", {"session": "../rig.toml"}),
        ("start", {"session": "none.toml"}),
        ("regions", {"regions": [{"name": "<b>", "polygon": [[0, 0], [1, 1], [2, 0]]}]}),
        ("hold?run=../x", {}),
    ],
)
def test_impossible_requests_are_refused_in_words(act: Page, name: str, content: Any) -> None:
    status, answer = act.ask(f"/api/{name}", content)
    assert status in (409, 422)
    assert answer["error"]


def test_a_body_of_a_hundred_megabytes_is_refused_and_the_page_still_answers(act: Page) -> None:
    assert act.ask("/api/regions", b"x" * 1_000_001)[0] == 413
    assert act.ask_raw("/api/regions", {"Content-Length": "100000000"}, b"") == 413
    assert act.ask_raw("/api/regions", {"Transfer-Encoding": "chunked"}, b"5\r\nhello\r\n") == 413
    assert act.ask_raw("/api/hold", {"Origin": "http://evil.example"}, b"") == 403
    assert act.ask("/api/state")[0] == 200


def test_devices_are_seen_live_and_given_back(act: Page) -> None:
    assert act.ask("/api/task", {"kind": "preview", "exposure_ms": 0.03})[0] == 200
    act.until("/api/state", lambda state: state["rig"]["sharpness"] > 0.0 or state["rig"]["problem"])
    assert act.ask("/api/task", {"kind": "polarimetry", "exposure_ms": 0.03})[0] == 200
    rig = act.until("/api/state", lambda state: state["rig"]["maps_sequence"] > 0 or state["rig"]["problem"])["rig"]
    assert rig["problem"] == ""
    # The exposure is the one that was asked for; the white panel takes 0.6 of the range.
    assert (rig["is_automatic"], rig["brightest"] > 0.2) == (False, True)
    assert act.ask("/api/dark", {})[0] == 200
    assert act.ask("/api/task", {"kind": "rest"})[0] == 200
    assert act.ask("/api/dark", {})[0] == 422


def test_a_session_is_planned_started_held_for_a_person_and_finished(act: Page, folder: Path) -> None:
    assert "5 frames (1 dark, 0 flat, 4 scene)" in act.ask("/api/plan", {"session": "short.toml"})[1]["plan"]
    status, answer = act.ask("/api/start", {"session": "short.toml"})
    assert status == 200
    of_run = f"?run={answer['run']}"
    act.until("/api/state", lambda state: any(row["run"] == answer["run"] for row in state["runs"]))
    for wanted in ("Cover the lens", "Point the camera"):
        state = act.until(f"/api/state{of_run}", lambda state, wanted=wanted: state["advice"].startswith(wanted))
        assert state["state"] == "holding"
        assert act.ask(f"/api/resume{of_run}", {})[0] == 200
    assert act.until(f"/api/state{of_run}", lambda state: state["state"] == "finished")["frames"] == 5
    assert act.ask(f"/api/hold{of_run}", {})[0] == 409
    # It ran in a process of its own, which prints its last line after the run folder is finished.
    log = folder / "runs" / f"{answer['run']}.log"
    wait_for(lambda: "5 frames" in log.read_text())
