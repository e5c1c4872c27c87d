"""The golden outputs that take minutes, as `python -m tests.golden --long` compares them."""

import os
import tempfile
from pathlib import Path
from unittest import mock

from tests.golden.run import run_chapters


def run_golden() -> bool:
    """Run all chapters; return whether each gives what is stored."""
    with tempfile.TemporaryDirectory(prefix="rigctl-golden-") as made:
        homes = {"XDG_STATE_HOME": made, "XDG_CACHE_HOME": made}
        with mock.patch.dict(os.environ, homes):
            return run_chapters((), Path(made), long=True)
