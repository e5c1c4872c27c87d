"""docs/simulated-stages.md names the commands that the simulated stages know, and no others."""

import re
from pathlib import Path

import numpy as np

from sim_devices.stages import apt as apt_address
from sim_devices.stages import ellx as ellx_address
from sim_devices.stages import zaber as zaber_address
from sim_devices.stages.apt import AptLanguage
from sim_devices.stages.drive import Drive
from sim_devices.stages.ellx import DATA_DIGITS, EllxLanguage
from sim_devices.stages.options import MotionOptions
from sim_devices.stages.zaber import ZaberLanguage

PAGE = Path(__file__).parents[3] / "docs" / "simulated-stages.md"


def named(section: str) -> set[str]:
    """What the first column of a section's table names."""
    text = PAGE.read_text(encoding="utf-8").split(f"## {section}\n")[1].split("\n## ")[0]
    cells = (line.split("|")[1] for line in text.splitlines() if line.startswith("| `"))
    return {name for cell in cells for name in re.findall(r"`(\w+)`", cell)}


def drive(motion: MotionOptions) -> Drive:
    return Drive(motion, counts_per_turn=143360.0, generator=np.random.default_rng(0))


def test_elliptec() -> None:
    options = ellx_address.parse_address("sim:ellx")
    understood = EllxLanguage(options, drive(options.motion)).understood
    assert named("Elliptec") == understood
    assert understood == DATA_DIGITS.keys()  # or the receiver would not know where a command ends


def test_apt() -> None:
    understood: set[int] = set()
    for model in apt_address.MODELS:
        options = apt_address.parse_address(f"sim:apt?model={model}")
        understood |= AptLanguage(options, drive(options.motion)).understood
    assert {int(number, 16) for number in named("Thorlabs APT")} == understood


def test_zaber() -> None:
    options = zaber_address.parse_address("sim:zaber")
    assert named("Zaber") == ZaberLanguage(options, drive(options.motion)).understood
