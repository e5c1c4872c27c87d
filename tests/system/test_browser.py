"""The page as people see it: in a browser on a desk and on a telephone that is touched."""

import os
import re
import shutil
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from rigctl.files.regions import RegionsFile
from rigctl.files.toml import load
from rigctl.rig.simulated_parts import turn_lens
from rigctl.session.take import take_session
from tests.rigctl.example_files import small_rig, small_rig_text, small_session
from tests.system.programs import RIGCTL, served

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(
    CHROMIUM is None and not os.environ.get("RIGCTL_REQUIRE_BROWSER"),
    reason="needs Debian's chromium and rigctl[browser]",
)
DESK = {"viewport": {"width": 1280, "height": 800}}
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True, "color_scheme": "dark"}
# A folder to keep a picture of each state in, for whoever wants to look.
PICTURES = os.environ.get("RIGCTL_BROWSER_PICTURES")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api", exc_type=ImportError)
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@contextmanager
def looking(browser: Any, address: str, device: dict[str, Any], *, allowed: tuple[str, ...] = ()) -> Iterator[Any]:
    """Open a page on a device; in the end it must have said no problem and loaded nothing from elsewhere.

    Problems of a network that was cut are `allowed`, by words of theirs.
    """
    problems: list[str] = []
    hosts: set[str] = set()
    context = browser.new_context(**device)
    tab = context.new_page()
    tab.set_default_timeout(60_000)
    tab.on("console", lambda message: problems.append(message.text))
    tab.on("pageerror", lambda error: problems.append(str(error)))
    tab.on("request", lambda request: hosts.add(urlsplit(request.url).netloc or "within the page"))
    tab.goto(address)
    yield tab
    assert [one for one in problems if not any(word in one for word in allowed)] == []
    assert hosts <= {urlsplit(address).netloc, "within the page"}
    context.close()


def until(tab: Any, is_so: Callable[[], bool]) -> None:
    """Wait; the page's policy lets no script be evaluated that could wait there."""
    deadline_s = time.monotonic() + 120.0
    while not is_so():
        assert time.monotonic() < deadline_s
        tab.wait_for_timeout(20)


def keep_picture(tab: Any, name: str) -> None:
    """Keep a picture of a page, where that is wanted; nothing sticks out, and a finger meets what it is to touch."""
    assert tab.evaluate("document.documentElement.scrollWidth") <= tab.viewport_size["width"], name
    small = "one => one.offsetParent && one.getBoundingClientRect().height < 43.5"
    assert (
        tab.evaluate(f"[...document.querySelectorAll('button, select, input, a')].filter({small}).map(one => one.id)")
        == []
    )
    if PICTURES:
        tab.screenshot(path=f"{PICTURES}/{name}.png", full_page=True)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("runs")
    # A name that is a script, where somebody forgets to escape it.
    run = folder / "run<img src=x onerror=alert(1)>"
    take_session(small_rig(folder), small_session(cycles=2), run, files={})
    with served("serve", str(run)) as told:
        yield told["look_url"]


@pytest.mark.parametrize(("name", "device"), [("desk", DESK), ("phone", PHONE)])
def test_a_finished_run_is_shown(browser: Any, finished: str, name: str, device: dict[str, Any]) -> None:
    with looking(browser, finished, device) as tab:
        tab.wait_for_selector("#aolp[data-sequence]")
        tab.wait_for_selector("#plot-dolp canvas")
        assert tab.inner_text("#state").startswith("finished")
        assert "onerror" in tab.inner_text("#run")
        assert "token" not in tab.url
        tab.click("#angles button[data-name='90']")
        assert tab.get_attribute("#angles button[data-name='90']", "aria-selected") == "true"
        keep_picture(tab, f"finished-{name}")


SESSION = """
name = "{name}"
[[take]]
kind = "dark"
exposure_ms = 0.03
cycles = 1
[[take]]
kind = "scene"
exposure_ms = 0.03
cycles = {cycles}
"""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rig")
    (folder / "rig.toml").write_text(small_rig_text(folder).replace("speed=20", "speed=200"))
    (folder / "short.toml").write_text(SESSION.format(name="short", cycles=1000))
    (folder / "runs").mkdir()
    return folder / "rig.toml"


@pytest.fixture(scope="module")
def hands(rig: Path) -> Iterator[str]:
    with served("serve", str(rig), "--sessions", str(rig.parent), "--runs", str(rig.parent / "runs")) as told:
        yield told["act_url"]


@contextmanager
def told_address(*words: str) -> Iterator[tuple[str, "subprocess.Popen[str]"]]:
    """Begin a command that says where its page is, and give the address."""
    words = (*RIGCTL, *words)
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            said = ""
            while (found := re.search(r"(http://\S+token=[\w-]+)[; ]", said)) is None:
                line = process.stderr.readline()
                assert line, said
                said += line.replace("\n", " ")
            yield found[1], process
        finally:
            process.terminate()


@pytest.mark.parametrize(("name", "device"), [("desk", DESK), ("phone", PHONE)])
def test_preview_is_the_page_at_its_camera_alone(browser: Any, rig: Path, name: str, device: dict[str, Any]) -> None:
    words = ("preview", str(rig), "--exposure-ms", "0.03", "--zoom", "2", "--listen", "127.0.0.1:0")
    with told_address(*words) as (address, _), looking(browser, address, device) as tab:
        tab.wait_for_selector("#focus[data-sequence]")
        tab.wait_for_selector("#view-histogram canvas")
        assert tab.inner_text("#run") == "preview rig.toml"
        assert [tab.input_value(one) for one in ("#exposure", "#gain", "#zoom")] == ["0.03", "0", "2"]
        assert "% saturated" in tab.inner_text("#rig-text")
        for other in ("#turn", "#region-add", "#plan", "#runs"):
            assert tab.is_hidden(other), other
        keep_picture(tab, f"preview-{name}")
        tab.fill("#zoom", "1")
        tab.press("#zoom", "Enter")
        until(tab, lambda: tab.get_attribute("#outlines", "data-width") == "96")
        tab.fill("#exposure", "")
        tab.press("#exposure", "Enter")
        until(tab, lambda: "(automatic)" in tab.inner_text("#rig-text"))


def drawn_at(tab: Any, *shares: tuple[float, float], by: str) -> None:
    """Set corners on the picture, at shares of its width and height."""
    tab.evaluate("scrollTo(0, 0)")
    box = tab.locator("#view").bounding_box()
    for x, y in shares:
        place = (box["x"] + x * box["width"], box["y"] + y * box["height"])
        if by == "finger":
            tab.touchscreen.tap(*place)
        else:
            tab.mouse.click(*place)


@pytest.mark.parametrize(("name", "device"), [("desk", DESK), ("phone", PHONE)])
def test_regions_are_drawn_on_the_page_at_a_picture_alone(
    browser: Any, tmp_path: Path, name: str, device: dict[str, Any]
) -> None:
    run, start, out = tmp_path / "run", tmp_path / "start.toml", tmp_path / "drawn.toml"
    take_session(small_rig(tmp_path), small_session(cycles=1), run, files={})
    place = "rectangle = { x = 70, y = 5, width = 9, height = 8 }"
    start.write_text(f'[[regions]]\nname = "old"\nedge_px = 1\n{place}\n[[regions]]\nname = "wrong"\n{place}\n')
    words = ("regions", "draw", str(run), "--start", str(start), "--out", str(out), "--no-browser")
    with told_address(*words) as (address, process), looking(browser, address, device, allowed=("ERR_",)) as tab:
        tab.wait_for_selector("#view[data-sequence]")
        for other in ("#exposure", "#turn", "#plan", "#runs", "#focus"):
            assert tab.is_hidden(other), other
        tab.click("[aria-label='remove wrong']")
        by = "finger" if name == "phone" else "mouse"
        drawn_at(tab, (0.25, 0.25), (0.5, 0.75), by=by)
        tab.fill("#region-name", "block")
        tab.click("#region-add")
        drawn_at(tab, (0.6, 0.5), (0.9, 0.5), (0.75, 0.9), by=by)
        tab.fill("#region-name", "wedge")
        tab.fill("#region-edge", "0")
        tab.click("#region-add")
        assert tab.inner_text("#run") == "draw regions on run"
        keep_picture(tab, f"regions-{name}")
        tab.click("#region-save")
        until(tab, lambda: tab.inner_text("#said") == "sent: drawn.toml is written. This page can be closed.")
        assert process.wait(60) == 0
        tab.wait_for_timeout(700)
        assert tab.is_hidden("#lost")
    old, block, wedge = load(out, RegionsFile).regions
    assert [(one.name, one.edge_px) for one in (old, block, wedge)] == [("old", 1), ("block", 2), ("wedge", 0)]
    assert block.rectangle is not None
    assert wedge.polygon is not None
    found = (block.rectangle.x, block.rectangle.y, block.rectangle.width, block.rectangle.height)
    # The picture has 96 x 48 pixels.
    assert found == pytest.approx((24, 12, 24, 24), abs=1)
    assert [x for x, _ in wedge.polygon] == pytest.approx([57.1, 85.9, 71.5], abs=0.5)


def test_the_lens_is_focused_by_the_number_on_a_telephone(browser: Any, hands: str, rig: Path) -> None:
    """Whoever turns the lens knows the page's number alone: coarse steps, and then finer ones about the best."""
    turn_lens(rig, defocus_mm=0.37)
    with looking(browser, hands, PHONE) as tab:
        tab.fill("#exposure", "0.03")
        tab.tap("[data-task=preview]")
        tab.wait_for_selector("#focus[data-sequence]")
        keep_picture(tab, "defocused-phone")

        def sharpness(defocus_mm: float) -> float:
            turn_lens(rig, defocus_mm=defocus_mm)
            # One picture may be on its way, and one in the camera, while the lens is turned.
            for _ in range(3):
                seen = tab.get_attribute("#focus", "data-sequence")
                until(tab, lambda seen=seen: tab.get_attribute("#focus", "data-sequence") != seen)
            return float(tab.inner_text("#sharpness-now"))

        best_mm, step_mm = 0.37, 0.3
        while step_mm > 0.005:
            best_mm = max((best_mm - step_mm, best_mm, best_mm + step_mm), key=sharpness)
            step_mm /= 2.0
        turn_lens(rig, defocus_mm=best_mm)
        # Within a blur of half a pixel of 8.3 um at f/2.
        assert abs(best_mm) < 0.0083
        keep_picture(tab, "focused-phone")
        tab.tap("[data-task=rest]")
        tab.wait_for_selector("#focus", state="hidden")


class Wire:
    """A network between a page and a browser: it can be cut, and it can swallow what is sent without a word."""

    def __init__(self, address: str) -> None:
        self._place = urlsplit(address)
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.address = address.replace(str(self._place.port), str(self._listening.getsockname()[1]))
        self._open: list[socket.socket] = []
        self._is_cut = False
        self._carries = threading.Event()
        self._carries.set()
        threading.Thread(target=self._accept, daemon=True).start()

    def swallow(self) -> None:
        self._carries.clear()

    def carry(self) -> None:
        self._carries.set()

    def cut(self) -> None:
        self._is_cut = True
        for one in self._open:
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)

    def mend(self) -> None:
        self._open, self._is_cut = [], False

    def close(self) -> None:
        self.cut()
        self._listening.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._listening.accept()
                if self._is_cut:
                    near.close()
                    continue
                far = socket.create_connection((self._place.hostname, self._place.port))
                self._open += [near, far]
                for here, there in ((near, far), (far, near)):
                    threading.Thread(target=self._carry, args=(here, there), daemon=True).start()

    def _carry(self, here: socket.socket, there: socket.socket) -> None:
        with suppress(OSError), here:
            while data := here.recv(65536):
                self._carries.wait()
                there.sendall(data)
            there.shutdown(socket.SHUT_WR)


@contextmanager
def rigctl(*words: str) -> Iterator["subprocess.Popen[bytes]"]:
    """Begin a command, and end it in the end."""
    with subprocess.Popen([*RIGCTL, *words], stderr=subprocess.DEVNULL) as process:
        yield process
        process.kill()


def state(tab: Any, begin: str) -> None:
    """Wait for what the page says of the session."""
    until(tab, lambda: tab.inner_text("#state").startswith(begin))


def test_a_session_is_watched_from_begin_to_end_through_all_that_can_happen(
    browser: Any, rig: Path, tmp_path: Path
) -> None:
    (tmp_path / "long.toml").write_text(SESSION.format(name="long", cycles=8))
    run = tmp_path / "run"
    with served("serve", str(run)) as told, ExitStack() as ends:
        wire = Wire(told["look_url"])
        ends.callback(wire.close)
        desk = ends.enter_context(looking(browser, told["look_url"], DESK))
        phone = ends.enter_context(looking(browser, wire.address, PHONE, allowed=("ERR_", "WebSocket")))

        def seen(begin: str, name: str) -> None:
            for tab, device in ((desk, "desk"), (phone, "phone")):
                state(tab, begin)
                keep_picture(tab, f"{name}-{device}")

        seen("waiting", "waiting")
        session = ends.enter_context(rigctl("acquire", str(rig), str(tmp_path / "long.toml"), "--out", str(run)))
        manifest = run / "manifest.jsonl"
        until(desk, lambda: manifest.exists() and manifest.read_bytes().count(b"\n") > 9)
        # It may be quicker than a page that asks once a second.
        session.send_signal(signal.SIGSTOP)
        for tab in (desk, phone):
            tab.wait_for_selector("#aolp[data-sequence]")
        seen("live", "live")
        # A session that hangs: nothing has been written for a minute.
        for file in run.iterdir():
            os.utime(file, (time.time() - 60.0,) * 2)
        seen("stale since", "stale")
        wire.swallow()
        phone.wait_for_selector("#lost:not([hidden])")
        wire.carry()
        phone.wait_for_selector("#lost", state="hidden")
        wire.cut()
        phone.wait_for_selector("#lost:not([hidden])")
        assert "Nothing heard since" in phone.inner_text("#lost")
        keep_picture(phone, "cut-phone")
        session.kill()
        session.wait()
        state(desk, "interrupted since")
        # What the telephone shows is old, and it says so; then it comes back by itself.
        assert phone.inner_text("#state").startswith("stale since")
        wire.mend()
        phone.wait_for_selector("#lost", state="hidden")
        seen("interrupted since", "interrupted")
        assert f"Interrupted. Continue with rigctl resume {run}" in phone.inner_text("#advice")
        frames = int(phone.inner_text("#facts dd").split()[0])
        assert 0 < frames < 33
        ends.enter_context(rigctl("resume", str(run)))
        seen("finished since", "ended")
        assert phone.inner_text("#facts dd") == "33 of 33"
        assert "resume" in desk.inner_text("#events")


def press(tab: Any, selector: str) -> None:
    """Press with a finger on a telephone, with a mouse on a desk."""
    touches = tab.evaluate("navigator.maxTouchPoints > 0")
    (tab.tap if touches else tab.click)(selector)


@pytest.mark.parametrize(("name", "device"), [("desk", DESK), ("phone", PHONE)])
def test_a_session_is_started_answered_held_resumed_and_stopped(
    browser: Any, hands: str, name: str, device: dict[str, Any]
) -> None:
    with looking(browser, hands, device) as tab:
        tab.select_option("#session", "short.toml")
        press(tab, "#plan")
        until(tab, lambda: "4001 frames (1 dark, 0 flat, 4000 scene)" in tab.inner_text("#plan-text"))
        keep_picture(tab, f"plan-{name}")
        press(tab, "#start")
        for wanted in ("Cover the lens", "Point the camera"):
            until(tab, lambda wanted=wanted: tab.inner_text("#advice").startswith(wanted))
            assert tab.inner_text("#advice").endswith(". Press Continue.")
            keep_picture(tab, f"asked-{wanted.split()[0].lower()}-{name}")
            press(tab, "#resume")
        state(tab, "live")
        press(tab, "#hold")
        state(tab, "holding")
        keep_picture(tab, f"holding-{name}")
        press(tab, "#resume")
        state(tab, "live")
        press(tab, "#stop")
        press(tab, "#ask button[value=no]")
        press(tab, "#stop")
        press(tab, "#ask button[value=yes]")
        state(tab, "stopped")
        press(tab, "#back")
        tab.wait_for_selector("#rows img")
        assert "stopped" in tab.inner_text("#rows")
        keep_picture(tab, f"list-{name}")
        press(tab, "#rows a:has-text('calibrations')")
        tab.wait_for_selector("#calibrations")


@pytest.mark.parametrize(("name", "device"), [("desk", DESK), ("phone", PHONE)])
def test_regions_drawn_on_the_page_are_watched_by_the_next_session_and_the_page_outlives_its_server(
    browser: Any, tmp_path: Path, name: str, device: dict[str, Any]
) -> None:
    (tmp_path / "rig.toml").write_text(small_rig_text(tmp_path).replace("speed=20", "speed=200"))
    (tmp_path / "three.toml").write_text(SESSION.format(name="three", cycles=3).replace("dark", "scene"))
    runs = tmp_path / "new" / "runs"
    words = ("serve", str(tmp_path / "rig.toml"), "--sessions", str(tmp_path), "--runs", str(runs))
    with ExitStack() as ends:
        with served(*words) as told:
            tab = ends.enter_context(looking(browser, told["act_url"], device, allowed=("ERR_", "WebSocket", "401")))
            tab.wait_for_selector("#no-runs:not([hidden])")
            assert "Press Look" in tab.inner_text("#closed")
            assert tab.inner_text("#no-runs") == "No runs yet. Choose a session and press Start."
            press(tab, "[data-task=preview]")
            tab.wait_for_selector("#view[data-sequence]")
            above = (
                ("#view", "#rig .bar") if name == "phone" else ("#view", "#view-histogram", "#start", "#region-save")
            )
            for one in above:
                box = tab.locator(one).bounding_box()
                assert box["y"] + box["height"] <= tab.viewport_size["height"], f"{one} is below the fold"
            drawn_at(tab, (0.3, 0.3), (0.6, 0.7), by="finger" if name == "phone" else "mouse")
            tab.fill("#region-name", "mine")
            press(tab, "#region-add")
            press(tab, "#region-save")
            until(tab, lambda: tab.inner_text("#said") == "written: regions.toml")
        tab.wait_for_selector("#lost:not([hidden])")
        with served(*words) as again:
            assert again == told
            until(tab, lambda: "restarted" in tab.inner_text("#lost"))
            tab.select_option("#session", "three.toml")
            press(tab, "#start")
            until(tab, lambda: tab.inner_text("#advice").startswith("Point the camera"))
            press(tab, "#resume")
            state(tab, "finished")
            tab.wait_for_selector("#plot-dolp canvas")
            until(tab, lambda: "mine" in tab.inner_text("#plot-dolp"))
            keep_picture(tab, f"regions-watched-{name}")
        with served(*words, "--new-tokens") as other:
            assert other["act_url"] != told["act_url"]
            until(tab, lambda: "new tokens" in tab.inner_text("#lost"))
