"""The sky of a scene with one kind of aerosol after another, side by side."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from model.atmosphere.aerosol.models import AerosolType
from model.atmosphere.lighting.fidelity import Fidelity
from model.atmosphere.transfer.phase import AerosolKind
from rigctl.choices import Engine
from rigctl.errors import ConfigError
from rigctl.files.light_sections import AtmosphereSection
from rigctl.files.scene_file import SceneFile
from rigctl.reports.sky_sheet import SkySheet, sky_sheet
from rigctl.reports.table import Column, Table

SCHEMA_VERSION = 1


@dataclass(frozen=True, kw_only=True, eq=False)
class SkyOfKind:
    """The sky with one kind of aerosol.

    Attributes
    ----------
    label : str
        What scatters, in words.
    is_chosen : bool
        Whether the scene file has it so.
    sheet : SkySheet
        Its sky.
    """

    label: str
    is_chosen: bool
    sheet: SkySheet


def skies_of_kinds(scene: SceneFile, *, engine: Engine = "own") -> Iterator[SkyOfKind]:
    """Yield the sky of a scene for each kind of aerosol: that of the file first, its depth at 550 nm in all of them.

    Raises
    ------
    ConfigError
        The scene's sky is a table, which has one aerosol, or cannot be computed.
    """
    own = scene.atmosphere
    if own is None or own.tier is Fidelity.TABLE:
        raise ConfigError(f"--compare-aerosols: {scene.name} has no atmosphere that is computed; a table's sky is one")
    for label, air in _kinds(own):
        changed = scene.model_copy(update={"atmosphere": air.model_copy(update={"alternative": None})})
        yield SkyOfKind(label=label, is_chosen=air is own, sheet=sky_sheet(changed, engine=engine))


def _kinds(own: AtmosphereSection) -> Iterable[tuple[str, AtmosphereSection]]:
    """Yield what the file says; then the other kinds of the same aerosol; then spheres of others below 2 km."""
    name = own.aerosol_type.value if own.own_aerosol is None else own.own_aerosol.name
    yield f"{own.aerosol}, {name}", own
    for kind in AerosolKind:
        if kind is not own.aerosol:
            yield f"{kind}, {name}", own.model_copy(update={"aerosol": kind})
    for other in AerosolType:
        if own.own_aerosol is not None or other is not own.aerosol_type:
            update = {"aerosol": AerosolKind.SPHERES, "aerosol_type": other, "own_aerosol": None}
            yield f"{AerosolKind.SPHERES}, {other.value}", own.model_copy(update=update)


def kinds_table(found: tuple[SkyOfKind, ...]) -> Table[SkyOfKind]:
    """Return the kinds, a row each: irradiances, largest DoLP, and how far the sky is from that of the file."""
    chosen = found[0]
    columns: tuple[Column[SkyOfKind], ...] = (
        Column(title="aerosol", text=lambda one: f"{one.label}{' *' if one.is_chosen else ''}", left=True),
        Column(title="beam W m-2", text=lambda one: f"{one.sheet.direct_irradiance:.1f}"),
        Column(title="sky W m-2", text=lambda one: f"{one.sheet.sky_irradiance:.1f}"),
        Column(title="largest DoLP", text=lambda one: f"{one.sheet.largest_dolp[0]:.3f}"),
        Column(title="zenith, azimuth deg", text=_place),
        Column(
            title="S0 differs, rms",
            text=lambda one: "-" if one.is_chosen else f"{_difference(one, chosen)['s0_rms']:.1%}",
        ),
        Column(
            title="DoLP differs, max",
            text=lambda one: "-" if one.is_chosen else f"{_difference(one, chosen)['largest_dolp']:.3f}",
        ),
    )
    return Table(title=f"{chosen.sheet.name}; *: as the file has it", columns=columns, rows=found)


def _place(one: SkyOfKind) -> str:
    _, zenith_deg, azimuth_deg = one.sheet.largest_dolp
    return f"{zenith_deg:.0f}, {azimuth_deg:.0f}"


def kinds_json(found: tuple[SkyOfKind, ...]) -> dict[str, Any]:
    """Return the kinds as JSON holds them."""
    return {
        "schema_version": SCHEMA_VERSION,
        "scene": found[0].sheet.name,
        "kinds": [
            {"aerosol": one.label, "is_chosen": one.is_chosen, "difference": _difference(one, found[0])}
            | one.sheet.as_json()
            for one in found
        ],
    }


def _difference(one: SkyOfKind, chosen: SkyOfKind) -> dict[str, float]:
    """Difference from the sky of the file: of S0, relative, rms over the solid angle; of DoLP, the largest."""
    sheet, reference = one.sheet, chosen.sheet
    weight = np.sin(np.deg2rad(reference.zenith_deg))[:, np.newaxis] * np.ones(reference.azimuth_deg.size)
    ratio = sheet.stokes[..., 0] / reference.stokes[..., 0] - 1.0
    return {
        "s0_rms": float(np.sqrt(np.average(ratio**2, weights=weight))),
        "largest_dolp": float(np.max(np.abs(sheet.dolp - reference.dolp))),
    }
