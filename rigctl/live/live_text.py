"""The live numbers of a session in words: for its own terminal, and for `rigctl status`."""

from collections.abc import Iterator

from rigctl.live.live_status import AngleNumbers, DarkSource, Estimate, LiveContent, RegionDrift
from rigctl.measurement.fault_terms import Fault

_SIGNS = "+/-"


def live_lines(live: LiveContent) -> Iterator[str]:
    """Give the lines of what the frames of a session show."""
    for angle, numbers in live.angles.items():
        yield f"{angle:>6} deg    {_of_angle(numbers)}"
    if live.sum_rule is not None:
        yield f"(I0 + I90) / (I45 + I135)  {_estimate(live.sum_rule)}"
    for name, found in live.regions.items():
        angle = "" if found.aolp_deg is None else f", AoLP {found.aolp_deg:.1f} deg"
        yield f"DoLP of {name}  {_estimate(found.dolp)}{angle}"
    if live.regions and live.dark is not None and live.dark.source is DarkSource.UNKNOWN:
        yield f"dark level {live.dark.source}"
    if live.drift is not None:
        yield _drift(live.drift)
    if live.diagnosis is not None:
        yield from (f"the cycle shows {_fault(fault)}" for fault in live.diagnosis.terms)


def _fault(fault: Fault) -> str:
    place = "" if fault.angle_deg is None else f" at {fault.angle_deg:g} deg"
    size = f"{fault.value or 0.0:+.3g} {_SIGNS} {fault.std_error or 0.0:.2g} {fault.unit}"
    moves = "" if fault.dolp_shift is None else f", moves DoLP of the picture by {fault.dolp_shift:+.4f}"
    return f"{fault.name}{place}  {size}{moves}"


def _of_angle(numbers: AngleNumbers) -> str:
    text = f"mean {numbers.mean_dn:.1f} DN, saturated {100 * numbers.saturated_fraction:.2f} %"
    regions = ", ".join(f"{name} {mean_dn:.1f} DN" for name, mean_dn in numbers.regions_dn.items())
    return f"{text}, {regions}" if regions else text


def _estimate(found: Estimate) -> str:
    if found.sigma is None:
        return f"{found.value:.4f}"
    return f"{found.value:.5f} {_SIGNS} {found.sigma:.5f} (noise of one cycle)"


def _drift(drift: RegionDrift) -> str:
    error = "" if drift.sigma_per_min is None else f" {_SIGNS} {100 * drift.sigma_per_min:.2f}"
    return f"drift of {drift.region}  {100 * drift.per_min:+.2f}{error} % a minute, over {drift.over_s:.1f} s"
