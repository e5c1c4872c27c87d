import math

import numpy as np
import pytest

from sim_devices.stages.drive import Ring

PULSES = 143360


def mechanics(
    *,
    landing_deg: float = 0.0,
    mark_deg: float = 0.0,
    start_deg: float = 0.0,
    backlash_deg: float = 0.0,
    creep_deg: float = 0.0,
) -> Ring:
    return Ring(
        counts_per_turn=PULSES,
        landing_deg=landing_deg,
        mark_deg=mark_deg,
        start_deg=start_deg,
        backlash_deg=backlash_deg,
        creep_deg=creep_deg,
        generator=np.random.default_rng(1),
    )


def test_turns_at_its_speed() -> None:
    ring = mechanics()
    assert ring.turn_to_counts(10.0, PULSES // 4, speed_deg_per_s=30.0) == 13.0
    assert ring.angle_deg(10.0) == 0.0
    assert ring.angle_deg(11.0) == pytest.approx(30.0, rel=1e-15)
    assert ring.is_moving(12.9)
    assert not ring.is_moving(13.0)
    assert ring.angle_deg(99.0) == 90.0


def test_a_turn_can_begin_during_another() -> None:
    ring = mechanics()
    ring.turn_to_counts(0.0, PULSES // 4, speed_deg_per_s=90.0)
    ring.turn_to_counts(0.5, 0, speed_deg_per_s=90.0)
    assert ring.angle_deg(0.75) == pytest.approx(22.5, rel=1e-15)


def test_gives_up_after_a_part_of_the_way() -> None:
    ring = mechanics()
    ring.turn_to_counts(0.0, PULSES // 4, speed_deg_per_s=90.0, part=0.5)
    assert ring.angle_deg(9.0) == 45.0


def test_the_encoder_calls_its_start_zero_until_the_mark_is_found() -> None:
    ring = mechanics(mark_deg=12.0, start_deg=77.0)
    assert ring.counts(0.0) == 0
    end_s = ring.find_mark(0.0, clockwise=True, speed_deg_per_s=65.0)
    assert end_s == 1.0  # from 77 clockwise to 12
    assert ring.angle_deg(end_s) == 12.0
    assert ring.counts(end_s) == 0


def test_counter_clockwise_the_way_to_the_mark_is_the_other_one() -> None:
    ring = mechanics(mark_deg=12.0, start_deg=77.0)
    assert ring.find_mark(0.0, clockwise=False, speed_deg_per_s=295.0) == 1.0  # from 77 on to 372
    assert ring.angle_deg(1.0) == 372.0


def test_positions_count_from_the_mark() -> None:
    ring = mechanics(mark_deg=12.0, start_deg=77.0)
    ring.find_mark(0.0, clockwise=True, speed_deg_per_s=100.0)
    end_s = ring.turn_to_counts(10.0, 17920, speed_deg_per_s=100.0)
    assert ring.angle_deg(end_s) == 57.0


def test_the_encoder_reads_where_the_ring_is_and_not_where_it_should_be() -> None:
    ring = mechanics(landing_deg=0.1)
    errors_deg = []
    for move in range(400):
        end_s = ring.turn_to_counts(100.0 * move, 1000 * move, speed_deg_per_s=1e4)
        true_deg = ring.angle_deg(end_s)
        assert abs(ring.counts(end_s) * 360.0 / PULSES - true_deg) <= 180.0 / PULSES + 1e-9
        errors_deg.append(true_deg - 1000 * move * 360.0 / PULSES)
    # The sample deviation of 400 draws has a standard error of 1/sqrt(800) = 3.5 %: 5 sigma.
    assert np.std(errors_deg) == pytest.approx(0.1, rel=5 * 0.035)


def test_moves_from_either_side_land_a_backlash_apart() -> None:
    ring = mechanics(backlash_deg=0.05)
    ring.turn_to_counts(0.0, PULSES // 4, speed_deg_per_s=90.0)
    assert ring.angle_deg(9.0) == pytest.approx(90.0 - 0.025, rel=1e-15)
    ring.turn_to_counts(10.0, PULSES // 8, speed_deg_per_s=90.0)
    assert ring.angle_deg(19.0) == pytest.approx(45.0 + 0.025, rel=1e-15)


def test_creeps_to_its_rest_after_the_motion() -> None:
    ring = mechanics(creep_deg=0.2)
    end_s = ring.turn_to_counts(0.0, PULSES // 4, speed_deg_per_s=90.0)
    assert not ring.is_moving(end_s)
    assert ring.angle_deg(end_s) == pytest.approx(89.8, rel=1e-15)
    assert ring.angle_deg(end_s + 0.1) == pytest.approx(90.0 - 0.2 / math.e, rel=1e-14)


def test_halts_where_it_is() -> None:
    ring = mechanics()
    ring.turn_to_counts(0.0, PULSES // 4, speed_deg_per_s=90.0)
    ring.halt(0.5)
    assert ring.angle_deg(9.0) == 45.0
    assert not ring.is_moving(0.5)
