"""The page of a polarizer calibration: numbers, scans, harmonics, channels and maps, in one HTML file."""

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from jinja2 import Environment, StrictUndefined

from rigctl.calibrations.polarizer.polarimeter_maps import PolarimeterMaps
from rigctl.calibrations.polarizer.polarizer_calibration import PolarizerCalibration
from rigctl.calibrations.polarizer.polarizer_json import HARMONIC_MEANING, rig_lines
from rigctl.reports.figures.polarizer_figures import channels_png, curves_png, harmonics_png, maps_png


@dataclass(frozen=True, kw_only=True)
class NumberRow:
    """A number of the page, as text."""

    title: str
    value: str
    error: str
    unit: str


@dataclass(frozen=True, kw_only=True)
class MatrixRow:
    """A row of W: values with their errors."""

    name: str
    cells: list[tuple[float, float]]


def polarizer_page(found: PolarizerCalibration, content: dict[str, Any], maps: PolarimeterMaps | None) -> str:
    """Return the page as HTML that needs no other file.

    Parameters
    ----------
    found : PolarizerCalibration
        The calibration, its sense decided.
    content : dict
        What ``polarizer.json`` holds of it.
    maps : PolarimeterMaps or None
        The same over the picture.
    """
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    template = environment.from_string((files("rigctl") / "data" / "polarizer.html.j2").read_text(encoding="utf-8"))
    reduction = content["data_reduction"]
    return template.render(
        title=", ".join(source["path"] for source in content["source"]),
        facts=_facts(content),
        numbers=list(_numbers(content)),
        rig_lines=rig_lines(content),
        content=content,
        meaning=HARMONIC_MEANING,
        curves=_embedded(curves_png(found)),
        harmonics=_embedded(harmonics_png(found)),
        channels=_embedded(channels_png(found)),
        reduction=[] if reduction is None else list(_matrix(reduction)),
        singular="" if reduction is None else ", ".join(f"{value:.4g}" for value in reduction["singular_values"]),
        maps=_embedded(None if maps is None else maps_png(maps)),
        maps_caption="" if maps is None else _maps_caption(maps),
    )


def _facts(content: dict[str, Any]) -> list[str]:
    made = content["made_for"]
    devices = [
        f"{what} {made[f'{what}_model'] or ''} {made[f'{what}_serial']}".replace("  ", " ")
        for what in ("camera", "stage")
        if made[f"{what}_serial"] is not None
    ]
    return [
        *devices,
        f"{content['frames']} frames",
        f"manifest {', '.join(source['sha256'][:16] for source in content['source'])}",
        f"made {content['created_utc'][:19]}Z by {content['created_by']}",
    ]


def _numbers(content: dict[str, Any]) -> Iterable[NumberRow]:
    offset, diattenuation, extinction = (content[name] for name in ("offset_deg", "diattenuation", "extinction_ratio"))
    yield NumberRow(title="sense of rotation", value=f"{content['sense']:+d}", error="", unit="")
    yield NumberRow(title="axis offset", value=f"{offset['value']:.4f}", error=f"{offset['std_error']:.4f}", unit="deg")
    if diattenuation is not None:
        value, error = (f"{diattenuation[part]:.5f}" for part in ("value", "std_error"))
        yield NumberRow(title="diattenuation", value=value, error=error, unit="")
    if extinction is not None:
        upper = "no upper limit" if extinction["upper"] is None else f"{extinction['upper']:.4g}"
        ratio = "not measured" if extinction["ratio"] is None else f"{extinction['ratio']:.4g}"
        interval = f"95 %: {extinction['lower']:.4g} to {upper}"
        yield NumberRow(title="extinction ratio", value=ratio, error=interval, unit="")


def _matrix(reduction: dict[str, Any]) -> Iterable[MatrixRow]:
    for name, values, errors in zip(("S0", "S1", "S2"), reduction["matrix"], reduction["std_error"], strict=True):
        yield MatrixRow(name=name, cells=list(zip(values, errors, strict=True)))


def _maps_caption(maps: PolarimeterMaps) -> str:
    side, left_out = maps.side_pixels, int((~maps.lit).sum())
    beside = f" {left_out} blocks are left out: dark or saturated." if left_out else ""
    return (
        f"Blocks of {side} x {side} pixels, each fitted by itself. Throughput is over its mean over the angles, so "
        f"that uneven light drops out; the axis is shown less its mean over the picture.{beside}"
    )


def _embedded(picture: bytes | None) -> str | None:
    return None if picture is None else base64.b64encode(picture).decode("ascii")
