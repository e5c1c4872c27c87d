"""What every rotation stage promises, whatever its make, simulated or of metal."""

from collections.abc import Iterator

import pytest

from drivers.errors import LimitError, NotConnectedError
from drivers.interfaces import Way
from tests.contracts.stages_under_test import STAGES, Maker, StageUnderTest, named


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    address = metafunc.config.getoption("--stage")
    makers = STAGES if address is None else {address: named(address)}
    metafunc.parametrize("maker", list(makers.values()), ids=list(makers), indirect=True)


@pytest.fixture
def maker(request: pytest.FixtureRequest) -> Maker:
    made: Maker = request.param
    return made


@pytest.fixture
def fresh(maker: Maker) -> Iterator[StageUnderTest]:
    """A stage as it is when it was opened."""
    with maker() as under_test:
        yield under_test


@pytest.fixture
def homed(fresh: StageUnderTest) -> StageUnderTest:
    fresh.stage.home()
    return fresh


def distance_deg(a_deg: float, b_deg: float) -> float:
    return min((a_deg - b_deg) % 360.0, (b_deg - a_deg) % 360.0)


def test_says_what_it_is(fresh: StageUnderTest) -> None:
    identity = fresh.stage.identify()
    assert identity.model
    assert identity.serial_number
    assert identity.firmware


def test_refuses_to_move_before_it_is_homed(fresh: StageUnderTest) -> None:
    if fresh.stage.status().homed:
        pytest.skip("somebody homed this stage before: switch it off and on")
    with pytest.raises(LimitError, match=r"[Hh]ome"):
        fresh.stage.move_to(45.0)


def test_homing_ends_at_zero(homed: StageUnderTest) -> None:
    assert distance_deg(homed.stage.position().angle_deg, 0.0) <= homed.tolerance_deg


@pytest.mark.parametrize("target_deg", [0.0, 90.0, 45.0, 135.0, 22.5, 301.237, 359.99])
def test_arrives_within_tolerance(homed: StageUnderTest, target_deg: float) -> None:
    move = homed.stage.move_to(target_deg)
    assert move.target_deg == target_deg
    assert distance_deg(move.position.angle_deg, target_deg) <= homed.tolerance_deg
    assert move.tries >= 1
    assert move.duration_s > 0.0


@pytest.mark.parametrize("target_deg", [0.0, 45.0, 301.237])
def test_the_ring_stands_where_the_readback_says(homed: StageUnderTest, target_deg: float) -> None:
    if homed.true_angle_deg is None:
        pytest.skip("nobody knows the true angle of this stage")
    move = homed.stage.move_to(target_deg)
    # An encoder that rounds is half a count off at most; no supported stage has counts above 0.0055 degrees.
    assert distance_deg(homed.true_angle_deg(), move.position.angle_deg) <= 0.0055 / 2


def test_knows_that_it_was_homed(homed: StageUnderTest) -> None:
    status = homed.stage.status()
    assert status.homed
    assert not status.moving


@pytest.mark.parametrize("target_deg", [200.0, 350.0, 10.0])
@pytest.mark.parametrize("way", ["forward", "backward"])
def test_a_way_that_is_asked_for_leads_there_or_is_refused(homed: StageUnderTest, way: Way, target_deg: float) -> None:
    homed.stage.move_to(100.0)
    try:
        move = homed.stage.move_to(target_deg, way=way)
    except LimitError:  # a stage of one turn cannot go every way, and stays where it is
        move = homed.stage.move_to(100.0)
    assert distance_deg(move.position.angle_deg, move.target_deg) <= homed.tolerance_deg


@pytest.mark.parametrize(("asked_deg", "meant_deg"), [(-45.0, 315.0), (405.0, 45.0), (-1e-9, 0.0), (720.0, 0.0)])
def test_angles_count_modulo_a_turn(homed: StageUnderTest, asked_deg: float, meant_deg: float) -> None:
    assert distance_deg(homed.stage.move_to(asked_deg).position.angle_deg, meant_deg) <= homed.tolerance_deg


def test_positions_lie_in_one_turn(homed: StageUnderTest) -> None:
    for target_deg in (359.999, 0.0, 0.001):
        assert 0.0 <= homed.stage.move_to(target_deg).position.angle_deg < 360.0


def test_position_after_a_move_is_its_readback(homed: StageUnderTest) -> None:
    move = homed.stage.move_to(60.0)
    assert distance_deg(homed.stage.position().angle_deg, move.position.angle_deg) <= homed.tolerance_deg


@pytest.mark.parametrize("angle_deg", [float("nan"), float("inf")])
def test_refuses_an_angle_that_is_no_number(homed: StageUnderTest, angle_deg: float) -> None:
    with pytest.raises(LimitError, match="finite"):
        homed.stage.move_to(angle_deg)


def test_works_on_after_a_refusal(homed: StageUnderTest) -> None:
    with pytest.raises(LimitError):
        homed.stage.move_to(float("nan"))
    assert distance_deg(homed.stage.move_to(10.0).position.angle_deg, 10.0) <= homed.tolerance_deg


def test_stopping_at_rest_changes_nothing(homed: StageUnderTest) -> None:
    homed.stage.move_to(30.0)
    homed.stage.stop()
    assert distance_deg(homed.stage.position().angle_deg, 30.0) <= homed.tolerance_deg


def test_closes_twice(fresh: StageUnderTest) -> None:
    fresh.stage.close()
    fresh.stage.close()


def test_a_closed_stage_says_so(fresh: StageUnderTest) -> None:
    with fresh.stage as stage:
        pass
    with pytest.raises(NotConnectedError, match="closed"):
        stage.position()
