"""A run watched over the network, as programs and people do it."""

import json
import re
from collections.abc import Iterator
from contextlib import ExitStack, closing
from http.client import HTTPConnection
from pathlib import Path
from socket import create_connection
from urllib.parse import urlsplit

import pytest
from websockets.sync.client import connect

from rigctl.cli import main
from rigctl.session.take import take_session
from tests.rigctl.example_files import small_rig, small_session
from tests.system.programs import served


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    take_session(small_rig(folder), small_session(cycles=2), folder / "run", files={})
    return folder


@pytest.fixture(scope="module")
def page(folder: Path) -> Iterator[str]:
    with served("serve", folder / "run") as told:
        assert told["act_url"] is None
        yield told["look_url"]


def asked(page: str, path: str, *, method: str = "GET", **headers: str) -> tuple[int, bytes]:
    place = urlsplit(page)
    token = place.query.removeprefix("token=")
    with closing(HTTPConnection(place.hostname, place.port, timeout=20)) as connection:
        connection.request(method, path, headers={"Authorization": f"Bearer {token}"} | headers)
        with connection.getresponse() as response:
            return response.status, response.read()


def test_state_and_frames_are_answered_by_their_contract_names(page: str) -> None:
    status, content = asked(page, "/api/state")
    state = json.loads(content)
    assert (status, state["state"], state["frames"], state["right"]) == (200, "finished", 10, "look")
    assert [one["name"] for one in state["newest"]] == ["0", "45", "90", "135", "dark"]
    assert asked(page, "/api/frame/45")[1].startswith(b"\xff\xd8")
    assert asked(page, "/api/frame/46")[0] == 404
    assert asked(page, "/api/frame/%2e%2e%2fsession.json")[0] == 404
    assert asked(page, "/api/hold", method="POST")[0] == 403


def test_all_that_the_page_loads_is_small_and_of_this_page(page: str) -> None:
    html = asked(page, "/")[1].decode()
    own = [one for one in re.findall(r'(?:src|href)="([^"#]+)"', html) if not one.startswith("data:")]
    assert {"watch.js", "rig.js", "style.css"} <= set(own)
    assert not [address for address in own if "//" in address]
    files = [asked(page, f"/{name}") for name in own]
    assert {status for status, _ in files} == {200}
    assert len(html) + sum(len(content) for _, content in files) < 400_000


def test_without_the_token_nothing_is_answered(page: str) -> None:
    for path in ("/", "/api/state", "/watch.js", "/api/frame/45"):
        assert asked(page, path, Authorization="Bearer guessed")[0] == 401
    assert asked(page, "/api/state", Host="evil.example")[0] == 421


def test_the_socket_answers_pictures_only_where_they_are_new(page: str) -> None:
    place = urlsplit(page)
    headers = {"Authorization": "Bearer " + place.query.removeprefix("token=")}
    with connect(f"ws://{place.netloc}/ws", additional_headers=headers, open_timeout=20) as socket:
        socket.send(json.dumps({"want": "picture", "name": "90"}))
        answer = socket.recv(timeout=20)
        length = int.from_bytes(answer[:4], "big")
        head = json.loads(answer[4 : 4 + length])
        assert answer[4 + length :].startswith(b"\xff\xd8")
        assert sum(head["histogram"]) == 96 * 48
        socket.send(json.dumps({"want": "picture", "name": "90", "after": head["sequence"]}))
        answer = socket.recv(timeout=20)
        assert len(answer) == 4 + int.from_bytes(answer[:4], "big")
        socket.send("[" * 900)
        with pytest.raises(Exception, match="1008"):
            socket.recv(timeout=20)


def test_the_page_answers_in_spite_of_hundreds_of_idle_connections(page: str) -> None:
    place = urlsplit(page)
    token = place.query.removeprefix("token=")
    socket_words = {"additional_headers": {"Authorization": f"Bearer {token}"}, "open_timeout": 20, "close_timeout": 1}
    with ExitStack() as open_ones:
        for number in range(200):
            one = open_ones.enter_context(create_connection((place.hostname, place.port), timeout=20))
            one.sendall(b"" if number % 2 else b"GET /api/state HTTP/1.1\r\nHost: 127.0.0.1\r\n")
        assert asked(page, "/api/state")[0] == 200
        for _ in range(40):
            newest = open_ones.enter_context(connect(f"ws://{place.netloc}/ws", **socket_words))
        newest.send(json.dumps({"want": "state"}))
        assert json.loads(newest.recv(timeout=20))["state"] == "finished"
        assert asked(page, "/api/state")[0] == 200


def test_a_place_where_nothing_can_be_is_refused(tmp_path: Path) -> None:
    for words in (
        [str(tmp_path / "no" / "run")],
        [str(tmp_path), "--listen", "nowhere"],
        [__file__],
        [str(tmp_path), "--runs", str(tmp_path)],
    ):
        assert main(["serve", *words]) == 2
