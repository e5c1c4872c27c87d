"""The ROC by Monte Carlo: it agrees with the exact one within its own standard error."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from model.processing.detection import rx_p_detection, rx_threshold
from model.processing.dolp_studies import rx_draws

MEAN = np.array([880.0, 44.0, 21.0])
COV = np.array([[91.0, 4.4, 2.1], [4.4, 158.0, 0.0], [2.1, 0.0, 158.0]])
BACKGROUND = np.array([900.0, 30.0, -12.0])
BACKGROUND_COV = np.array([[701.0, 2.4, -1.0], [2.4, 168.0, 0.0], [-1.0, 0.0, 168.0]])
P = np.array([1e-3, 1e-2, 0.1, 0.5])


@pytest.mark.parametrize("draw_threshold", [False, True])
def test_counts_agree_with_the_law(draw_threshold: bool) -> None:
    drawn = rx_draws(
        P,
        MEAN,
        COV,
        BACKGROUND,
        BACKGROUND_COV,
        draws=200_000,
        generator=np.random.default_rng(5),
        draw_threshold=draw_threshold,
    )
    exact = rx_p_detection(P, MEAN, COV, BACKGROUND, BACKGROUND_COV)
    assert np.all(np.abs(drawn.p_detection - exact) < 5.0 * drawn.standard_error)


@pytest.mark.parametrize("draw_threshold", [False, True])
def test_standard_error_is_the_scatter_of_repeats(draw_threshold: bool) -> None:
    generator = np.random.default_rng(6)
    repeats = 300
    runs = [
        rx_draws(
            P[1:],
            MEAN,
            COV,
            BACKGROUND,
            BACKGROUND_COV,
            draws=2000,
            generator=generator,
            draw_threshold=draw_threshold,
        )
        for _ in range(repeats)
    ]
    scatter = np.std([run.p_detection for run in runs], axis=0)
    claimed = np.sqrt(np.mean([np.square(run.standard_error) for run in runs], axis=0))
    # a deviation of 300 values is known to 4 %, at 5 sigma 20 %; the slope taken from 2000 draws adds some per cent
    assert_allclose(claimed, scatter, rtol=0.25)


def test_nothing_detected_leaves_an_error() -> None:
    drawn = rx_draws(
        [1e-12], BACKGROUND, COV, BACKGROUND, BACKGROUND_COV, draws=100, generator=np.random.default_rng(1)
    )
    assert drawn.p_detection == 0.0
    assert drawn.standard_error > 1.0 / 200.0
    assert_allclose(drawn.threshold, rx_threshold([1e-12]), rtol=0.0)


def test_threshold_of_less_than_one_false_alarm_is_refused() -> None:
    with pytest.raises(ValueError, match="less than one false alarm"):
        rx_draws(
            1e-6,
            MEAN,
            COV,
            BACKGROUND,
            BACKGROUND_COV,
            draws=1000,
            generator=np.random.default_rng(1),
            draw_threshold=True,
        )


@pytest.mark.parametrize(("p", "draws", "message"), [(0.0, 100, "p_false_alarm"), (0.1, 1, "draws")])
def test_values_out_of_range_are_refused(p: float, draws: int, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rx_draws(p, MEAN, COV, BACKGROUND, BACKGROUND_COV, draws=draws, generator=np.random.default_rng(1))
