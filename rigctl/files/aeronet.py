"""AERONET files of version 3 (CSV): optical depth, refractive index and sizes of the aerosol.

Two kinds are understood, of level 1.5 or 2.0, all points or daily averages: AOD files (columns AOD_440nm, ...,
440-870_Angstrom_Exponent, Ozone(Dobson)) and inversion products (AOD_Coincident_Input[440nm] or
AOD_Extinction-Total[440nm], Refractive_Index-Real_Part[440nm], ..., and dV/dln(r) in columns named by radii in um;
whole or as parts .aod, .rin, .siz). -999 is a missing value. The layouts are those of https://aeronet.gsfc.nasa.gov.
"""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
from rigctl.errors import ConfigError
from rigctl.files.csv_table import refuse

_DEPTH = re.compile(r"AOD_(\d+)nm$")
_INVERTED_DEPTH = re.compile(r"(?:AOD_Coincident_Input|AOD_Extinction-Total)\[(\d+)nm\]$")
_REAL = re.compile(r"Refractive_Index-Real_Part\[(\d+)nm\]$")
_IMAGINARY = re.compile(r"Refractive_Index-Imaginary_Part\[(\d+)nm\]$")
_RADIUS = re.compile(r"\d+\.\d+$")
_MEASURED = (_DEPTH, _INVERTED_DEPTH, _REAL, _IMAGINARY, _RADIUS)
_EXPONENT, _OZONE = "440-870_Angstrom_Exponent", "Ozone(Dobson)"
_LEVEL = re.compile(r"Level (\d\.\d)")
_LEVELS = ("1.5", "2.0")
# Largest distance of a row from the time of the scene; daily averages belong to their day.
_FURTHEST, _FURTHEST_DAILY = timedelta(hours=3), timedelta(hours=24)
# Of optical depth from a field instrument: Giles et al. (2019), doi:10.5194/amt-12-169-2019.
_DEPTH_STD = 0.01
# Angstrom's law is taken from two wavelengths in this range, preferably from these.
_LEAST_NM, _MOST_NM, _BEST_NM = 380.0, 1020.0, (440.0, 870.0)


@dataclass(frozen=True, kw_only=True)
class Aeronet:
    """What AERONET files say of the air at a time."""

    source: str  #: Site, level and time, in words.
    depths: tuple[tuple[float, float, float], ...]  #: Two of wavelength [nm], optical depth and its std; or none.
    ozone_du: float | None
    radius_um: tuple[float, ...]  #: Of the table of sizes; empty without an inversion, as what follows.
    volume_per_log_radius: tuple[float, ...]
    index_wavelength_nm: tuple[float, ...]
    n: tuple[float, ...]
    k: tuple[float, ...]

    @property
    def has_particles(self) -> bool:
        """True if sizes and refractive index are known."""
        return bool(self.radius_um) and bool(self.n)


def read_aeronet(paths: Sequence[Path], *, near: datetime | None) -> Aeronet:
    """Return the properties of the air in AERONET files: the row next to a time, or the mean of all rows without one.

    Raises
    ------
    ConfigError
        A file cannot be read or has another layout, no row near that time, or no usable column.
    """
    found: dict[str, tuple[float, float]] = {}
    sources = []
    for path in paths:
        values, source = _row(path, near)
        found |= {name: value for name, value in values.items() if name not in found}
        sources.append(source)
    indices = _by_number(found, _REAL)
    absorbing = _by_number(found, _IMAGINARY)
    sizes = {float(name): value for name, (value, _) in found.items() if _RADIUS.match(name)}
    indexed_nm = sorted(indices.keys() & absorbing.keys())
    result = Aeronet(
        source="; ".join(dict.fromkeys(sources)),
        depths=_depths(found),
        ozone_du=found[_OZONE][0] if _OZONE in found else None,
        radius_um=tuple(sorted(sizes)),
        volume_per_log_radius=tuple(max(sizes[radius], 0.0) for radius in sorted(sizes)),
        index_wavelength_nm=tuple(indexed_nm),
        n=tuple(indices[nm][0] for nm in indexed_nm),
        k=tuple(absorbing[nm][0] for nm in indexed_nm),
    )
    if not result.depths:
        names = ", ".join(map(str, paths))
        raise ConfigError(
            f"{names}: the rows lack optical depths at two wavelengths (or at one, with {_EXPONENT}); add the AOD file "
            "of the same site"
        )
    return result


def _row(path: Path, near: datetime | None) -> tuple[dict[str, tuple[float, float]], str]:
    """Return values and spread of the row next to a time, or of all, without missing ones; and their source."""
    head, names, rows = _table(path)
    columns = {name: k for k, name in enumerate(names)}
    date, time = (
        next((k for name, k in columns.items() if name.startswith(start)), None) for start in ("Date", "Time")
    )
    wanted = [name for name in names if name in (_EXPONENT, _OZONE) or any(one.match(name) for one in _MEASURED)]
    if date is None or time is None or not wanted:
        raise ConfigError(
            f"{path}: is not an AERONET AOD or inversion file: its columns need Date(dd:mm:yyyy), Time(hh:mm:ss), and "
            "AOD_*nm, Refractive_Index-*, or radii of a size distribution"
        )
    problems, times, values = [], [], []
    for line, row in rows:
        try:
            times.append(datetime.strptime(f"{row[date]} {row[time]}", "%d:%m:%Y %H:%M:%S").replace(tzinfo=UTC))
        except (ValueError, IndexError):
            problems.append(f"line {line}: date and time are not dd:mm:yyyy and hh:mm:ss")
            continue
        numbers = [_number(row, columns[name]) for name in wanted]
        problems += [
            f"line {line}: {name} is {_cell(row, columns[name])!r}, must be a number"
            for name, number in zip(wanted, numbers, strict=True)
            if number is None
        ]
        values.append([math.nan if number is None else number for number in numbers])
    if not rows:
        problems.append("has no row of numbers")
    refuse(path, problems)
    table = np.array(values)
    site = head[1].strip() if len(head) > 1 else path.stem
    words = f"AERONET {site}, level {_level(path, head)}"
    if near is None:
        with np.errstate(all="ignore"):
            used = [(name, column[np.isfinite(column)]) for name, column in zip(wanted, table.T, strict=True)]
        mean = {name: (float(np.mean(c)), float(np.std(c))) for name, c in used if c.size}
        return mean, f"{words}, mean of {len(times)} rows"
    furthest = _FURTHEST_DAILY if any("Daily" in line for line in head) else _FURTHEST
    # Rows without any value do not count.
    apart = [
        abs(when - near) if np.any(np.isfinite(row)) else timedelta.max for when, row in zip(times, table, strict=True)
    ]
    nearest = min(range(len(times)), key=apart.__getitem__)
    if apart[nearest] > furthest:
        raise ConfigError(
            f"{path}: has no row within {furthest.total_seconds() / 3600:g} h of {near.astimezone(UTC):%Y-%m-%d %H:%M} "
            f"UTC; its rows are from {min(times):%Y-%m-%d %H:%M} to {max(times):%Y-%m-%d %H:%M}"
        )
    chosen = {name: (float(x), 0.0) for name, x in zip(wanted, table[nearest], strict=True) if math.isfinite(x)}
    return chosen, f"{words}, {times[nearest]:%Y-%m-%d %H:%M} UTC"


def _table(path: Path) -> tuple[list[str], list[str], list[tuple[int, list[str]]]]:
    """Return the lines before the columns' names, these names, and the rows with their line numbers."""
    try:
        lines = read_bounded(path, MOST_TEXT_BYTES).decode("latin-1").splitlines()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    at = next((k for k, line in enumerate(lines) if "Date" in line and "Time" in line and line.count(",") > 2), None)
    if at is None or not lines[0].startswith("AERONET Version 3"):
        raise ConfigError(
            f"{path}: is not an AERONET file of version 3: its first line must begin with AERONET Version 3, and a "
            "later one must name the columns (Date(dd:mm:yyyy),Time(hh:mm:ss),...)"
        )
    names = [name.strip() for name in lines[at].split(",")]
    rows = csv.reader(lines[at + 1 :])
    return lines[:at], names, [(k, row) for k, row in enumerate(rows, start=at + 2) if "".join(row).strip()]


def _level(path: Path, head: Sequence[str]) -> str:
    found = next((match.group(1) for line in head if (match := _LEVEL.search(line))), "unknown")
    if found not in _LEVELS:
        raise ConfigError(f"{path}: is of level {found}; cloud-free data of level {' or '.join(_LEVELS)} are needed")
    return found


def _cell(row: Sequence[str], place: int) -> str:
    return (row[place].strip() if place < len(row) else "") or "empty"


def _number(row: Sequence[str], place: int) -> float | None:
    """Return a cell's number, NaN for -999 (missing), None if it is not a number."""
    try:
        number = float(_cell(row, place))
    except ValueError:
        return None
    if not math.isfinite(number):
        return None
    return math.nan if number <= -999.0 else number


def _by_number(found: Mapping[str, tuple[float, float]], pattern: re.Pattern[str]) -> dict[float, tuple[float, float]]:
    """Return values by the wavelength in the name of their column; the first of each wavelength."""
    by: dict[float, tuple[float, float]] = {}
    for name, value in found.items():
        if match := pattern.match(name):
            by.setdefault(float(match.group(1)), value)
    return by


def _depths(found: Mapping[str, tuple[float, float]]) -> tuple[tuple[float, float, float], ...]:
    """Return two wavelengths with their optical depth: 440 and 870 nm, or the nearest measured ones."""
    measured = _by_number(found, _INVERTED_DEPTH) | _by_number(found, _DEPTH)
    usable = sorted(nm for nm, (depth, _) in measured.items() if _LEAST_NM <= nm <= _MOST_NM and depth > 0.0)
    chosen = sorted({min(usable, key=lambda nm: abs(nm - best)) for best in _BEST_NM}) if usable else []
    depths = [(nm, measured[nm][0], math.hypot(_DEPTH_STD, measured[nm][1])) for nm in chosen]
    if len(depths) == 1 and _EXPONENT in found:
        nm, depth, std = depths[0]
        other = next(best for best in reversed(_BEST_NM) if best != nm)
        depths.append((other, depth * (other / nm) ** -found[_EXPONENT][0], std))
    return tuple(sorted(depths)) if len(depths) == 2 else ()
