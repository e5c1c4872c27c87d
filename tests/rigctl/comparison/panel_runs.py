"""Runs of three surfaces of known radiance, drawn by numpy from the sensor equation, and the scene file for them."""

from pathlib import Path

import numpy as np

from rigctl.runs.folder import Run
from tests.rigctl.made_runs import at, make_run
from tests.rigctl.scene_texts import SENSOR

ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
BLACK_DN, GAIN, READ_NOISE_E, EXPOSURE_S = 64.0, 0.24, 10.0, 3e-5
SESSION = {"origin": "device", "rig": {"polarizer": {"extinction_ratio": 500.0}}}
PLACES = {"black": 4, "white": 52, "grey": 100}
# S0, DoLP and AoLP [deg].
LIGHT = {"black": (8.0, 0.4, 12.0), "white": (60.0, 0.03, 95.0), "grey": (14.0, 0.15, 168.0)}


def scene_text(*, error: dict[str, float] | None = None, told: dict[str, float] | None = None, **sensor: object) -> str:
    """Return a scene file: S0 of each region as told (times the truth), with its standard uncertainty (relative)."""
    text = 'name = "panels"\n' + SENSOR.replace("band_nm = [400, 700]", "wavelength_nm = 550.0")
    text = text.replace("prnu = 0.005", "prnu = 0.0").replace("dsnu_e = 1.0", "dsnu_e = 0.0")
    for name, value in sensor.items():
        lines = [line for line in text.splitlines() if not line.startswith(f"{name} =")]
        place = lines.index("[noise]" if name == "gain_dn_per_e" else "[sensor]")
        text = "\n".join([*lines[: place + 1], f"{name} = {value}", *lines[place + 1 :]]) + "\n"
    for name, (s0, dolp, aolp_deg) in LIGHT.items():
        s0 *= (told or {}).get(name, 1.0)
        s1, s2 = (s0 * dolp * f(2.0 * np.radians(aolp_deg)) for f in (np.cos, np.sin))
        std = s0 * (error or {}).get(name, 0.0)
        text += (
            f'[[regions]]\nname = "{name}"\nrectangle = {{ x = {PLACES[name]}, y = 4, width = 40, height = 40 }}\n'
            f"stokes_radiance = [{{ value = {s0}, std = {std} }}, {s1}, {s2}]\n"
        )
    return text


def electrons_per_radiance(efficiency: float = 0.45, exposure_s: float = EXPOSURE_S) -> float:
    """[MK14] eq. (17) with pi, for the sensor of the scene files, written out."""
    photon_j = 6.62607015e-34 * 299792458.0 / 550e-9
    return float(np.pi / 17.0 * 8.3e-6**2 * exposure_s * 0.9 * efficiency / photon_j)


def response_dn(efficiency: float = 0.45, exposure_s: float = EXPOSURE_S) -> float:
    """Counts per unit of unpolarized radiance."""
    return GAIN * electrons_per_radiance(efficiency, exposure_s) * 0.5 * 0.8 * (1.0 + 1.0 / 500.0)


def panel_run(
    path: Path,
    *,
    seed: int = 1,
    efficiency: float = 0.45,
    exposure_s: float = EXPOSURE_S,
    throughput: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0),
    **facts: object,
) -> Run:
    """Return a run of two cycles."""
    draws = np.random.default_rng(seed)
    frames = []
    for cycle in range(2):
        for angle, passed in zip(ANGLES_DEG, throughput, strict=True):
            counts = np.full((48, 144), BLACK_DN)
            for name, (s0, dolp, aolp_deg) in LIGHT.items():
                seen = s0 * (1.0 + (499.0 / 501.0) * dolp * np.cos(2.0 * np.radians(angle - aolp_deg)))
                mean_e = passed * response_dn(efficiency, exposure_s) / GAIN * seen
                light_e = draws.poisson(mean_e, (40, 40)) + READ_NOISE_E * draws.standard_normal((40, 40))
                counts[4:44, PLACES[name] : PLACES[name] + 40] += GAIN * light_e
            known = at(angle, cycle=cycle, exposure_s=exposure_s, black_level_dn=BLACK_DN, **facts)
            frames.append((known, np.rint(counts)))
    return make_run(path, frames, session=SESSION)
