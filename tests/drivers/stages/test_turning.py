import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import LimitError
from drivers.interfaces import Way
from drivers.stages.apt import find_model
from drivers.stages.serial_stage import distance_deg, require_finite, route_deg, target_within_deg

ANGLES = st.floats(-1e4, 1e4)


@pytest.mark.parametrize(
    ("from_deg", "angle_deg", "way", "route"),
    [
        (0.0, 90.0, "short", 90.0),
        (350.0, 10.0, "short", 20.0),
        (10.0, 350.0, "short", -20.0),
        (10.0, 350.0, "forward", 340.0),
        (350.0, 10.0, "backward", -340.0),
        (90.0, 90.01, "backward", 0.01),  # near enough to be there: no turn is made for it
        (720.5, 0.0, "short", -0.5),
    ],
)
def test_routes(from_deg: float, angle_deg: float, way: Way, route: float) -> None:
    # Angles up to 720 have a rounding of 1e-13.
    assert route_deg(from_deg, angle_deg, way=way, near_deg=0.02) == pytest.approx(route, abs=1e-12)


@settings(deadline=None, max_examples=200)
@given(from_deg=ANGLES, angle_deg=ANGLES, way=st.sampled_from(["short", "forward", "backward"]))
def test_every_route_ends_at_the_angle(from_deg: float, angle_deg: float, way: Way) -> None:
    route = route_deg(from_deg, angle_deg, way=way, near_deg=0.02)
    assert distance_deg(from_deg + route, angle_deg) <= 1e-8  # rounding of angles up to 1e4
    assert abs(route) <= 360.0


@pytest.mark.parametrize(
    ("from_deg", "angle_deg", "target_deg"),
    [(350.0, 10.0, 10.0), (10.0, -10.0, 350.0), (100.0, 200.0, 200.0)],
)
def test_limits_make_the_short_way_long(from_deg: float, angle_deg: float, target_deg: float) -> None:
    found = target_within_deg(from_deg, angle_deg, way="short", near_deg=0.02, lowest_deg=0.0, highest_deg=360.0)
    assert found == pytest.approx(target_deg, abs=1e-12)


def test_limits_refuse_a_way_that_was_asked_for() -> None:
    with pytest.raises(LimitError, match=r"forward way.*limits, 0 to 360"):
        target_within_deg(350.0, 10.0, way="forward", near_deg=0.02, lowest_deg=0.0, highest_deg=360.0)


def test_an_angle_outside_of_the_limits_is_refused() -> None:
    with pytest.raises(LimitError, match="limits"):
        target_within_deg(50.0, 200.0, way="short", near_deg=0.02, lowest_deg=0.0, highest_deg=180.0)


@pytest.mark.parametrize("angle_deg", [float("nan"), float("inf")])
def test_an_angle_must_be_finite(angle_deg: float) -> None:
    with pytest.raises(LimitError, match="finite"):
        require_finite(angle_deg)


PER_DEG = {
    "ELL14": 143360 / 360.0,
    "ELL14 of 0x40000": 262144 / 360.0,
    "ELL16": 65536 / 360.0,
    "Zaber": 1536000 / 360.0,
    "K10CR1": find_model("K10CR1", stage_id=0, actuator=None).counts_per_deg,
    "PRM1-Z8": find_model("KDC101", stage_id=6, actuator=None).counts_per_deg,
}


@pytest.mark.parametrize("name", list(PER_DEG))
def test_every_thousandth_of_a_degree_goes_through_counts_within_half_a_count(name: str) -> None:
    per_deg = PER_DEG[name]
    worst_counts = max(
        abs(round(angle_deg * per_deg) - angle_deg * per_deg) for angle_deg in (n / 1000.0 for n in range(360_000))
    )
    assert worst_counts <= 0.5
