"""Trial of the diffuse term "volume" against the measured Mueller BRDF of sintered PTFE.

FOLDER/ptfe_mueller/PTFE.data.csv is that of Germer, Appl. Opt. 56, 9333 (2017). Parameters are fitted to a random half
of the geometries of each wavelength and judged on the other half: relative error of f00, and error of DoLP of the mean
of two mirror images of a geometry, with what their noise alone gives. The noise is what mirror images differ by.
`--uncertainties` fits all geometries and prints how the parameters change where one angle of incidence is left out: the
uncertainties of the library.
"""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from model.surface.materials import material, surface_of
from model.surface.pbrdf import Surface, mueller
from model.surface.table import MeasuredTable
from rigctl.files.materials import read_brdf_table

# Name of a parameter, where to look for it.
FREE = {
    "slope_rms": (0.15, 0.6),
    "specular_weight": (0.01, 0.5),
    "dhr": (0.9, 0.999),
    "single_scattering": (0.2, 1.0),
    "asymmetry": (0.0, 0.75),
    "single_dolp": (0.02, 0.4),
    "depolarization": (0.0, 1.0),
}
F_ALLOWED, DOLP_ALLOWED = 0.04, 0.007
# Weights of the fit: of f00, and least of an element over f00.
F_STD, RATIO_STD = 0.02, 0.004
NADIR_RAD = np.radians(1.0)

FloatArray = NDArray[np.float64]


def mirror_pairs(data: MeasuredTable, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return rows of a geometry and of its mirror image, shape (P, 2)."""
    keys = np.stack(
        [data.theta_i_rad[rows], data.theta_r_rad[rows], np.sin(data.phi_rad[rows]), np.cos(data.phi_rad[rows])]
    )
    places = {tuple(key): row for key, row in zip(np.round(keys.T, 4).tolist(), rows.tolist(), strict=True)}
    return np.array(
        [(row, places[i, r, -s, c]) for (i, r, s, c), row in places.items() if s > 1e-3 and (i, r, -s, c) in places]
    )


def element_noise(data: MeasuredTable, rows: NDArray[np.intp]) -> FloatArray:
    """Return the standard deviation of elements over f00 from mirror images, shape (3, 3)."""
    first, second = mirror_pairs(data, rows).T
    flip = np.diag([1.0, 1.0, -1.0])
    return np.asarray(np.std(data.ratios[first] - flip @ data.ratios[second] @ flip, axis=0) / np.sqrt(2.0))


def fitted(data: MeasuredTable, rows: NDArray[np.intp], start: Surface, noise: FloatArray) -> Surface:
    """Return the surface that fits f00 and all elements of rows best."""
    weights = np.sqrt(noise**2 + RATIO_STD**2)

    def residuals(values: FloatArray) -> FloatArray:
        f = mueller(
            data.theta_i_rad[rows],
            data.theta_r_rad[rows],
            data.phi_rad[rows],
            surface=replace(start, **dict(zip(FREE, values.tolist(), strict=True))),
        )
        ratios = ((f / f[:, :1, :1] - data.ratios[rows]) / weights).reshape(-1, 9)[:, 1:]
        return np.append((f[:, 0, 0] / data.f00_per_sr[rows] - 1.0) / F_STD, ratios)

    low, high = np.array(list(FREE.values())).T
    begin = np.clip([getattr(start, name) for name in FREE], low + 1e-3, high - 1e-3)
    found = least_squares(
        residuals, begin, bounds=(low, high), x_scale=high - low, diff_step=1e-3, xtol=1e-4, ftol=1e-4
    )
    return replace(start, **dict(zip(FREE, found.x.tolist(), strict=True)))


def judged(data: MeasuredTable, rows: NDArray[np.intp], surface: Surface) -> tuple[float, float, float]:
    """Return rms of f00's relative error, of DoLP's error on means of mirror images, and of S1 and S2 over S0 there."""
    f = mueller(data.theta_i_rad[rows], data.theta_r_rad[rows], data.phi_rad[rows], surface=surface)
    pairs = mirror_pairs(data, rows)
    mean = 0.5 * (data.ratios[pairs[:, 0], 1:, 0] + data.ratios[pairs[:, 1], 1:, 0] * [1.0, -1.0])
    place = np.searchsorted(rows, pairs[:, 0])
    predicted = f[place, 1:, 0] / f[place, :1, 0]
    off = predicted - mean
    return (
        rms(f[:, 0, 0] / data.f00_per_sr[rows] - 1.0),
        rms(np.hypot(*predicted.T) - np.hypot(*mean.T)),
        rms(off),
    )


def rms(values: FloatArray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def noise_of_dolp(data: MeasuredTable, rows: NDArray[np.intp], surface: Surface, noise: FloatArray) -> float:
    """Return the rms error of DoLP that noise alone gives to means of mirror images of a surface without fault."""
    rng, pairs = np.random.default_rng(1), mirror_pairs(data, rows)[:, 0]
    f = mueller(data.theta_i_rad[pairs], data.theta_r_rad[pairs], data.phi_rad[pairs], surface=surface)
    true = f[:, 1:, 0] / f[:, :1, 0]
    drawn = true + rng.standard_normal((40, *true.shape)) * noise[1:, 0] / np.sqrt(2.0)
    return rms(np.hypot(drawn[..., 0], drawn[..., 1]) - np.hypot(*true.T))


def random_halves(
    data: MeasuredTable, rows: NDArray[np.intp], rng: np.random.Generator
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows of two random halves; mirror images stay together."""
    names = np.round(np.stack([data.theta_i_rad[rows], data.theta_r_rad[rows], np.cos(data.phi_rad[rows])]), 4)
    _, group = np.unique(names, axis=1, return_inverse=True)
    chosen = rng.permutation(group.max() + 1) < (group.max() + 1) / 2
    return rows[chosen[group.ravel()]], rows[~chosen[group.ravel()]]


def run_white_panel(*, halves: int = 4, seed: int = 0) -> bool:
    """Fit halves and judge the others; return whether all are within what is allowed."""
    if "RIGCTL_REAL_DATA" not in os.environ:
        print("not run: set RIGCTL_REAL_DATA to the folder that has ptfe_mueller/PTFE.data.csv")
        return True
    path = Path(os.environ["RIGCTL_REAL_DATA"]) / "ptfe_mueller" / "PTFE.data.csv"
    data, sound = read_brdf_table(path), True
    sintered = material("sintered-ptfe")
    wavelengths = np.unique(data.wavelength_m)
    print("half    nm     f00 rms   DoLP rms  by noise  beyond noise  S1, S2 over S0")
    for half in range(halves + 1):
        rng = np.random.default_rng([seed, half])
        found = []
        for wavelength_m in wavelengths:
            rows = np.flatnonzero((data.wavelength_m == wavelength_m) & (data.theta_i_rad > NADIR_RAD))
            noise, surface = element_noise(data, rows), surface_of(sintered, wavelength_m=wavelength_m)
            if half < halves:
                training, rows = random_halves(data, rows, rng)
                surface = fitted(data, training, surface, noise)
            f00, dolp, ratio = judged(data, rows, surface)
            by_noise = noise_of_dolp(data, rows, surface, noise)
            found.append((f00, dolp, by_noise, ratio))
            name = f"{half + 1}" if half < halves else "library"
            row = (f00, dolp, by_noise, max(dolp**2 - by_noise**2, 0.0) ** 0.5, ratio)
            print(f"{name:7s} {wavelength_m * 1e9:5.0f}" + "".join(f"  {value:8.4f}" for value in row))
        f00, dolp, by_noise, _ = (rms(np.array(column)) for column in zip(*found, strict=True))
        beyond = max(dolp**2 - by_noise**2, 0.0) ** 0.5
        print(f"{'':7s}   all" + "".join(f"  {value:8.4f}" for value in (f00, dolp, by_noise, beyond)))
        sound &= f00 <= F_ALLOWED and beyond <= DOLP_ALLOWED
    return sound
