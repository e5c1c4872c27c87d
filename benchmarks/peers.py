"""Programs of others, each in an environment of its own: `python -m benchmarks.peers` makes them (1.5 GB, minutes).

They are kept in $RIGCTL_PEERS_DIR or ~/.cache/rigctl/peers. What has not been made is left out of the table.
"""

import os
import subprocess
from pathlib import Path

from tests.clients.make_venvs import make, python_of

NEEDS = {
    "polanalyser": "polanalyser==3.0.0 numpy matplotlib opencv-contrib-python-headless",
    "emva1288": "emva1288==1.0.2 numpy<2 scipy<1.14",
    "pbrdf": "pySCATMECH==0.1.10 mitsuba==3.9.1 numpy",
}


def _folder() -> Path:
    given = os.environ.get("RIGCTL_PEERS_DIR")
    return Path(given) if given else Path.home() / ".cache" / "rigctl" / "peers"


def peer_python(peer: str) -> Path | None:
    """Return the interpreter that has a peer; None where it has not been made."""
    python = python_of(NEEDS[peer], _folder())
    return python if (python.parent.parent / "installed").exists() else None


def answer(python: Path, program: str, *words: str) -> str:
    """Return what a program prints under a peer's interpreter."""
    done = subprocess.run(
        [str(python), "-W", "ignore", "-c", program, *words], check=True, stdout=subprocess.PIPE, text=True
    )
    return done.stdout


if __name__ == "__main__":
    for requirement in NEEDS.values():
        make(requirement, _folder())
