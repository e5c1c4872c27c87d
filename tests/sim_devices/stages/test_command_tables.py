"""docs/simulated-stages.md names the commands that the simulated stages know, and no others."""

import re
from pathlib import Path

import numpy as np

from sim_devices.stages.apt import MODELS, AptLanguage, AptOptions
from sim_devices.stages.drive import Drive
from sim_devices.stages.ellx import DATA_DIGITS, EllxLanguage, EllxOptions
from sim_devices.stages.options import StageOptions
from sim_devices.stages.zaber import ZaberLanguage, ZaberOptions

PAGE = Path(__file__).parents[3] / "docs" / "simulated-stages.md"


def named(section: str) -> set[str]:
    """What the first column of a section's table names."""
    text = PAGE.read_text(encoding="utf-8").split(f"## {section}\n")[1].split("\n## ")[0]
    cells = (line.split("|")[1] for line in text.splitlines() if line.startswith("| `"))
    return {name for cell in cells for name in re.findall(r"`(\w+)`", cell)}


def drive(options: StageOptions) -> Drive:
    return Drive(options, generator=np.random.default_rng(0))


def test_elliptec() -> None:
    understood = EllxLanguage(EllxOptions(), drive(EllxOptions())).understood
    assert named("Elliptec") == understood
    assert understood == DATA_DIGITS.keys()  # or the receiver would not know where a command ends


def test_apt() -> None:
    options = [AptOptions(model=model) for model in MODELS]
    understood = set[int]().union(*(AptLanguage(one, drive(one)).understood for one in options))
    assert {int(number, 16) for number in named("Thorlabs APT")} == understood


def test_zaber() -> None:
    assert named("Zaber") == ZaberLanguage(ZaberOptions(), drive(ZaberOptions())).understood
