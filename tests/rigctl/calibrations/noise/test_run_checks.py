"""What the records of a run say against a calibration from it."""

import pytest

from calibration.results import Flag
from rigctl.calibrations.noise_frames import record_flags
from rigctl.runs.records import FrameRecord
from tests.rigctl.run_samples import make_record


def records(
    *, exposure_s: float, spacing_s: float, temperatures_c: tuple[float, ...] = (30.0,) * 3
) -> list[FrameRecord]:
    return [
        make_record(
            number,
            kind="dark",
            exposure_s=exposure_s,
            start_monotonic_ns=round(1e9 * spacing_s * number),
            camera_temperature_c=warmth,
        )
        for number, warmth in enumerate(temperatures_c)
    ]


def flags(given: list[FrameRecord]) -> dict[str, Flag]:
    return {flag.name: flag for flag in record_flags(given)}


def test_frames_that_follow_their_exposure_are_fine() -> None:
    assert flags(records(exposure_s=0.1, spacing_s=0.12)) == {}


def test_exposures_longer_than_the_time_between_frames_are_refused() -> None:
    # 10 ms that were read as 10 s.
    assert flags(records(exposure_s=10.0, spacing_s=0.05))["wrong_time_unit"].refuses


@pytest.mark.parametrize(("spread_c", "drifts"), [(1.0, False), (6.0, True)])
def test_a_camera_that_warms_up_is_flagged(spread_c: float, drifts: bool) -> None:
    given = records(exposure_s=0.1, spacing_s=0.12, temperatures_c=(30.0, 30.0 + 0.5 * spread_c, 30.0 + spread_c))
    assert ("temperature_drift" in flags(given)) is drifts
