"""`rigctl surface`: DoLP and reflectance of a material by angle, and the sources of its values."""

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from rigctl.console import Json, note
from rigctl.errors import ConfigError
from rigctl.files.choices import DiffuseKind, Shadowing
from rigctl.verbs.options import FilePath, Files, Part, Result, Writes

if TYPE_CHECKING:
    from model.surface.materials import Material
    from rigctl.report.document import AnyTable
    from rigctl.scene.reflected_light import SurfaceSheet

_FILES = ("surface.png", "hemisphere.png", "surface.json", "surface.csv")
# Material files among the examples, listed after the library.
_EXAMPLES = "paper/rough-*.toml"


def surface(
    material: str | None = None,
    /,
    *more: str,
    listed: Annotated[bool, Parameter(name="--list")] = False,
    wavelength_nm: float = 550.0,
    sun_zenith_deg: float = 45.0,
    shadowing: Shadowing = "v-cavity",
    diffuse: DiffuseKind | None = None,
    at: FilePath | None = None,
    out: Annotated[FilePath | None, Writes(kind="folder", names=_FILES)] = None,
) -> "SurfaceResult | SurfaceReadings | ManySurfaces | MaterialList":
    """Print DoLP and reflectance of a material against angle, and the source of each of its values.

    A scene file uses such a material by `material = "black-paint"` in a region.

    Example: rigctl surface --list

    Example: rigctl surface black-paint --sun-zenith-deg 50 --out black-paint

    Example: rigctl surface black-paint white-paint asphalt --out paints

    Example: rigctl surface white-paint --at geometries.csv > white-paint.csv

    Parameters
    ----------
    material : str
        Material file, or a name of the library such as black-paint, white-paint or asphalt.
    more : str
        More materials to compare: one line each, and one picture with all curves.
    listed : bool
        List all materials that come with the program: values, uncertainties, sources, and what is assumed.
    wavelength_nm : float
        Wavelength in air, within the material's tables [nm].
    sun_zenith_deg : float
        Angle of the sun from the normal, 0 to below 90 [deg].
    shadowing : {"none", "v-cavity", "smith", "smith-correlated"}
        Model of shadowing and masking between facets.
    diffuse : {"lambert", "balance", "coupled", "polarised", "volume"}
        Model of the diffuse term, in place of the one of the material.
    at : path
        CSV file of geometries with the columns incidence_deg, reflection_deg, azimuth_deg (180 is forward) and, if it
        varies, wavelength_nm. They are printed as CSV with f00_per_sr and, for unpolarized incident light, s1 and s2
        (over S0), dolp and their standard uncertainties.
    out : path
        Folder for surface.png (against angle), hemisphere.png (all directions of the camera) and surface.json; with
        --at for surface.csv and surface.json.

    Returns
    -------
    SurfaceResult, SurfaceReadings, ManySurfaces or MaterialList
        Reflected light of a material, also in given geometries; of several materials; or a list of materials.

    Raises
    ------
    ConfigError
        There is no such material, or a number is outside its range.
    """
    if listed:
        return MaterialList(materials=_materials())
    if material is None:
        raise ConfigError("MATERIAL is missing; rigctl surface --list shows the materials of the library")
    if not 0.0 <= sun_zenith_deg < 90.0:
        raise ConfigError(f"--sun-zenith-deg: is {sun_zenith_deg:g}, must lie in [0, 90)")
    if at is not None:
        if more:
            raise ConfigError(f"--at {at}: needs one material, {1 + len(more)} are given")
        read = _readings(material, Path(at), wavelength_nm, shadowing=shadowing, diffuse=diffuse)
        if out is not None:
            note(f"written: {', '.join(read.write(Path(out)))} in {out}", below=True)
        return read
    sheets = tuple(
        _sheet(str(one), wavelength_nm, sun_zenith_deg, shadowing=shadowing, diffuse=diffuse)
        for one in (material, *more)
    )
    found = ManySurfaces(sheets=sheets) if more else SurfaceResult(sheet=sheets[0])
    if out is not None:
        note(f"written: {', '.join(found.write(Path(out)))} in {out}", below=True)
    return found


def _sheet(
    name: str, wavelength_nm: float, sun_zenith_deg: float, *, shadowing: Shadowing, diffuse: DiffuseKind | None
) -> "SurfaceSheet":
    from model.surface.materials import surface_of
    from rigctl.files.materials import NM_PER_M, find_material
    from rigctl.scene.reflected_light import surface_sheet

    stated = find_material(name, beside=Path())
    try:
        own = surface_of(stated, wavelength_m=wavelength_nm / NM_PER_M, shadowing=shadowing, diffuse=diffuse)
        return surface_sheet(stated, own, wavelength_nm=wavelength_nm, sun_zenith_deg=sun_zenith_deg)
    except ValueError as error:
        raise ConfigError(str(error)) from error


_GEOMETRY = ("incidence_deg", "reflection_deg", "azimuth_deg")
_READINGS = ("f00_per_sr", "s1", "s2", "dolp")
_ROUNDING = 1e-15


def _readings(
    name: str, at: Path, wavelength_nm: float, *, shadowing: Shadowing, diffuse: DiffuseKind | None
) -> "SurfaceReadings":
    import numpy as np

    from model.surface.materials import surface_of
    from rigctl.files.csv_table import read_number_table
    from rigctl.files.materials import NM_PER_M, find_material
    from rigctl.scene.reflected_light import readings_at

    stated = find_material(name, beside=Path())
    given = read_number_table(at, needs=_GEOMETRY, may_have=("wavelength_nm",))
    angles_rad = [np.deg2rad(given[key]) for key in _GEOMETRY]
    at_nm = given.setdefault("wavelength_nm", np.full(angles_rad[0].size, wavelength_nm))
    found = np.empty((2, at_nm.size, len(_READINGS)))
    try:
        for nm in np.unique(at_nm):
            rows = at_nm == nm
            found[:, rows] = readings_at(
                stated,
                *(angle[rows] for angle in angles_rad),
                surface_of=lambda one, nm=nm: surface_of(  # type: ignore[misc]
                    one, wavelength_m=nm / NM_PER_M, shadowing=shadowing, diffuse=diffuse
                ),
            )
    except ValueError as error:
        raise ConfigError(f"{at}: {error}") from error
    # Shares of f00, sums of terms up to 1: what is left of those that cancel is rounding.
    found[np.abs(found) < _ROUNDING] = 0.0
    columns = {key: given[key] for key in (*_GEOMETRY, "wavelength_nm")}
    columns |= {key: found[0, :, k] for k, key in enumerate(_READINGS)}
    columns |= {f"{key}_std": found[1, :, k] for k, key in enumerate(_READINGS)}
    return SurfaceReadings(material=stated.name, columns={key: column.tolist() for key, column in columns.items()})


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceReadings(Result):
    """Reflected light of a material in given geometries; undefined numbers, such as DoLP without light, are NaN."""

    material: str
    columns: dict[str, list[float]]

    def _table(self) -> "AnyTable":
        from rigctl.report.document import Table, value_columns

        return Table(columns=value_columns(*self.columns), rows=tuple(zip(*self.columns.values(), strict=True)))

    def content(self) -> Iterable[Part]:
        """Return the table as CSV."""
        yield self._table().csv().rstrip()

    def show(self) -> None:
        """Print CSV without line breaks for the terminal."""
        sys.stdout.write("".join(f"{part}\n" for part in self.content()))

    def as_json(self) -> dict[str, Json]:
        """Return the material and an object for each geometry."""
        return {"material": self.material, "geometries": self._table().json()}

    def output_files(self) -> Files:
        """Return the table and the numbers."""
        return {"surface.csv": self._table(), "surface.json": self.as_json()}

    def table(self, *, backend: Literal["pandas", "polars"] = "pandas") -> Any:
        """Return the columns as a data frame."""
        return self._table().data_frame(backend)


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceResult(Result):
    """Reflected light of a material: tables and pictures."""

    sheet: "SurfaceSheet"

    def __repr__(self) -> str:
        sheet = self.sheet
        return f"<{sheet.material} at {sheet.wavelength_nm:g} nm, sun at {sheet.sun_zenith_deg:g} deg>"

    def content(self) -> Iterable[Part]:
        """Return the most DoLP, the material's values, light in the plane of the sun, reflectance, and findings."""
        from rigctl.report.surface import most_polarized, surface_tables

        yield most_polarized([self.sheet])
        for table in surface_tables(self.sheet):
            yield table
            yield ""
        yield from (f"finding: {finding}" for finding in self.sheet.findings)

    def as_json(self) -> dict[str, Json]:
        """Return the content of surface.json."""
        from rigctl.report.surface import surface_json

        return surface_json(self.sheet)

    def output_files(self) -> Files:
        """Return pictures and numbers."""
        from rigctl.report.surface import hemisphere_picture, surface_picture
        from rigctl.scene.reflected_light import reflected_maps

        curve, hemisphere = reflected_maps(self.sheet.surface, sun_zenith_deg=self.sheet.sun_zenith_deg)
        return {
            "surface.png": surface_picture(self.sheet, curve),
            "hemisphere.png": hemisphere_picture(self.sheet, hemisphere),
            "surface.json": self.as_json(),
        }

    def table(self, *, backend: Literal["pandas", "polars"] = "pandas") -> Any:
        """Return camera_zenith_deg, f00_per_sr, s1n and dolp in the plane of sun and normal."""
        from rigctl.report.document import Column, Table

        keys = ("camera_zenith_deg", "f00_per_sr", "s1n", "dolp")
        columns = tuple(Column[Any](key=key) for key in keys)
        return Table(columns=columns, rows=self.sheet.principal_plane).data_frame(backend)


@dataclass(frozen=True, kw_only=True, eq=False)
class ManySurfaces(Result):
    """Reflected light of several materials, side by side."""

    sheets: "tuple[SurfaceSheet, ...]"

    def content(self) -> Iterable[Part]:
        """Return the material that polarizes most, then a line for each."""
        from rigctl.report.surface import most_polarized, overview_table

        yield most_polarized(self.sheets)
        yield overview_table(self.sheets)
        for sheet in self.sheets:
            yield from (f"{sheet.material}: finding: {finding}" for finding in sheet.findings)

    def as_json(self) -> dict[str, Json]:
        """Return the content of surface.json: for each material the same as for a single one."""
        from rigctl.report.surface import surface_json

        return {"materials": [surface_json(sheet) for sheet in self.sheets]}

    def output_files(self) -> Files:
        """Return one picture of all, and the numbers."""
        from rigctl.report.surface import surfaces_picture

        return {"surface.png": surfaces_picture(self.sheets), "surface.json": self.as_json()}


@dataclass(frozen=True, kw_only=True, eq=False)
class MaterialList(Result):
    """All materials of the program: the library by names, others by the paths of their files."""

    materials: "dict[str, Material]"

    def content(self) -> Iterable[Part]:
        """Return the number of materials, and a table of all values with their sources."""
        from rigctl.report.surface import materials_table

        yield f"{len(self.materials)} materials; each name is one for rigctl surface and for scene files"
        yield materials_table(self.materials)

    def as_json(self) -> dict[str, Json]:
        """Return the content for JSON."""
        from rigctl.report.surface import materials_json

        return {"materials": materials_json(self.materials)}


def _materials() -> "dict[str, Material]":
    from importlib.resources import as_file, files

    from model.surface.materials import MATERIALS, material
    from rigctl.files.materials import load_material

    found = {name: material(name) for name in MATERIALS}
    with as_file(files("rigctl") / "data" / "examples") as examples:
        for path in sorted(examples.glob(_EXAMPLES)):
            found[f"examples/{path.relative_to(examples)}"] = load_material(path)
    return found
