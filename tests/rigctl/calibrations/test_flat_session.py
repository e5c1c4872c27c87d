"""Flat frames in a session: several exposures at one angle, or several angles with one exposure."""

import pytest
from pydantic import ValidationError

from rigctl.files.session_file import Take


def test_flat_fields_are_taken_at_each_angle() -> None:
    take = Take(kind="flat", exposure_ms=0.05, angles_deg=[0.0, 45.0, 90.0, 135.0])
    assert take.polarizer_angles_deg == (0.0, 45.0, 90.0, 135.0)


def test_flats_of_a_noise_calibration_are_taken_at_one_angle() -> None:
    with pytest.raises(ValidationError, match="at one angle"):
        Take(kind="flat", exposure_ms=[0.05, 0.1], angles_deg=[0.0, 45.0])
