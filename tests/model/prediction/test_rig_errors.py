from dataclasses import replace

import numpy as np
import pytest

from model.prediction import RigErrors, predict, predict_with_errors
from model.scene.scene import Readout, RegionLight, Scenario
from model.sensor import Imperfections, drifting_light
from tests.model.sensors import sensor

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


def test_no_light_is_refused():
    with pytest.raises(ValueError, match="above 0"):
        _quantities(replace(NONE, exposure_ratio=0.0))
