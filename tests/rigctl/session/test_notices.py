"""Notices of a session, and that nothing of them delays or fails it."""

import json
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import pytest

from rigctl.cli import main
from rigctl.files.rig_file import NotifySection, load_rig
from rigctl.runs.folder import read_run
from rigctl.session.control import Notifier, notice_of, notices, send
from rigctl.session.take import resume_session, take_session
from rigctl.verbs.verify import verification_of
from tests.rigctl.example_files import EXAMPLES, small_rig, small_rig_text, small_session


@pytest.fixture
def heard() -> Iterator[tuple[str, list[dict[str, str]]]]:
    """Give an address that takes notices, and those that it has taken."""
    taken: list[dict[str, str]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            taken.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *words: object) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/hook", taken
        server.shutdown()
        thread.join()


def test_the_end_of_a_session_gives_a_notice(tmp_path: Path, heard: tuple[str, list[dict[str, str]]]) -> None:
    address, taken = heard
    section = NotifySection(webhook=address)
    rig = small_rig(tmp_path).model_copy(update={"notify": section})
    assert take_session(rig, small_session(cycles=1), tmp_path / "run", files={}).is_finished
    assert [(one["run"], one["event"]) for one in taken] == [("run", "finished")]
    assert "frames: 6" in taken[0]["text"]


def test_an_error_that_ends_a_session_gives_a_notice(tmp_path: Path, heard: tuple[str, list[dict[str, str]]]) -> None:
    address, taken = heard
    with pytest.raises(ValueError, match="broken"), notices(NotifySection(webhook=address), tmp_path / "run"):
        raise ValueError("broken")
    assert taken[0]["event"] == "failed"
    assert "broken" in taken[0]["text"]


@pytest.fixture
def garbage() -> Iterator[str]:
    """Give the address of a server that answers something else than HTTP."""
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def answer() -> None:
            with suppress(OSError):
                while True:
                    one, _ = listening.accept()
                    with one:
                        one.recv(4096)
                        one.sendall(b"garbage\r\n\r\n")

        threading.Thread(target=answer, daemon=True).start()
        yield f"http://127.0.0.1:{listening.getsockname()[1]}/hook"


def test_a_webhook_that_does_not_speak_http_is_noted_and_silences_nothing(tmp_path: Path, garbage: str) -> None:
    heard = tmp_path / "heard"
    program = f"import json, sys; open({str(heard)!r}, 'a').write(json.load(sys.stdin)['event'] + ' ')"
    section = NotifySection(webhook=garbage, command=[sys.executable, "-c", program], events=["hold", "stopped"])
    noted: list[tuple[str, Any]] = []
    notifier = Notifier(section, "run")
    notifier.note = lambda event, **facts: noted.append((event, facts["notice"]))
    for event in ("hold", "stopped", "notice not sent"):
        notifier.tell(event, {})
    notifier.close()
    assert heard.read_text().split() == ["hold", "stopped"]
    assert noted == [("notice not sent", "hold"), ("notice not sent", "stopped")]
    with pytest.raises(ValueError, match="user and password"):
        NotifySection(webhook="http://user:pw@h/x")
    told = send(NotifySection(webhook="http://h:x/secret", command=["false", "secret"]), notice_of("run", "test", ""))
    assert told == ("webhook at h:x: the address is wrong", "command false: ended with exit code 1")


def test_a_run_keeps_no_address_of_notices_and_a_resume_finds_it_again(
    tmp_path: Path, heard: tuple[str, list[dict[str, str]]]
) -> None:
    address, taken = heard
    file, run = tmp_path / "rig.toml", tmp_path / "run"
    receivers = f'webhook = "{address}?secret"\ncommand = ["false", "secret"]\nevents = ["finished"]\n'
    file.write_text(f"{small_rig_text(tmp_path)}\n[notify]\n{receivers}")
    take_session(load_rig(file), small_session(), run, files={"rig": file})
    assert not [path for path in run.rglob("*") if path.is_file() and b"secret" in path.read_bytes()]
    assert verification_of(run).state == "whole"
    (run / read_run(run).frames[-1].file).unlink()
    assert resume_session(run).is_finished
    assert [notice["event"] for notice in taken] == ["finished", "finished"]


def test_a_receiver_that_never_answers_delays_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    goes_on, answered = threading.Event(), []
    monkeypatch.setattr("rigctl.session.control.send", lambda *_: answered.append(goes_on.wait(60.0)) or ())
    notifier = Notifier(NotifySection(command=["receiver"], timeout_s=0.1), "run")
    for _ in range(1000):
        notifier.tell("finished", {})
        assert answered == []
    notifier.close()
    assert answered == []
    goes_on.set()


def test_a_command_gets_the_notice_and_a_failure_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "told.json"
    program = f"import sys; open({str(out)!r}, 'w').write(sys.stdin.read())"
    base = (EXAMPLES / "rig-sim.toml").read_text().replace("scene-panels.toml", str(EXAMPLES / "scene-panels.toml"))
    rig = tmp_path / "rig.toml"
    rig.write_text(base + f"\n[notify]\ncommand = {json.dumps([sys.executable, '-c', program])}\n")
    assert main(["doctor", str(rig), "--try-notices"]) == 0
    assert json.loads(out.read_text())["event"] == "test"
    rig.write_text(base + '\n[notify]\ncommand = ["/no/such/program"]\n')
    assert main(["doctor", str(rig), "--try-notices"]) == 3
    assert "/no/such/program" in capsys.readouterr().out
    rig.write_text(base)
    assert main(["doctor", str(rig), "--try-notices"]) == 2
    rig.write_text(base + '\n[notify]\nwebhook = "file:///etc/passwd"\n')
    assert main(["doctor", str(rig), "--try-notices"]) == 2
