"""What stages of every family share: the way to an angle, counts, and what becomes of a line that fails."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import DeviceFaultError, DeviceTimeoutError, LimitError, NotConnectedError, ProtocolError
from drivers.interfaces import Way
from drivers.stages.apt import find_model
from drivers.stages.elliptec import open_elliptec
from drivers.stages.serial_stage import distance_deg, route_deg, target_within_deg
from sim_devices.clock import SimClock
from sim_devices.stages.catalogue import make_stage, parse_stage_address
from sim_devices.stages.stage import InProcessPort, serve_on_pty
from tests.drivers.stages.lines import FAMILIES, Bench

ANGLES = st.floats(-1e4, 1e4)
TOLERANCE_DEG, HALF_COUNT_DEG = 0.02, 180.0 / 65536
PICKERING_DEG = (0.0, 90.0, 45.0, 135.0)
families = pytest.mark.parametrize("family", FAMILIES)


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


@pytest.mark.parametrize(
    ("from_deg", "angle_deg", "way", "highest_deg"), [(350.0, 10.0, "forward", 360.0), (50.0, 200.0, "short", 180.0)]
)
def test_a_way_beyond_the_limits_is_refused(from_deg: float, angle_deg: float, way: Way, highest_deg: float) -> None:
    with pytest.raises(LimitError, match=rf"{way} way.*limits, 0 to {highest_deg:g}"):
        target_within_deg(from_deg, angle_deg, way=way, near_deg=0.02, lowest_deg=0.0, highest_deg=highest_deg)


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
        abs(round(angle_deg * per_deg) - angle_deg * per_deg)
        for angle_deg in (n / 1000.0 for n in range(0, 360_000, 7))
    )
    assert worst_counts <= 0.5


@families
@pytest.mark.parametrize("tolerance_deg", [0.0, 180.0, float("nan")])
def test_a_tolerance_that_means_nothing_is_refused(family: str, tolerance_deg: float) -> None:
    with pytest.raises(LimitError, match="half an encoder count"):
        Bench(family).connect(tolerance_deg=tolerance_deg)


@families
def test_a_port_that_vanishes_and_comes_back_is_opened_again_and_all_is_as_before(family: str) -> None:
    bench = Bench(f"{family}?vanish=60&back=3&start=1")
    stage = bench.homed()
    with pytest.raises(NotConnectedError, match="disconnected"):
        all(stage.position() for _ in range(60))
    stage.close()
    with pytest.raises(NotConnectedError, match="disconnected"):
        bench.connect()
    bench.clock.advance(3.0)
    assert bench.homed().move_to(45.0).position.angle_deg == pytest.approx(45.0, abs=TOLERANCE_DEG)


@pytest.mark.parametrize("family", ["ellx", "zaber"])
def test_after_a_stall_the_stage_moves_again(family: str) -> None:
    bench = Bench(f"{family}?stall=1")
    stage = bench.homed()
    with pytest.raises(DeviceFaultError, match="stalled"):
        stage.move_to(90.0)
    stage.move_to(90.0)
    assert bench.off_deg(90.0) <= TOLERANCE_DEG + HALF_COUNT_DEG


@families
@pytest.mark.parametrize("late_s", [0.4, 1.1, 2.5])
def test_answers_later_than_their_deadline_never_give_a_wrong_angle(family: str, late_s: float) -> None:
    bench = Bench(f"{family}?late={late_s}")
    try:
        stage = bench.homed()
        for target_deg in PICKERING_DEG:
            stage.move_to(target_deg)
            assert bench.off_deg(target_deg) <= TOLERANCE_DEG + HALF_COUNT_DEG
            assert bench.off_deg(stage.position().angle_deg) <= HALF_COUNT_DEG
    except (DeviceTimeoutError, ProtocolError):
        assert late_s > 0.5  # what comes within its deadline is no error


# A move of an APT controller is not confirmed: a lost one may end in an error.
@pytest.mark.parametrize("family", ["ellx", "zaber"])
@pytest.mark.parametrize("damage", ["drop", "double", "flip"])
def test_a_line_that_loses_one_byte_in_five_hundred_is_worked_with(family: str, damage: str) -> None:
    bench = Bench(f"{family}?{damage}=0.002&seed=5")
    stage = bench.homed()
    for target_deg in PICKERING_DEG * 5:
        stage.move_to(target_deg)
        assert bench.off_deg(target_deg) <= TOLERANCE_DEG + HALF_COUNT_DEG


@families
def test_an_interrupted_move_leaves_nothing_behind(family: str, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(f"{family}?slow=20")
    stage = bench.homed()

    def interrupt(*args: object, **kwargs: object) -> bytes:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(InProcessPort, "read_some", interrupt)
        with pytest.raises(KeyboardInterrupt):
            stage.move_to(90.0)
    stage.move_to(45.0)
    assert bench.off_deg(45.0) <= TOLERANCE_DEG + HALF_COUNT_DEG


def test_a_port_is_released_when_nothing_answers() -> None:
    clock = SimClock(speed=50.0)
    machine = make_stage(parse_stage_address("sim:ellx?model=17"), clock=clock)
    with serve_on_pty(machine, clock=clock) as path:
        with pytest.raises(ProtocolError, match="ELL17") as first:
            open_elliptec(path, sleep=clock.sleep)
        # `first` keeps the port's object alive, so that only closing it can have released it
        with pytest.raises(ProtocolError, match="ELL17"):
            open_elliptec(path, sleep=clock.sleep)
    assert first.value.__traceback__ is not None
