"""Runs of three panels whose truth is drawn from what a scene file says of it, by numpy from the sensor equation.

Nothing of the model is used: the counts are drawn, not predicted.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigctl.runs.folder import Run
from tests.rigctl.made_runs import at, make_run

ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
# As they are taken: 0, 90, 45, 135.
_ORDER = (0, 2, 1, 3)
CYCLES, SIDE, BLACK_DN, EXPOSURE_S = 3, 40, 64.0, 3e-5
REGIONS = ("black", "white", "grey")


@dataclass(frozen=True, kw_only=True)
class Number:
    """What a scene file states of an input."""

    value: float
    std: float = 0.0


# S0, S1, S2; DoLP 0.4, 0.03 and 0.15.
STATED: dict[str, Number] = {
    "sensor.quantum_efficiency": Number(value=0.45, std=0.0135),
    "sensor.optics_transmittance": Number(value=0.9, std=0.009),
    "sensor.extinction_ratio": Number(value=500.0, std=60.0),
    "noise.gain_dn_per_e": Number(value=0.24, std=0.006),
    "noise.read_noise_e": Number(value=10.0, std=1.0),
    "noise.prnu": Number(value=0.01, std=0.0015),
    "rig.polarizer_offset_deg": Number(value=0.0, std=0.4),
    "rig.exposure_ratio": Number(value=1.0, std=0.004),
    "errors.illumination_drift": Number(value=0.0, std=0.004),
    "regions.black.stokes_radiance.0": Number(value=8.0, std=0.4),
    "regions.black.stokes_radiance.1": Number(value=2.923, std=0.12),
    "regions.black.stokes_radiance.2": Number(value=1.302, std=0.05),
    "regions.black.texture_rms": Number(value=0.03, std=0.004),
    "regions.white.stokes_radiance.0": Number(value=50.0, std=0.5),
    "regions.white.stokes_radiance.1": Number(value=-1.477, std=0.05),
    "regions.white.stokes_radiance.2": Number(value=-0.2605, std=0.05),
    "regions.grey.stokes_radiance.0": Number(value=14.0, std=0.1),
    "regions.grey.stokes_radiance.1": Number(value=1.919, std=0.02),
    "regions.grey.stokes_radiance.2": Number(value=-0.854, std=0.01),
    "regions.grey.texture_rms": Number(value=0.02, std=0.003),
}


def scene_text() -> str:
    """Return the scene file that states these inputs."""

    def stated(name: str) -> str:
        number = STATED[name]
        return f"{{ value = {number.value!r}, std = {number.std!r} }}"

    def section(name: str, fixed: str) -> str:
        own = [key for key in STATED if key.startswith(f"{name}.")]
        return "\n".join([f"[{name}]", fixed, *(f"{key.partition('.')[2]} = {stated(key)}" for key in own)])

    parts = [
        'name = "panels, uncertain"',
        section(
            "sensor",
            "pixel_pitch_um = 8.3\nf_number = 2.0\nwavelength_nm = 550.0\nbit_depth = 12\n"
            "polarizer_transmittance = 0.8",
        ),
        section("noise", f"dark_current_e_per_s = 0.0\nblack_level_dn = {BLACK_DN}\ndsnu_e = 0.0"),
        section("rig", ""),
        section("errors", ""),
        "[acquisition]\nexposure_ms = 0.03",
    ]
    for k, region in enumerate(REGIONS):
        radiance = ", ".join(stated(f"regions.{region}.stokes_radiance.{i}") for i in range(3))
        texture = f"regions.{region}.texture_rms"
        parts.append(
            f'[[regions]]\nname = "{region}"\nstokes_radiance = [{radiance}]\n'
            f"rectangle = {{ x = {4 + (SIDE + 8) * k}, y = 4, width = {SIDE}, height = {SIDE} }}\n"
            + (f"texture_rms = {stated(texture)}\n" if texture in STATED else "")
        )
    return "\n".join(parts)


def drawn_truth(draws: np.random.Generator, *, moved: str | None = None, by_std: float = 0.0) -> dict[str, float]:
    """Return a truth drawn from the stated uncertainties, with one input moved on top."""
    truth = {name: number.value + number.std * float(draws.standard_normal()) for name, number in STATED.items()}
    if moved is not None:
        truth[moved] += by_std * STATED[moved].std
    return truth


def take_run(
    path: Path,
    truth: dict[str, float],
    draws: np.random.Generator,
    *,
    facts: Callable[[int], dict[str, object]] = lambda _: {},
) -> Run:
    """Return a run of the panels with this truth; its records say what the scene file says."""
    height, width = SIDE + 8, len(REGIONS) * (SIDE + 8) + 8
    response = 1.0 + truth["noise.prnu"] * draws.standard_normal((height, width))
    light = np.zeros((3, height, width))
    for k, region in enumerate(REGIONS):
        texture = 1.0 + truth.get(f"regions.{region}.texture_rms", 0.0) * draws.standard_normal((SIDE, SIDE))
        stokes = [truth[f"regions.{region}.stokes_radiance.{i}"] for i in range(3)]
        left = 4 + (SIDE + 8) * k
        light[:, 4 : 4 + SIDE, left : left + SIDE] = np.array(stokes)[:, None, None] * texture
    frames = []
    for sequence in range(CYCLES * len(_ORDER)):
        cycle, place = divmod(sequence, len(_ORDER))
        angle = ANGLES_DEG[_ORDER[place]]
        drift = 1.0 + truth["errors.illumination_drift"] * (place / (len(_ORDER) - 1) - 0.5)
        electrons = _electrons(truth, light, np.radians(angle + truth["rig.polarizer_offset_deg"])) * drift
        counts = truth["noise.gain_dn_per_e"] * (
            draws.poisson(electrons * response) + truth["noise.read_noise_e"] * draws.standard_normal(response.shape)
        )
        known = at(angle, cycle=cycle, exposure_s=EXPOSURE_S, black_level_dn=BLACK_DN)
        frames.append((known | facts(sequence), np.rint(counts + BLACK_DN).astype(np.uint16)))
    return make_run(path, frames, session={"origin": "device", "rig": {"polarizer": {"extinction_ratio": 500.0}}})


def _electrons(truth: dict[str, float], light: np.ndarray, angle_rad: float) -> np.ndarray:
    """[MK14] eq. (11)-(17) with pi, written out."""
    along, across = 0.8, 0.8 / truth["sensor.extinction_ratio"]
    seen = 0.5 * (
        (along + across) * light[0]
        + (along - across) * (light[1] * math.cos(2.0 * angle_rad) + light[2] * math.sin(2.0 * angle_rad))
    )
    photon_j = 6.62607015e-34 * 299792458.0 / 550e-9
    etendue = math.pi / 17.0 * 8.3e-6**2 * EXPOSURE_S * truth["rig.exposure_ratio"]
    return seen * etendue * truth["sensor.optics_transmittance"] * truth["sensor.quantum_efficiency"] / photon_j
