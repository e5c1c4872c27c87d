from dataclasses import replace

import numpy as np
import pytest

from model.moments import Moments
from model.prediction import (
    RigErrors,
    budget,
    detections_of_cases,
    detections_of_sweep,
    polarization_strength,
    predict,
    predict_with_errors,
    reason_missing,
    shift_cause,
)
from model.processing.detection import rx_p_detection
from model.processing.reconstruction import design
from model.scene.scene import Readout, RegionLight, Scenario
from model.sensor import Imperfections, drifting_light
from tests.model.prediction.test_whole_chain import READOUT, SENSOR
from tests.model.sensors import sensor


def test_what_a_region_lacks_has_its_reason():
    assert reason_missing(predicted(a=((20.0, 5.0, 1.0), 0.01))["a"]) == {}
    unpolarised = reason_missing(predicted(a=((20.0, 0.0, 0.0), 0.0))["a"])
    assert "unpolarised" in unpolarised["aolp_deg"]
    assert "dolp_pixels" not in unpolarised


def test_light_as_good_as_none_has_no_ratios_and_no_warning():
    (dark,) = predicted(a=((1e-200, 1e-201, 0.0), 0.0)).values()
    assert {"s1n", "dolp", "dolp_pixels"}.isdisjoint(dark.quantities)
    assert "as good as 0" in reason_missing(dark)["dolp"]


def predicted(**lights):
    regions = tuple(
        RegionLight(name=name, stokes_radiance=np.array(stokes), texture_rms=rms, texture_cov=np.zeros((3, 3)))
        for name, (stokes, rms) in lights.items()
    )
    return predict(Scenario(regions=regions, sensor=SENSOR, readout=READOUT))


def test_every_ordered_pair_is_there_and_a_pair_of_equals_is_chance():
    predictions = predicted(a=((20.0, 5.0, 1.0), 0.01), b=((20.0, 5.0, 1.0), 0.01), c=((21.0, 4.0, 1.0), 0.01))
    (found,) = detections_of_sweep([predictions], (1e-3, 1e-2))
    assert [(pair.target, pair.background) for pair in found] == [
        ("a", "b"), ("a", "c"), ("b", "a"), ("b", "c"), ("c", "a"), ("c", "b"),
    ]  # fmt: skip
    assert found[0].p_detection == pytest.approx([1e-3, 1e-2], rel=1e-9)
    assert found[0].auc == pytest.approx(0.5, abs=1e-9)
    assert np.all(found[1].p_detection > [1e-3, 1e-2])


def test_several_sets_of_predictions_are_detected_as_each_alone():
    several = [predicted(a=((s0, 5.0, 1.0), 0.01), b=((20.5, 4.0, 1.0), 0.02)) for s0 in (20.0, 20.1, 23.0)]
    found = detections_of_cases([("a", "b", one) for one in several], (1e-3, 1e-2))
    for predictions, together in zip(several, found, strict=True):
        (alone,) = detections_of_cases([("a", "b", predictions)], (1e-3, 1e-2))
        np.testing.assert_allclose(together.p_detection, alone.p_detection, rtol=1e-9)
        assert together.auc == pytest.approx(alone.auc, rel=1e-9)
        assert together.p_detection_error.shape == (2,)
        assert together.warnings == alone.warnings


def test_a_roc_on_counts_is_the_detector_on_the_channels():
    found = predicted(a=((20.0, 5.0, 1.0), 0.01), b=((20.5, 4.0, 1.0), 0.02))
    rates = [1e-3, 1e-2, 1e-1]
    (counts,) = detections_of_cases([("a", "b", found)], rates, kind="intensity")
    moments = []
    for name in ("a", "b"):
        channels = found[name].channels
        cov = channels.scene_cov_dn2 + channels.fixed_pattern_cov_dn2 + np.diag(channels.temporal_var_dn2)
        moments += [channels.mean_dn, cov]
    np.testing.assert_allclose(counts.p_detection, rx_p_detection(np.array(rates), *moments), rtol=1e-8)


def test_one_background_that_cannot_be_is_named_and_spoils_no_other_case():
    good = predicted(a=((20.0, 5.0, 1.0), 0.01), b=((20.5, 4.0, 1.0), 0.02))
    flat = replace(good["b"], stokes_dn=replace(good["b"].stokes_dn, cov=np.zeros((3, 3))))
    first, second, third = detections_of_cases(
        [("a", "b", good), ("a", "b", good | {"b": flat}), ("b", "a", good)], (1e-3, 1e-2)
    )
    assert np.isnan(second.p_detection).all()
    assert second.warnings[0].startswith("b cannot be a background: ")
    assert np.isfinite([*first.p_detection, *third.p_detection]).all()


def test_half_of_the_pixels_lie_below_the_median():
    strength = polarization_strength(predicted(a=((20.0, 5.0, 1.0), 0.01))["a"])
    assert list(strength.quantiles) == sorted(strength.quantiles)
    # Close to normal at this signal: the median is close to DoLP of the mean, off by the order of NEDoLP^2 / DoLP.
    assert strength.quantiles[1] == pytest.approx(np.hypot(5, 1) / 20, abs=2 * strength.nedolp**2 / 0.25)


def test_noise_floor_does_not_hold_texture():
    plain = polarization_strength(predicted(a=((20.0, 5.0, 1.0), 0.0))["a"])
    textured = polarization_strength(predicted(a=((20.0, 5.0, 1.0), 0.05))["a"])
    assert textured.nedolp == pytest.approx(plain.nedolp, rel=1e-12)


def test_unpolarised_light_shows_its_noise_floor():
    prediction = predicted(a=((20.0, 0.0, 0.0), 0.0))["a"]
    strength = polarization_strength(prediction)
    # Rice: mean over deviation of a component is sqrt(pi / 2), up to the square of the noise of S0.
    assert strength.unpolarised_mean == pytest.approx(np.sqrt(np.pi / 2) * strength.nedolp, rel=1e-3)
    assert prediction.quantities["dolp_pixels"]["mean"] == pytest.approx(strength.unpolarised_mean, rel=1e-6)


@pytest.mark.parametrize(
    ("s0", "noise", "nedolp"),
    [
        # Channels of 500 with deviation 2: S0 = 1000, covariance 4 diag(1, 2, 2); 1 / (sqrt 2 snr) of one channel.
        (1000.0, 4.0 * np.diag([1.0, 2.0, 2.0]), 1.0 / (np.sqrt(2.0) * 250.0)),
        # Shot noise.
        (1e4, 1e4 * np.diag([0.5, 1.0, 1.0]), 1e-2),
    ],
)
def test_noise_floor_of_modified_pickering(s0, noise, nedolp):
    prediction = predicted(a=((20.0, 0.0, 0.0), 0.0))["a"]
    stokes = Moments(mean=np.array([s0, 0.0, 0.0]), cov=noise)
    found = polarization_strength(replace(prediction, stokes_dn=stokes, stokes_noise_dn2=noise))
    assert found.nedolp == pytest.approx(nedolp, rel=1e-14)
    # Rice; S0 fluctuates too, which adds its relative variance.
    assert found.unpolarised_mean == pytest.approx(1.25331413731550025 * nedolp, rel=noise[0, 0] / s0**2 + 1e-6)


PLAN = design(np.deg2rad([0.0, 45.0, 90.0, 135.0]), np.inf)


def test_additive_noise_makes_the_known_deviations():
    stokes = np.array([1000.0, 300.0, 400.0])
    found = budget(PLAN.system @ stokes, {"read": np.eye(4)}, plan=PLAN)
    # Modified Pickering, sigma = 1: cov S = diag(1, 2, 2), so var P = (2 + P^2) / S0^2 and var psi = 2 / (4 Q^2).
    assert found["dolp"]["read"] == pytest.approx(np.sqrt(2.25) / 1000.0)
    assert found["s0"]["read"] == pytest.approx(1e-3)
    assert found["aolp_deg"]["read"] == pytest.approx(np.rad2deg(np.sqrt(2.0) / 1000.0))


def test_a_common_factor_moves_s0_alone():
    mean = PLAN.system @ np.array([1000.0, 300.0, 400.0])
    found = budget(mean, {"scale": 1e-4 * np.outer(mean, mean)}, plan=PLAN)
    assert found["s0"]["scale"] == pytest.approx(0.01)
    # The root of rounding of 1e-4.
    assert found["dolp"]["scale"] < 1e-9


def test_unpolarised_light_has_no_angle():
    found = budget(PLAN.system @ np.array([1000.0, 0.0, 0.0]), {"read": np.eye(4)}, plan=PLAN)
    assert set(found) == {"s0", "s1n", "s2n"}


def test_no_light_is_refused():
    with pytest.raises(ValueError, match="must be above 0"):
        budget(np.zeros(4), {"read": np.eye(4)}, plan=PLAN)


def test_a_shift_acts_by_the_mean_gradient():
    down, right = np.mgrid[0:20, 0:30].astype(float)
    pictures = np.stack([3.0 * right + 2.0 * down, 0.0 * down])
    inside = np.zeros((20, 30), dtype=bool)
    inside[5:10, 5:10] = True
    found = shift_cause(pictures, inside, shift_pixels=np.array([[0.5, 1.0], [0.5, 1.0]]))
    np.testing.assert_allclose(found, np.diag([1.5**2 + 2.0**2, 0.0]), atol=1e-12)


ANGLES = np.deg2rad([0.0, 45.0, 90.0, 135.0])
NONE = RigErrors(turned_rad=np.zeros(4), exposure_ratio=1.0)


def _scenario():
    light = RegionLight(
        name="panel", stokes_radiance=np.array([10.0, 3.0, 1.0]), texture_rms=0.02, texture_cov=np.zeros((3, 3))
    )
    names = ("dn_0", "dn_45", "dn_90", "dn_135")
    readout = Readout(angles_rad=ANGLES, channel_names=names, cycles=2, extinction_ratio=np.inf)
    return Scenario(regions=(light,), sensor=sensor(), readout=readout)


def _quantities(errors):
    return predict_with_errors(_scenario(), errors)["panel"].quantities


def test_without_errors_it_is_the_plain_prediction():
    plain = predict(_scenario())["panel"].quantities
    found = _quantities(NONE)
    for name, statistics in plain.items():
        for statistic, value in statistics.items():
            assert found[name][statistic] == pytest.approx(value, rel=1e-13), (name, statistic)


def test_without_errors_the_session_adds_what_it_adds_to_the_plain_prediction():
    session = Imperfections(polarizer_angle_std_rad=0.02, misregistration_pixels=0.5, drift=0.03)
    scenario = replace(_scenario(), imperfections=session)
    plain, found = predict(scenario)["panel"].quantities, predict_with_errors(scenario, NONE)["panel"].quantities
    assert plain["s1"]["std"] != pytest.approx(_quantities(NONE)["s1"]["std"], rel=1e-2)
    for name, statistics in plain.items():
        assert found[name] == pytest.approx(statistics, rel=1e-13), name


def test_a_turned_axis_turns_the_angle_of_polarization_the_other_way_and_leaves_dolp():
    plain = _quantities(NONE)
    found = _quantities(replace(NONE, turned_rad=np.full(4, np.deg2rad(2.0))))
    assert found["aolp_deg"]["mean"] - plain["aolp_deg"]["mean"] == pytest.approx(-2.0, abs=1e-9)
    assert found["dolp"]["mean"] == pytest.approx(plain["dolp"]["mean"], rel=1e-12)


def test_exposure_scales_the_counts_and_not_their_ratios():
    plain, found = _quantities(NONE), _quantities(replace(NONE, exposure_ratio=1.1))
    assert found["s0"]["mean"] == pytest.approx(1.1 * plain["s0"]["mean"], rel=1e-12)
    assert found["s1n"]["mean"] == pytest.approx(plain["s1n"]["mean"], rel=1e-12)


def test_drift_scales_means_and_shot_noise_of_each_frame():
    # 0 deg is the last of four frames: 0.8, 0.93, 1.07, 1.2 of the mean light.
    session = Imperfections(drift=0.4, drift_order=(3, 0, 1, 2))
    plain = _quantities(NONE)
    found = predict_with_errors(replace(_scenario(), imperfections=session), NONE)["panel"].quantities
    assert found["dn_0"]["mean"] == pytest.approx(1.2 * plain["dn_0"]["mean"], rel=1e-12)
    brighter = replace(_scenario().sensor, exposure_s=1.2 * _scenario().sensor.exposure_s)
    same = predict(replace(_scenario(), sensor=brighter))["panel"].quantities["dn_0"]["std_temporal"]
    # A longer exposure makes as much more light, and a little more dark current, which is the rest.
    assert found["dn_0"]["std_temporal"] == pytest.approx(same, rel=1e-3)


def test_linear_drift_in_the_order_0_90_45_135_makes_the_known_false_dolp():
    # 0.2357 times the drift over the cycle of four frames (closed form 1/2 eps sqrt(dt_0,90^2 + dt_45,135^2)).
    light = drifting_light(0.01, np.array([0, 2, 1, 3]))
    s0 = light.sum() / 2.0
    assert np.hypot(light[0] - light[2], light[1] - light[3]) / s0 == pytest.approx(0.002357, rel=1e-3)


def test_errors_that_do_not_fit_the_angles_are_refused():
    with pytest.raises(ValueError, match="does not fit 4 angles"):
        _quantities(replace(NONE, turned_rad=np.zeros(3)))


def test_an_exposure_of_nothing_is_refused():
    with pytest.raises(ValueError, match="above 0"):
        _quantities(replace(NONE, exposure_ratio=0.0))
