"""The affine map between pictures, and the error that it states."""

import numpy as np
import pytest

from calibration.polarimeter.pictures import fit_affine
from calibration.results import CalibrationError

MAP = np.array([[1.01, -0.03, 5.2], [0.02, 0.98, -3.1]])
CORNERS = np.array([[0.0, 0.0], [40.0, 1.0], [41.0, 39.0], [-1.0, 40.0], [200.0, 10.0], [240.0, 12.0]])


def moved(points: np.ndarray) -> np.ndarray:
    return np.column_stack([points, np.ones(len(points))]) @ MAP.T


def test_exact_points_give_their_map() -> None:
    found = fit_affine(CORNERS, moved(CORNERS))
    np.testing.assert_allclose(found.matrix, MAP, atol=1e-12)
    assert found.residual_rms_px < 1e-12


def test_stated_error_is_that_of_repeated_fits() -> None:
    generator, noise_px, far = np.random.default_rng(4), 0.2, np.array([[400.0, 300.0]])
    fits = [fit_affine(CORNERS, moved(CORNERS) + noise_px * generator.standard_normal((6, 2))) for _ in range(4000)]
    errors = np.array([fit.apply(far)[0] - moved(far)[0] for fit in fits])
    stated = np.sqrt(np.mean([fit.std_error_px(far)[0] ** 2 for fit in fits]))
    # 8000 values: their deviation is known to 1 / sqrt(16000) = 0.8 %; the stated one, with 6 degrees of freedom, less.
    assert stated == pytest.approx(errors.std(), rel=0.05)


def test_too_few_points_are_refused() -> None:
    with pytest.raises(CalibrationError, match="needs 4 points, 3"):
        fit_affine(CORNERS[:3], CORNERS[:3])


def test_points_on_a_line_are_refused() -> None:
    line = np.array([[k, 2.0 * k] for k in range(5)])
    with pytest.raises(CalibrationError, match="not all on a line"):
        fit_affine(line, line)
