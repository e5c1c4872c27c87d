"""Prediction of counts, Stokes parameters, DoLP and detection, with the errors of the rig.

`predict` takes the light of regions through the sensor to the moments of the counts behind each polarizer angle, and
from these to Stokes parameters, DoLP and AoLP ([MK14] section II). `predict_with_errors` does the same for a rig whose
axes or exposure differ from the record. `budget` splits the uncertainty of a measured region by cause,
`detections_of_cases` gives the performance of the RX detector between regions.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments
from model.processing import dolp
from model.processing.detection import condition_warnings, rx_roc
from model.processing.reconstruction import Design, aolp_moments_rad, design, normalized_moments
from model.quantities import OF_RATIOS
from model.scene.scene import Readout, RegionLight, Scenario
from model.sensor import ChannelMoments, channel_moments

FloatArray = NDArray[np.float64]

# Degree of polarization due to rounding.
_ROUNDING = 1e-12
# DoLP due to rounding under unpolarized skies, whose angle is meaningless.
_UNPOLARISED = 1e-8


def noise_causes(
    channels: ChannelMoments, *, gain_dn_per_e: float, noise_factor: float, pixels: float, cycles: int
) -> dict[str, FloatArray]:
    """Return the covariance of the mean of a region's channels, by cause.

    Parameters
    ----------
    channels
        Moments of single pixels, N channels.
    gain_dn_per_e
        Gain of the sensor, > 0.
    noise_factor
        Kn of [MK14] eq. (32), >= 0.
    pixels
        Independent pixels of the mean, > 0.
    cycles
        Frames per channel, >= 1.

    Returns
    -------
    dict
        "shot" (of light and dark current), "read" (with rounding to whole counts), "fixed pattern" and "texture" to
        covariance, shape (N, N) [DN^2].

    References
    ----------
    [MK14] eq. (10), (19), (20).
    """
    temporal = np.asarray(channels.temporal_var_dn2)
    shot = np.minimum(noise_factor**2 * gain_dn_per_e * (channels.mean_dn + channels.dark_signal_dn), temporal)
    frames = pixels * cycles
    return {
        "shot": np.diag(shot) / frames,
        "read": np.diag(temporal - shot) / frames,
        "fixed pattern": np.asarray(channels.fixed_pattern_cov_dn2) / pixels,
        "texture": np.asarray(channels.scene_cov_dn2) / pixels,
    }


def budget(mean_dn: FloatArray, causes: Mapping[str, FloatArray], *, plan: Design) -> dict[str, dict[str, float]]:
    """Return the standard uncertainty of a region's polarization by cause.

    Parameters
    ----------
    mean_dn
        Mean channels, shape (N,), dark level subtracted.
    causes
        Name to covariance of that mean, shape (N, N).
    plan
        Angles and inverse.

    Returns
    -------
    dict
        Quantity ("s0" as a share of S0, "s1n", "s2n", "dolp", "aolp_deg") to cause to standard uncertainty, to first
        order; without polarization there is no "dolp" and no "aolp_deg".

    Raises
    ------
    ValueError
        There is no light.

    References
    ----------
    [MK14] eq. (22), (25); the signs and squares of (25)-(28) as derivatives of DoLP by S0, S1 and S2.
    """
    gradients = _gradients(plan.inverse @ mean_dn)
    return {
        quantity: {cause: _deviation(plan.inverse.T @ gradient, cov) for cause, cov in causes.items()}
        for quantity, gradient in gradients.items()
    }


def shift_cause(pictures: FloatArray, inside: NDArray[np.bool_], *, shift_pixels: FloatArray) -> FloatArray:
    """Return the covariance of a region's mean in each picture due to shifts.

    Parameters
    ----------
    pictures
        Mean picture of each channel, shape (N, H, W).
    inside
        Pixels of the region, shape (H, W).
    shift_pixels
        Standard deviation of each picture's shift in x and y, shape (N, 2).

    Returns
    -------
    array of float64, shape (N, N)
        Diagonal: the mean gradient of the region times the shift, squared.

    References
    ----------
    Definition, to first order in the shift.
    """
    images = np.asarray(pictures, dtype=np.float64)
    down, right = (np.asarray(np.gradient(images, axis=axis)) for axis in (1, 2))
    moved = np.stack([right[:, inside].mean(axis=1), down[:, inside].mean(axis=1)], axis=1) * shift_pixels
    return np.diag(np.sum(moved**2, axis=1))


def _deviation(gradient: FloatArray, cov: FloatArray) -> float:
    # A common factor leaves only rounding of either sign in a ratio.
    return math.sqrt(max(float(gradient @ cov @ gradient), 0.0))


def _gradients(stokes: FloatArray) -> dict[str, FloatArray]:
    """Return the derivatives of each quantity by S0, S1 and S2."""
    s0, s1, s2 = stokes
    if not s0 > 0.0:
        raise ValueError(f"S0 is {s0:.3g}; it must be above 0")
    found = {
        "s0": np.array([1.0, 0.0, 0.0]) / s0,
        "s1n": np.array([-s1 / s0, 1.0, 0.0]) / s0,
        "s2n": np.array([-s2 / s0, 0.0, 1.0]) / s0,
    }
    polarised = float(np.hypot(s1, s2))
    if polarised > _ROUNDING * s0:
        found["dolp"] = np.array([-polarised / s0, s1 / polarised, s2 / polarised]) / s0
        found["aolp_deg"] = (90.0 / np.pi) * np.array([0.0, -s2, s1]) / polarised**2
    return found


# Prediction of a scenario: counts, Stokes parameters, DoLP and their deviations, per region


# Less counts as no light, because squares of ratios would overflow.
LEAST_S0_DN = 1e-100
# Tolerance at which moments of DoLP must exist, also in coarser predictions, so that finer ones do not lose them.
_EXISTING_TO = 1e-6
# Root of the rounding of a variance: a deviation of a ratio below this share of all fluctuations over S0 is 0.
_ROUNDED_STD = 1e-7

# quantity -> statistic -> number. Quantities: dn_ANGLE, and those of `model.quantities`.
# Statistics: "mean"; "std" over the pixels of one frame or cycle; "std_temporal" of one pixel from repeat to repeat;
# "std_spatial_mean" over the pixels of the mean of all repeats.
Quantities = dict[str, dict[str, float]]


@dataclass(frozen=True, kw_only=True)
class RegionPrediction:
    """Prediction of one region.

    Parameters
    ----------
    channels
        Moments of the counts behind each polarizer angle.
    stokes_dn
        Mean and covariance of the Stokes parameters over the pixels of one cycle [DN], dark level subtracted.
    stokes_noise_dn2
        Covariance of the Stokes parameters of one cycle due to temporal noise alone, shape (3, 3) [DN^2].
    dolp_method
        Method for mean and deviation of the pixels' DoLP.
    dolp_mean_error, dolp_std_error
        Their absolute errors as estimated by the method; nan if they do not exist.
    quantities
        Numbers to compare with a measurement, without moments of DoLP that do not exist.
    warnings
        Where the model is void or poor, in words.
    """

    channels: ChannelMoments
    stokes_dn: Moments
    stokes_noise_dn2: FloatArray
    dolp_method: str
    dolp_mean_error: float
    dolp_std_error: float
    quantities: Quantities
    warnings: tuple[str, ...]

    @property
    def dolp_error(self) -> float:
        """The larger of the two errors."""
        return max(self.dolp_mean_error, self.dolp_std_error)


def predict(scenario: Scenario, *, tolerance: float = 1e-6) -> dict[str, RegionPrediction]:
    """Return the prediction of each region of a scenario.

    Parameters
    ----------
    scenario
        Light, sensor and readout.
    tolerance
        Relative tolerance of mean and deviation of the pixels' DoLP.

    Returns
    -------
    dict
        Region name to prediction, in the order of the scenario.

    References
    ----------
    [MK14] eq. (10)-(29).
    """
    return predict_all((scenario,), tolerance=tolerance)[0]


def predict_all(scenarios: Sequence[Scenario], *, tolerance: float = 1e-6) -> tuple[dict[str, RegionPrediction], ...]:
    """Return the results of `predict` for several scenarios, with the laws of DoLP of all regions at once.

    [MK14] eq. (10)-(29).
    """
    places = [(place, region) for place, one in enumerate(scenarios) for region in one.regions]
    plans = _designs(scenarios)
    read = [
        _Read(
            as_processed(_channels(region, scenarios[place]), scenarios[place].readout),
            plans[place],
            scenarios[place].readout.channel_names,
            scenarios[place].readout.cycles,
        )
        for place, region in places
    ]
    predictions: tuple[dict[str, RegionPrediction], ...] = tuple({} for _ in scenarios)
    for (place, region), one in zip(places, _with_dolp(_without_dolp(read), tolerance), strict=True):
        predictions[place][region.name] = one
    return predictions


def _designs(scenarios: Sequence[Scenario]) -> list[Design]:
    """Return the design of each scenario, shared by scenarios of equal readout."""
    made: dict[object, Design] = {}
    found = []
    for one in scenarios:
        angles_rad, extinction_ratio = one.readout.angles_rad, one.readout.extinction_ratio
        key = (np.asarray(angles_rad).tobytes(), extinction_ratio)
        if key not in made:
            made[key] = design(angles_rad, extinction_ratio)
        found.append(made[key])
    return found


def predict_region(
    channels: ChannelMoments, *, plan: Design, channel_names: tuple[str, ...], cycles: int, tolerance: float = 1e-6
) -> RegionPrediction:
    """Return the prediction from the moments of a region's channels.

    Parameters
    ----------
    channels
        From the sensor model, or with measured mean and scene covariance.
    plan
        Polarizer angles and the inverse in use, N channels.
    channel_names
        N names, used as keys of the counts.
    cycles
        Number of averaged repeats, >= 1.
    tolerance
        Relative tolerance of mean and deviation of the pixels' DoLP.

    References
    ----------
    [MK14] eq. (19)-(29).
    """
    return _with_dolp(_without_dolp([_Read(channels, plan, channel_names, cycles)]), tolerance)[0]


class _Read(NamedTuple):
    """Channels of a region, and how they were read."""

    channels: ChannelMoments
    plan: Design
    names: tuple[str, ...]
    cycles: int


def _without_dolp(several: Sequence[_Read]) -> list[RegionPrediction]:
    """Return predictions that lack the law of the pixels' DoLP; regions that are read by one plan are one array."""
    groups: dict[int, list[int]] = defaultdict(list)
    for k, one in enumerate(several):
        groups[id(one.plan)].append(k)
    found: dict[int, RegionPrediction] = {}
    for group in groups.values():
        found |= dict(zip(group, _of_one_plan([several[k] for k in group]), strict=True))
    return [found[k] for k in range(len(several))]


def _of_one_plan(several: Sequence[_Read]) -> Iterator[RegionPrediction]:
    channels, plan = [one.channels for one in several], several[0].plan
    mean = np.stack([one.mean_dn for one in channels])
    spatial = np.stack([one.scene_cov_dn2 + one.fixed_pattern_cov_dn2 for one in channels])
    temporal = np.stack([one.temporal_var_dn2 for one in channels])[:, None] * np.eye(mean.shape[-1])
    cycles = np.array([one.cycles for one in several])[:, None, None]
    covs = {"std": spatial + temporal, "std_temporal": temporal, "std_spatial_mean": spatial + temporal / cycles}
    stokes_covs = {name: plan.inverse @ cov @ plan.inverse.T for name, cov in covs.items()}
    # One at a time: where S2 is 0 but for rounding, the angle is 0 or just below 180 deg by the order of the sum.
    stokes = Moments(mean=np.stack([plan.inverse @ one for one in mean]), cov=stokes_covs["std"])
    of_counts, of_stokes, ratios = _linear(mean, covs), _linear(stokes.mean, stokes_covs), _ratios(stokes)
    for k, one in enumerate(several):
        yield RegionPrediction(
            channels=one.channels,
            stokes_dn=Moments(mean=stokes.mean[k], cov=stokes.cov[k]),
            stokes_noise_dn2=stokes_covs["std_temporal"][k],
            dolp_method="none",
            dolp_mean_error=np.nan,
            dolp_std_error=np.nan,
            quantities=dict(zip((*one.names, "s0", "s1", "s2"), (*of_counts[k], *of_stokes[k]), strict=True))
            | ratios[k],
            warnings=(*one.channels.warnings, *plan.warnings),
        )


def _with_dolp(predictions: Sequence[RegionPrediction], tolerance: float) -> list[RegionPrediction]:
    """Return predictions with the laws of DoLP, all at once, with warnings if moments do not exist."""
    lit = [k for k, one in enumerate(predictions) if one.stokes_dn.mean[0] > LEAST_S0_DN]
    missing = {k: _no_light(float(one.stokes_dn.mean[0])) for k, one in enumerate(predictions)}
    found = list(predictions)
    if lit:
        means, covs = (np.stack([getattr(predictions[k].stokes_dn, name) for k in lit]) for name in ("mean", "cov"))
        laws = dolp.moments(means, covs, tolerance=tolerance, existing_to=_EXISTING_TO)
        stds = _above_rounding(laws.std, Moments(mean=means, cov=covs))
        for at, k in enumerate(lit):
            missing[k] = "" if laws.exists[at] else str(laws.reason[at])
            quantities, mean, std = dict(found[k].quantities), float(laws.mean[at]), float(stds[at])
            if laws.exists[at]:
                quantities["dolp_pixels"] = {"mean": mean, "std": std}
                if std > 0.0:
                    quantities["dolp_snr"] = {"mean": mean / std} | quantities.get("dolp_snr", {})
            found[k] = replace(
                found[k],
                dolp_method=str(laws.method[at]),
                dolp_mean_error=float(laws.mean_error[at]),
                dolp_std_error=float(laws.std_error[at]),
                quantities=quantities,
            )
    said = "mean and deviation of the pixels' DoLP do not exist: "
    return [
        replace(one, warnings=(*one.warnings, said + missing[k])) if missing[k] else one for k, one in enumerate(found)
    ]


def reason_missing(prediction: RegionPrediction) -> dict[str, str]:
    """Return the quantities missing in a region, wholly or in part, each with the reason.

    Parameters
    ----------
    prediction
        Of the region.
    """
    s0 = float(prediction.stokes_dn.mean[0])
    if not s0 > LEAST_S0_DN:
        lost = ("s1n", "s2n", "dolp", "aolp_deg", "dolp_pixels", "dolp_snr")
        return dict.fromkeys(lost, _no_light(s0))
    found = {}
    if "aolp_deg" not in prediction.quantities:
        found["aolp_deg"] = found["dolp.std"] = "unpolarised light has no angle, and no first-order deviation of DoLP"
        found["dolp_snr.first_order"] = found["dolp.std"]
    if "dolp_pixels" not in prediction.quantities:
        found["dolp_pixels"] = found["dolp_snr.mean"] = prediction.warnings[-1]
    elif "mean" not in prediction.quantities.get("dolp_snr", {}):
        found["dolp_snr.mean"] = "nothing fluctuates: the deviation of DoLP is 0"
    return found


def as_processed(channels: ChannelMoments, readout: Readout) -> ChannelMoments:
    """Return moments of channels after flat fields and interpolation.

    The error of a flat field is an independent pattern at each angle: unlike the response that it removes, it affects
    DoLP.
    """
    if readout.noise_factor is not None:
        channels = replace(channels, temporal_var_dn2=channels.temporal_var_dn2 * readout.noise_factor)
    if readout.flat_error is None:
        return channels
    added = np.square(channels.mean_dn * readout.flat_error)[:, None] * np.eye(channels.mean_dn.size)
    return replace(channels, fixed_pattern_cov_dn2=channels.fixed_pattern_cov_dn2 + added)


def _no_light(s0: float) -> str:
    return f"the mean of S0 is {s0:.3g} DN, {'as good as' if s0 > 0.0 else 'not above'} 0"


def _linear(mean: FloatArray, covs: dict[str, FloatArray]) -> list[list[dict[str, float]]]:
    """Return the statistics of each component of each of several vectors (M, n)."""
    statistics = {"mean": mean} | {kind: _deviations(cov) for kind, cov in covs.items()}
    numbers = np.stack(list(statistics.values()), axis=-1).tolist()
    return [[dict(zip(statistics, one, strict=True)) for one in vector] for vector in numbers]


def _deviations(cov: FloatArray) -> FloatArray:
    """Return standard deviations; variances negative by rounding give 0."""
    return np.asarray(np.sqrt(np.maximum(np.diagonal(cov, axis1=-2, axis2=-1), 0.0)))


def _above_rounding(std: FloatArray, stokes: Moments) -> FloatArray:
    """Return deviations of ratios (M,) or (M, n); 0 for what is rounding, as where texture alone fluctuates."""
    least = _ROUNDED_STD * np.sqrt(np.trace(stokes.cov, axis1=1, axis2=2)) / stokes.mean[:, 0]
    return np.where(std > least.reshape(-1, *[1] * (std.ndim - 1)), std, 0.0)


def _ratios(stokes: Moments) -> list[Quantities]:
    """Return what does not depend on the scale of the counts: of the mean, with first-order deviations of a pixel.

    Of several Stokes vectors (M, 3); nothing of one without light.
    """
    found: list[Quantities] = [{} for _ in stokes.mean]
    lit = np.flatnonzero(stokes.mean[:, 0] > LEAST_S0_DN)
    if not lit.size:
        return found
    seen = Moments(mean=stokes.mean[lit], cov=stokes.cov[lit])
    normalized = normalized_moments(seen)
    results = [[function(*mean) for function in OF_RATIOS.values()] for mean in normalized.mean.tolist()]
    gradients = np.array([[gradient for _, gradient in one] for one in results])
    deviations = _above_rounding(_deviations(gradients @ normalized.cov @ np.swapaxes(gradients, -1, -2)), seen)
    for k, one, stds in zip(lit, results, deviations.tolist(), strict=True):
        found[k] = {
            name: {"mean": value, "std": std} for name, (value, _), std in zip(OF_RATIOS, one, stds, strict=True)
        }
        found[k]["dolp"] = {"mean": 0.0}
    is_polarised = np.hypot(seen.mean[:, 1], seen.mean[:, 2]) > _UNPOLARISED * seen.mean[:, 0]
    if not np.any(is_polarised):
        return found
    polarised = Moments(mean=seen.mean[is_polarised], cov=seen.cov[is_polarised])
    angle, first = aolp_moments_rad(polarised), dolp.first_order(polarised.mean, polarised.cov)
    angle_std = _above_rounding(_deviations(angle.cov)[:, 0], polarised)
    angles_deg = np.rad2deg(np.stack([angle.mean[:, 0], angle_std], axis=-1)).tolist()
    degrees = zip(first.mean.tolist(), _above_rounding(np.sqrt(first.variance), polarised).tolist(), strict=True)
    for k, (mean, std), (aolp, aolp_std) in zip(lit[is_polarised], degrees, angles_deg, strict=True):
        found[k] |= {"dolp": {"mean": mean, "std": std}, "aolp_deg": {"mean": aolp, "std": aolp_std}}
        if std > 0.0:
            found[k]["dolp_snr"] = {"first_order": mean / std}
    return found


# Strength of the polarization of a predicted region: the distribution of its DoLP, and its noise floor


@dataclass(frozen=True, kw_only=True)
class PolarizationStrength:
    """Strength and certainty of the polarization of a region, of one cycle.

    Parameters
    ----------
    probabilities, quantiles
        Quantiles of the pixels' DoLP given S0 > 0, which exist even without moments.
    nedolp
        First-order noise-equivalent DoLP from temporal noise: the deviation of DoLP that unpolarised light of this
        intensity would show. None if temporal noise is unknown.
    unpolarised_mean
        Mean DoLP of unpolarised light of this intensity due to noise; nan if it does not exist.
    """

    probabilities: FloatArray
    quantiles: FloatArray
    nedolp: float | None
    unpolarised_mean: float


def polarization_strength(
    prediction: RegionPrediction, *, probabilities: Sequence[float] = (0.025, 0.5, 0.975)
) -> PolarizationStrength:
    """Return quantiles of a region's DoLP, and its noise floor.

    Parameters
    ----------
    prediction
        Of the region.
    probabilities
        Of the quantiles, each in (0, 1).

    Raises
    ------
    ValueError
        The mean of S0 is not above 0.

    References
    ----------
    [MK14] section IV-A; definition.
    """
    stokes, noise = prediction.stokes_dn, prediction.stokes_noise_dn2
    levels = np.asarray(probabilities, dtype=np.float64)
    nedolp, unpolarised_mean = None, np.nan
    if np.any(noise):
        nedolp = float(np.sqrt(max(noise[1, 1] + noise[2, 2], 0.0) / 2.0) / stokes.mean[0])
        unpolarised = stokes.mean * np.array([1.0, 0.0, 0.0])
        unpolarised_mean = float(dolp.moments(unpolarised, noise, tolerance=1e-6).mean)
    return PolarizationStrength(
        probabilities=levels,
        quantiles=np.asarray(dolp.quantile(levels, stokes.mean, stokes.cov)),
        nedolp=nedolp,
        unpolarised_mean=unpolarised_mean,
    )


# Prediction for a rig that differs from its record: axes turned, exposure off


@dataclass(frozen=True, kw_only=True, eq=False)
class RigErrors:
    """Errors of a rig compared with its record.

    Parameters
    ----------
    turned_rad
        True angle of the polarizer's axis less the recorded one, by frame of a cycle, shape (N,) [rad].
    exposure_ratio
        True exposure over the recorded one, > 0.
    """

    turned_rad: FloatArray
    exposure_ratio: float


def predict_with_errors(
    scenario: Scenario, errors: RigErrors, *, tolerance: float = 1e-6
) -> dict[str, RegionPrediction]:
    """Return the prediction for light through the true rig and processing with the recorded one.

    Parameters
    ----------
    scenario
        With the recorded angles and exposure.
    errors
        Of the rig.
    tolerance
        Relative tolerance of mean and deviation of the pixels' DoLP.

    Raises
    ------
    ValueError
        Errors do not fit the angles, or leave no light.

    Notes
    -----
    Without errors it equals `model.prediction.predict`; imperfections of the session act as there. The frames of every
    cycle have the same errors.

    References
    ----------
    [MK14] eq. (11)-(29).
    """
    angles_rad = scenario.readout.angles_rad
    if errors.turned_rad.shape != angles_rad.shape:
        raise ValueError(
            f"turned_rad {errors.turned_rad.shape} does not fit {angles_rad.size} angles; allowed is one for each"
        )
    if not errors.exposure_ratio > 0.0:
        raise ValueError(f"exposure_ratio = {errors.exposure_ratio}; it must be above 0")
    plan = design(angles_rad, scenario.readout.extinction_ratio)
    return {
        region.name: predict_region(
            as_processed(_channels(region, scenario, errors), scenario.readout),
            plan=plan,
            channel_names=scenario.readout.channel_names,
            cycles=scenario.readout.cycles,
            tolerance=tolerance,
        )
        for region in scenario.regions
    }


def _channels(region: RegionLight, scenario: Scenario, errors: RigErrors | None = None) -> ChannelMoments:
    """Return the moments of a region's counts from the sensor."""
    sensor, angles_rad = scenario.sensor, scenario.readout.angles_rad
    if errors is not None:
        sensor = replace(sensor, exposure_s=sensor.exposure_s * errors.exposure_ratio)
        angles_rad = angles_rad + errors.turned_rad
    return channel_moments(
        region.aperture_moments(),
        angles_rad=angles_rad,
        sensor=sensor,
        flat_fielded=scenario.readout.flat_error is not None,
        imperfections=scenario.imperfections,
        smooth_cov=region.smooth_cov(),
    )


# Performance of the RX detector between the regions of a predicted scene

# Target, background, and predictions by region.
PairCase = tuple[str, str, Mapping[str, RegionPrediction]]


@dataclass(frozen=True, kw_only=True)
class PairDetection:
    """RX detection of one region on another, from the exact distribution.

    Parameters
    ----------
    target, background
        Names.
    p_false_alarm, p_detection, p_miss
        Shape (K,); `p_miss` is 1 - `p_detection`, accurate even where it is tiny.
    auc
        Area under the whole curve.
    p_detection_error, auc_error
        Absolute errors of both as estimated by the integral; shape (K,) and a number.
    warnings
        Limits of the result.
    """

    target: str
    background: str
    p_false_alarm: FloatArray
    p_detection: FloatArray
    p_miss: FloatArray
    auc: float
    p_detection_error: FloatArray
    auc_error: float
    warnings: tuple[str, ...]


def detections_of_cases(
    cases: Sequence[PairCase],
    p_false_alarm: Sequence[float] | FloatArray,
    *,
    kind: Literal["stokes", "intensity"] = "stokes",
    tolerance: float = 1e-10,
) -> tuple[PairDetection, ...]:
    """Return the performance of the RX detector for each of several cases, in about the time of one.

    Parameters
    ----------
    cases
        Target, background, and the predictions of one cycle by region.
    p_false_alarm
        Shape (K,), each in (0, 1).
    kind
        Detection on Stokes parameters, three components, or on the counts behind each angle of the polarizer.
    tolerance
        Relative tolerance of the integrated tail, 1e-12 to 0.01.

    Returns
    -------
    tuple of PairDetection
        Nan with the reason in its warnings, if a background's covariance is singular.

    References
    ----------
    [MK14] eq. (30), section IV-B: "multichannel intensity or Stokes parameters".
    """
    if not cases:
        return ()
    rates = np.asarray(p_false_alarm, dtype=np.float64)
    try:
        return _together(cases, rates, kind=kind, tolerance=tolerance)
    except (ValueError, ArithmeticError) as error:
        half = len(cases) // 2
        if half:
            # One impossible case makes all fail, so each half is tried on its own.
            return tuple(
                found
                for some in (cases[:half], cases[half:])
                for found in detections_of_cases(some, rates, kind=kind, tolerance=tolerance)
            )
        ((target, background, _),) = cases
        nothing = np.full(rates.shape, np.nan)
        is_singular = isinstance(error, ValueError)
        reason = f"{background} cannot be a background" if is_singular else f"{target} on {background}"
        return (
            PairDetection(
                target=target,
                background=background,
                p_false_alarm=rates,
                p_detection=nothing,
                p_miss=nothing,
                auc=np.nan,
                p_detection_error=nothing,
                auc_error=np.nan,
                warnings=(f"{reason}: {error}",),
            ),
        )


def detections_of_sweep(
    alternatives: Sequence[Mapping[str, RegionPrediction]],
    p_false_alarm: Sequence[float],
    *,
    pairs: Sequence[tuple[str, str]] | None = None,
    tolerance: float = 1e-10,
) -> tuple[tuple[PairDetection, ...], ...]:
    """Return the detections of several sets of predictions, for some pairs or for every ordered pair.

    Parameters
    ----------
    alternatives
        Predictions by region, all with the same regions.
    p_false_alarm, tolerance
        As in `detections_of_cases`.
    pairs
        Targets and backgrounds.
    """
    if pairs is None:
        pairs = tuple(permutations(alternatives[0], 2)) if alternatives else ()
    cases = [(target, background, one) for one in alternatives for target, background in pairs]
    found = detections_of_cases(cases, p_false_alarm, tolerance=tolerance)
    return tuple(found[k * len(pairs) : (k + 1) * len(pairs)] for k in range(len(alternatives)))


def _counts(prediction: RegionPrediction) -> Moments:
    """Return mean and covariance of the counts of single pixels of one cycle, [MK14] eq. (18), (20)."""
    channels = prediction.channels
    noise = np.diag(channels.temporal_var_dn2)
    return Moments(mean=channels.mean_dn, cov=channels.scene_cov_dn2 + channels.fixed_pattern_cov_dn2 + noise)


def _together(
    cases: Sequence[PairCase], rates: FloatArray, *, kind: Literal["stokes", "intensity"], tolerance: float
) -> tuple[PairDetection, ...]:
    """Return detection of all cases by one integral; ValueError if a background's covariance is singular."""

    def pixels(one: RegionPrediction) -> Moments:
        return one.stokes_dn if kind == "stokes" else _counts(one)

    targets = [pixels(predictions[target]) for target, _, predictions in cases]
    backgrounds = [pixels(predictions[background]) for _, background, predictions in cases]
    moments = (
        np.stack([getattr(one, moment) for one in several])
        for several in (targets, backgrounds)
        for moment in ("mean", "cov")
    )
    curves = rx_roc(rates[:, np.newaxis], *moments, tolerance=tolerance)
    p_detection_error = curves.error * np.maximum(curves.p_detection, curves.p_miss)
    auc_error = curves.auc_error * np.minimum(curves.auc, 1.0 - curves.auc)
    return tuple(
        PairDetection(
            target=target,
            background=background,
            p_false_alarm=rates,
            p_detection=curves.p_detection[:, k],
            p_miss=curves.p_miss[:, k],
            auc=float(curves.auc[k]),
            p_detection_error=p_detection_error[:, k],
            auc_error=float(auc_error[k]),
            warnings=condition_warnings(curves.background_condition[k]),
        )
        for k, (target, background, _) in enumerate(cases)
    )
