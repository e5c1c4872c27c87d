"""Cases of the monkey: a command line, and a workspace in which one thing is not as it should be."""

import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.monkey.mutations import WILD, damage_run, damaged_bytes, damaged_json, damaged_text

# Every command, with all the files that it can read. OUT is a name that is not there. The first ones take milliseconds.
_QUICK = """
sim lens rig.toml --defocus-mm nothing
note run cloud --at 14:10 --by me
note run bird --exclude 1,2-3 --by me
note run --include 1
bundle run --out OUT.zip --frames 1
archive index . --json
archive find . "frames>1" --json
archive health . --json
calibrate lens images/0.png --out OUT.json
calibrate list . --for run --json
calibrate history . --out OUT.png --json
calibrate pointing run --json
study scene.toml --out OUT --workers 1 --json
predict scene.toml --json
predict scene.toml
predict scene.toml --noise noise.json --json
predict scene.toml --uncertainty --noise noise.json --set noise.prnu=0.01
sweep scene.toml acquisition.exposure_ms=0.01:1:3 --json
sweep scene.toml acquisition.exposure_ms=0.01:1:2 sensor.f_number=2:4:2 --json
predict scene.toml --radiometric radiometric.json --snr first-order --json
predict scene.toml --write-truth OUT.toml
surface scene.toml
surface material.toml --json
surface --list --json
surface black-paint --sun-zenith-deg 50 --wavelength-nm 550 --shadowing smith --json
effects scene.toml --noise noise.json --tolerance 0.01 --json
plan rig.toml session.toml --at 2026-05-04T10:00Z --json
plan rig.toml session.toml --at 2026-05-04T10:00Z --until 2026-05-04T10:05Z --all
plan rig.toml session.toml --scene scene.toml --noise noise.json --frame 96x48
acquire rig.toml session.toml --out OUT --dry-run
acquire rig.toml session.toml --out OUT --dry-run --scene scene.toml --noise noise.json --target-dolp-sigma 0.05
paper --estimators --json
new OUT --simulated --no-input --json
new OUT --stage zaber:/dev/none --camera gige:192.0.2.1 --latitude-deg 43 --longitude-deg -77 --elevation-m 100
verify run
verify run --json
status run --contents
status run --contents --json
status run
status run --json
status run --log --last 5
status run --log --only frame --json
hold run
stop run
resume run --json
export run --to tiff --out OUT
export run --to hdf5 --out OUT.h5
export run --to zarr --out OUT.zarr
calibrate noise --emva data.txt --out OUT.json
calibrate noise --table table.csv --bit-depth 12 --out OUT.json --json
calibrate noise --folder levels --bit-depth 12 --exposure-unit us --out OUT.json --json
calibrate noise --run run --out OUT.json --json
calibrate axis run --reference-deg 0 --out OUT.json
calibrate axis scan --generator generator.csv --dolp 0.98 --out OUT.json --json
calibrate axis scan --reference-deg 20 --expect-offset-deg 31.7 --out OUT.json --write rig.toml
calibrate flat run --out OUT.npz --json
calibrate radiometric run --panel left --scene scene.toml --noise noise.json --out OUT.json --json
calibrate registration run --out OUT.json --json
calibrate doubling noise.json radiometric.json --json
regions mark run regions.toml --out OUT.toml
regions find run regions.toml --out OUT.toml --json
infer runs/panels scene.toml --most-steps 250 --out OUT --json
calibrate stage rig.toml session.toml --repeats 1
sim stage nothing --link OUT
import OUT images/0.png images/1.png images/2.png images/3.png --angles 0,45,90,135 --same-exposure --black-level-dn 64
import OUT images/0.png --mosaic 90,45,135,0 --exposure-s 0.01 --black-level-dn 64 --bit-depth 12 --max-frame-mb 1
import OUT images/ours.fits --angle-key POLANG --exposure-key EXPTIME --black-level-dn 64 --bit-depth 12
look images/0.png images/1.png images/2.png images/3.png --angles 0,45,90,135 --out OUT.png --json
preview rig.toml --frames 1 --picture OUT.jpg --exposure-ms 0.03
devices --json
"""
# They draw, or compute for a second.
_SLOW = """
stokes run --out OUT --regions regions.toml --noise noise.json --json
stokes run --out OUT --polarizer polarizer.json --correct throughput,dark-level
detect run --background left --target right --regions regions.toml --out OUT --json
detect run --background left --target right --scene scene.toml --noise noise.json --out OUT
acquire rig.toml session.toml --out OUT --clock 2026-05-04T10:00Z --noise noise.json
status run --page OUT.html --json
predict scene.toml --roc right,left --out OUT
predict roof.toml --json
sky roof.toml --json
effects roof.toml --json
tradeoff scene.toml --noise noise.json --tolerances 0.1,0.01 --json
tradeoff scene.toml --acquisition --target-dolp-sigma 0.01 --drift-percent-per-min 1 --settling-time-ms 10 --json
doctor rig.toml session.toml --json --frames 2
acquire rig.toml session.toml --out OUT --trace TRACE
"""
# They take several seconds.
_HEAVY = """
archive verify . --out OUT --workers 1 --json
archive stokes . --regions regions.toml --out OUT --workers 1 --json
archive compare . --scene scene.toml --where "frames>1" --out OUT --workers 1 --json
archive recalibrate . --scene scene.toml --polarizer polarizer.json --noise noise.json --out OUT --workers 1 --json
compare run --scene scene.toml --noise noise.json --out OUT --json
compare run --scene scene.toml --radiometric radiometric.json --alpha 0.01 --anonymous --out OUT
compare run --regions regions.toml --out OUT --json
paper --figure 9 --materials rough --digitised digitised.csv --json
demo --out OUT --seed -1
"""
# They serve until they are stopped: only with a mistake in them.
_SERVING = """
serve run --listen nowhere --json
serve run --listen 1:2:3
serve run --listen 127.0.0.1:0 --certificate none.pem --key none.pem
serve scene.toml
serve rig.toml --listen nowhere
serve nothing --runs none --json
doctor rig.toml --try-notices
doctor scene.toml --try-notices
regions draw run --out OUT.toml --port 99999999
regions draw none --out OUT.toml --no-browser
sim stage nothing --link OUT
sim camera nothing --rig rig.toml
sim camera 127.0.0.1?hang=x
"""
_IMAGES = ("images/0.png", "images/picture.tif", "images/ours.fits", "levels/dark_20us_0.png")
_PEOPLE = (
    "scene.toml", "session.toml", "rig.toml", "regions.toml", "material.toml", "data.txt", "roof.toml",
    "table.csv", "generator.csv", "digitised.csv",
)  # fmt: skip
_CALIBRATIONS = ("noise.json", "polarizer.json", "radiometric.json")
_RUNS = ("run", "run", "run", "scan")
_OPTIONS = ("--json", "--out", "--at", "--region", "--noise", "--tolerance", "--uncertainty", "--help", "--")


def _words(lines: str) -> tuple[list[str], ...]:
    return tuple(line.split() for line in lines.strip().splitlines())


QUICK, SLOW, HEAVY = _words(_QUICK), _words(_SLOW), _words(_HEAVY)
SERVING = (*_words(_SERVING), ["serve", "run", "--listen", "a" * 300 + ":80"])
_SLOW_EVERY, _HEAVY_EVERY = 12, 60


@dataclass(frozen=True, kw_only=True)
class Case:
    """A command line to be run in the workspace, and what was done to the workspace before."""

    arguments: list[str]
    done: str


class _Draws(random.Random):
    """A generator that knows whether commands of several seconds may be drawn."""

    is_patient = True


def make_case(seed: int, folder: Path, *, is_patient: bool = True) -> Case:
    """Return a case, once the workspace has been changed for it; whoever is not patient gets no command of seconds."""
    draws = _Draws(seed)
    draws.is_patient = is_patient
    kinds: tuple[Callable[[_Draws, Path], Case], ...] = (_line, _line, _people, _calibration, _run, _run, _image)
    return kinds[seed % len(kinds)](draws, folder)


def _drawn(draws: _Draws, reads: tuple[str, ...] = ()) -> list[str]:
    """Return a command line that reads one of these; mostly a quick one."""
    chance = draws.random()
    order = (SLOW, QUICK, HEAVY) if chance < 1 / _SLOW_EVERY else (QUICK, SLOW, HEAVY)
    if chance < 1 / _HEAVY_EVERY and draws.is_patient:
        order = (HEAVY, SLOW, QUICK)
    for lines in order:
        fit = [line for line in lines if not reads or any(word in reads for word in line)]
        if fit:
            return list(draws.choice(fit))
    raise ValueError(f"no command reads {', '.join(reads)}")


def _line(draws: _Draws, folder: Path) -> Case:
    """A command line with one word changed, lost, doubled or added."""
    words = _drawn(draws)
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


def _people(draws: _Draws, folder: Path) -> Case:
    # Of the last one only a command of several seconds reads.
    names = _PEOPLE if draws.is_patient else _PEOPLE[:-1]
    return _with_file(draws, folder, draws.choice(names), damaged_text)


def _calibration(draws: _Draws, folder: Path) -> Case:
    return _with_file(draws, folder, draws.choice(_CALIBRATIONS), damaged_json)


def _with_file(draws: _Draws, folder: Path, name: str, damage: Callable[[bytes, random.Random], bytes]) -> Case:
    path = folder / name
    path.write_bytes(damage(path.read_bytes(), draws))
    return Case(arguments=_drawn(draws, (name,)), done=f"{name} damaged")


def _run(draws: _Draws, folder: Path) -> Case:
    name = draws.choice(_RUNS)
    done = damage_run(folder / name, draws)
    return Case(arguments=_drawn(draws, (name,)), done=done)


def _image(draws: _Draws, folder: Path) -> Case:
    name = draws.choice(_IMAGES)
    path = folder / name
    path.write_bytes(damaged_bytes(path.read_bytes(), draws))
    if name.startswith("levels"):
        return Case(arguments=_drawn(draws, ("levels", "table.csv")), done=f"{name} damaged")
    words = ["import", "OUT", name, "--angles", "0", "--same-exposure", "--black-level-dn", "64"]
    return Case(arguments=[*words, "--bit-depth", "12"], done=f"{name} damaged")
