"""What the characterisation finds of simulated stages whose truth is known."""

import json
import math

import pytest

from rigctl.rig.characterise import Characterisation, characterisation_file, characterise
from tests.drivers.stages.lines import Bench

ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
COUNT_DEG = 360.0 / 1536000


def measured(address: str, *, repeats: int = 4, watch_s: float = 1.0) -> Characterisation:
    bench = Bench(address)
    with bench.connect(tolerance_deg=1.0) as stage:
        return characterise(
            stage,
            ANGLES_DEG,
            repeats=repeats,
            band_deg=0.01,
            watch_s=watch_s,
            progress=lambda _: None,
            now_s=bench.clock.now_s,
            sleep=bench.clock.sleep,
        )


def test_backlash_and_repeatability_are_found() -> None:
    result = measured("zaber?backlash=0.03&landing=0.002&seed=4", repeats=8)
    # 8 visits to 4 angles from each side: the backlash has a standard error of 0.002 sqrt(2/32) = 0.0005 degrees, of
    # which 4 are allowed; the deviation, of 56 degrees of freedom, one of 1/sqrt(112) = 9.4 %.
    assert result.backlash_deg == pytest.approx(0.03, abs=4 * 0.0005)
    assert result.repeatability_deg == pytest.approx(0.002, rel=4 * 0.094)
    assert result.backlash_std_error_deg == pytest.approx(result.repeatability_deg * math.sqrt(2 / 32), rel=1e-12)


def test_a_perfect_stage_is_off_by_its_rounding_only() -> None:
    result = measured("zaber?landing=0", repeats=2)
    assert result.largest_error_deg <= COUNT_DEG / 2 + 1e-9  # rounding of angles up to 360
    assert result.settle_s == 0.0


def test_the_time_to_settle_is_that_of_the_creeping() -> None:
    result = measured("zaber?landing=0&creep=0.1", repeats=2)
    # It creeps by 0.1 exp(-t/0.1 s) and is within 0.01 degrees after 0.23 s. The driver sees the end of the motion up
    # to its 0.05 s of polling later, and readings are 0.02 s apart.
    true_s = 0.1 * math.log(10.0)
    assert true_s - 0.05 - 0.02 <= result.settle_s <= true_s
    assert result.is_settled


def test_a_stage_that_was_watched_too_shortly_is_reported() -> None:
    assert not measured("zaber?landing=0&creep=0.1", repeats=2, watch_s=0.15).is_settled


def test_an_angle_is_reached_from_the_side_that_it_says() -> None:
    result = measured("ellx?landing=0&backlash=0.05", repeats=2)
    for visit in result.visits:
        assert (visit.error_deg < 0.0) == (visit.side == "forward")


def test_the_file_holds_every_visit_and_is_json() -> None:
    result = measured("zaber", repeats=2)
    content = json.loads(json.dumps(characterisation_file(result)))
    assert len(content["visits"]) == 2 * 2 * len(ANGLES_DEG)
    assert content["stage"]["serial_number"] == "114821"
    assert content["backlash_deg"]["std_error"] > 0.0


def test_one_visit_has_no_scatter() -> None:
    with pytest.raises(ValueError, match="2 or more"):
        measured("zaber", repeats=1)
