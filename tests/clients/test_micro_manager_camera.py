"""A calibration of the demonstration camera of Micro-Manager, no line of it ours, finds what it is set to."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from rigctl.cli import main
from tests.clients.make_venvs import CAMERA, default_folder, python_of

HERE = Path(__file__).parent
ELECTRONS_PER_DN, READ_NOISE_E, OFFSET_DN, FLUX_PER_MS = 2.0, 8.0, 100, 1000.0
EXPOSURES_MS = (0.4, 0.8, 1.2, 1.8, 2.4, 3.0, 3.6, 4.2, 4.8, 5.4, 6.0, 6.6, 7.2, 7.6, 7.9, 8.1, 8.4)
STACK_MS, STACK, PAIR = 3.6, 16, 2
PROPERTIES = {
    "Mode": "Noise",
    "PixelType": "16bit",
    "BitDepth": "12",
    "Offset": str(OFFSET_DN),
    "Photon Conversion Factor": str(ELECTRONS_PER_DN),
    "ReadNoise (electrons)": str(READ_NOISE_E),
}


def camera_python() -> Path:
    """The interpreter that has the camera; skips, or fails where it has to be there."""
    python = python_of(CAMERA[0], default_folder())
    if not python.exists():
        required = os.environ.get("RIGCTL_CLIENTS") == "1"
        (pytest.fail if required else pytest.skip)(
            f"`python tests/clients/make_venvs.py` installs {CAMERA[0]}, in an environment of its own"
        )
    return python


def groups() -> list[dict[str, Any]]:
    """Flats of an exposure sweep into saturation. The camera is dark at no exposure alone: its flux is never 0."""
    flats = [
        {"name": f"flat_{time_ms:g}ms", "exposure_ms": time_ms, "photon_flux": FLUX_PER_MS, "frames": PAIR}
        for time_ms in EXPOSURES_MS
    ]
    for flat in flats:
        if flat["exposure_ms"] == STACK_MS:
            flat["frames"] = STACK
    return [*flats, {"name": "dark_0ms", "exposure_ms": 0.0, "photon_flux": FLUX_PER_MS, "frames": STACK}]


def calibrate(folder: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    settings = folder / "settings.json"
    settings.write_text(json.dumps({"properties": PROPERTIES, "groups": groups()}), encoding="utf-8")
    subprocess.run([camera_python(), HERE / CAMERA[1], folder, settings], check=True, timeout=120)
    lines = ["file,kind,exposure_ms"]
    for group in groups():
        for number, frame in enumerate(np.load(folder / f"{group['name']}.npy")):
            name = f"{group['name']}_{number}.png"
            cv2.imwrite(str(folder / name), frame)
            lines.append(f"{name},{group['name'].partition('_')[0]},{group['exposure_ms']}")
    table = folder / "frames.csv"
    table.write_text("\n".join(lines), encoding="utf-8")
    command = ["calibrate", "noise", "--table", str(table), "--bit-depth", "12", "--out", str(folder / "noise.json")]
    assert main([*command, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


@pytest.mark.slow
def test_finds_what_the_camera_is_set_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = calibrate(tmp_path, capsys)
    # Its samples are cut off to whole counts, once with the offset and once more with the signal: half a count less in
    # the dark, a whole one in the light, and two roundings of 1/12 DN^2 in the noise, of which we take off one.
    read_noise_e = np.hypot(READ_NOISE_E, ELECTRONS_PER_DN * np.sqrt(1.0 / 12.0))
    truth = {
        "gain_dn_per_e": 1.0 / ELECTRONS_PER_DN,
        "read_noise_e": read_noise_e,
        "black_level_dn": OFFSET_DN - 0.5,
    }
    for name, value in truth.items():
        assert abs(found[name]["value"] - value) < 3.0 * found[name]["std_error"], name
    assert found["gain_dn_per_e"]["std_error"] < 0.01 / ELECTRONS_PER_DN
    # Full scale cuts the upper half of the noise off; its variance is largest some two standard deviations below.
    full_e = (4095 - OFFSET_DN) * ELECTRONS_PER_DN
    saturation_e = full_e - 2.0 * np.sqrt(full_e + READ_NOISE_E**2)
    assert abs(found["saturation_e"]["value"] - saturation_e) < 3.0 * found["saturation_e"]["std_error"]
    # All its pixels are alike, and it has no dark current to see.
    assert found["prnu"] is None or "bound" in found["prnu"] or found["prnu"]["value"] < 1e-3
    assert found["dsnu_e"] is None or "bound" in found["dsnu_e"]
    assert found["dark_current_e_per_s"] is None
    assert not [flag for flag in found["flags"] if flag["level"] is not None]
