"""Noise calibrations as records, of what a test says of them."""

from typing import Any

from pydantic import TypeAdapter

from rigctl.calibrations.noise import QUANTITIES, NoiseParameters


def noise_parameters(content: dict[str, Any]) -> NoiseParameters:
    """Return the record of a calibration file; what the content does not have is not known, a black level is 0."""
    exact = {"value": 0.0, "std_error": 0.0, "n": 1}
    unknown = dict.fromkeys(QUANTITIES) | {"black_level_dn": exact, "schema_version": 2}
    return TypeAdapter(NoiseParameters).validate_python(unknown | content)
