"""Real frames by others are judged as their sources say they are."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from model.processing.diagnosis import Diagnosis, diagnose
from model.processing.fault_fit import SHARED
from model.processing.reconstruction import design

REAL_DATA = os.environ.get("RIGCTL_REAL_DATA")
pytestmark = [
    pytest.mark.skipif(
        REAL_DATA is None, reason="set RIGCTL_REAL_DATA to the folder of real frames (imx250_fruits, mueller_psa)"
    ),
    pytest.mark.slow,
    pytest.mark.timeout(600),
]
FOLDER = Path(REAL_DATA or "")
STATES = sorted(path.relative_to(FOLDER).as_posix() for path in FOLDER.glob("mueller_psa/*nm_g*/a*"))


def _picture(path: Path) -> NDArray[np.float64]:
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), dtype=np.float64)


def _mosaic(name: str) -> NDArray[np.float64]:
    """Return the planes at 0, 45, 90, 135 deg; the cell is 90, 45 over 135, 0."""
    raw = _picture(FOLDER / f"imx250_{name}" / f"{name}_IMX250MZR.png")
    return np.array([raw[1::2, 1::2], raw[0::2, 1::2], raw[0::2, 0::2], raw[1::2, 0::2]])


def _diagnosed(frames: NDArray[np.float64], angles_deg: list[float]) -> Diagnosis:
    """Return what the middle of the pictures shows; tests of the commands take them whole."""
    height, width = frames.shape[1] // 4, frames.shape[2] // 4
    frames = frames[:, height:-height, width:-width]
    angles_rad = np.radians(angles_deg)
    usable = np.all(frames < 255.0, axis=0)
    times = range(len(frames))
    return diagnose(design(angles_rad), frames, usable, angles_rad=angles_rad, times=times, step=1.0)


def _named(found: Diagnosis) -> list[str]:
    return [term.name for term in found.terms if term.is_named]


@pytest.mark.parametrize("name", ["fruits", "carps"])
def test_two_per_cent_between_pairs_are_throughput_and_no_response(name: str) -> None:
    found = _diagnosed(_mosaic(name), [0.0, 45.0, 90.0, 135.0])
    pairs = next(term for term in found.terms if term.name == "throughput of pairs")
    assert pairs.is_named
    assert pairs.value is not None
    assert (1.0 + pairs.value / 2.0) / (1.0 - pairs.value / 2.0) == pytest.approx(0.980, abs=0.002)
    assert not set(_named(found)) & set(SHARED)


def test_a_tone_mapped_picture_has_its_response_named_first() -> None:
    found = _diagnosed(_mosaic("polarizer"), [0.0, 45.0, 90.0, 135.0])
    assert found.first is not None
    assert found.first.name in SHARED
    assert found.first.value is not None
    # The pair sums follow DoLP^2 cos(4 AoLP) with a slope far below 0: the response compresses.
    assert found.first.value < -0.3


@pytest.mark.parametrize("state", STATES)
def test_no_state_of_a_linear_camera_is_called_non_linear(state: str) -> None:
    angles_deg = [float(angle) for angle in range(0, 360, 45)]
    frames = np.array([_picture(FOLDER / state / f"p{angle:03.0f}.png") for angle in angles_deg])
    found = _diagnosed(frames, angles_deg)
    assert not set(_named(found)) & set(SHARED)
    responses = [term for term in found.terms if term.name in SHARED]
    assert all(term.value is None or abs(term.value) < 5.0 * (term.std_error or 0.0) for term in responses)
