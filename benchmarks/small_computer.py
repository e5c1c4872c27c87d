"""What a small ARM computer at the rig needs: wheels for aarch64 and their size, and the memory of a session.

``python -m benchmarks.small_computer --wheels FOLDER`` resolves the dependencies and each extra for Linux on aarch64
with CPython 3.11 by pip, keeps the wheels in FOLDER and prints their sizes; exit 1 where a set cannot be resolved.
``--session`` takes sessions of a simulated GigE camera that runs in a process of its own, at two sizes of picture, and
prints the largest resident memory of `rigctl acquire`.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from benchmarks.gige_sustained import ADDRESS

ROOT = Path(__file__).parents[1]
PYTHON = "3.11"
# Debian 12 and Raspberry Pi OS of 2023 have glibc 2.36.
PLATFORMS = ("manylinux_2_28_aarch64", "manylinux_2_17_aarch64", "manylinux2014_aarch64")
SIZES = ((782, 582), (2448, 2048))
_MB, _KB_PER_MB = 1e6, 1024.0


def dependency_sets() -> dict[str, list[str]]:
    """Return what is to be resolved: acquisition alone, everything, and each extra, by name."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    extras = project["project"]["optional-dependencies"]
    everything = project["project"]["dependencies"]
    # The docs and dev extras are of those who change the program.
    wanted = {name: [*everything, *extra] for name, extra in extras.items() if name not in ("docs", "dev")}
    return {"acquisition": project["dependency-groups"]["acquisition"], "everything": everything} | wanted


def resolve(requirements: Sequence[str], folder: Path) -> tuple[list[Path], str]:
    """Return the wheels for the small computer, or what pip says where there are none."""
    folder.mkdir(parents=True, exist_ok=True)
    platforms = [word for one in PLATFORMS for word in ("--platform", one)]
    words = [sys.executable, "-m", "pip", "download", "--dest", str(folder), *platforms, "--python-version", PYTHON]
    words += ["--implementation", "cp", "--only-binary=:all:", "-c", str(ROOT / "constraints.txt"), *requirements]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
        return [], "; ".join(errors) or done.stderr[-300:]
    named = re.findall(r"(?:Saved|already downloaded) \S*?([^/\s]+\.whl)", done.stdout)
    return sorted({folder / name for name in named}), ""


def print_wheels(folder: Path) -> bool:
    """Print a row for each set; return whether all can be resolved."""
    good = True
    print(f"set           wheels  packed MB  unpacked MB   ({', '.join(PLATFORMS)}; CPython {PYTHON})")
    for name, requirements in dependency_sets().items():
        wheels, problem = resolve(requirements, folder)
        good &= not problem
        if problem:
            print(f"{name:<12}  {problem}")
            continue
        unpacked = sum(entry.file_size for wheel in wheels for entry in zipfile.ZipFile(wheel).infolist())
        packed = sum(wheel.stat().st_size for wheel in wheels)
        print(f"{name:<12} {len(wheels):7} {packed / _MB:10.0f} {unpacked / _MB:12.0f}", flush=True)
    return good


@contextmanager
def devices_served(width: int, height: int, link: Path) -> Iterator[None]:
    """Serve a simulated camera whose pictures cost nothing, and a stage, each in a process of its own."""
    serve = f"from benchmarks.gige_sustained import serve; serve({width}, {height})"
    stage = [sys.executable, "-m", "rigctl", "sim", "stage", "sim:ellx?speed=20", "--link", str(link)]
    with (
        subprocess.Popen([sys.executable, "-c", serve], stdout=subprocess.PIPE, cwd=ROOT) as camera,
        subprocess.Popen(stage, stderr=subprocess.PIPE) as turning,
    ):
        try:
            if not (camera.stdout and camera.stdout.readline() and turning.stderr and turning.stderr.readline()):
                raise SystemExit("camera or stage are not served")
            yield
        finally:
            camera.terminate()
            turning.terminate()


def session_mb(width: int, height: int, folder: Path, cycles: int) -> float:
    """Return the largest resident memory of a session with pictures of this size [MB]."""
    rig = (ROOT / "examples/rig-sim.toml").read_text().partition("# What the simulated")[0]
    rig = re.sub(r'^port = "[^"]*"', f'port = "{folder}/stage"', rig, flags=re.MULTILINE)
    (folder / "rig.toml").write_text(rig.replace("sim:gc780", f"gige:{ADDRESS}?pixel_format=Mono12"))
    # Without dark frames, before which a real rig asks for the lens to be covered.
    take = f'name = "memory"\n[[take]]\nkind = "scene"\nexposure_ms = 1.0\ncycles = {cycles}\n'
    (folder / "session.toml").write_text(take)
    with devices_served(width, height, folder / "stage"):
        words = ["acquire", str(folder / "rig.toml"), str(folder / "session.toml"), "--out", str(folder / "run")]
        process = os.posix_spawn(sys.executable, [sys.executable, "-m", "rigctl", *words], os.environ)
        _, status, usage = os.wait4(process, 0)
    if status:
        raise SystemExit(f"acquire ended with {os.waitstatus_to_exitcode(status)}")
    return usage.ru_maxrss / _KB_PER_MB


def print_sessions(cycles: int) -> None:
    """Print the largest memory at each size of picture."""
    for width, height in SIZES:
        with tempfile.TemporaryDirectory() as folder:
            peak_mb = session_mb(width, height, Path(folder), cycles)
        print(f"acquire, {4 * cycles} frames of {width} x {height}: at most {peak_mb:.0f} MB resident", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--wheels", type=Path)
    parser.add_argument("--session", action="store_true")
    parser.add_argument("--cycles", type=int, default=10)
    arguments = parser.parse_args()
    if arguments.session:
        print_sessions(arguments.cycles)
    raise SystemExit(0 if arguments.wheels is None or print_wheels(arguments.wheels) else 1)
