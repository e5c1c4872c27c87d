"""Make docs/pictures/report.png, the first screen of the demo's report: `make pictures`. Needs Chromium."""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from rigctl.cli import main as rigctl

PICTURE = Path(__file__).parent / "pictures" / "report.png"
WIDTH, HEIGHT = 1280, 900


def main() -> None:
    """Run the demo and take a picture of the top of its report."""
    browser = next(
        (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
    )
    if browser is None:
        sys.exit("needs Chromium: apt-get install chromium")
    with tempfile.TemporaryDirectory() as made:
        if rigctl(["demo", "--out", f"{made}/demo"]) != 0:
            sys.exit("the demo failed")
        options = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            f"--window-size={WIDTH},{HEIGHT}",
        ]
        page = f"file://{made}/demo/report.html"
        subprocess.run([browser, *options, f"--screenshot={PICTURE}", page], check=True, capture_output=True)
    print(PICTURE)


if __name__ == "__main__":
    main()
