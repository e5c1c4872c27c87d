"""What a run says of itself before any model: pair sums, linear response, registration, drift, residual of the fit."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.registration import Registration
from model.moments import Moments
from model.prediction.quantity_table import angle_of
from model.processing.bayesian_update import chi_square_tail
from model.processing.redundancy import block_means, linear_response, pair_sum_excess, residual_chi_square
from model.sensor.imperfections import drifting_light
from model.stokes import dolp
from rigctl.comparison.run_prediction import frame_order
from rigctl.errors import DataError
from rigctl.measurement.measurement import Measurement, signal_of_cycle

FloatArray = NDArray[np.float64]
Verdict = Literal["sound", "flagged", "refused", "not testable"]

# Pair sums this far apart are no polarimeter's any more; half a per cent is what stages and lamps leave.
_PAIRS_REFUSED, _PAIRS_FLAGGED = 0.08, 0.01
# Blur and edges that lie a tenth of a pixel apart feign up to this much in a scene with structure.
_CURVATURE_FLAGGED = 0.02
_SHIFT_FLAGGED_PIXELS = 0.2
_DRIFT_FLAGGED = 0.005
_SIGMAS = 5.0
_BLOCK_PIXELS = 8


@dataclass(frozen=True, kw_only=True)
class Check:
    """One check of a run.

    Attributes
    ----------
    name : str
        Such as "pair sums".
    verdict : str
        "sound", "flagged", "refused" or "not testable".
    text : str
        What was found, and what is allowed.
    """

    name: str
    verdict: Verdict
    text: str


def run_checks(measurement: Measurement, registration: Registration | str) -> tuple[Check, ...]:
    """Return every check of a run, with how its pictures lie on one another, or why that cannot be told."""
    return (
        *_pair_sums(measurement),
        _linear(measurement),
        _registration(measurement, registration),
        _drift(measurement),
    )


def require_sound(checks: Sequence[Check], *, run: str) -> None:
    """Refuse a run of which a check was refused.

    Raises
    ------
    DataError
        With the name of the check and what it found.
    """
    refused = [f"{check.name}: {check.text}" for check in checks if check.verdict == "refused"]
    if refused:
        raise DataError(f"{run}: " + "; ".join(refused))


def _pair_sums(measurement: Measurement) -> Iterable[Check]:
    if measurement.plan.redundancy == 0:
        text = "three angles fit any frames: there is nothing to hold them against"
        yield Check(name="pair sums", verdict="not testable", text=text)
        return
    for name, region in measurement.regions.items():
        moments = region.channels_mean
        if not moments.mean.mean() > 0.0:
            continue
        excess, error = pair_sum_excess(measurement.plan, moments.mean, moments.cov)
        verdict: Verdict = "sound"
        if excess > max(_PAIRS_FLAGGED, _SIGMAS * error):
            verdict = "refused" if excess > _PAIRS_REFUSED else "flagged"
        yield Check(
            name=f"pair sums of {name}",
            verdict=verdict,
            text=f"pairs of orthogonal angles, each of which holds all of the light, differ by {excess:.2%} +- "
            f"{error:.2%}; flagged above {_PAIRS_FLAGGED:.0%} and {_SIGMAS:g} errors, refused above "
            f"{_PAIRS_REFUSED:.0%}: light that changed, unequal exposures or throughput, a dark level that is wrong, "
            "or an angle that is" + _residual(measurement, moments),
        )


def _linear(measurement: Measurement) -> Check:
    usable = ~(measurement.saturated | measurement.missing)
    found = linear_response(measurement.plan, block_means(measurement.channels, usable, side=_BLOCK_PIXELS))
    if found is None:
        text = "needs four angles or more, and light that is polarized in more than one way"
        return Check(name="linear response", verdict="not testable", text=text)
    off = abs(found.curvature) > max(_CURVATURE_FLAGGED, _SIGMAS * found.std_error)
    return Check(
        name="linear response",
        verdict="flagged" if off else "sound",
        text=f"the residual goes with the square of the light as a response that is {found.curvature:+.2%} +- "
        f"{found.std_error:.2%} off a line at the mean light; flagged above {_CURVATURE_FLAGGED:.0%} and {_SIGMAS:g} "
        "standard errors: gamma, tone mapping, saturation, or a dark level that is wrong",
    )


def _registration(measurement: Measurement, found: Registration | str) -> Check:
    name = "registration"
    if measurement.shifts is not None:
        return Check(name=name, verdict="sound", text="frames were moved by a registration that was given")
    if isinstance(found, str):
        return Check(name=name, verdict="not testable", text=found)
    sizes = np.linalg.norm(found.shift_pixels, axis=1)
    errors = np.linalg.norm(found.std_error_pixels, axis=1)
    worst = int(np.argmax(sizes))
    off = sizes[worst] > max(_SHIFT_FLAGGED_PIXELS, _SIGMAS * errors[worst])
    angle = angle_of(measurement.grid.channel_names[worst])
    return Check(
        name=name,
        verdict="flagged" if off else "sound",
        text=f"the picture at {angle} deg lies {sizes[worst]:.2f} +- {errors[worst]:.2f} pixel from the first; flagged "
        f"above {_SHIFT_FLAGGED_PIXELS:g} pixel: edges show polarization that is not there (rigctl calibrate "
        "registration, then --register)",
    )


def _drift(measurement: Measurement) -> Check:
    name, cycles = "drift of the light", measurement.grid.cycles
    if cycles < 3 or not measurement.regions:
        return Check(name=name, verdict="not testable", text="needs three cycles or more")
    light = np.array([_light(measurement, cycle) for cycle in range(cycles)])
    relative = light / light.mean() - 1.0
    time = np.arange(cycles) - 0.5 * (cycles - 1)
    slope = float(time @ relative / (time @ time))
    left = relative - slope * time
    error = float(np.sqrt(left @ left / (cycles - 2) / (time @ time)))
    false = _false_dolp(measurement, slope)
    return Check(
        name=name,
        verdict="flagged" if abs(slope) > max(_DRIFT_FLAGGED, _SIGMAS * error) else "sound",
        text=f"{slope:+.3%} +- {error:.3%} a cycle, which alone would show as a DoLP of {false:.5f} in the order in "
        f"which the angles were taken; flagged above {_DRIFT_FLAGGED:.1%}",
    )


def _light(measurement: Measurement, cycle: int) -> float:
    usable = ~(measurement.saturated | measurement.missing)
    return float(signal_of_cycle(measurement, cycle)[:, usable].mean())


def _false_dolp(measurement: Measurement, drift: float) -> float:
    unpolarised = drifting_light(drift, frame_order(measurement))
    return float(dolp(measurement.plan.inverse @ unpolarised))


def _residual(measurement: Measurement, moments: Moments) -> str:
    try:
        chi_square, freedom = residual_chi_square(measurement.plan, moments.mean, moments.cov)
    except ValueError as error:
        return f"; no residual of the weighted fit: {error}"
    plural = "degree" if freedom == 1 else "degrees"
    p_value = chi_square_tail(chi_square, freedom)
    return (
        f"; residual of the weighted fit: chi-square {chi_square:.1f}, {freedom} {plural} of freedom, p = {p_value:.2g}"
    )
