"""The sky of a scene, and that of one kind of aerosol after another: lines and tables for the terminal, and JSON."""

from dataclasses import asdict
from typing import Any

from rigctl.reports.table import Column, Table
from rigctl.scene.sky_map import SkyMap, SkyOfKind, sky_difference

SCHEMA_VERSION = 1


def sky_lines(sky: SkyMap) -> tuple[str, ...]:
    """Return what is to be known of a sky, in words."""
    degree, zenith_deg, azimuth_deg = sky.largest_dolp
    return (
        f"sun: zenith {sky.sun_zenith_deg:.2f} deg, azimuth {sky.sun_azimuth_deg:.2f} deg",
        (
            f"irradiance in band: beam {sky.direct_irradiance:.4g} W m-2 on a plane normal to it, sky "
            f"{sky.sky_irradiance:.4g} W m-2 on level ground"
        ),
        f"largest DoLP {degree:.3f} at zenith {zenith_deg:.0f} deg, azimuth {azimuth_deg:.0f} deg",
        *sky.remarks,
    )


def title_lines(sky: SkyMap) -> tuple[str, ...]:
    """Return the heading of a figure."""
    return (f"{sky.name}: north at the top, azimuth clockwise, horizon outside", sky_lines(sky)[0], *sky.remarks[:1])


def sky_json(sky: SkyMap) -> dict[str, Any]:
    """Return a sky as JSON holds it."""
    degree, zenith_deg, azimuth_deg = sky.largest_dolp
    return {
        "schema_version": SCHEMA_VERSION,
        "scene": sky.name,
        "sun": {"zenith_deg": sky.sun_zenith_deg, "azimuth_deg": sky.sun_azimuth_deg},
        "direct_irradiance": sky.direct_irradiance,
        "sky_irradiance": sky.sky_irradiance,
        "largest_dolp": {"dolp": degree, "zenith_deg": zenith_deg, "azimuth_deg": azimuth_deg},
        "relative_error": sky.relative_error,
        "zenith_deg": sky.zenith_deg.tolist(),
        "azimuth_deg": sky.azimuth_deg.tolist(),
        "stokes": sky.stokes.tolist(),
        "remarks": list(sky.remarks),
    }


def kinds_table(found: tuple[SkyOfKind, ...]) -> Table[SkyOfKind]:
    """Return the kinds, a row each: irradiances, largest DoLP, and how far the sky is from that of the file."""
    chosen = found[0]
    columns: tuple[Column[SkyOfKind], ...] = (
        Column(title="aerosol", text=lambda one: f"{one.label}{' *' if one.is_chosen else ''}", left=True),
        Column(title="beam W m-2", text=lambda one: f"{one.sky.direct_irradiance:.1f}"),
        Column(title="sky W m-2", text=lambda one: f"{one.sky.sky_irradiance:.1f}"),
        Column(title="largest DoLP", text=lambda one: f"{one.sky.largest_dolp[0]:.3f}"),
        Column(title="zenith, azimuth deg", text=_place),
        Column(
            title="S0 differs, rms",
            text=lambda one: "-" if one.is_chosen else f"{sky_difference(one.sky, chosen.sky).s0_rms:.1%}",
        ),
        Column(
            title="DoLP differs, max",
            text=lambda one: "-" if one.is_chosen else f"{sky_difference(one.sky, chosen.sky).largest_dolp:.3f}",
        ),
    )
    return Table(title=f"{chosen.sky.name}; *: as the file has it", columns=columns, rows=found)


def _place(one: SkyOfKind) -> str:
    _, zenith_deg, azimuth_deg = one.sky.largest_dolp
    return f"{zenith_deg:.0f}, {azimuth_deg:.0f}"


def kinds_json(found: tuple[SkyOfKind, ...]) -> dict[str, Any]:
    """Return the kinds as JSON holds them."""
    return {
        "schema_version": SCHEMA_VERSION,
        "scene": found[0].sky.name,
        "kinds": [
            {
                "aerosol": one.label,
                "is_chosen": one.is_chosen,
                "difference": asdict(sky_difference(one.sky, found[0].sky)),
            }
            | sky_json(one.sky)
            for one in found
        ],
    }
