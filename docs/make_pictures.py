"""Makes the pictures of the pages from the program itself: `make pictures`. Screenshots need Chromium."""

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

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
    f"acquire {_ROOF} --out noon": None,
    "infer noon examples/scene-roof.toml --input regions.asphalt.dhr --input regions.asphalt.slope_rms --out infer": (
        "infer/corner.png"
    ),
}
# Names of pictures that differ from those of their files.
_NAMES = {"pictures.png": "stokes.png", "hemisphere.png": "measured-surface.png", "corner.png": "infer.png"}


def main() -> None:
    """Run the commands, and take screenshots of a report and of a page of `rigctl serve`."""
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        sys.exit("needs Chromium: apt-get install chromium")
    examples = Path(__file__).parents[1] / "examples"
    with tempfile.TemporaryDirectory() as made:
        for command, picture in _COMMANDS.items():
            words = [word.replace("examples/", f"{examples}/") for word in command.split()]
            after = ("--out", "--plot", "--run", "--noise", "--regions")
            words = [
                f"{made}/{word}" if before in after or word in ("demo/run", "noon") else word
                for before, word in zip(["", *words], words, strict=False)
            ]
            if rigctl(words) != 0:
                sys.exit(f"failed: rigctl {command}")
            if picture is not None:
                name = Path(picture).name
                _keep(Path(made, picture), _NAMES.get(name, name))
        _screenshot(browser, f"file://{made}/demo/report.html", "report.png")
        serve = [sys.executable, "-m", "rigctl", "serve", f"{made}/demo/run", "--json"]
        with subprocess.Popen(serve, stdout=subprocess.PIPE, text=True) as server:
            try:
                _screenshot(browser, json.loads(next(iter(server.stdout or ())))["look_url"], "watching.png")
            finally:
                server.terminate()


def _screenshot(browser: str, address: str, name: str) -> None:
    # The page of `serve` loads its pictures through a socket after it is complete.
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--timeout=20000"]
    with tempfile.TemporaryDirectory() as made:
        picture = Path(made, name)
        options += [f"--window-size={_WIDTH},{_HEIGHT}", f"--screenshot={picture}"]
        subprocess.run([browser, *options, address], check=True, capture_output=True)
        _keep(picture, name)


def _keep(picture: Path, name: str) -> None:
    """Store a picture with a palette, no larger than a page."""
    with Image.open(picture) as image:
        image.thumbnail((_WIDTH, _HEIGHT))
        image.convert("RGB").quantize(_COLOURS).save(PICTURES / name, optimize=True)
    print(PICTURES / name)


if __name__ == "__main__":
    main()
