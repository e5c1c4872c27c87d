"""Makes one virtual environment for each independent client of rotation stages, and one for a camera of others.

    python tests/clients/make_venvs.py [FOLDER]

FOLDER is by default $RIGCTL_CLIENTS_DIR, or ~/.cache/rigctl/clients. All five take about 500 MB, most of it pylablib's.
Four of the clients are under the GPL: they run as programs of their own and are never imported by rigctl.
"""

import os
import subprocess
import sys
import venv
from pathlib import Path

PYLABLIB = "pylablib-lightweight==1.4.3 pyserial==3.5"

# Client -> (what pip installs, script that drives it, simulated stage that it drives).
CLIENTS = {
    "elliptec": ("elliptec==0.1.0", "elliptec_client.py", "sim:ellx?speed=5"),
    "thorlabs-elliptec": ("thorlabs-elliptec==1.3.0", "thorlabs_elliptec_client.py", "sim:ellx?speed=5"),
    "pylablib-elliptec": (PYLABLIB, "pylablib_elliptec_client.py", "sim:ellx?speed=5"),
    "pylablib-k10cr1": (PYLABLIB, "pylablib_kinesis_client.py", "sim:apt?speed=50"),
    "pylablib-kdc101": (PYLABLIB, "pylablib_kinesis_client.py", "sim:apt?model=KDC101&speed=50"),
    "thorlabs-apt-device": ("thorlabs-apt-device==0.3.8", "apt_device_client.py", "sim:apt?model=KDC101&speed=50"),
    "zaber-motion": ("zaber-motion==10.2.0", "zaber_motion_client.py", "sim:zaber?oneturn=1&speed=20"),
}

# A camera that others simulate, read by their own program: what pip installs, and the script that takes its frames.
CAMERA = ("pymmcore==12.5.1.75.0 mm-test-adapters==75.20261014.post1 numpy", "micro_manager_camera.py")


def default_folder() -> Path:
    """Where the environments are."""
    given = os.environ.get("RIGCTL_CLIENTS_DIR")
    return Path(given) if given else Path.home() / ".cache" / "rigctl" / "clients"


def python_of(requirement: str, folder: Path) -> Path:
    """The interpreter that has a client."""
    return folder / requirement.partition(" ")[0].replace("==", "-") / "bin" / "python"


def make(requirement: str, folder: Path) -> None:
    """Make one environment, unless it is there already."""
    python = python_of(requirement, folder)
    done = python.parent.parent / "installed"
    if done.exists():
        return
    venv.create(python.parent.parent, with_pip=True, clear=True)
    subprocess.run(
        [python, "-m", "pip", "install", "-q", "--disable-pip-version-check", *requirement.split()], check=True
    )
    done.touch()


def main(folder: Path) -> int:
    """Make all; return how many could not be made."""
    failed = 0
    for requirement in sorted({CAMERA[0], *(requirement for requirement, _, _ in CLIENTS.values())}):
        try:
            make(requirement, folder)
        except subprocess.CalledProcessError:
            sys.stderr.write(f"{requirement}: cannot be installed here\n")
            failed += 1
    return failed


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else default_folder()))
