"""Tables of a material for the terminal."""

from collections.abc import Iterable

from rich.table import Table

from rigctl.reports.surface_sheet import SurfaceSheet


def surface_tables(sheet: SurfaceSheet) -> Iterable[Table]:
    """Return what goes into a material, what it reflects in the principal plane, and how much in all."""
    yield _properties(sheet)
    yield _principal_plane(sheet)
    yield _reflectance(sheet)


def _properties(sheet: SurfaceSheet) -> Table:
    surface = sheet.surface
    table = _table(
        f"{sheet.material} at {sheet.wavelength_nm:g} nm, shadowing {surface.shadowing}, "
        f"diffuse {'none' if surface.dhr is None else surface.diffuse}"
    )
    for column in ("property", "value", "± std", "basis", "confidence", "source"):
        table.add_column(
            column, justify="right" if column in ("value", "± std") else "left", no_wrap=column != "source"
        )
    for given in sheet.properties:
        basis = "assumed" if given.assumed else "measured"
        table.add_row(given.name, f"{given.value:.5g}", f"{given.std:.2g}", basis, given.confidence, given.source)
    return table


def _principal_plane(sheet: SurfaceSheet) -> Table:
    table = _table(
        f"principal plane, sun at {sheet.sun_zenith_deg:g} deg, unpolarised light; "
        "camera zenith: positive towards the glint, negative on the sun's side"
    )
    for column in ("camera [deg]", "F00 [1/sr]", "S1/S0", "DoLP"):
        table.add_column(column, justify="right")
    for light in sheet.principal_plane:
        table.add_row(
            f"{light.camera_zenith_deg:+.0f}",
            f"{light.f00_per_sr:.5g}",
            _or_dash(light.s1n, "+z.4f"),
            _or_dash(light.dolp),
        )
    return table


def _reflectance(sheet: SurfaceSheet) -> Table:
    table = _table(
        "directional-hemispherical reflectance by angle of incidence: of unpolarised light, the specular lobe's part "
        "of it, and of light polarised horizontally and vertically"
    )
    for column in ("sun [deg]", "DHR", "specular", "horizontal", "vertical", "error"):
        table.add_column(column, justify="right")
    for given in sheet.reflectance:
        numbers = (given.total, given.specular, given.horizontal, given.vertical)
        table.add_row(f"{given.zenith_deg:.0f}", *(f"{number:.4f}" for number in numbers), f"{given.error:.0e}")
    return table


def _table(title: str) -> Table:
    return Table(title=title, title_justify="left", box=None, pad_edge=False)


def _or_dash(number: float | None, form: str = ".4f") -> str:
    return "-" if number is None else format(number, form)
