"""Makes the pictures of the pages: `make pictures`. Needs Chromium and the extras browser and infer."""

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, sync_playwright

from rigctl.cli import main as rigctl

PICTURES = Path(__file__).parent / "pictures"
_WIDTH, _HEIGHT, _COLOURS = 1280, 900, 256

# Commands in their order, and the picture that each of them makes, if any.
_ROOF = "examples/rig-roof.toml examples/session-roof.toml --clock 2010-05-25T17:07:40Z"
_COMMANDS = {
    "demo --out demo": None,
    "calibrate noise --run demo/noise-run --out noise.json --plot photon-transfer.png": "photon-transfer.png",
    "stokes demo/run --regions demo/regions.toml --noise noise.json --out stokes": "stokes/pictures.png",
    "sky examples/scene-airborne.toml --out sky": "sky/sky.png",
    "effects examples/scene-airborne.toml --out effects": "effects/effects.png",
    "surface black-paint --sun-zenith-deg 50 --out surface": "surface/surface.png",
    "surface examples/measured-panel.csv --wavelength-nm 550 --out measured": "measured/hemisphere.png",
    "acquire examples/rig-sim.toml examples/session.toml --regions examples/regions.toml --out panels": None,
    f"acquire {_ROOF} --out noon": None,
    "infer noon examples/scene-roof.toml --input regions.asphalt.dhr --input regions.asphalt.slope_rms --out infer": (
        "infer/corner.png"
    ),
}
# Names of pictures that differ from those of their files.
_NAMES = {"pictures.png": "stokes.png", "hemisphere.png": "measured-surface.png", "corner.png": "infer.png"}


def main() -> None:
    """Run the commands, and take screenshots of a report and of a page of `rigctl serve`."""
    examples = Path(__file__).parents[1] / "examples"
    after = ("--out", "--plot", "--run", "--noise", "--regions")
    with tempfile.TemporaryDirectory() as made, sync_playwright() as playwright:
        for command, picture in _COMMANDS.items():
            words = [word.replace("examples/", f"{examples}/") for word in command.split()]
            words = [
                f"{made}/{word}"
                if (before in after and not word.startswith("/")) or word in ("demo/run", "noon")
                else word
                for before, word in zip(["", *words], words, strict=False)
            ]
            if rigctl(words) != 0:
                sys.exit(f"failed: rigctl {command}")
            if picture is not None:
                _keep(Path(made, picture), _NAMES.get(Path(picture).name, Path(picture).name))
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        _screenshot(browser, f"file://{made}/demo/report.html", "report.png", wait_for="img")
        serve = [sys.executable, "-m", "rigctl", "serve", f"{made}/panels", "--json"]
        with subprocess.Popen(serve, stdout=subprocess.PIPE, text=True) as server:
            try:
                address = json.loads(next(iter(server.stdout or ())))["look_url"]
                _screenshot(browser, address, "watching.png", wait_for="#plot-dolp canvas")
            finally:
                server.terminate()


def _screenshot(browser: Browser, address: str, name: str, *, wait_for: str) -> None:
    page = browser.new_page(viewport={"width": _WIDTH, "height": _HEIGHT})
    page.goto(address)
    page.wait_for_selector(wait_for)
    with tempfile.TemporaryDirectory() as made:
        page.screenshot(path=f"{made}/{name}")
        _keep(Path(made, name), name)


def _keep(picture: Path, name: str) -> None:
    """Store a picture with a palette, no larger than a page."""
    with Image.open(picture) as image:
        image.thumbnail((_WIDTH, _HEIGHT))
        image.convert("RGB").quantize(_COLOURS).save(PICTURES / name, optimize=True)
    print(PICTURES / name)


if __name__ == "__main__":
    main()
