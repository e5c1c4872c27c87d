"""Writes the folders that chapters run in: the examples, and small rigs and pictures made from them."""

import re
import shutil
from pathlib import Path

import cv2
import numpy as np

EXAMPLES = Path(__file__).parents[2] / "examples"

_PLACES = {
    "black_panel": "rectangle = { x = 8, y = 12, width = 48, height = 72 }",
    "white_panel": "rectangle = { x = 72, y = 12, width = 48, height = 72 }",
    "asphalt": "polygon = [[136, 12], [184, 14], [182, 84], [138, 82]]",
}
_NOISE_EXPOSURES = "[0.002, 0.006, 0.010, 0.014, 0.018, 0.022, 0.026, 0.030, 0.034, 0.040, 0.046, 0.052, 0.060]"
# Whether frames wait for the disk depends on how busy this machine is.
_NO_QUEUE = '\n[interlocks]\nqueue = "off"\n'
_DARKS_AND = """\
name = "{name}"
[[take]]
kind = "dark"
exposure_ms = {dark_ms}
cycles = {darks}
[[take]]
kind = "{kind}"
exposure_ms = {exposure_ms}
cycles = {cycles}
"""


def examples(folder: Path) -> None:
    """Copy the examples."""
    shutil.copytree(EXAMPLES, folder, dirs_exist_ok=True)


def small_rig(folder: Path) -> None:
    """Write the examples, and rig, scenes and sessions of pictures of 192 x 96 pixels."""
    examples(folder)
    for name in (
        "scene-panels.toml",
        "scene-panels-uncertain.toml",
        "scene-roof.toml",
        "session-roof.toml",
        "regions.toml",
    ):
        _edit(folder / name, *[(_place_of(folder / name, region), place) for region, place in _PLACES.items()])
    for name in ("rig-sim.toml", "rig-roof.toml"):
        _edit(folder / name, ("width = 782", "width = 192"), ("height = 582", "height = 96"))
    _edit(folder / "rig-mosaic.toml", ("width = 1564", "width = 384"), ("height = 1164", "height = 192"))
    _edit(folder / "session-roof.toml", ("[metering]", f"{_NO_QUEUE}\n[metering]"))
    session = _DARKS_AND.format(name="short", dark_ms=0.03, darks=4, kind="scene", exposure_ms=0.03, cycles=2)
    (folder / "session.toml").write_text(session + f"angles_deg = [0, 90, 45, 135]\n{_NO_QUEUE}")
    many = "[" + ", ".join(str(angle) for angle in range(0, 180, 20)) + "]"
    (folder / "session-many.toml").write_text(session + f"angles_deg = {many}\n{_NO_QUEUE}")
    darks = _NOISE_EXPOSURES.replace("]", ", 20, 100]")
    noise = _DARKS_AND.format(name="noise", dark_ms=darks, darks=2, kind="flat", exposure_ms=_NOISE_EXPOSURES, cycles=2)
    stack = _DARKS_AND.format(name="noise", dark_ms=0.022, darks=8, kind="flat", exposure_ms=0.022, cycles=8)
    (folder / "session-noise.toml").write_text(noise + stack.partition("\n")[2] + _NO_QUEUE)
    flats = _DARKS_AND.format(name="flats", dark_ms=0.03, darks=8, kind="flat", exposure_ms=0.03, cycles=8)
    (folder / "session-flats.toml").write_text(flats + f"angles_deg = [0, 90, 45, 135]\n{_NO_QUEUE}")


def rig_with_store(folder: Path) -> None:
    """Write the small rig and an empty folder for its calibrations."""
    small_rig(folder)
    (folder / "calibrations").mkdir()


def perturbed_rig(folder: Path) -> None:
    """Write the small rig, one whose polarizer is turned, and one whose sensor has a smaller gain."""
    small_rig(folder)
    truth, camera = "[simulation.polarizer]\nsense = -1\noffset_deg = 31.7", "gain_dn_per_e = 0.24"
    for name, old, new in (
        ("rig-turned.toml", truth, truth.replace("31.7", "34.7")),
        ("rig-weak.toml", camera, "gain_dn_per_e = 0.22"),
    ):
        shutil.copy(folder / "rig-sim.toml", folder / name)
        _edit(folder / name, (old, new))


def calibration_rig(folder: Path) -> None:
    """Write the small rig, scenes of polarized light at 0 and 30 deg, walking pictures and chessboards."""
    small_rig(folder)
    turning = "[" + ", ".join(str(angle) for angle in range(0, 180, 15)) + "]"
    session = _DARKS_AND.format(name="axis", dark_ms=0.03, darks=4, kind="scene", exposure_ms=0.03, cycles=1)
    (folder / "session-axis.toml").write_text(session + f"angles_deg = {turning}\n{_NO_QUEUE}")
    for direction_deg in (0, 30):
        s1, s2 = (38.0 * f(np.radians(2.0 * direction_deg)) for f in (np.cos, np.sin))
        scene, _, _ = (folder / "scene-panels.toml").read_text().partition("[[regions]]")
        scene += f'[[regions]]\nname = "light"\n{_PLACES["white_panel"]}\nstokes_radiance = [40.0, {s1}, {s2}]\n'
        (folder / f"scene-axis{direction_deg}.toml").write_text(scene)
        shutil.copy(folder / "rig-sim.toml", folder / f"rig-axis{direction_deg}.toml")
        _edit(folder / f"rig-axis{direction_deg}.toml", ("scene-panels.toml", f"scene-axis{direction_deg}.toml"))
    (folder / "light.toml").write_text(f'[[regions]]\nname = "light"\n{_PLACES["white_panel"]}\n')
    _write_walk(folder)
    _write_boards(folder)


def wrong_files(folder: Path) -> None:
    """Write the examples, and some of them with one mistake each."""
    examples(folder)
    for name, original, old, new in (
        ("key", "scene-panels.toml", "f_number = 2.0", "f_nummer = 2.0"),
        ("text", "scene-panels.toml", "f_number = 2.0", 'f_number = "two"'),
        ("number", "scene-panels.toml", "f_number = 2.0", "f_number = -2"),
        ("toml", "scene-panels.toml", "[sensor]", "[sensor"),
        ("missing", "scene-panels.toml", "[noise]", "[nose]"),
        ("stokes", "scene-panels.toml", "[8.0, 2.777", "[8.0, 9.0"),
        ("driver", "rig-sim.toml", '"ellx"', '"ELL14"'),
        ("sense", "rig-sim.toml", "sense = -1", "sense = 2"),
    ):
        shutil.copy(folder / original, folder / f"wrong-{name}.toml")
        _edit(folder / f"wrong-{name}.toml", (old, new))


def real_regions(folder: Path) -> None:
    """Write two regions that lie in every real picture."""
    regions = ((50, 60), (120, 100))
    (folder / "regions.toml").write_text(
        "".join(
            f'[[regions]]\nname = "at{x}"\nrectangle = {{ x = {x}, y = {y}, width = 40, height = 40 }}\n'
            for x, y in regions
        )
    )


def _write_walk(folder: Path) -> None:
    """Write pictures walk0.png ... that walk on a circle of 2 pixels as the polarizer turns."""
    draws = np.random.default_rng(3)
    scene = 1000.0 + 6000.0 * cv2.GaussianBlur(draws.standard_normal((240, 300)), (0, 0), 3.0)
    for angle_deg in (0, 45, 90, 135):
        walk = 2.0 * np.exp(1j * np.radians(angle_deg)) - 2.0
        motion = np.array([[1.0, 0.0, walk.real], [0.0, 1.0, walk.imag]])
        picture = cv2.warpAffine(scene, motion, (300, 240), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        cv2.imwrite(str(folder / f"walk{angle_deg}.png"), np.clip(np.rint(picture), 0, 4095).astype(np.uint16))


def _write_boards(folder: Path) -> None:
    """Write pictures board0.png ... of a chessboard of 7 x 5 inner corners and squares of 30 mm, 500 pixels focal."""
    cells = np.indices((6, 8)).sum(axis=0) % 2
    board = cv2.copyMakeBorder(np.kron(1 - cells, np.ones((40, 40))), 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=1.0)
    camera = np.array([[500.0, 0.0, 159.5], [0.0, 500.0, 119.5], [0.0, 0.0, 1.0]])
    # From pixels of the drawn board to metres about its middle.
    metres = np.array([[0.03 / 40, 0.0, -0.15 + 0.0004], [0.0, 0.03 / 40, -0.12 + 0.0004], [0.0, 0.0, 1.0]])
    turns = ((0.5, 0.1, 0.0), (-0.4, 0.3, 0.1), (0.1, -0.5, 0.2), (0.4, 0.4, -0.2), (-0.3, -0.4, 0.0))
    for number, turn in enumerate(turns):
        rotation, _ = cv2.Rodrigues(np.array(turn))
        place = np.column_stack([rotation[:, :2], (0.01 * number - 0.02, 0.01, 0.5)])
        picture = cv2.warpPerspective(
            300.0 + 2700.0 * board, camera @ place @ metres, (320, 240), flags=cv2.INTER_AREA, borderValue=3000.0
        )
        noisy = np.random.default_rng(2).normal(picture, 20.0).clip(0.0, 4095.0)
        cv2.imwrite(str(folder / f"board{number}.png"), noisy.astype(np.uint16))


def _place_of(path: Path, region: str) -> str:
    """Return the line with the outline of a region."""
    found = re.search(rf'name = "{region}".*\n((rectangle|polygon) = .*)', path.read_text())
    assert found is not None, f"{path.name} has no outline of {region}"
    return found[1]


def _edit(path: Path, *changes: tuple[str, str]) -> None:
    """Replace texts in a file, each of which has to be there."""
    text = path.read_text()
    for old, new in changes:
        assert old in text, f"{path.name} has no {old!r}"
        text = text.replace(old, new)
    path.write_text(text)
