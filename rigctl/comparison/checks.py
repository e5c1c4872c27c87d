"""Checks of a run by itself, the verdict of a comparison, and where disagreements point.

`run_checks` tests pair sums, response, registration, drift, clipped pixels and bits without any model; a run or region
that a check refuses is not judged. `verdict_of` makes one verdict of regions and run, so that no two parts of a report
contradict one another. `diagnose` points from disagreeing rows to a cause; `trends_of` tests whether numbers are in the
predicted order, whatever their scale.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.pictures import Registration
from model.effects.effect import Effect
from model.moments import Moments
from model.processing.agreement import RankCorrelation, chi_square_tail, rank_correlation
from model.processing.diagnosis import region_residual
from model.processing.fault_fit import SHARED as RESPONSES
from model.processing.fault_fit import rounding_offsets
from model.processing.reconstruction import pair_sum_excess, residual_chi_square
from model.quantities import ORDERED, angle_of, is_counts
from model.sensor import drifting_light
from model.stokes import dolp
from rigctl.base.numbers import p_value
from rigctl.imports.levels import histogram, odd_pattern, saturation_plateau
from rigctl.measure.diagnose import MeasuredRun, RunDiagnosis
from rigctl.measure.measure import Measurement, signal_of_cycle

if TYPE_CHECKING:
    from rigctl.comparison.rows import Row
    from rigctl.runs.folder import Run
    from rigctl.runs.records import FrameRecord

FloatArray = NDArray[np.float64]
Verdict = Literal["sound", "flagged", "refused", "not testable"]

# Pair sums of stages and lamps differ by half a percent; a polarimeter whose pair sums differ by 8 % is broken.
_PAIRS_REFUSED, _PAIRS_FLAGGED = 0.08, 0.01
# Blur, and edges that lie a tenth of a pixel apart, look like a response up to this size.
_CURVATURE_FLAGGED = 0.02
_CURVATURE_REFUSED = 0.1
# Standard error over its size of a response that cannot be measured.
_UNKNOWN = 0.5
_CLIPPED_FLAGGED = 0.05
# Shares of a region's counts at an end: above the first means need the law of counts, above the second they are wrong.
_AT_END_FLAGGED, _AT_ZERO_REFUSED = 1e-3, 0.01
_SHIFT_FLAGGED_PIXELS = 0.2
_DRIFT_FLAGGED = 0.005
_SIGMAS = 5.0
_NOTHING_TESTED = "nothing tested"
_PAIRS_DIFFER = "sums of orthogonal pairs of angles, which should all equal the total light, differ"
_PAIRS_RULE = (
    f"flagged above {_PAIRS_FLAGGED:.0%} and {_SIGMAS:g} errors, refused above {_PAIRS_REFUSED:.0%}; "
    "possible causes: light that changed, unequal exposures or throughput, a wrong dark level, response or angle"
)


@dataclass(frozen=True, kw_only=True)
class Check:
    """One check of a run."""

    name: str  #: Such as "pair sums".
    verdict: Verdict  #: "sound", "flagged", "refused" or "not testable".
    text: str  #: Result and rule.
    region: str | None = None  #: None for a check of the whole run.
    size: str = ""  #: Result in a few words, of a check that every region has.
    rule: str = ""  #: Rule that all regions share.

    @property
    def kind(self) -> str:
        """Its name without the region."""
        return self.name.removesuffix(f" of {self.region}")


def run_checks(run: MeasuredRun) -> tuple[Check, ...]:
    """Return every check of a run."""
    measurement = run.measurement
    return (
        *_pair_sums(measurement),
        _linear(run.diagnosis),
        _registration(measurement, run.registration),
        _drift(measurement),
        *_usable(measurement),
        *_at_ends(measurement),
        *_hit(measurement),
        *_plateau(measurement),
        *_bits(measurement),
    )


def nothing_tested(rows: Sequence["Row"], why: Sequence[str]) -> tuple[Check, ...]:
    """Return the flag of a comparison with rows of which none was tested; nothing otherwise."""
    if not rows or any(row.agrees is not None for row in rows):
        return ()
    return (Check(name=_NOTHING_TESTED, verdict="flagged", text="; ".join(why)),)


def _pair_sums(measurement: Measurement) -> Iterable[Check]:
    if measurement.plan.redundancy == 0:
        text = "three angles fit any frames, so there is no residual to test"
        yield Check(name="pair sums", verdict="not testable", text=text)
        return
    rounding = _rounding(measurement)
    for name, region in measurement.regions.items():
        if not region.channels_mean.mean.mean() > 0.0:
            continue
        found = region_residual(measurement.plan, measurement.channels, region.inside)
        moments = replace(found, cov=found.cov + rounding)
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
    usable = measurement.frames.usable
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
        text=f"the residual of the angles depends on the light like a response that is {size}; flagged above "
        f"{_CURVATURE_FLAGGED:.0%} if it can be distinguished from other faults, refused above "
        f"{_CURVATURE_REFUSED:.0%}; possible causes: gamma, tone mapping, saturation, a wrong dark level",
    )


def _usable(measurement: Measurement) -> Iterable[Check]:
    """Flag pictures with many clipped pixels."""
    high, low = measurement.clipped_shares
    if high > _CLIPPED_FLAGGED:
        yield Check(
            name="clipped pixels",
            verdict="flagged",
            text=f"{high:.1%} of the pixels are clipped in one frame or more, and left out; flagged above "
            f"{_CLIPPED_FLAGGED:.0%}: expose for less",
        )
    if low > _CLIPPED_FLAGGED:
        yield Check(
            name="pixels at 0",
            verdict="flagged",
            text=f"{low:.1%} of the pixels are 0 in one frame or more: noise below 0 is cut off, so these "
            f"pixels are too bright and their DoLP is too small; flagged above {_CLIPPED_FLAGGED:.0%}: raise the black "
            "level of the camera, or expose for longer",
        )


def _at_ends(measurement: Measurement) -> Iterable[Check]:
    """Flag or refuse regions whose noise is cut off at an end of the range, which shifts their means."""
    advice = "raise the camera's black level, or expose for longer"
    by_law = "means are estimated by the law of the counts that are cut off there, deviations are not tested"
    for name, region in measurement.regions.items():
        at_zero, at_top = region.at_ends
        if region.is_by_law and at_top > _AT_END_FLAGGED:
            yield Check(
                name=f"clipped at saturation of {name}",
                verdict="flagged",
                region=name,
                text=f"{at_top:.1%} of its counts behind an angle are saturated; {by_law}: expose for less",
            )
        said = f"{at_zero:.1%} of its counts behind an angle are 0"
        if at_zero > _AT_END_FLAGGED and region.is_by_law:
            text = f"{said}; {by_law}"
        elif at_zero > _AT_ZERO_REFUSED:
            text = f"{said}; refused above {_AT_ZERO_REFUSED:.0%} if the counts are not those of uniform light"
        else:
            continue
        yield Check(
            name=f"clipped at zero of {name}",
            verdict="flagged" if region.is_by_law else "refused",
            region=name,
            text=f"{text}: {advice}",
        )


def _hit(measurement: Measurement) -> Iterable[Check]:
    """Flag regions with pixels that only their neighbours show to be hit."""
    for name, region in measurement.regions.items():
        if region.hit and measurement.grid.cycles == 1:
            yield Check(
                name=f"hit pixels of {name}",
                verdict="flagged",
                region=name,
                text=f"{region.hit} pixels differ from their neighbours at one angle, as after hits by "
                "cosmic rays, and are left out: two cycles or more would make this certain",
            )


def _plateau(measurement: Measurement) -> Iterable[Check]:
    """Flag frames in which many pixels share a largest count below the stated saturation."""
    run, said = measurement.run, list[str]()
    for record in measurement.grid.records[0]:
        found = saturation_plateau(_received(run, record), full_scale_dn=int(record.saturation_dn))
        if found is not None:
            angle = "" if record.polarizer_angle_deg is None else f" at {record.polarizer_angle_deg:g} deg"
            said.append(f"{found.fraction:.1%} of the frame{angle} at {found.value_dn} DN")
    if said:
        yield Check(
            name="largest count",
            verdict="flagged",
            text=f"many pixels share the largest count: {', '.join(said)}, below the stated saturation: if they are "
            "clipped, the numbers are wrong; state the saturation with rigctl import --saturation-dn",
        )


def _received(run: "Run", record: "FrameRecord") -> NDArray[np.int64]:
    """Return the histogram of a frame without the count that marks missing pixels."""
    counts = run.counts(record)
    return histogram(counts if record.missing_dn is None else counts[counts != record.missing_dn])


def _bits(measurement: Measurement) -> Iterable[Check]:
    """Flag counts whose histogram is not that of a camera in half of the frames or more."""
    run, records = measurement.run, measurement.grid.records[0]
    found = [text for record in records if (text := odd_pattern(_received(run, record)))]
    if 2 * len(found) >= len(records):
        yield Check(
            name="odd bits", verdict="flagged", text=f"{found[0]}; the counts have fewer significant bits than stated"
        )


def _registration(measurement: Measurement, found: Registration | str) -> Check:
    name = "registration"
    if measurement.shifts is not None:
        return Check(name=name, verdict="sound", text="frames were moved by the given registration")
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
        "edges show false polarization (rigctl calibrate registration, then --register)",
    )


def _before_and_after(found: Registration, index: int) -> str:
    if index >= len(found.edge_residual):
        return ""
    before, after = found.edge_residual[index]
    return f"; residual of shifted edges: {before:.1%}, after moving them back {after:.1%}"


def _drift(measurement: Measurement) -> Check:
    name, cycles = "drift of the light", measurement.grid.cycles
    if cycles < 3 or not measurement.regions:
        return Check(name=name, verdict="not testable", text="needs three cycles or more")
    slope, error = _slope(measurement)
    false = _false_dolp(measurement, slope)
    return Check(
        name=name,
        verdict="flagged" if abs(slope) > max(_DRIFT_FLAGGED, _SIGMAS * error) else "sound",
        text=f"{slope:+.3%} +- {error:.3%} a cycle, which looks like a DoLP of {false:.5f} with this order of "
        f"angles; flagged above {_DRIFT_FLAGGED:.1%}",
    )


def _slope(measurement: Measurement) -> tuple[float, float]:
    """Return the change of the light in a cycle over its mean, and its standard error."""
    cycles = measurement.grid.cycles
    light = np.array([_light(measurement, cycle) for cycle in range(cycles)])
    relative = light / light.mean() - 1.0
    time = np.arange(cycles) - 0.5 * (cycles - 1)
    slope = float(time @ relative / (time @ time))
    left = relative - slope * time
    return slope, float(np.sqrt(left @ left / (cycles - 2) / (time @ time)))


def shown_effects(run: MeasuredRun) -> dict[Effect, tuple[float, float]]:
    """Return size and standard error of the effects that the run itself shows: drift and misregistration."""
    measurement, registration = run.measurement, run.registration
    found: dict[Effect, tuple[float, float]] = {}
    if measurement.grid.cycles >= 3 and measurement.regions:
        found[Effect.DRIFT] = _slope(measurement)
    if measurement.shifts is None and not isinstance(registration, str):
        # Along each axis, against their mean.
        moved = registration.shift_pixels - registration.shift_pixels.mean(axis=0)
        errors = registration.std_error_pixels
        found[Effect.MISREGISTRATION] = (float(np.sqrt(np.mean(moved**2))), float(np.sqrt(np.mean(errors**2))))
    return found


def _light(measurement: Measurement, cycle: int) -> float:
    usable = measurement.frames.usable
    if usable.all():
        return float(measurement.frames.light[cycle])
    # The pixels to leave out are known only after all frames were read, so the frames are read again.
    return float(signal_of_cycle(measurement, cycle).mean(axis=0)[usable].mean())


def _false_dolp(measurement: Measurement, drift: float) -> float:
    unpolarised = drifting_light(drift, measurement.grid.frame_order)
    return float(dolp(measurement.plan.inverse @ unpolarised))


def _residual(measurement: Measurement, moments: Moments) -> str:
    try:
        chi_square, freedom = residual_chi_square(measurement.plan, moments.mean, moments.cov)
    except ValueError as error:
        return f"; no residual of the weighted fit: {error}"
    plural = "degree" if freedom == 1 else "degrees"
    found = p_value(chi_square_tail(chi_square, freedom))
    return f"; residual of the weighted fit: chi-square {chi_square:.1f}, {freedom} {plural} of freedom, {found}"


VerdictName = Literal["agrees", "agrees_with_reservations", "disagrees", "cannot_be_judged"]

# Whether a verdict is agreement; None for neither.
AGREES: dict[VerdictName, bool | None] = {
    "agrees": True,
    "agrees_with_reservations": True,
    "disagrees": False,
    "cannot_be_judged": None,
}


@dataclass(frozen=True, kw_only=True)
class RegionVerdict:
    """Verdict of a region, and the reason if it cannot be judged or agrees with reservations."""

    verdict: VerdictName
    reason: str


def region_verdicts(
    rows: Sequence["Row"], checks: Sequence["Check"], unjudged: Mapping[str, str]
) -> dict[str, RegionVerdict]:
    """Return the verdict of every region."""
    names = dict.fromkeys([*(row.region for row in rows), *unjudged])
    return {name: _of_region(name, rows, checks, unjudged) for name in names}


def verdict_of(rows: Sequence["Row"], checks: Sequence["Check"], unjudged: Mapping[str, str]) -> VerdictName:
    """Return the verdict of a comparison; regions that cannot be judged do not count unless none can."""
    regions = region_verdicts(rows, checks, unjudged)
    if any(_refuses_run(check) for check in checks):
        return "cannot_be_judged"
    if regions and all(found.verdict == "cannot_be_judged" for found in regions.values()):
        return "cannot_be_judged"
    if any(row.agrees is False for row in rows):
        return "disagrees"
    is_reserved = any(check.verdict in ("flagged", "refused") for check in checks) or any(
        found.verdict == "cannot_be_judged" for found in regions.values()
    )
    return "agrees_with_reservations" if is_reserved else "agrees"


def refused_regions(checks: Sequence["Check"]) -> dict[str, str]:
    """Return the regions that a check refused, each with the reason."""
    return {
        check.region: f"{check.name}: {check.text}"
        for check in checks
        if check.verdict == "refused" and check.region is not None
    }


def refusals(checks: Sequence["Check"]) -> tuple[str, ...]:
    """Return why a run or some of its regions are unsound; a reason of many regions once."""
    return tuple(f"{title.removeprefix('refused, ')}: {text}" for title, text in titled_texts(checks, "refused"))


def reservations(checks: Sequence["Check"], regions: Mapping[str, RegionVerdict]) -> str:
    """Return the reservations of an agreement: flags, and regions that cannot be judged; empty without any."""
    flags = titles(checks, "flagged")
    unjudged = [name for name, found in regions.items() if found.verdict == "cannot_be_judged"]
    parts = [f"flagged: {flags}"] if flags else []
    return "; ".join([*parts, f"cannot be judged: {', '.join(unjudged)}"] if unjudged else parts)


def not_judged(checks: Sequence["Check"]) -> str:
    """Return the verdict of a comparison that cannot be judged, in a sentence without its point."""
    if any(check.verdict == "refused" for check in checks):
        why = "the run is unsound"
    else:
        is_untested = any(check.name == _NOTHING_TESTED for check in checks)
        why = "no number was tested" if is_untested else "no region gives its numbers"
    return f"model and measurement cannot be judged: {why}"


def unjudged_lines(regions: Mapping[str, RegionVerdict], checks: Sequence["Check"]) -> list[str]:
    """Return why regions cannot be judged, those of one reason together; without those that a check refused."""
    refused = refused_regions(checks)
    by_reason: dict[str, list[str]] = {}
    for name, found in regions.items():
        if found.verdict == "cannot_be_judged" and name not in refused:
            by_reason.setdefault(found.reason, []).append(name)
    return [f"{', '.join(names)} cannot be judged: {reason}" for reason, names in by_reason.items()]


def titled_texts(checks: Sequence["Check"], *verdicts: str) -> list[tuple[str, str]]:
    """Return checks of some verdicts as heading and text; checks of one kind together."""
    groups: dict[tuple[str, str], list[Check]] = {}
    for check in checks:
        if check.verdict in verdicts:
            groups.setdefault((check.verdict, check.kind), []).append(check)
    return [(f"{verdict}, {_title(group)}", _text(group)) for (verdict, _), group in groups.items()]


def titles(checks: Sequence["Check"], *verdicts: str) -> str:
    """Return the names of checks of some verdicts, those of one kind together."""
    groups: dict[str, list[Check]] = {}
    for check in checks:
        if check.verdict in verdicts:
            groups.setdefault(check.kind, []).append(check)
    return ", ".join(_title(group) for group in groups.values())


def _title(group: Sequence["Check"]) -> str:
    regions = [check.region for check in group if check.region is not None]
    return f"{group[0].kind} of {', '.join(regions)}" if len(regions) > 1 else group[0].name


def _text(group: Sequence["Check"]) -> str:
    if len(group) == 1:
        return group[0].text
    if all(check.size for check in group):
        return f"{'; '.join(f'{check.region} {check.size}' for check in group)}: {group[0].rule}"
    return "; ".join(dict.fromkeys(check.text for check in group))


def without_decisions(rows: Iterable["Row"], unjudged: Mapping[str, str]) -> tuple["Row", ...]:
    """Return rows without a decision where their region cannot be judged."""
    return tuple(replace(row, agrees=None) if row.region in unjudged else row for row in rows)


def _refuses_run(check: "Check") -> bool:
    return check.verdict == "refused" and check.region is None


def _of_region(
    name: str, rows: Sequence["Row"], checks: Sequence["Check"], unjudged: Mapping[str, str]
) -> RegionVerdict:
    if name in unjudged:
        return RegionVerdict(verdict="cannot_be_judged", reason=unjudged[name])
    run = [check for check in checks if _refuses_run(check)]
    if run:
        return RegionVerdict(verdict="cannot_be_judged", reason="; ".join(f"{one.name}: {one.text}" for one in run))
    if any(row.agrees is False for row in rows if row.region == name):
        return RegionVerdict(verdict="disagrees", reason="")
    if not any(row.agrees is not None for row in rows if row.region == name):
        return RegionVerdict(verdict="cannot_be_judged", reason="none of its numbers was tested")
    flags = [check.name for check in checks if check.verdict == "flagged" and check.region in (None, name)]
    if flags:
        return RegionVerdict(verdict="agrees_with_reservations", reason="flagged: " + ", ".join(flags))
    return RegionVerdict(verdict="agrees", reason="")


Cause = Literal["scale", "axis-offset", "axis-sense", "polarization", "noise", "not-normal"]

ADVICE: dict[Cause, str] = {
    "scale": "Counts and S0 are off by a common factor while DoLP and AoLP agree: look at the gain, the exposure, "
    "transmittance and quantum efficiency, or the radiance of the scene.",
    "axis-offset": "AoLP is off by the same angle everywhere while DoLP agrees: look at the offset of the polarizer's "
    "axis in the rig file.",
    "axis-sense": "AoLP is mirrored while DoLP agrees: look at the sense of rotation of the polarizer in the rig file "
    "(+1 or -1 as the camera sees it), or a mirrored picture.",
    "polarization": "The degree of polarization is off: look at the extinction ratio, at a dark level that was not "
    "subtracted, at drift of the light, or at the polarization of the scene.",
    "noise": "Means agree and deviations do not: look at the noise calibration, or at the texture of the scene.",
    "not-normal": "The pixels of a region do not scatter normally, as the law of DoLP assumes: look for an edge, "
    "shading or parts of different polarization in the region, or for noise of few counts.",
}


# Quantities that the law of DoLP predicts.
_OF_LAW = ("dolp_pixels", "dolp_snr")


def diagnose(rows: Sequence["Row"], *, is_of_law: bool = False) -> tuple[Cause, ...]:
    """Return the causes that would show as the disagreeing rows do; none where all rows agree.

    Causes are told apart by the numbers that they do not change: a scale leaves s1, s2, DoLP and AoLP alone, a turned
    axis leaves S0 and DoLP alone, and only noise leaves every mean alone.
    """
    off = {(row.quantity, row.statistic) for row in rows if row.agrees is False}
    means = {quantity for quantity, statistic in off if statistic == "mean"}
    causes: list[Cause] = []
    if "dolp" in means:
        causes.append("polarization")
    else:
        if means & {"aolp_deg", "s1n", "s2n"}:
            causes.append(_axis_cause(rows))
        if "s0" in means or (not causes and _any_count(means)):
            causes.append("scale")
    if off and not causes:
        causes.append("not-normal" if is_of_law and all(name in _OF_LAW for name, _ in off) else "noise")
    return tuple(causes)


def _any_count(quantities: set[str]) -> bool:
    return any(is_counts(quantity) or quantity in ("s1", "s2") for quantity in quantities)


def _axis_cause(rows: Sequence["Row"]) -> Cause:
    """Return whether one turn, or one mirror, explains the angles of polarization of all regions."""
    angles = [row for row in rows if row.quantity == "aolp_deg" and row.statistic == "mean" and row.std_error]
    weights = np.array([1.0 / (row.std_error or 1.0) ** 2 for row in angles])
    predicted = np.deg2rad([2.0 * row.predicted for row in angles])
    measured = np.deg2rad([2.0 * row.measured for row in angles])
    turned, mirrored = _spread(measured - predicted, weights), _spread(measured + predicted, weights)
    return "axis-sense" if mirrored < turned else "axis-offset"


def _spread(angles_rad: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """Return the weighted spread of angles on the circle: 0 where they are all one."""
    return 1.0 - float(abs(np.average(np.exp(1j * angles_rad), weights=weights)))


_LEAST_NUMBERS = 3


@dataclass(frozen=True, kw_only=True)
class Trend:
    """Whether a series of numbers has the same order by the model and by the frames."""

    quantity: str  #: Such as "dolp".
    over: str  #: The series: "angles of black_panel", "regions", "runs of asphalt".
    #: Kendall's tau, pairs that are known in spite of their errors, and the chance of so good an order.
    order: RankCorrelation

    @property
    def predicted(self) -> bool | None:
        """Whether every pair whose order is known is in the predicted order; None where none is known."""
        share = self.order.share_concordant
        return None if share is None else share == 1.0


def trends_of(rows: Sequence["Row"], cov: FloatArray | None, measurement: Measurement) -> tuple[Trend, ...]:
    """Return the trends within one run: of counts over angles, and of each scale-free quantity over regions."""
    predicted_cov = np.zeros((len(rows), len(rows))) if cov is None else cov
    return (*_over_angles(rows, predicted_cov, measurement), *_over_regions(rows, predicted_cov))


def trend(rows: Sequence["Row"], *, over: str, predicted_cov: FloatArray, measured_cov: FloatArray) -> Trend:
    """Return the trend of one quantity along rows."""
    order = rank_correlation(
        [row.predicted for row in rows],
        [row.measured for row in rows],
        predicted_cov=predicted_cov,
        measured_cov=measured_cov,
    )
    return Trend(quantity=rows[0].quantity, over=over, order=order)


def _over_angles(rows: Sequence["Row"], cov: FloatArray, measurement: Measurement) -> Iterable[Trend]:
    for name, region in measurement.regions.items():
        places = [
            k
            for k, row in enumerate(rows)
            if row.region == name and row.statistic == "mean" and row.quantity in measurement.grid.channel_names
        ]
        if len(places) == measurement.grid.angles >= _LEAST_NUMBERS:
            found = trend(
                [rows[k] for k in places],
                over=f"angles of {name}",
                predicted_cov=cov[np.ix_(places, places)],
                measured_cov=region.channels_mean.cov,
            )
            yield Trend(quantity="counts", over=found.over, order=found.order)


def _over_regions(rows: Sequence["Row"], cov: FloatArray) -> Iterable[Trend]:
    for quantity in ORDERED:
        places = [k for k, row in enumerate(rows) if (row.quantity, row.statistic) == (quantity, "mean")]
        if len(places) >= _LEAST_NUMBERS:
            chosen = [rows[k] for k in places]
            yield trend(
                chosen,
                over="regions",
                predicted_cov=cov[np.ix_(places, places)],
                measured_cov=np.diag([(row.std_error or 0.0) ** 2 for row in chosen]),
            )
