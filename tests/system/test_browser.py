"""The page as people see it: in a browser on a desk and on a telephone that is touched."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from rigctl.session.take_session import take_session
from rigctl.simulated.lens_position import turn_lens
from tests.rigctl.example_files import EXAMPLES, small_rig, small_session

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(
    CHROMIUM is None and not os.environ.get("RIGCTL_REQUIRE_BROWSER"),
    reason="needs Debian's chromium and rigctl[browser]",
)
DESK = {"viewport": {"width": 1280, "height": 900}}
PHONE = {"viewport": {"width": 360, "height": 740}, "has_touch": True, "is_mobile": True, "color_scheme": "dark"}
# A folder to keep a picture of each state in, for whoever wants to look.
PICTURES = os.environ.get("RIGCTL_BROWSER_PICTURES")


@contextmanager
def served(*words: str) -> Iterator[dict[str, str]]:
    """Serve a page by the command, and give its addresses."""
    with subprocess.Popen([sys.executable, "-m", "rigctl", *words, "--json"], stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            yield json.loads(process.stdout.readline())
        finally:
            process.terminate()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api", exc_type=ImportError)
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@contextmanager
def looking(browser: Any, address: str, device: dict[str, Any]) -> Iterator[Any]:
    """Open a page on a device; in the end it must have said no problem and loaded nothing from elsewhere."""
    problems: list[str] = []
    hosts: set[str] = set()
    context = browser.new_context(**device)
    tab = context.new_page()
    tab.set_default_timeout(30_000)
    tab.on("console", lambda message: problems.append(message.text))
    tab.on("pageerror", lambda error: problems.append(str(error)))
    tab.on("request", lambda request: hosts.add(urlsplit(request.url).netloc or "within the page"))
    tab.goto(address)
    yield tab
    assert problems == []
    assert hosts <= {urlsplit(address).netloc, "within the page"}
    context.close()


def until(tab: Any, is_so: Callable[[], bool]) -> None:
    """Wait; the page's policy lets no script be evaluated that could wait there."""
    deadline_s = time.monotonic() + 30.0
    while not is_so():
        assert time.monotonic() < deadline_s
        tab.wait_for_timeout(20)


def keep_picture(tab: Any, name: str) -> None:
    """Keep a picture of a page, where that is wanted; nothing of it may stick out to the right."""
    assert tab.evaluate("document.documentElement.scrollWidth") <= tab.viewport_size["width"], name
    if PICTURES:
        tab.screenshot(path=f"{PICTURES}/{name}.png", full_page=True)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("runs")
    take_session(small_rig(folder), small_session(cycles=2), folder / "run", files={})
    with served("watch", str(folder / "run")) as told:
        yield told["look_url"]


@pytest.mark.parametrize(("name", "device"), [("desk", DESK), ("phone", PHONE)])
def test_a_finished_run_is_shown(browser: Any, finished: str, name: str, device: dict[str, Any]) -> None:
    with looking(browser, finished, device) as tab:
        tab.wait_for_selector("#aolp[data-sequence]")
        tab.wait_for_selector("#plot-dolp canvas")
        assert tab.inner_text("#state").startswith("finished")
        assert "token" not in tab.url
        tab.click("#angles button[data-name='90']")
        assert tab.get_attribute("#angles button[data-name='90']", "aria-selected") == "true"
        keep_picture(tab, f"finished-{name}")


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rig")
    (folder / "rig.toml").write_text((EXAMPLES / "rig-sim.toml").read_text().replace("speed=20", "speed=200"))
    (folder / "scene-panels.toml").write_text((EXAMPLES / "scene-panels.toml").read_text())
    (folder / "runs").mkdir()
    return folder / "rig.toml"


@pytest.fixture(scope="module")
def hands(rig: Path) -> Iterator[str]:
    with served("serve", str(rig), "--sessions", str(rig.parent), "--runs", str(rig.parent / "runs")) as told:
        yield told["act_url"]


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
            seen = int(tab.get_attribute("#focus", "data-sequence"))
            # One picture may have been on its way while the lens was turned.
            until(tab, lambda: int(tab.get_attribute("#focus", "data-sequence")) > seen + 2)
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
