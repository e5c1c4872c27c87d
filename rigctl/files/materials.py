"""Material files: the properties of a surface with their sources, or a table of measured BRDF."""

import json
import math
import tomllib
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from model.stokes import rotation
from model.surface.materials import MATERIALS, Confidence, Material, Property, material, properties, tabulated
from model.surface.pbrdf import ASYMMETRY_MOST, DiffuseKind
from model.surface.table import MeasuredTable
from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
from rigctl.errors import ConfigError
from rigctl.files.csv_table import Columns, Problem, columns_of, csv_lines, header_of
from rigctl.files.toml import Section, Within, load

# Dividing by a whole number rounds once: 550 becomes 550e-9 exactly.
NM_PER_M = 1e9

Number = Annotated[float, Field(strict=True)]
Wavelengths = Annotated[list[Annotated[Number, Field(gt=0)]], Field(min_length=2)]


def _listed(given: object) -> object:
    return given if isinstance(given, list) else [given]


class PropertySection(Section):
    """One property: a plain number, ``{value, std, ...}``, or lists of the same length as a table over wavelength.

    A value without a source counts as assumed unless the file says otherwise.
    """

    value: Annotated[list[Number], BeforeValidator(_listed)]
    """The number, or one for each wavelength. Example: `1.5`."""
    wavelength_nm: Wavelengths | None = None
    """Rising wavelengths of the values. Example: `[400.0, 700.0]`."""
    std: Annotated[float, Field(ge=0)] = 0.0
    """Standard uncertainty of each value. Example: `0.02`."""
    source: Annotated[str, Field(pattern=r"\S")] = "no source given"
    """Where the number is from. Example: `"measured on 2026-05-04"`."""
    confidence: Confidence = "low"
    """Trust in the source. Example: `"medium"`."""
    assumed: bool = True
    """Not measured on this surface. Example: `false`."""

    @model_validator(mode="before")
    @classmethod
    def _plain_number(cls, given: object) -> object:
        return given if isinstance(given, dict) else {"value": given}

    @model_validator(mode="after")
    def _one_value_for_each_wavelength(self) -> "PropertySection":
        expected = 1 if self.wavelength_nm is None else len(self.wavelength_nm)
        if len(self.value) != expected:
            raise ValueError(f"has {len(self.value)} values, needs one, or as many as it has wavelength_nm")
        if self.wavelength_nm is not None and sorted(set(self.wavelength_nm)) != self.wavelength_nm:
            raise ValueError("has a wavelength_nm that does not ascend")
        return self


Above0 = Annotated[PropertySection, Within(gt=0)]
NotBelow0 = Annotated[PropertySection, Within(ge=0)]
From0To1 = Annotated[PropertySection, Within(ge=0, le=1)]
Cosine = Annotated[PropertySection, Within(ge=-ASYMMETRY_MOST, le=ASYMMETRY_MOST)]


class MaterialFile(Section):
    """Content of a material file; `model.surface.pbrdf.Surface` explains the properties.

    A file with `table = "FILE.csv"`, a table of measured BRDF, has only this key and a name.
    """

    schema_version: Literal[1] = 1
    """Version of the layout. Example: `1`."""
    name: Annotated[str, Field(pattern=r"\S")]
    """Name of the material. Example: `"my black paint"`."""
    n: Above0
    """Real part of the refractive index. Example: `{ value = 1.5, std = 0.02 }`."""
    k: NotBelow0 = PropertySection(value=[0.0], source="not in the file: taken as 0, no absorption")
    """Imaginary part of the refractive index. Example: `0.0`."""
    slope_rms: Above0
    """Deviation of the facets' slopes. Example: `{ value = 0.25, std = 0.05 }`."""
    dhr: From0To1 | None = None
    """Directional-hemispherical reflectance. Example: `{ value = 0.05, std = 0.01 }`."""
    dhr_angle_deg: Annotated[float, Field(ge=0, lt=90)] = 8.0
    """Angle from the normal at which dhr was measured. Example: `8.0`."""
    specular_weight: From0To1 = PropertySection(value=[1.0], source="not in the file: taken as 1, a clean surface")
    """Factor on the light that facets mirror. Example: `1.0`."""
    diffuse: DiffuseKind | None = None
    """Form of the diffuse term; left out, `"volume"` with single_scattering, else `"coupled"`. Example: `"volume"`."""
    single_scattering: From0To1 | None = None
    """Weight of light that keeps the pattern of one scattering. Example: `{ value = 0.75, std = 0.03 }`."""
    asymmetry: Cosine | None = None
    """Mean cosine of the angle by which a particle scatters. Example: `{ value = 0.5, std = 0.05 }`."""
    single_dolp: From0To1 | None = None
    """DoLP of unpolarized light that a particle scatters by 90 deg. Example: `{ value = 0.23, std = 0.02 }`."""
    depolarization: From0To1 | None = None
    """Share of polarized light that a particle depolarizes. Example: `{ value = 0.3, std = 0.02 }`."""


class TableMaterialFile(Section):
    """Content of a material file that names a table of measured BRDF in place of properties."""

    schema_version: Literal[1] = 1
    """Version of the layout. Example: `1`."""
    name: Annotated[str, Field(pattern=r"\S")]
    """Name of the material. Example: `"my white panel"`."""
    table: Path
    """CSV file of measured BRDF. Example: `"my-panel.csv"`."""


# Of tables of measured BRDF; other files of materials are TOML.
TABLE_SUFFIXES = (".csv", ".txt", ".dat")


def load_table(path: Path) -> MeasuredTable:
    """Return the measured geometries of a CSV file; an unchanged file is read once."""
    try:
        stated = path.stat()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    return _read_table(path.resolve(), stated.st_mtime_ns, stated.st_size)


@lru_cache(maxsize=8)
def _read_table(path: Path, _changed_ns: int, _size: int) -> MeasuredTable:
    return read_brdf_table(path)


def _names_table(path: Path) -> bool:
    try:
        return "table" in tomllib.loads(read_bounded(path, MOST_TEXT_BYTES).decode())
    except (OSError, ValueError):  # `load` reports the problem
        return False


def load_material(path: Path) -> Material:
    """Return the material of a material file, or of a table of measured BRDF."""
    if path.suffix.lower() in TABLE_SUFFIXES:
        return tabulated(path.stem, load_table(path))
    if _names_table(path):
        named = load(path, TableMaterialFile)
        return tabulated(named.name, load_table(path.parent / named.table))
    file = load(path, MaterialFile)
    stated = {name: getattr(file, name) for name in MaterialFile.model_fields}
    given: dict[str, Any] = {
        name: _property(found) for name, found in stated.items() if isinstance(found, PropertySection)
    }
    return Material(
        name=file.name,
        **given,
        dhr_angle_rad=math.radians(file.dhr_angle_deg),
        diffuse=file.diffuse or ("coupled" if file.single_scattering is None else "volume"),
    )


def find_material(name_or_path: str, *, beside: Path) -> Material:
    """Return a material of the library by its name, or else from a file.

    Relative paths count from the folder `beside`, that of the file that names the material.
    """
    if name_or_path in MATERIALS:
        return material(name_or_path)
    path = beside / name_or_path
    if not path.is_file():
        known = ", ".join(MATERIALS)
        close = get_close_matches(name_or_path, MATERIALS, n=1)
        alike = f"; did you mean {close[0]}?" if close else ""
        raise ConfigError(
            f"material {name_or_path!r}: must be one of {known}, a material file or a table of measured "
            f"BRDF (.csv); none at {path}{alike}"
        )
    return load_material(path)


def material_toml(material: Material) -> str:
    """Return a material as the text of a material file, which `load_material` reads back."""
    lines = [
        f"name = {_quoted(material.name)}",
        f"dhr_angle_deg = {math.degrees(material.dhr_angle_rad):.12g}",
        f'diffuse = "{material.diffuse}"',
    ]
    for name, given in properties(material).items():
        lines += ["", f"[{name}]"]
        if given.wavelengths_m:
            lines.append(f"wavelength_nm = {[round(w * NM_PER_M, 6) for w in given.wavelengths_m]}")
        lines += [
            f"value = {list(given.values) if given.wavelengths_m else given.values[0]}",
            f"std = {given.standard_uncertainty}",
            f"source = {_quoted(given.source)}",
            f"confidence = {_quoted(given.confidence)}",
            f"assumed = {'true' if given.assumed else 'false'}",
        ]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    # A JSON string is a TOML basic string too.
    return json.dumps(text, ensure_ascii=False)


def _property(section: PropertySection) -> Property:
    return Property(
        values=tuple(section.value),
        wavelengths_m=tuple(wavelength / NM_PER_M for wavelength in section.wavelength_nm or ()),
        standard_uncertainty=section.std,
        source=section.source,
        confidence=section.confidence,
        assumed=section.assumed,
    )


# Tables of measured BRDF and polarization that people bring, read into the project's frames.

_NIST = ("lambda", "thetai", "phi", "thetar", "phir", "f_r11")
_OWN = ("incidence_deg", "reflection_deg", "azimuth_deg", "wavelength_nm", "f00_per_sr")
_ELEMENTS = tuple((i, j) for i in range(3) for j in range(3))
_MATRIX = tuple(f"m{i}{j}" for i, j in _ELEMENTS[1:])
# An element over f00 exceeds 1 only by noise.
_RATIO_MOST = 1.2


def read_brdf_table(path: Path) -> MeasuredTable:
    """Return the measured geometries of a CSV file.

    Raises
    ------
    ConfigError
        The file cannot be read, its layout is unknown, or rows are wrong (up to twenty are listed).
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
    yield "phi", columns["phi"] != 0.0, "be 0, for incidence in the plane of the instrument"
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
