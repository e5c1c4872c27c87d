from model.prediction import reason_missing
from tests.model.prediction.test_pair_detection import predicted


def test_what_a_region_lacks_has_its_reason():
    assert reason_missing(predicted(a=((20.0, 5.0, 1.0), 0.01))["a"]) == {}
    unpolarised = reason_missing(predicted(a=((20.0, 0.0, 0.0), 0.0))["a"])
    assert "unpolarised" in unpolarised["aolp_deg"]
    assert "dolp_pixels" not in unpolarised


def test_light_as_good_as_none_has_no_ratios_and_no_warning():
    (dark,) = predicted(a=((1e-200, 1e-201, 0.0), 0.0)).values()
    assert {"s1n", "dolp", "dolp_pixels"}.isdisjoint(dark.quantities)
    assert "as good as 0" in reason_missing(dark)["dolp"]
