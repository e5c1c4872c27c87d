"""Checks of a run by itself, before any model: pair sums, linear response, registration, drift, residual of the fit."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.pictures import Registration, register
from calibration.results import CalibrationError
from model.moments import Moments
from model.processing.agreement import chi_square_tail
from model.processing.diagnosis import region_residual
from model.processing.fault_fit import SHARED as RESPONSES
from model.processing.fault_fit import rounding_offsets
from model.processing.reconstruction import pair_sum_excess, residual_chi_square
from model.quantities import angle_of
from model.sensor import drifting_light
from model.stokes import dolp
from rigctl.imports.image_levels import histogram, odd_pattern, saturation_plateau
from rigctl.measurement.measurement import Measurement, frame_order, signal_of_cycle
from rigctl.measurement.run_diagnosis import RunDiagnosis, diagnose_run
from rigctl.numbers.number_text import p_value

if TYPE_CHECKING:
    from rigctl.comparison.rows import Row

FloatArray = NDArray[np.float64]
Verdict = Literal["sound", "flagged", "refused", "not testable"]

# Pair sums this far apart are no polarimeter's any more; half a per cent is what stages and lamps leave.
_PAIRS_REFUSED, _PAIRS_FLAGGED = 0.08, 0.01
# Blur and edges that lie a tenth of a pixel apart feign up to this much in a scene with structure.
_CURVATURE_FLAGGED = 0.02
_CURVATURE_REFUSED = 0.1
# Standard error, as a share of its size, of a response that no fit could follow.
_UNKNOWN = 0.5
_CLIPPED_FLAGGED = 0.05
_SHIFT_FLAGGED_PIXELS = 0.2
_DRIFT_FLAGGED = 0.005
_SIGMAS = 5.0
_PAIRS_DIFFER = "pairs of orthogonal angles, each of which holds all of the light, differ"
_PAIRS_RULE = (
    f"flagged above {_PAIRS_FLAGGED:.0%} and {_SIGMAS:g} errors, refused above {_PAIRS_REFUSED:.0%}: light that "
    "changed, unequal exposures or throughput, a dark level or a response that is wrong, or an angle that is"
)


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
    region : str or None
        That it is of; None where it is of the whole run.
    size, rule : str
        Of a check that every region has: what was found in a few words, and what holds for all of them.
    """

    name: str
    verdict: Verdict
    text: str
    region: str | None = None
    size: str = ""
    rule: str = ""

    @property
    def kind(self) -> str:
        """Its name without the region."""
        return self.name.removesuffix(f" of {self.region}")


def registration_of(measurement: Measurement) -> Registration | str:
    """Return the shifts of a run's pictures against the first, or why they cannot be told."""
    try:
        return register(measurement.channels, ~(measurement.saturated | measurement.missing))
    except CalibrationError as error:
        return str(error)


def run_checks(
    measurement: Measurement, registration: Registration | str, diagnosis: RunDiagnosis | None = None
) -> tuple[Check, ...]:
    """Return every check of a run, with how its pictures lie on one another, or why that cannot be told."""
    found = diagnose_run(measurement) if diagnosis is None else diagnosis
    return (
        *_pair_sums(measurement),
        _linear(found),
        _registration(measurement, registration),
        _drift(measurement),
        *_usable(measurement),
        *_plateau(measurement),
        *_bits(measurement),
    )


def nothing_tested(rows: Sequence["Row"], why: Sequence[str]) -> tuple[Check, ...]:
    """Return the flag of a comparison in which no number was tested; none where one was, or where there are none."""
    if not rows or any(row.agrees is not None for row in rows):
        return ()
    return (Check(name="nothing tested", verdict="flagged", text="; ".join(why)),)


def _pair_sums(measurement: Measurement) -> Iterable[Check]:
    if measurement.plan.redundancy == 0:
        text = "three angles fit any frames: there is nothing to hold them against"
        yield Check(name="pair sums", verdict="not testable", text=text)
        return
    rounding = _rounding(measurement)
    for name, region in measurement.regions.items():
        if not region.channels_mean.mean.mean() > 0.0:
            continue
        found = region_residual(measurement.plan, measurement.channels, region.inside)
        moments = Moments(mean=found.means, cov=found.cov + rounding)
        excess, error = pair_sum_excess(measurement.plan, moments.mean, moments.cov)
        verdict: Verdict = "sound"
        if excess > max(_PAIRS_FLAGGED, _SIGMAS * error):
            verdict = "refused" if excess > _PAIRS_REFUSED else "flagged"
        size = f"{excess:.2%} +- {error:.2%}"
        yield Check(
            name=f"pair sums of {name}",
            verdict=verdict,
            region=name,
            text=f"{_PAIRS_DIFFER} by {size}; {_PAIRS_RULE}" + _residual(measurement, moments),
            size=size,
            rule=f"{_PAIRS_DIFFER}; {_PAIRS_RULE}",
        )


def _rounding(measurement: Measurement) -> FloatArray:
    """Return the covariance of the means of frames by rounding, which is that of every region."""
    usable = ~(measurement.saturated | measurement.missing)
    step = float(measurement.grid.to_unit.max())
    return np.diag(np.square(rounding_offsets(measurement.channels, usable, step=step)))


def _linear(found: RunDiagnosis) -> Check:
    name = "linear response"
    terms = [term for term in found.terms if term.name in RESPONSES]
    best = next((term for term in terms if term.named), next((term for term in terms if term.testable), None))
    if best is None or best.value is None or best.std_error is None:
        text = found.reason or next((term.reason for term in terms), "needs four angles or more")
        return Check(name=name, verdict="not testable", text=text)
    verdict: Verdict = "sound"
    if best.named and abs(best.value) > _CURVATURE_FLAGGED:
        verdict = "refused" if abs(best.value) > _CURVATURE_REFUSED else "flagged"
    meant = "off a line at the mean light" if best.name == RESPONSES[0] else "off 1 in its exponent"
    size = f"{best.value:+.2%} +- {best.std_error:.2%} {meant}"
    if best.named and best.std_error >= _UNKNOWN * abs(best.value):
        size = "too far off a line to be measured"
    return Check(
        name=name,
        verdict=verdict,
        text=f"what the angles leave over goes with the light as a response that is {size}; flagged above "
        f"{_CURVATURE_FLAGGED:.0%} where it is told from other faults, refused above {_CURVATURE_REFUSED:.0%}: gamma, "
        "tone mapping, saturation, or a dark level that is wrong",
    )


def _usable(measurement: Measurement) -> Iterable[Check]:
    """Flag pictures of which clipping takes part."""
    share = float(measurement.saturated.mean())
    if share > _CLIPPED_FLAGGED:
        yield Check(
            name="clipped pixels",
            verdict="flagged",
            text=f"{share:.1%} of the pixels are clipped in one frame or more, and left out; flagged above "
            f"{_CLIPPED_FLAGGED:.0%}: expose for less",
        )


def _plateau(measurement: Measurement) -> Iterable[Check]:
    """Flag frames of which many pixels share the largest count, below what is taken for saturation."""
    run, said = measurement.run, list[str]()
    for record in measurement.grid.records[0]:
        found = saturation_plateau(histogram(run.counts(record)), full_scale_dn=int(record.saturation_dn))
        if found is not None:
            angle = "" if record.polarizer_angle_deg is None else f" at {record.polarizer_angle_deg:g} deg"
            said.append(f"{found.fraction:.1%} of the frame{angle} at {found.value_dn} DN")
    if said:
        yield Check(
            name="largest count",
            verdict="flagged",
            text=f"many pixels share the largest count: {', '.join(said)}, below the stated saturation: if they are "
            "clipped, they are in the numbers (rigctl import --saturation-dn)",
        )


def _bits(measurement: Measurement) -> Iterable[Check]:
    """Flag counts whose histogram is not a camera's own: frame by frame, for each has its own range of light."""
    run, records = measurement.run, measurement.grid.records[0]
    found = [text for record in records if (text := odd_pattern(histogram(run.counts(record))))]
    if 2 * len(found) >= len(records):
        yield Check(name="odd bits", verdict="flagged", text=f"{found[0]}; rounding is coarser than the counts say")


def _registration(measurement: Measurement, found: Registration | str) -> Check:
    name = "registration"
    if measurement.shifts is not None:
        return Check(name=name, verdict="sound", text="frames were moved by a registration that was given")
    if isinstance(found, str):
        return Check(name=name, verdict="not testable", text=found)
    sizes = np.linalg.norm(found.shift_pixels, axis=1)
    errors = np.linalg.norm(found.std_error_pixels, axis=1)
    worst = int(np.argmax(sizes))
    off = [k for k in range(len(sizes)) if sizes[k] > max(_SHIFT_FLAGGED_PIXELS, _SIGMAS * errors[k])]
    lies = [
        f"at {angle_of(measurement.grid.channel_names[k])} deg lies {sizes[k]:.2f} +- {errors[k]:.2f} pixel"
        for k in (off or [worst])
    ]
    angles = [angle_of(channel) for channel in measurement.grid.channel_names]
    not_plain = [k for k in range(len(sizes)) if sizes[k] > _SHIFT_FLAGGED_PIXELS and not found.is_plain(k)]
    doubt = "".join(
        f"; at {angles[k]} deg it is not a plain shift: ninths of the picture scatter by {found.scatter_pixels[k]:.2f} "
        f"pixel{_before_and_after(found, k)}"
        for k in not_plain
    ) or "".join(f"; at {angles[k]} deg{_before_and_after(found, k).removeprefix(';')}" for k in off)
    return Check(
        name=name,
        verdict="flagged" if off or not_plain else "sound",
        text=f"the picture {', '.join(lies)} from the first{doubt}; flagged above {_SHIFT_FLAGGED_PIXELS:g} pixel: "
        "edges show polarization that is not there (rigctl calibrate registration, then --register)",
    )


def _before_and_after(found: Registration, index: int) -> str:
    if index >= len(found.edge_residual):
        return ""
    before, after = found.edge_residual[index]
    return f"; what is left of edges that do not lie on one another: {before:.1%}, moved back {after:.1%}"


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
    if usable.all():
        return float(measurement.light[cycle])
    # Which pixels are left out is known only when all frames were read: they are read again.
    return float(signal_of_cycle(measurement, cycle).mean(axis=0)[usable].mean())


def _false_dolp(measurement: Measurement, drift: float) -> float:
    unpolarised = drifting_light(drift, frame_order(measurement))
    return float(dolp(measurement.plan.inverse @ unpolarised))


def _residual(measurement: Measurement, moments: Moments) -> str:
    try:
        chi_square, freedom = residual_chi_square(measurement.plan, moments.mean, moments.cov)
    except ValueError as error:
        return f"; no residual of the weighted fit: {error}"
    plural = "degree" if freedom == 1 else "degrees"
    found = p_value(chi_square_tail(chi_square, freedom))
    return f"; residual of the weighted fit: chi-square {chi_square:.1f}, {freedom} {plural} of freedom, {found}"
