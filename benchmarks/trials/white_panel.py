"""Trial of the diffuse term "volume" against the measured Mueller BRDF of sintered PTFE.

FOLDER/ptfe_mueller/PTFE.data.csv is that of Germer, Appl. Opt. 56, 9333 (2017). Every geometry is predicted from a fit
to others: to the other one of two random halves, or to all but those of its sector of azimuth, or of its angle of
incidence. The last row is a smooth table through a random half: it has no parameters, only symmetry and reciprocity.

The rms errors are those of f00 (relative), of DoLP, and of S1/S0 and S2/S0. Polarization is that of the mean of a
geometry and its mirror image; their difference gives the noise. The parameters of a fit to all geometries are printed
last. Their uncertainty is a jackknife over angles of incidence.
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
# Weights of the fit: of f00, and least of an element over f00; S1 and S2 of unpolarized light count more.
F_STD, RATIO_STD, UNPOLARIZED = 0.02, 0.004, 2.0
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
    weights[1:, 0] /= UNPOLARIZED

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


def judged(data: MeasuredTable, rows: NDArray[np.intp], f: FloatArray, noise: FloatArray) -> tuple[float, ...]:
    """Return rms errors of Mueller matrices f: of f00, DoLP, DoLP by noise alone, S1 and S2 over S0."""
    pairs = mirror_pairs(data, rows)
    mean = 0.5 * (data.ratios[pairs[:, 0], 1:, 0] + data.ratios[pairs[:, 1], 1:, 0] * [1.0, -1.0])
    place = np.searchsorted(rows, pairs[:, 0])
    predicted = f[place, 1:, 0] / f[place, :1, 0]
    drawn = np.random.default_rng(1).standard_normal((40, *predicted.shape)) * noise[1:, 0] / np.sqrt(2.0)
    dolp = np.hypot(*predicted.T)
    return (
        rms(f[:, 0, 0] / data.f00_per_sr[rows] - 1.0),
        rms(dolp - np.hypot(*mean.T)),
        rms(np.linalg.norm(predicted + drawn, axis=-1) - dolp),
        rms(predicted - mean),
    )


def rms(values: FloatArray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def angles_of(data: MeasuredTable, rows: NDArray[np.intp]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return incidence, reflection and azimuth of rows [rad]."""
    return data.theta_i_rad[rows], data.theta_r_rad[rows], data.phi_rad[rows]


def groups_of(data: MeasuredTable, rows: NDArray[np.intp], kind: str, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return the group of each row that is left out together; mirror images stay together."""
    incidence, reflection, azimuth = angles_of(data, rows)
    if kind == "azimuth":
        return np.minimum(np.abs(azimuth) // np.radians(30.0), 5.0).astype(np.intp)
    if kind == "incidence":
        return np.round(incidence / np.radians(15.0)).astype(np.intp)
    names = np.round(np.stack([incidence, reflection, np.cos(azimuth)]), 4)
    _, geometry = np.unique(names, axis=1, return_inverse=True)
    return (rng.permutation(geometry.max() + 1) % 2)[geometry.ravel()]


def table_of(data: MeasuredTable, rows: NDArray[np.intp]) -> MeasuredTable:
    """Return a table of these rows alone."""
    named = ("wavelength_m", "theta_i_rad", "theta_r_rad", "phi_rad", "f00_per_sr", "ratios")
    return MeasuredTable(source="rows", **{name: getattr(data, name)[rows] for name in named})


def run_white_panel(*, halves: int = 4, seed: int = 0) -> bool:
    """Predict geometries from fits to others; return whether all random halves are within what is allowed."""
    if "RIGCTL_REAL_DATA" not in os.environ:
        print("not run: set RIGCTL_REAL_DATA to the folder that has ptfe_mueller/PTFE.data.csv")
        return True
    data, sound = read_brdf_table(Path(os.environ["RIGCTL_REAL_DATA"]) / "ptfe_mueller" / "PTFE.data.csv"), True
    sintered, jackknifed = material("sintered-ptfe"), {}
    print("left out      nm     f00 rms   DoLP rms  by noise  beyond noise  S1, S2 over S0")
    kinds = [*(f"half {k + 1}" for k in range(halves)), "azimuth", "incidence", "library", "table"]
    for place, kind in enumerate(kinds):
        rng, found = np.random.default_rng([seed, place]), []
        for wavelength_m in data.wavelengths_m:
            rows = np.flatnonzero((data.wavelength_m == wavelength_m) & (data.theta_i_rad > NADIR_RAD))
            noise, start = element_noise(data, rows), surface_of(sintered, wavelength_m=wavelength_m)
            f = mueller(*angles_of(data, rows), surface=start)
            group, fits = groups_of(data, rows, kind, rng), []
            for left_out in np.unique(group) if kind != "library" else ():
                others, these = rows[group != left_out], group == left_out
                if kind == "table":
                    f[these] = table_of(data, others).at(wavelength_m).matrix(*angles_of(data, rows[these]))
                    continue
                fits.append(fitted(data, others, start, noise))
                f[these] = mueller(*angles_of(data, rows[these]), surface=fits[-1])
            if kind == "incidence":
                jackknifed[wavelength_m] = [[getattr(one, name) for one in fits] for name in FREE]
            found.append(judged(data, rows, f, noise))
            _print_row(kind, f"{wavelength_m * 1e9:.0f}", found[-1])
        total = tuple(rms(np.array(column)) for column in zip(*found, strict=True))
        _print_row(kind, "all", total)
        if kind.startswith("half"):
            sound &= total[0] <= F_ALLOWED and _beyond(total) <= DOLP_ALLOWED
    print("\nfit to all    nm  " + "".join(f"{name:>20s}" for name in FREE))
    for wavelength_m, without in jackknifed.items():
        rows = np.flatnonzero((data.wavelength_m == wavelength_m) & (data.theta_i_rad > NADIR_RAD))
        surface = fitted(data, rows, surface_of(sintered, wavelength_m=wavelength_m), element_noise(data, rows))
        std = np.std(without, axis=1) * np.sqrt(len(without[0]) - 1.0)
        cells = (f"{getattr(surface, name):.4f} ± {of:.4f}" for name, of in zip(FREE, std, strict=True))
        print(f"{'':10s}{wavelength_m * 1e9:6.0f}  " + "".join(f"{cell:>20s}" for cell in cells))
    return sound


def _beyond(errors: tuple[float, ...]) -> float:
    return max(errors[1] ** 2 - errors[2] ** 2, 0.0) ** 0.5


def _print_row(kind: str, wavelength: str, errors: tuple[float, ...]) -> None:
    cells = (*errors[:3], _beyond(errors), errors[3])
    print(f"{kind:10s}{wavelength:>6s}" + "".join(f"  {value:8.4f}" for value in cells), flush=True)
