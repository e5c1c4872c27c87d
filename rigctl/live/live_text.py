"""The live numbers of a session in words: for its own terminal, and for `rigctl status`."""

from collections.abc import Iterator, Mapping
from typing import Any

_SIGNS = "+/-"


def live_lines(live: Mapping[str, Any]) -> Iterator[str]:
    """Give the lines of what a session last said of itself, as `LiveNumbers.content` has it."""
    for angle, numbers in live.get("angles", {}).items():
        yield f"{angle:>6} deg    {_of_angle(numbers)}"
    if live.get("sum_rule"):
        yield f"(I0 + I90) / (I45 + I135)  {_estimate(live['sum_rule'])}"
    for name, found in live.get("regions", {}).items():
        angle = "" if found["aolp_deg"] is None else f", AoLP {found['aolp_deg']:.1f} deg"
        yield f"DoLP of {name}  {_estimate(found['dolp'])}{angle}"
    dark = live.get("dark") or {"source": ""}
    if live.get("regions") and dark["source"].startswith("not known"):
        yield f"dark level {dark['source']}"
    if live.get("drift"):
        yield _drift(live["drift"])


def _of_angle(numbers: Mapping[str, Any]) -> str:
    text = f"mean {numbers['mean_dn']:.1f} DN, saturated {100 * numbers['saturated_fraction']:.2f} %"
    regions = ", ".join(f"{name} {mean_dn:.1f} DN" for name, mean_dn in numbers["regions_dn"].items())
    return f"{text}, {regions}" if regions else text


def _estimate(found: Mapping[str, Any]) -> str:
    if found["sigma"] is None:
        return f"{found['value']:.4f}"
    return f"{found['value']:.5f} {_SIGNS} {found['sigma']:.5f} (noise of one cycle)"


def _drift(drift: Mapping[str, Any]) -> str:
    sigma = drift["sigma_per_min"]
    error = "" if sigma is None else f" {_SIGNS} {100 * sigma:.2f}"
    return f"drift of {drift['region']}  {100 * drift['per_min']:+.2f}{error} % a minute, over {drift['over_s']:.1f} s"
