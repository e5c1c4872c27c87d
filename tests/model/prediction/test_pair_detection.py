from dataclasses import replace

import numpy as np
import pytest

from model.prediction import detections_of_cases, detections_of_sweep, predict
from model.processing.detection import rx_p_detection
from model.scene.scene import RegionLight, Scenario
from tests.model.prediction.test_whole_chain import READOUT, SENSOR


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
