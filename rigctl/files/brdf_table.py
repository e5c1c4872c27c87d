"""Tables of measured BRDF and polarization that people bring, read into the project's frames.

Two layouts are understood by their first line. That of NIST (Germer 2017): wavelength [um], incidence and its azimuth,
reflection and its azimuth [deg], f_r11 [1/sr], and further elements of the Mueller matrix over f_r11; rows of outgoing
light count from axes that do not turn with its azimuth. And the project's own: columns incidence_deg, reflection_deg,
azimuth_deg (180 is forward), wavelength_nm, f00_per_sr, and over it all of m01 to m22, or s1 and s2, or dolp.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model.stokes import rotation
from model.surface.table import MeasuredTable
from rigctl.errors import ConfigError
from rigctl.files.number_table import Columns, Problem, columns_of, csv_lines, header_of

FloatArray = NDArray[np.float64]

_NIST = ("lambda", "thetai", "phi", "thetar", "phir", "f_r11")
_OWN = ("incidence_deg", "reflection_deg", "azimuth_deg", "wavelength_nm", "f00_per_sr")
_ELEMENTS = tuple((i, j) for i in range(3) for j in range(3))
_MATRIX = tuple(f"m{i}{j}" for i, j in _ELEMENTS[1:])
# An element over f00 cannot exceed 1 but for noise.
_RATIO_MOST = 1.2


def read_brdf_table(path: Path) -> MeasuredTable:
    """Return the measured geometries of a CSV file.

    Raises
    ------
    ConfigError
        The file cannot be read or its layout is not known; else with all rows that are wrong, up to twenty.
    """
    lines = csv_lines(path)
    header = header_of(lines)
    if set(_NIST) <= set(header):
        needs = (*_NIST, *(f"f_r{i + 1}{j + 1}/f_r11" for i, j in _ELEMENTS[1:]))
        return _of_nist(path, columns_of(path, lines, needs=needs, problems_of=_nist_problems))
    optional: tuple[str, ...] = ()
    for names in (_MATRIX, ("s1", "s2"), ("dolp",)):
        if set(names) <= set(header):
            optional = names
            break
    missing = [name for name in _OWN if name not in header]
    if missing or not optional:
        lacking = ", ".join(missing) if missing else "the polarization: m01 to m22, or s1 and s2, or dolp"
        raise ConfigError(
            f"{path}: its first line lacks {lacking}; allowed are {','.join(_OWN)} with m01 to m22, s1 and s2, or dolp "
            f"(all over f00), or the layout of NIST, {','.join(_NIST)},f_r12/f_r11,..."
        )
    columns = columns_of(path, lines, needs=(*_OWN, *optional), problems_of=_own_problems)
    return _of_own(path, columns, optional)


def _nist_problems(columns: Columns) -> Iterator[Problem]:
    yield "lambda", columns["lambda"] <= 0.0, "be above 0 [um]"
    yield "thetai", np.abs(columns["thetai"]) >= 90.0, "lie between -90 and 90"
    yield "phi", columns["phi"] != 0.0, "be 0: incidence in the plane of the instrument"
    yield "thetar", (columns["thetar"] < 0.0) | (columns["thetar"] >= 90.0), "lie in [0, 90)"
    yield "f_r11", columns["f_r11"] <= 0.0, "be above 0"
    for i, j in _ELEMENTS[1:]:
        name = f"f_r{i + 1}{j + 1}/f_r11"
        yield name, np.abs(columns[name]) > _RATIO_MOST, f"lie within -{_RATIO_MOST:g} and {_RATIO_MOST:g}"


def _own_problems(columns: Columns) -> Iterator[Problem]:
    for name in ("incidence_deg", "reflection_deg"):
        yield name, (columns[name] < 0.0) | (columns[name] >= 90.0), "lie in [0, 90)"
    for name in ("wavelength_nm", "f00_per_sr"):
        yield name, columns[name] <= 0.0, "be above 0"
    for name in columns.keys() - set(_OWN):
        yield name, np.abs(columns[name]) > _RATIO_MOST, f"lie within -{_RATIO_MOST:g} and {_RATIO_MOST:g}"
    if "dolp" in columns:
        yield "dolp", columns["dolp"] < 0.0, "not be below 0"


def _of_nist(path: Path, columns: Columns) -> MeasuredTable:
    """Return rows of NIST: forward is phir = 0 for thetai below 0, and 180 deg for thetai above."""
    turned = np.where(columns["thetai"] > 0.0, 180.0, 0.0)
    around = np.deg2rad(columns["phir"] + turned)
    ratios = np.ones((around.size, 3, 3))
    for i, j in _ELEMENTS[1:]:
        ratios[:, i, j] = columns[f"f_r{i + 1}{j + 1}/f_r11"]
    return MeasuredTable(
        source=str(path),
        wavelength_m=columns["lambda"] / 1e6,
        theta_i_rad=np.abs(np.deg2rad(columns["thetai"])),
        theta_r_rad=np.deg2rad(columns["thetar"]),
        phi_rad=around - np.pi,
        f00_per_sr=columns["f_r11"],
        ratios=rotation(around) @ ratios,
        is_degree=False,
    )


def _of_own(path: Path, columns: Columns, names: Sequence[str]) -> MeasuredTable:
    ratios = np.full((columns["f00_per_sr"].size, 3, 3), np.nan)
    ratios[:, 0, 0] = 1.0
    places = {"s1": (1, 0), "s2": (2, 0), "dolp": (1, 0)} | {f"m{i}{j}": (i, j) for i, j in _ELEMENTS}
    for name in names:
        ratios[(slice(None), *places[name])] = columns[name]
    return MeasuredTable(
        source=str(path),
        wavelength_m=columns["wavelength_nm"] / 1e9,
        theta_i_rad=np.deg2rad(columns["incidence_deg"]),
        theta_r_rad=np.deg2rad(columns["reflection_deg"]),
        phi_rad=np.deg2rad(columns["azimuth_deg"]),
        f00_per_sr=columns["f00_per_sr"],
        ratios=ratios,
        is_degree=names == ("dolp",),
    )
