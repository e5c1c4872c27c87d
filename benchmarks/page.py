"""Writes docs/benchmarks.md: runs the benchmarks and puts what each prints between its marks on the page.

Usage: python -m benchmarks.page [NAMES ...] [--make-peers] (`make bench`: all of them)

Every section says its command, the day, the machine, how busy that was and how long it took. What is text outside of
the marks is written by hand. Programs of others that are set beside ours have environments of their own:
``python -m benchmarks.page --make-peers`` makes them in $RIGCTL_PEERS_DIR or ~/.cache/rigctl/peers (1.5 GB); what is
not there is left out, and its section says so. pySCATMECH comes as C++ and takes some minutes to compile.
"""

import argparse
import os
import platform
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from tests.clients.make_venvs import make, python_of

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "benchmarks.md"
# Peer -> what pip installs for it.
PEERS = {
    "polanalyser": "polanalyser==3.0.0 numpy matplotlib opencv-contrib-python-headless",
    "emva1288": "emva1288==1.0.2 numpy<2 scipy<1.14",
    "pbrdf": "pySCATMECH==0.1.10 mitsuba==3.9.1 numpy",
}


@dataclass(frozen=True, kw_only=True)
class Section:
    """A benchmark of the page.

    Attributes
    ----------
    words : tuple of str
        After `python -m benchmarks.`.
    peer : str or None
        Whose Python is given as `--peer`, where it has been made.
    is_markdown : bool
        It prints lines of the page rather than text as it stands.
    """

    words: tuple[str, ...]
    peer: str | None = None
    is_markdown: bool = False

    @property
    def name(self) -> str:
        """Name of its marks."""
        return self.words[0]


SECTIONS = (
    Section(words=("command_time",), is_markdown=True),
    Section(words=("maps",), peer="polanalyser"),
    Section(words=("growth",), is_markdown=True),
    Section(words=("pbrdf_speed",), peer="pbrdf"),
    Section(words=("noise_calibration", "--frames", "400"), peer="emva1288"),
    Section(words=("gige_sustained",)),
    Section(words=("unpack",)),
    Section(words=("frame_overhead",)),
    Section(words=("page_pictures",)),
    Section(words=("rendering_effects",)),
    Section(words=("sky_solver",)),
    Section(words=("mie_speed",)),
    Section(words=("scene_speed",)),
    Section(words=("dolp_accuracy_time",)),
    Section(words=("roc_accuracy_time",)),
    Section(words=("effect_savings",)),
    Section(words=("hand_chosen",)),
)


def peers_folder() -> Path:
    """Where the environments of others are."""
    given = os.environ.get("RIGCTL_PEERS_DIR")
    return Path(given) if given else Path.home() / ".cache" / "rigctl" / "peers"


def peer_python(peer: str) -> Path | None:
    """Return the interpreter that has a peer; None where it has not been made."""
    python = python_of(PEERS[peer], peers_folder())
    return python if (python.parent.parent / "installed").exists() else None


def machine() -> str:
    """Return processor, how busy it is, and the versions that matter, in words."""
    found = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text()) if sys.platform == "linux" else None
    processor = found[1] if found else platform.processor() or platform.machine()
    return (
        f"{processor}, {os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} at the start, "
        f"Python {platform.python_version()}, numpy {version('numpy')}"
    )


def write_section(name: str, lines: Sequence[str]) -> None:
    """Put lines between the marks of a section of docs/benchmarks.md."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    text = PAGE.read_text(encoding="utf-8")
    if begin not in text or end not in text:
        raise ValueError(f"{PAGE}: has no {begin} ... {end}")
    content = "\n".join((begin, "", *lines, "", end))
    PAGE.write_text(re.sub(f"{begin}.*?{end}", lambda _: content, text, flags=re.DOTALL), encoding="utf-8")


def run(section: Section) -> int:
    """Run a benchmark and write its section; return its exit code."""
    words, shown = list(section.words), list(section.words)
    python = None if section.peer is None else peer_python(section.peer)
    if python is not None:
        words, shown = [*words, "--peer", str(python)], [*shown, "--peer", "DIR/bin/python"]
    facts, start_s = machine(), time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", f"benchmarks.{words[0]}", *words[1:]], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    took = f"{datetime.now(tz=UTC):%Y-%m-%d}, {facts}; it took {time.monotonic() - start_s:.0f} s"
    failed = "" if done.returncode == 0 else f" and ended with {done.returncode}"
    without = "" if section.peer is None or python is not None else f" {section.peer} was not there to be timed."
    lines = [f"`python -m benchmarks.{shlex.join(shown)}`, {took}{failed}.{without}", ""]
    output = done.stdout.rstrip().splitlines()
    write_section(section.name, [*lines, *(output if section.is_markdown else ["```text", *output, "```"])])
    print("\n".join((*lines, *output)), flush=True)
    return done.returncode


def main() -> int:
    """Run what was asked for; return 1 where a benchmark failed or missed its bar."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [section.name for section in SECTIONS]
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"Of {', '.join(names)}; all by default.")
    parser.add_argument("--make-peers", action="store_true", help="Make the environments of others, and stop.")
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.names) - set(names))
    if unknown:
        parser.error(f"there is no {', '.join(unknown)}; there are {', '.join(names)}")
    if arguments.make_peers:
        for requirement in PEERS.values():
            make(requirement, peers_folder())
        return 0
    wanted = [section for section in SECTIONS if not arguments.names or section.name in arguments.names]
    return max([run(section) for section in wanted]) and 1


if __name__ == "__main__":
    sys.exit(main())
