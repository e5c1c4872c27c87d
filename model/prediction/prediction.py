"""Prediction of a scenario: counts, Stokes parameters, DoLP and their deviations, per region."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments
from model.processing import dolp
from model.processing.reconstruction import Design, design
from model.processing.stokes_ratios import aolp_moments_rad, normalized_moments
from model.scene.scenario import Readout, RegionLight, Scenario
from model.sensor.channels import ChannelMoments, channel_moments

FloatArray = NDArray[np.float64]

# Less polarised light than this share of S0 is the rounding of none, and has no direction.
_ROUNDING = 1e-12
# Less is no light: squares of what is divided by it would not be numbers.
LEAST_S0_DN = 1e-100
# Moments of DoLP exist if they do to this tolerance, whatever looser one they are computed to: what a coarse prediction
# gives no finer one takes away, down to fifty times this.
_EXISTING_TO = 1e-6

# quantity -> statistic -> number. Quantities: dn_ANGLE, and those of `model.prediction.quantity_table`.
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
        Mean and covariance of the Stokes parameters over the pixels of one cycle [DN], dark level taken off.
    stokes_noise_dn2
        Covariance that temporal noise alone gives the Stokes parameters of one cycle, shape (3, 3) [DN^2].
    dolp_method
        How mean and deviation of the pixels' DoLP were found.
    dolp_mean_error, dolp_std_error
        Their absolute errors as that method estimates them itself; not a number where they do not exist.
    quantities
        Everything a measurement is set beside. Where moments of DoLP do not exist they are left out.
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
    """Return what the model predicts for each region of a scenario.

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
    """Return what `predict` does for each of several scenarios, with the laws of DoLP of all regions at once.

    Parameters
    ----------
    scenarios
        Light, sensor and readout of each.
    tolerance
        As in `predict`.

    References
    ----------
    [MK14] eq. (10)-(29).
    """
    found = [
        (place, region.name, _of_region(region, one, plan))
        for place, (one, plan) in enumerate(zip(scenarios, _designs(scenarios), strict=True))
        for region in one.regions
    ]
    laws = _distributions([moments.stokes for _, _, moments in found], tolerance)
    predictions: tuple[dict[str, RegionPrediction], ...] = tuple({} for _ in scenarios)
    for (place, name, moments), law in zip(found, laws, strict=True):
        predictions[place][name] = _completed(moments, law)
    return predictions


def _designs(scenarios: Sequence[Scenario]) -> list[Design]:
    """Design of each scenario; made once for those that are read out alike."""
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
    """Return what follows from the moments of a region's channels.

    Parameters
    ----------
    channels
        From the sensor model, or with mean and scene covariance as they were measured.
    plan
        Polarizer angles and the inverse in use, N channels.
    channel_names
        N names, used as keys of the counts.
    cycles
        Number of repeats that a mean is taken over, >= 1.
    tolerance
        Relative tolerance of mean and deviation of the pixels' DoLP.

    References
    ----------
    [MK14] eq. (19)-(29).
    """
    moments = _linear_moments(channels, plan, channel_names, cycles)
    return _completed(moments, _distributions([moments.stokes], tolerance)[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class _LinearMoments:
    """What follows linearly from the moments of a region's channels."""

    channels: ChannelMoments
    plan: Design
    stokes: Moments
    noise_dn2: FloatArray
    quantities: Quantities


def _linear_moments(
    channels: ChannelMoments, plan: Design, channel_names: tuple[str, ...], cycles: int
) -> _LinearMoments:
    temporal = channels.temporal_var_dn2[:, None] * np.eye(channels.mean_dn.size)
    spatial = channels.scene_cov_dn2 + channels.fixed_pattern_cov_dn2
    covs = {"std": spatial + temporal, "std_temporal": temporal, "std_spatial_mean": spatial + temporal / cycles}
    stokes_mean = plan.inverse @ channels.mean_dn
    stokes_covs = {name: plan.inverse @ cov @ plan.inverse.T for name, cov in covs.items()}
    quantities = _linear(channel_names, channels.mean_dn, covs)
    quantities |= _linear(("s0", "s1", "s2"), stokes_mean, stokes_covs)
    return _LinearMoments(
        channels=channels,
        plan=plan,
        stokes=Moments(mean=stokes_mean, cov=stokes_covs["std"]),
        noise_dn2=stokes_covs["std_temporal"],
        quantities=quantities,
    )


def _completed(moments: _LinearMoments, distribution: "_Distribution") -> RegionPrediction:
    """Prediction of a region with the law of its DoLP."""
    quantities, stokes = moments.quantities, moments.stokes
    if stokes.mean[0] > LEAST_S0_DN:
        quantities |= _ratios(stokes)
    if distribution.exists:
        quantities["dolp_pixels"] = {"mean": distribution.mean, "std": distribution.std}
        if distribution.std > 0.0:
            quantities["dolp_snr"] = {"mean": distribution.mean / distribution.std} | quantities.get("dolp_snr", {})
    missing = (
        () if distribution.exists else (f"mean and deviation of the pixels' DoLP do not exist: {distribution.reason}",)
    )
    return RegionPrediction(
        channels=moments.channels,
        stokes_dn=stokes,
        stokes_noise_dn2=moments.noise_dn2,
        dolp_method=distribution.method,
        dolp_mean_error=distribution.mean_error,
        dolp_std_error=distribution.std_error,
        quantities=quantities,
        warnings=(*moments.channels.warnings, *moments.plan.warnings, *missing),
    )


def reason_missing(prediction: RegionPrediction) -> dict[str, str]:
    """Return the quantities that a region lacks, wholly or in part, each with the reason.

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
    """Return moments of channels with what flat fields and interpolation do to them.

    Parameters
    ----------
    channels
        As frames have them; without the response of pixels where a flat field takes it away.
    readout
        Its `noise_factor` and `flat_error`.

    Notes
    -----
    The error of a flat field is a pattern of each angle by itself: unlike the response that it takes away, it shows in
    DoLP.
    """
    if readout.noise_factor is not None:
        channels = replace(channels, temporal_var_dn2=channels.temporal_var_dn2 * readout.noise_factor)
    if readout.flat_error is None:
        return channels
    added = np.square(channels.mean_dn * readout.flat_error)[:, None] * np.eye(channels.mean_dn.size)
    return replace(channels, fixed_pattern_cov_dn2=channels.fixed_pattern_cov_dn2 + added)


@dataclass(frozen=True, kw_only=True)
class _Distribution:
    """Mean and deviation of the pixels' DoLP, or why there are none."""

    mean: float
    std: float
    mean_error: float
    std_error: float
    method: str
    exists: bool
    reason: str


def _distributions(several: Sequence[Moments], tolerance: float) -> list[_Distribution]:
    """Law of DoLP of each, all at once; none where there is no light."""
    lit = [k for k, one in enumerate(several) if one.mean[0] > LEAST_S0_DN]
    laws = [_dark(float(one.mean[0])) for one in several]
    if lit:
        means, covs = (np.stack([getattr(several[k], name) for k in lit]) for name in ("mean", "cov"))
        found = dolp.moments(means, covs, tolerance=tolerance, existing_to=_EXISTING_TO)
        for place, k in enumerate(lit):
            laws[k] = _Distribution(
                mean=float(found.mean[place]),
                std=float(found.std[place]),
                mean_error=float(found.mean_error[place]),
                std_error=float(found.std_error[place]),
                method=str(found.method[place]),
                exists=bool(found.exists[place]),
                reason=str(found.reason[place]),
            )
    return laws


def _no_light(s0: float) -> str:
    return f"the mean of S0 is {s0:.3g} DN, {'as good as' if s0 > 0.0 else 'not above'} 0"


def _dark(s0: float) -> _Distribution:
    return _Distribution(
        mean=np.nan,
        std=np.nan,
        mean_error=np.nan,
        std_error=np.nan,
        method="none",
        exists=False,
        reason=_no_light(s0),
    )


def _of_region(region: RegionLight, scenario: Scenario, plan: Design) -> _LinearMoments:
    readout = scenario.readout
    channels = channel_moments(
        region.aperture_moments(),
        angles_rad=readout.angles_rad,
        sensor=scenario.sensor,
        flat_fielded=readout.flat_error is not None,
        imperfections=scenario.imperfections,
        smooth_cov=region.smooth_cov(),
    )
    return _linear_moments(as_processed(channels, readout), plan, readout.channel_names, readout.cycles)


def _linear(names: tuple[str, ...], mean: FloatArray, covs: dict[str, FloatArray]) -> Quantities:
    deviations = {kind: _deviations(cov) for kind, cov in covs.items()}
    return {
        name: {"mean": float(mean[k])} | {kind: float(each[k]) for kind, each in deviations.items()}
        for k, name in enumerate(names)
    }


def _deviations(cov: FloatArray) -> FloatArray:
    """Return standard deviations; a variance that is negative by rounding, where nothing fluctuates, is none."""
    return np.asarray(np.sqrt(np.maximum(np.diag(cov), 0.0)))


def _ratios(stokes: Moments) -> Quantities:
    """Return what does not depend on the scale of the counts: of the mean, with first-order deviations of a pixel."""
    normalized = normalized_moments(stokes)
    deviations = _deviations(normalized.cov)
    found = {
        "s1n": {"mean": float(normalized.mean[0]), "std": float(deviations[0])},
        "s2n": {"mean": float(normalized.mean[1]), "std": float(deviations[1])},
    }
    is_polarised = float(np.hypot(stokes.mean[1], stokes.mean[2])) > _ROUNDING * float(stokes.mean[0])
    return found | (_polarised_ratios(stokes) if is_polarised else {"dolp": {"mean": 0.0}})


def _polarised_ratios(stokes: Moments) -> Quantities:
    aolp = aolp_moments_rad(stokes)
    first = dolp.first_order(stokes.mean, stokes.cov)
    first_std = float(np.sqrt(first.variance))
    return {
        "dolp": {"mean": float(first.mean), "std": first_std},
        "aolp_deg": {
            "mean": float(np.rad2deg(aolp.mean[0])),
            "std": float(np.rad2deg(np.sqrt(aolp.cov[0, 0]))),
        },
    } | ({"dolp_snr": {"first_order": float(first.mean) / first_std}} if first_std > 0.0 else {})
