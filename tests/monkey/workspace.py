"""A folder with one small sound thing of every kind: scene, rig, session, regions, calibrations, run, images."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np

from rigctl.files.rig_file import load_rig
from rigctl.files.session_file import load_session
from rigctl.session.take import take_session
from rigctl.session.timing import SessionClock
from rigctl.verbs.calibrate import radiometric
from tests.rigctl.example_files import EXAMPLES, SMALL_SCENE
from tests.rigctl.made_runs import at, make_run

_SHAPE = (48, 96)
_ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
_NOISE = {
    "gain_dn_per_e": 0.24,
    "read_noise_e": 10.0,
    "dark_current_e_per_s": 20.0,
    "black_level_dn": 64.0,
    "saturation_e": 16000.0,
    "prnu": 0.005,
    "dsnu_e": 1.0,
}
_MADE_FOR = {"gain_db": 0.0, "bit_depth": 12, "taken_utc": "2026-05-04T10:00:00.000000000Z", "valid_days": 3650.0}
REGIONS = """
[[regions]]
name = "left"
rectangle = { x = 4, y = 4, width = 40, height = 40 }
[[regions]]
name = "right"
polygon = [[52, 4], [92, 4], [92, 44]]
"""
SESSION = """
name = "small"
[[take]]
kind = "dark"
exposure_ms = 0.03
cycles = 2
[[take]]
kind = "scene"
exposure_ms = 0.03
angles_deg = [0, 90, 45, 135]
cycles = 2
"""
DESCRIPTOR = "v 3.0\nn 12 96 48\nb 1000 100\ni images/0.png\ni images/1.png\nd 1000\ni images/2.png\ni images/3.png\n"


def make_workspace(folder: Path) -> Path:
    """Return a folder with everything that commands take."""
    folder.mkdir()
    (folder / "scene.toml").write_text(SMALL_SCENE)
    (folder / "session.toml").write_text(SESSION)
    (folder / "regions.toml").write_text(REGIONS)
    (folder / "data.txt").write_text(DESCRIPTOR)
    rig = (EXAMPLES / "rig-sim.toml").read_text()
    smaller = {"scene-panels.toml": "scene.toml", "width = 782": "width = 96", "height = 582": "height = 48"}
    for old, new in smaller.items():
        rig = rig.replace(old, new)
    (folder / "rig.toml").write_text(rig)
    shutil.copy(EXAMPLES / "material-mine.toml", folder / "material.toml")
    shutil.copy(EXAMPLES / "scene-rooftop-noon.toml", folder / "roof.toml")
    (folder / "digitised.csv").write_text("figure,panel,label,x,y\n9,a,25,40,12\n")
    _write_calibrations(folder)
    _write_pictures(folder)
    _write_levels(folder)
    _write_scan(folder)
    _write_run(folder)
    return folder


def _write_calibrations(folder: Path) -> None:
    dated = {"schema_version": 2, "created_utc": "2026-05-04T10:00:00.000000000Z", "made_for": _MADE_FOR}
    noise = {name: {"value": value, "std_error": 0.01 * value, "n": 64} for name, value in _NOISE.items()}
    names, errors = list(_NOISE), np.array([0.01 * value for value in _NOISE.values()])
    joint = {"names": names, "matrix": np.diag(errors**2).tolist()}
    (folder / "noise.json").write_text(
        json.dumps(dated | {"kind": "noise"} | noise | {"covariance": joint, "flags": []}, indent=1)
    )
    axis = {"kind": "polarizer", "sense": -1, "offset_deg": {"value": 31.7, "std_error": 0.01}}
    (folder / "polarizer.json").write_text(json.dumps(dated | axis, indent=1))


def _write_run(folder: Path) -> None:
    """Take the session of the workspace, and a radiometric calibration of it: a run with seals, inputs and events."""
    rig, session = load_rig(folder / "rig.toml"), load_session(folder / "session.toml")
    files = {"rig": folder / "rig.toml", "session": folder / "session.toml"}
    take_session(rig, session, folder / "run", files=files, clock=SessionClock(sleep=lambda _seconds: None))
    radiometric(folder / "run", panel="left", scene=folder / "scene.toml", out=folder / "radiometric.json")


def _write_levels(folder: Path) -> None:
    """Write dark and flat frames of a few exposures, and a table of them."""
    draws = np.random.default_rng(2)
    (folder / "levels").mkdir()
    rows = ["file,kind,exposure_ms,photons,level"]
    for kind, exposures_us in {"dark": (20, 400), "flat": (20, 100, 200, 300, 400)}.items():
        for exposure_us in exposures_us:
            for number in range(2):
                light = 20.0 * exposure_us if kind == "flat" else 0.0
                counts = draws.normal(64 + 0.24 * light, 0.24 * np.sqrt(light + 100.0), (24, 32)).round()
                name = f"{kind}_{exposure_us}us_{number}.png"
                cv2.imwrite(str(folder / "levels" / name), counts.clip(0, 4095).astype(np.uint16))
                rows.append(f"levels/{name},{kind},{exposure_us / 1e3},{light / 0.45},")
    (folder / "table.csv").write_text("\n".join(rows) + "\n")


def _write_scan(folder: Path) -> None:
    """Make a scan of a polarizer: two turns of a generator behind twelve angles each."""
    draws = np.random.default_rng(3)
    frames = []
    for cycle, generator_deg in enumerate((0.0, 30.0, 60.0, 90.0)):
        for angle_deg in range(0, 180, 15):
            light = 500.0 * (1.0 + 0.98 * np.cos(np.deg2rad(2 * (angle_deg - generator_deg))))
            facts = at(angle_deg, stage_angle_deg=-angle_deg, exposure_s=3e-5, gain_db=0.0, cycle=cycle)
            frames.append((facts, draws.poisson(light, (8, 12)).astype(np.uint16)))
    make_run(folder / "scan", frames)
    (folder / "generator.csv").write_text("cycle,angle_deg\n0,0\n1,30\n2,60\n3,90\n")


def _write_pictures(folder: Path) -> None:
    draws = np.random.default_rng(1)
    (folder / "images").mkdir()
    frames = []
    for number, angle_deg in enumerate(_ANGLES_DEG):
        right = 1200.0 + 200.0 * np.cos(np.deg2rad(2 * angle_deg))
        light = np.where(np.arange(_SHAPE[1]) < _SHAPE[1] // 2, 300.0, right)
        counts = (draws.poisson(np.broadcast_to(light, _SHAPE)) + 64).astype(np.uint16)
        cv2.imwrite(str(folder / "images" / f"{number}.png"), counts)
        facts = at(angle_deg, black_level_dn=64.0, exposure_s=3e-5, gain_db=0.0, cycle=0)
        frames.append((facts | {"start_utc": "2026-05-04T10:00:00.000000000Z"}, counts))
    cv2.imwrite(str(folder / "images" / "picture.tif"), frames[0][1])
    run = make_run(folder / "images" / "made", frames)
    shutil.copy(run.path / run.frames[0].file, folder / "images" / "ours.fits")
    shutil.rmtree(run.path)
