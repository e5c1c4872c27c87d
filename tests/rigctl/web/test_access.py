"""Access to a page, request by request, without a network."""

import asyncio
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import cv2
import numpy as np
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
    qr_text,
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


LOOKS, ACTS = {"cookie": cookie(ACCESS.look)}, {"cookie": cookie(ACCESS.act)}
SOCKET = {"kind": "websocket", "path": "/ws"}
FOREIGN = {"origin": "http://evil.example"}


@pytest.mark.parametrize(
    ("request_", "status"),
    [
        # without a valid token
        ({}, 401),
        ({"cookie": cookie("guessed")}, 401),
        (SOCKET, 401),
        # the token for looking does not act
        ({"method": "POST", **LOOKS}, 403),
        ({"method": "POST", **ACTS}, 200),
        # a page of others neither acts nor opens a socket
        ({"method": "POST", **ACTS, **FOREIGN}, 403),
        ({**SOCKET, **ACTS, **FOREIGN}, 403),
        ({**SOCKET, **LOOKS, "origin": f"http://{HOST}"}, 101),
        # a large body, or one of no stated length, is refused before it is read
        *(
            ({"method": "POST", **ACTS, "content_length": length}, 413)
            for length in (str(MOST_BODY_BYTES + 1), "99999999999999999999", "-1", "many")
        ),
        ({"method": "POST", **ACTS, "transfer_encoding": "chunked"}, 413),
        # names of this machine, and of others
        *(({**LOOKS, "host": host}, 200) for host in ("localhost:8765", "127.0.0.1:8765", "[::1]:8765", "LOCALHOST")),
        *(
            ({**LOOKS, "host": host}, 421)
            for host in ("evil.example", "evil.example:8765", "127.0.0.1.evil.example", "", "[", "localhost.evil")
        ),
    ],
)
def test_requests_are_answered_or_refused(request_: dict[str, str], status: int) -> None:
    assert answer(**request_)[0] == status


def test_the_token_of_the_address_becomes_a_cookie_that_no_script_reads() -> None:
    status, headers, _ = answer("/", query=f"token={ACCESS.look}&run=a%20b")
    assert (status, headers["location"]) == (303, "/?run=a+b")
    assert {"HttpOnly", "SameSite=strict"} <= set(headers["set-cookie"].replace(";", " ").split())
    assert answer(**LOOKS)[2] == "look"
    assert answer(authorization=f"Bearer {ACCESS.act}")[2] == "act"


def test_a_wrong_token_in_the_address_does_not_replace_the_cookie() -> None:
    status, headers, text = answer(query="token=garbage", **ACTS)
    assert (status, text, "set-cookie" in headers) == (200, "act", False)


@pytest.mark.parametrize("path", ["//evil.example/..", "///evil.example", "/\\evil.example"])
def test_a_token_redirects_to_no_other_host(path: str) -> None:
    status, headers, _ = answer(path, query=f"token={ACCESS.look}")
    assert (status, urlsplit(headers["location"]).netloc) == (303, "")
    assert headers["location"].startswith("/evil.example")


def test_every_answer_forbids_scripts_of_others() -> None:
    for headers in (answer()[1], answer(**LOOKS)[1]):
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


def test_a_page_for_others_that_is_not_encrypted_is_doubtful(caplog: pytest.LogCaptureFixture) -> None:
    with PageServer(APP, Place(host="0.0.0.0"), can_act=False):
        assert "not encrypted" in caplog.text


def read_back(text: str) -> str:
    """Return the text of a QR code that a terminal shows light on dark."""
    rows = [[c in halves for c in line] for line in text.split("\n") for halves in ("▀█", "▄█")]
    picture = np.pad((np.array(rows) * 255).astype(np.uint8), 4, constant_values=255)
    return cv2.QRCodeDetector().detectAndDecode(np.kron(picture, np.ones((8, 8), np.uint8)))[0]


@pytest.mark.parametrize(
    "address", ["http://10.0.0.7:8765/?token=zwabWfcelqs1POFMsnTPwADs", "https://[fd00::1]:1/?token=a"]
)
def test_a_phone_reads_the_address_from_its_qr_code(address: str) -> None:
    assert read_back(qr_text(address)) == address


def test_an_address_too_long_for_a_qr_code_is_refused() -> None:
    with pytest.raises(ValueError, match="too many"):
        qr_text("x" * 5000)
