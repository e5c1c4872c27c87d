"""Who is let through to a page, request by request, without a network."""

import asyncio
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute

from rigctl.web.server import (
    MOST_BODY_BYTES,
    Access,
    Addresses,
    Guard,
    PageServer,
    Place,
    names_of_this_machine,
)

ACCESS = Access()
HOST = "127.0.0.1:8765"


async def _right(request: Any) -> PlainTextResponse:
    return PlainTextResponse(request.scope["state"]["right"])


async def _socket(socket: Any) -> None:
    await socket.accept()
    await socket.close()


APP = Starlette(routes=[Route("/api/x", _right, methods=["GET", "POST"]), WebSocketRoute("/ws", _socket)])


def answer(
    path: str = "/api/x", *, method: str = "GET", query: str = "", kind: str = "http", **headers: str
) -> tuple[int, dict[str, str], str]:
    """Return status, headers and text of the answer to one request; a socket that opens has the status 101."""
    given = {"host": HOST} | {name.replace("_", "-"): value for name, value in headers.items()}
    scope = {
        "type": kind,
        "http_version": "1.1",
        "method": method,
        "scheme": "http",
        "path": path,
        "raw_path": path.encode(),
        "query_string": query.encode(),
        "headers": [(name.encode(), value.encode()) for name, value in given.items()],
        "extensions": {"websocket.http.response": {}},
        "subprotocols": [],
    }
    sent: list[dict[str, Any]] = []

    async def receive() -> dict[str, Any]:
        return {"type": "websocket.connect"} if kind == "websocket" else {"type": "http.request", "body": b""}

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    guard = Guard(APP, ACCESS, hosts=names_of_this_machine("127.0.0.1"), port=8765, is_secure=False)
    asyncio.run(guard(scope, receive, send))
    start = sent[0]
    if start["type"] == "websocket.accept":
        return 101, {}, ""
    told = {name.decode(): value.decode() for name, value in start["headers"]}
    return start["status"], told, b"".join(message.get("body", b"") for message in sent[1:]).decode()


def cookie(token: str) -> str:
    return f"rigctl-8765={token}"


def test_nobody_looks_without_a_token() -> None:
    assert answer()[0] == 401
    assert answer(cookie=cookie("guessed"))[0] == 401
    assert answer(kind="websocket", path="/ws")[0] == 401


def test_the_token_of_the_address_becomes_a_cookie_that_no_script_reads() -> None:
    status, headers, _ = answer(query=f"token={ACCESS.look}")
    assert status == 303
    assert headers["location"] == "/api/x"
    assert {"HttpOnly", "SameSite=strict"} <= set(headers["set-cookie"].replace(";", " ").split())
    assert answer(cookie=cookie(ACCESS.look))[2] == "look"


def test_a_wrong_token_in_the_address_takes_no_cookie_away() -> None:
    status, headers, text = answer(query="token=garbage", cookie=cookie(ACCESS.act))
    assert (status, text, "set-cookie" in headers) == (200, "act", False)


@pytest.mark.parametrize("path", ["//evil.example/..", "///evil.example", "/\\evil.example"])
def test_a_token_leads_nobody_to_another_host(path: str) -> None:
    status, headers, _ = answer(path, query=f"token={ACCESS.look}")
    assert status == 303
    assert urlsplit(headers["location"]).netloc == ""
    assert headers["location"].startswith("/evil.example")


def test_the_two_tokens_give_two_rights() -> None:
    assert answer(cookie=cookie(ACCESS.look), method="POST")[0] == 403
    assert answer(cookie=cookie(ACCESS.act), method="POST")[0] == 200
    assert answer(authorization=f"Bearer {ACCESS.act}")[2] == "act"


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8765", "127.0.0.1.evil.example", "", "[", "localhost.evil"]
)
def test_a_name_that_is_not_this_machine_is_misdirected(host: str) -> None:
    assert answer(cookie=cookie(ACCESS.look), host=host)[0] == 421


@pytest.mark.parametrize("host", ["localhost:8765", "127.0.0.1:8765", "[::1]:8765", "LOCALHOST"])
def test_names_of_this_machine_are_answered(host: str) -> None:
    assert answer(cookie=cookie(ACCESS.look), host=host)[0] == 200


def test_a_foreign_page_neither_acts_nor_opens_a_socket() -> None:
    words = {"cookie": cookie(ACCESS.act), "origin": "http://evil.example"}
    assert answer(method="POST", **words)[0] == 403
    assert answer(kind="websocket", path="/ws", **words)[0] == 403
    assert answer(kind="websocket", path="/ws", cookie=cookie(ACCESS.look), origin=f"http://{HOST}")[0] == 101


@pytest.mark.parametrize("length", [str(MOST_BODY_BYTES + 1), "99999999999999999999", "-1", "many"])
def test_a_large_body_is_refused_before_it_is_read(length: str) -> None:
    assert answer(method="POST", cookie=cookie(ACCESS.act), content_length=length)[0] == 413


def test_a_body_of_no_stated_length_is_refused() -> None:
    assert answer(method="POST", cookie=cookie(ACCESS.act), transfer_encoding="chunked")[0] == 413


def test_every_answer_forbids_scripts_of_others() -> None:
    for headers in (answer()[1], answer(cookie=cookie(ACCESS.look))[1]):
        assert "script-src 'self'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"


def _addresses(folder: Path, **words: Any) -> Addresses:
    server = PageServer(APP, Place(), can_act=True, kept=folder / "tokens.json", **words)
    with server:
        return server.addresses


def test_tokens_and_port_outlive_a_server_for_this_user_alone(tmp_path: Path) -> None:
    first = _addresses(tmp_path)
    assert (tmp_path / "tokens.json").stat().st_mode & 0o777 == 0o600
    assert _addresses(tmp_path) == first
    assert _addresses(tmp_path, is_new=True).act_url != first.act_url
    kept = _addresses(tmp_path)
    (tmp_path / "tokens.json").chmod(0o644)  # others may have read it
    assert _addresses(tmp_path).act_url != kept.act_url
    (tmp_path / "tokens.json").write_text("no tokens")
    assert _addresses(tmp_path).act_url is not None
    assert _addresses(tmp_path / "nowhere").look_url


def test_a_look_link_keeps_what_it_asks_for() -> None:
    assert answer("/", query=f"token={ACCESS.look}&run=a%20b")[1]["location"] == "/?run=a+b"


def test_a_page_for_others_that_is_not_encrypted_is_doubtful(caplog: pytest.LogCaptureFixture) -> None:
    with PageServer(APP, Place(host="0.0.0.0"), can_act=False):
        assert "not encrypted" in caplog.text
