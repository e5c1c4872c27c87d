"""EMVA 1288 figures of a real CCD beside those of the package emva1288 1.0.2 (numpy 1.26.4, scipy 1.13.1)."""

import os
from functools import cache
from pathlib import Path

import pytest

from calibration.sensor.emva1288 import EmvaFigure
from rigctl.calibrations.noise_calibration import calibrate_frames
from rigctl.calibrations.noise_frames import emva_frames

REAL_DATA = os.environ.get("RIGCTL_REAL_DATA")
DESCRIPTOR = Path(REAL_DATA or "") / "emva_ccd12" / "EMVA1288_Data.txt"

pytestmark = pytest.mark.skipif(
    not REAL_DATA, reason="set RIGCTL_REAL_DATA to a folder that holds emva_ccd12 (frames of a real camera)"
)

# Half of EMVA 1288 reference set 001 (Basler AG, CC BY-SA 3.0). Name -> (the package's number, relative tolerance).
# Pixels that jump by 6 standard deviations are left out here (1e-5 of them), and the noise in a stack is taken from
# consecutive frames: 1e-4 in a gain, 2e-4 in what hangs on the stack.
REFERENCE = {
    "gain_dn_per_e": (0.280350833, 1e-4),
    "responsivity_dn_per_photon": (0.126778410, 1e-4),
    "quantum_efficiency": (0.452213425, 2e-4),
    "temporal_dark_noise_dn": (3.07319262, 1e-4),
    "temporal_dark_noise_e": (10.9134845, 2e-4),
    "threshold_photons": (25.3463348, 2e-4),
    "threshold_e": (11.4619530, 2e-4),
    "saturation_photons": (30957.0, 1e-9),
    "saturation_e": (13999.1710, 2e-4),
    "dynamic_range": (1221.36002, 2e-4),
    "snr_max": (118.318092, 1e-4),
    "linearity_error_min": (-0.00604809658, 2e-3),
    "linearity_error_max": (0.00454671842, 2e-3),
    "dark_current_mean_e_per_s": (29.2289346, 1e-3),
    "dark_current_variance_e_per_s": (81.4581578, 5e-3),
    "dsnu_e": (0.529478812, 0.02),
    "dsnu_row_e": (0.404138765, 0.02),
    "dsnu_column_e": (0.538244486, 0.02),
    "prnu": (0.00432901905, 1e-3),
    "prnu_row": (0.00323867126, 1e-3),
    "prnu_column": (0.00111554290, 2e-3),
    "prnu_pixel": (0.00264706978, 2e-3),
}


@cache
def figures() -> dict[str, EmvaFigure | None]:
    return calibrate_frames(emva_frames(DESCRIPTOR)).noise.emva1288


@pytest.mark.parametrize("name", REFERENCE)
def test_agrees_with_the_reference_package(name: str) -> None:
    found, (value, tolerance) = figures()[name], REFERENCE[name]
    assert found is not None
    assert found.value == pytest.approx(value, rel=tolerance)


def test_a_pattern_that_the_package_calls_nan_is_none() -> None:
    assert figures()["dsnu_pixel_e"] is None
