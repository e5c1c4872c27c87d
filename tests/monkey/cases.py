"""Cases of the monkey: a command line, and a workspace in which one thing is not as it should be."""

import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.monkey.mutations import WILD, damage_run, damaged_bytes, damaged_json, damaged_text

_IMPORT = ["--angles", "0,45,90,135", "--same-exposure", "--black-level-dn", "64", "--bit-depth", "12"]
_IMAGES = [f"images/{k}.png" for k in range(4)]
# What is tried, with the files that it reads. OUT is a name that is not there.
_READERS: dict[str, tuple[list[str], ...]] = {
    "scene.toml": (["predict", "scene.toml", "--json"], ["predict", "scene.toml"], ["surface", "scene.toml"]),
    "session.toml": (["plan", "rig.toml", "session.toml", "--at", "2026-05-04T10:00Z", "--json"],),
    "rig.toml": (["plan", "rig.toml", "session.toml", "--at", "2026-05-04T10:00Z", "--all"],),
    "regions.toml": (["stokes", "run", "--out", "OUT", "--regions", "regions.toml", "--json"],),
    "material.toml": (["surface", "material.toml", "--json"],),
    "data.txt": (["calibrate", "noise", "--emva", "data.txt", "--out", "OUT.json"],),
    "noise.json": (["predict", "scene.toml", "--noise", "noise.json", "--json"],),
    "polarizer.json": (["predict", "scene.toml", "--polarizer", "polarizer.json", "--json"],),
}
_OF_RUNS: tuple[list[str], ...] = (
    ["verify", "run", "--json"],
    ["verify", "run"],
    ["info", "run", "--json"],
    ["status", "run"],
    ["status", "run", "--json"],
    ["log", "run"],
    ["log", "run", "--json"],
    ["stokes", "run", "--out", "OUT", "--json"],
    ["stop", "run"],
)
_PLAIN: tuple[list[str], ...] = (
    *(line for lines in _READERS.values() for line in lines),
    *_OF_RUNS,
    ["dolp", "--json"],
    ["predict", "scene.toml", "--sweep", "acquisition.exposure_ms=0.01:1:3", "--json"],
    ["import", "OUT", *_IMAGES, *_IMPORT, "--json"],
    ["calibrate", "axis", "run", "--reference-deg", "0", "--out", "OUT.json"],
    ["plan", "rig.toml", "session.toml", "--at", "2026-05-04T10:00Z", "--until", "2026-05-04T10:05Z"],
)
_OPTIONS = ("--json", "--out", "--at", "--region", "--noise", "--sweep", "--tolerance", "--uncertainty", "--help", "--")


@dataclass(frozen=True, kw_only=True)
class Case:
    """A command line to be run in the workspace, and what was done to the workspace before."""

    arguments: list[str]
    done: str


def make_case(seed: int, folder: Path) -> Case:
    """Return a case, once the workspace has been changed for it."""
    draws = random.Random(seed)
    kinds: tuple[Callable[[random.Random, Path], Case], ...] = (_line, _line, _people, _calibration, _run, _run, _image)
    return kinds[seed % len(kinds)](draws, folder)


def _line(draws: random.Random, folder: Path) -> Case:
    """A command line with one word changed, lost, doubled or added."""
    words = list(draws.choice(_PLAIN))
    place, kind = draws.randrange(1, len(words) + 1), draws.randrange(4)
    if kind == 0 or place == len(words):
        words[place:place] = [draws.choice(_OPTIONS), draws.choice(WILD)]
    elif kind == 1:
        del words[place]
    elif kind == 2:
        words[place] = draws.choice((".", "run", "scene.toml", "noise.json", "images", "/dev/zero", "none.toml"))
    else:
        words[place] = draws.choice(WILD)
    return Case(arguments=words, done="command line")


def _people(draws: random.Random, folder: Path) -> Case:
    name = draws.choice(("scene.toml", "session.toml", "rig.toml", "regions.toml", "material.toml", "data.txt"))
    return _with_file(draws, folder, name, damaged_text)


def _calibration(draws: random.Random, folder: Path) -> Case:
    return _with_file(draws, folder, draws.choice(("noise.json", "polarizer.json")), damaged_json)


def _with_file(draws: random.Random, folder: Path, name: str, damage: Callable[[bytes, random.Random], bytes]) -> Case:
    path = folder / name
    path.write_bytes(damage(path.read_bytes(), draws))
    return Case(arguments=list(draws.choice(_READERS[name])), done=f"{name} damaged")


def _run(draws: random.Random, folder: Path) -> Case:
    done = damage_run(folder / "run", draws)
    return Case(arguments=list(draws.choice(_OF_RUNS)), done=done)


def _image(draws: random.Random, folder: Path) -> Case:
    name = draws.choice(("0.png", "picture.tif", "ours.fits"))
    path = folder / "images" / name
    path.write_bytes(damaged_bytes(path.read_bytes(), draws))
    words = ["import", "OUT", f"images/{name}", "--angles", "0", "--same-exposure", "--black-level-dn", "64"]
    return Case(arguments=[*words, "--bit-depth", "12"], done=f"{name} damaged")
