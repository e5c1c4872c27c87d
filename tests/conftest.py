"""Options of the whole test suite, and a home of its own: no test reads or writes what the user has kept."""

import os
import shutil
import tempfile
from pathlib import Path

import pytest

from tests.skipped_before import SkippedTests, add_options

_HOME = "RIGCTL_TEST_HOME"

# As the program asks for, before anything imports numpy: on matrices this small, threads wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def pytest_configure(config: pytest.Config) -> None:
    # The first process makes it; those that pytest-xdist starts, and the programs that tests start, find it.
    if _HOME not in os.environ:
        os.environ[_HOME] = tempfile.mkdtemp(prefix="rigctl-tests-")
        config.add_cleanup(lambda: shutil.rmtree(os.environ.pop(_HOME), ignore_errors=True))
        # The fonts that matplotlib has found are none of ours, and looking for them again takes seconds.
        cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        os.environ.setdefault("MPLCONFIGDIR", str(Path(cache) / "matplotlib"))
    home = Path(os.environ[_HOME])
    for name, folder in (("XDG_STATE_HOME", home / "state"), ("XDG_CACHE_HOME", home / "cache")):
        folder.mkdir(exist_ok=True)  # astropy warns of one that is not there
        os.environ[name] = str(folder)
    config.pluginmanager.register(SkippedTests(config))


def pytest_addoption(parser: pytest.Parser) -> None:
    add_options(parser)
    parser.addoption(
        "--stage",
        metavar="ADDRESS",
        help="hold the contract suite over this rotation stage: DRIVER:PORT, such as ellx:/dev/serial/by-id/..., with "
        "?address=1&tolerance_deg=0.05 and the like behind it; or sim:... It will be homed and turned all the way",
    )
    parser.addoption(
        "--camera",
        metavar="ADDRESS",
        help="hold the contract suite over this camera: gige:192.168.0.5, v4l2:/dev/video0?pixel_format=Y12 and the "
        "like. It is exposed for 2 to 500 ms at a gain of 0 dB",
    )
