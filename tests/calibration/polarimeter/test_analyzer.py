"""Axis, sense, extinction and W from simulated scans: Malus' law by Mueller calculus, with known truth."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom

from calibration.polarimeter.analyzer import (
    Harmonic,
    analyzer_channels,
    extinction,
    false_dolp,
    fit_axis,
    fit_fourier,
    fit_scan,
    half_turn,
    harmonics_are_told_apart,
    linear_states,
    measured_data_reduction,
    pooled_diattenuation,
)
from calibration.results import CalibrationError

FloatArray = NDArray[np.float64]

GENERATOR_RAD = np.radians(np.arange(0.0, 180.0, 5.0))
STAGE_RAD = np.radians([0.0, 45.0, 90.0, 135.0])
SNR = 2000.0
DOLP = 0.995
THROUGHPUT = np.array([1.0, 0.98, 1.02, 1.01])
# States that differ by half a turn.
REPEATS = linear_states(np.array([0.0, np.pi, 0.5, 0.5 + np.pi]), dolp=1.0)


@dataclass(frozen=True, kw_only=True)
class Rig:
    sense: int = 1
    offset_rad: float = np.radians(17.3)
    ratio: float = 500.0

    @property
    def diattenuation(self) -> float:
        return (self.ratio - 1.0) / (self.ratio + 1.0)

    def analyzer(self) -> FloatArray:
        """First rows (N, 3) of the Mueller matrices of the polarizer at the stage's angles."""
        axis = self.sense * STAGE_RAD + self.offset_rad
        d = self.diattenuation
        rows = np.column_stack([np.ones_like(axis), d * np.cos(2 * axis), d * np.sin(2 * axis)])
        first_rows: FloatArray = 0.5 * THROUGHPUT[:, None] * rows
        return first_rows

    def scan(self, seed: int, snr: float = SNR) -> FloatArray:
        """Intensities (K, N); noise of a region at the mean intensity over the SNR."""
        states = np.array(
            [np.ones_like(GENERATOR_RAD), DOLP * np.cos(2 * GENERATOR_RAD), DOLP * np.sin(2 * GENERATOR_RAD)]
        )
        clean = (self.analyzer() @ states).T
        noise = np.random.default_rng(seed).standard_normal(clean.shape)
        return np.asarray(clean + clean.mean() / snr * noise)


SEEDS = range(40)
RIGS = [Rig(), Rig(sense=-1), Rig(sense=-1, offset_rad=np.radians(0.0)), Rig(offset_rad=np.radians(179.99), ratio=30.0)]


@pytest.mark.parametrize("rig", RIGS)
def test_axis_and_sense_from_a_generator_scan(rig: Rig) -> None:
    scores = []
    for seed in SEEDS:
        channels = analyzer_channels(GENERATOR_RAD, rig.scan(seed), generator_dolp=DOLP)
        fit = fit_axis(axis_rad=channels.axis_rad, stage_rad=STAGE_RAD, std_error_rad=channels.axis_error_rad)
        assert fit.is_decided
        assert fit.best.sense == rig.sense
        error = float(half_turn(np.array(fit.best.offset_rad - rig.offset_rad)))
        # One channel: 0.5 sqrt(2 / 36) / 2000 = 0.0034 deg; four of them half of that.
        assert fit.best.std_error_rad < np.radians(0.005)
        assert abs(error) < np.radians(0.02)
        scores.append(error / fit.best.std_error_rad)
    # Errors hold 33 degrees of freedom a channel, and scatter that only enlarges them: variance at most 1.1.
    assert abs(np.mean(scores)) < 4.0 / np.sqrt(len(SEEDS))
    assert 0.3 < np.var(scores) < 2.0


def test_generator_scan_finds_throughput_and_diattenuation() -> None:
    rig = Rig()
    channels = analyzer_channels(GENERATOR_RAD, rig.scan(1), generator_dolp=DOLP)
    truth = THROUGHPUT / THROUGHPUT.mean()
    # Mean of 36 values: 1 / 2000 / 6.
    assert np.max(np.abs(channels.throughput - truth)) < 5.0 / SNR / 6.0
    assert np.all(np.abs(channels.diattenuation - rig.diattenuation) < 5.0 * channels.diattenuation_error)
    assert np.all(channels.diattenuation_error < 2.0 * np.sqrt(2.0 / 36.0) / SNR)


@pytest.mark.parametrize("ratio", [30.0, 500.0, 3000.0])
def test_extinction_is_within_its_interval(ratio: float) -> None:
    inside = 0
    for seed in SEEDS:
        channels = analyzer_channels(GENERATOR_RAD, Rig(ratio=ratio).scan(seed), generator_dolp=DOLP)
        value, error = pooled_diattenuation(channels)
        found = extinction(float(value), float(error))
        inside += found.lower <= ratio and (found.upper is None or ratio <= found.upper)
    # Binomial of 40 with 0.95: 33 or fewer with a chance of 4e-4.
    assert inside >= 34


def test_a_polarizer_too_good_to_measure_has_a_lower_limit_only() -> None:
    found = extinction(0.9999, 2e-4)
    assert found.upper is None
    assert found.lower == pytest.approx((1.0 + 0.9999 - 1.959964 * 2e-4) / (1.0 - 0.9999 + 1.959964 * 2e-4), rel=1e-9)
    assert extinction(1.00002, 2e-4).ratio is None


@pytest.mark.parametrize(
    ("work", "problem"),
    [
        (lambda: extinction(1.01, 0.001), "above 1"),
        (lambda: extinction(-0.2, 0.01), "allowed is above 0"),
        (lambda: measured_data_reduction(np.ones((3, 3)), np.ones((4, 3))), "at least 3 angles and 4 states"),
        (lambda: measured_data_reduction(np.ones((3, 36)), np.ones((2, 36))), "at least 3 angles and 4 states"),
        (lambda: measured_data_reduction(REPEATS, Rig().analyzer() @ REPEATS), "do not span"),
        (lambda: fit_fourier(np.radians([0.0, 90.0, 180.0, 270.0, 360.0]), np.ones(5)), "repeats"),
        (lambda: fit_fourier(np.radians([0.0, 180.0, 0.0, 180.0]), np.ones(4)), "repeats"),
        (lambda: fit_fourier(np.array([0.0, 0.5, 1.0]), np.ones(3)), "at least 4 angles"),
        (lambda: fit_fourier(np.linspace(0.0, 3.0, 8), np.full(8, -0.1)), "no light"),
        (lambda: analyzer_channels(GENERATOR_RAD, Rig().scan(1), generator_dolp=0.0), "generator's DoLP"),
    ],
)
def test_numbers_that_are_no_scan_are_refused(work: Callable[[], object], problem: str) -> None:
    with pytest.raises(CalibrationError, match=problem):
        work()


@pytest.mark.parametrize("rig", RIGS)
def test_w_from_known_inputs(rig: Rig) -> None:
    truth = np.linalg.pinv(rig.analyzer())
    found = measured_data_reduction(linear_states(GENERATOR_RAD, dolp=DOLP), rig.scan(3).T)
    assert np.max(np.abs(found.matrix - truth)) < 1e-3
    assert np.all(np.abs(found.matrix - truth) < 5.0 * found.std_error)


def test_w_has_the_errors_that_it_says() -> None:
    truth, states = np.linalg.pinv(Rig().analyzer()), linear_states(GENERATOR_RAD, dolp=DOLP)
    found = [measured_data_reduction(states, Rig().scan(seed, snr=200.0).T) for seed in range(200)]
    scores = np.array([(one.matrix - truth) / one.std_error for one in found])
    # 200 draws with 33 degrees of freedom behind each error: variance 1.06; 5 sigma of 12 correlated elements.
    assert np.all(np.abs(scores.var(axis=0) - 1.06) < 5.0 * 1.06 * np.sqrt(2.0 / 200.0))


def test_w_is_truncated_to_three_singular_values() -> None:
    found = measured_data_reduction(linear_states(GENERATOR_RAD, dolp=DOLP), Rig().scan(4).T)
    assert np.linalg.matrix_rank(found.matrix) == 3
    assert found.singular_values[3] < 0.01 * found.singular_values[2]
    # Untruncated, the fourth would be inverted: elements of W that are hundreds of times those of the truth.
    assert np.max(np.abs(found.matrix)) < 2.0


def analyzer_scan(rig: Rig, reference_rad: float, *, seed: int = 1, n: int = 36) -> tuple[FloatArray, FloatArray]:
    """Stage angles over a turn and intensities of light that is polarized along a fixed direction."""
    stage = np.radians(np.arange(n) * 360.0 / n)
    axis = rig.sense * stage + rig.offset_rad
    clean = 0.5 * (1.0 + rig.diattenuation * DOLP * np.cos(2.0 * (axis - reference_rad)))
    return stage, clean + 0.5 / SNR * np.random.default_rng(seed).standard_normal(n)


def pair(rig: Rig, reference_deg: float, seed: int = 1) -> tuple[float, float]:
    fit = fit_fourier(*analyzer_scan(rig, np.radians(reference_deg), seed=seed))
    return float(fit.phase_rad), float(fit.phase_error_rad())


@pytest.mark.parametrize("rig", RIGS)
def test_two_references_find_the_sense(rig: Rig) -> None:
    references = np.radians([0.0, 30.0])
    pairs = np.array([pair(rig, 0.0, 1), pair(rig, 30.0, 2)])
    fit = fit_axis(axis_rad=references, stage_rad=pairs[:, 0], std_error_rad=pairs[:, 1])
    assert fit.is_decided
    assert fit.best.sense == rig.sense
    assert abs(half_turn(np.array(fit.best.offset_rad - rig.offset_rad))) < 5.0 * fit.best.std_error_rad


@pytest.mark.parametrize(
    ("sense", "reference_deg", "mark", "is_decided"),
    [
        (1, 30.0, True, True),
        (-1, 30.0, True, True),
        (1, 30.0, False, False),
        # Along and across the axis of the stage's zero both senses give one offset.
        (-1, 0.0, True, False),
        (-1, 90.0, True, False),
    ],
)
def test_one_reference_finds_the_sense_with_a_mark_on_the_mount(
    sense: int, reference_deg: float, mark: bool, is_decided: bool
) -> None:
    rig = Rig(sense=sense, offset_rad=np.radians(3.0))
    phase, error = pair(rig, reference_deg)
    fit = fit_axis(
        axis_rad=np.radians([reference_deg]),
        stage_rad=np.array([phase]),
        std_error_rad=np.array([error]),
        expected_rad=0.0 if mark else None,
        expected_error_rad=np.radians(5.0),
    )
    assert bool(fit.is_decided) is is_decided
    if is_decided:
        assert fit.best.sense == sense
        # The mark decides, and does not move the number.
        assert abs(half_turn(np.array(fit.best.offset_rad - rig.offset_rad))) < 5.0 * fit.best.std_error_rad


def test_the_error_of_the_reference_is_in_the_offset() -> None:
    phase, error = pair(Rig(), 30.0)
    fit = fit_axis(
        axis_rad=np.radians([30.0]), stage_rad=np.array([phase]), std_error_rad=np.array([error]), common_error_rad=0.01
    )
    assert fit.best.std_error_rad == pytest.approx(np.hypot(error, 0.01), rel=1e-12)


def test_phase_and_modulation_have_the_errors_that_they_say() -> None:
    draws = np.random.default_rng(9)
    angles = np.radians(np.arange(0.0, 180.0, 7.5))
    clean = 100.0 * (1.0 + 0.6 * np.cos(2.0 * (angles - 0.7)))
    fit = fit_fourier(angles, clean[:, None] + draws.standard_normal((24, 4000)))
    # 21 degrees of freedom: t, variance 21 / 19; 5 sigma of 4000.
    for score in ((fit.phase_rad - 0.7) / fit.phase_error_rad(), (fit.modulation - 0.6) / fit.modulation_error()):
        assert np.var(score) == pytest.approx(21.0 / 19.0, abs=5.0 * np.sqrt(2.5 / 4000.0))


def test_a_wedge_and_a_detector_that_is_not_linear_are_seen_apart() -> None:
    stage, values = analyzer_scan(Rig(), 0.4)
    assert not any(harmonic.is_seen for harmonic in fit_scan(stage, values)[1])
    wedge = {h.order: h for h in fit_scan(stage, values * (1.0 + 0.01 * np.cos(stage - 0.2)))[1]}
    assert wedge[1].is_seen
    # cos x (1 + D cos (2 x - phase)) has the amplitude 1 at one cycle, and 1/2 more or less by the phase.
    assert 0.0049 < wedge[1].amplitude < 0.0151
    bent = {h.order: h for h in fit_scan(stage, values * (1.0 - 0.02 * values))[1]}
    assert bent[4].is_seen
    # y^2 of 0.5 (1 + D cos): the square of the cosine has half of it at twice the frequency: 0.02 / 4 / 2 / 0.5.
    assert bent[4].amplitude == pytest.approx(0.005, rel=0.1)


def test_every_pixel_has_its_own_channels() -> None:
    scan = Rig().scan(1)
    stacked = np.stack([scan, 2.0 * scan], axis=2)
    channels = analyzer_channels(GENERATOR_RAD, stacked, generator_dolp=DOLP)
    alone = analyzer_channels(GENERATOR_RAD, scan, generator_dolp=DOLP)
    np.testing.assert_allclose(channels.axis_rad[:, 1], alone.axis_rad, atol=1e-12)
    np.testing.assert_allclose(channels.diattenuation[:, 0], alone.diattenuation, rtol=1e-12)


@pytest.mark.parametrize(("turn_deg", "apart"), [(360.0, True), (180.0, False)])
def test_harmonics_are_told_from_one_another_over_a_whole_turn_only(turn_deg: float, apart: bool) -> None:
    assert harmonics_are_told_apart(np.radians(np.arange(36) * turn_deg / 36.0)) is apart


def test_the_law_at_other_angles() -> None:
    angles = np.radians(np.arange(0.0, 180.0, 20.0))
    fit = fit_fourier(angles, 3.0 + np.cos(2.0 * (angles - 0.3)))
    np.testing.assert_allclose(fit.at(np.array([0.3, 0.3 + np.pi / 2])), [4.0, 2.0], rtol=1e-12)


def with_harmonics(law: FloatArray, angles: FloatArray, draws: np.random.Generator) -> FloatArray:
    waves = [draws.uniform(0.01, 0.03) * np.cos(order * angles - draws.uniform(0.0, 6.3)) for order in (4, 6)]
    return law + np.sum(waves, axis=0)


def with_wedge(law: FloatArray, angles: FloatArray, draws: np.random.Generator) -> FloatArray:
    """A wedge whose picture wanders over uneven light: the phase walks by 3 degrees a frame."""
    phase = draws.uniform(0.0, 6.3) + np.cumsum(draws.normal(0.0, 0.05, len(angles)))
    return law * (1.0 + 0.02 * np.cos(angles - phase))


def with_drift(law: FloatArray, angles: FloatArray, draws: np.random.Generator) -> FloatArray:
    return law * (1.0 + np.cumsum(draws.normal(0.0, 0.003, len(angles))))


def ideal(law: FloatArray, angles: FloatArray, draws: np.random.Generator) -> FloatArray:
    return law


@pytest.mark.slow
@pytest.mark.parametrize("effect", [ideal, with_harmonics, with_wedge, with_drift])
def test_the_stated_error_of_the_axis_holds_it(effect: Callable[..., FloatArray]) -> None:
    scores = np.array([axis_score(effect, seed) for seed in range(200)])
    for sigmas, share in ((1.0, 0.6827), (1.96, 0.95)):
        inside = int(np.count_nonzero(np.abs(scores) < sigmas))
        low, high = binom.ppf([5e-4, 1.0 - 5e-4], len(scores), share)
        assert low <= inside <= high


def axis_score(effect: Callable[..., FloatArray], seed: int) -> float:
    draws = np.random.default_rng(seed)
    angles, axis = np.radians(np.arange(36) * 10.0), draws.uniform(0.0, np.pi)
    law = 1000.0 * (1.0 + 0.98 * np.cos(2.0 * (angles - axis)))
    fit, _ = fit_scan(angles, effect(law, angles, draws) + draws.normal(0.0, 1.0, 36))
    return float(half_turn(fit.phase_rad - axis) / fit.phase_error_rad())


def test_a_drift_does_not_turn_the_axis_as_in_the_law_alone() -> None:
    angles = np.radians(np.arange(36) * 10.0)
    values = (1.0 + np.cos(2.0 * (angles - 0.7))) * (1.0 + np.linspace(-0.02, 0.02, 36))
    values += np.random.default_rng(3).normal(0.0, 1e-3, 36)
    fit, plain = fit_scan(angles, values)[0], fit_fourier(angles, values)
    assert abs(fit.phase_rad - 0.7) < 3.0 * fit.phase_error_rad()
    assert abs(plain.phase_rad - 0.7) > 3.0 * abs(fit.phase_rad - 0.7)


def test_harmonics_do_not_widen_the_error_of_the_axis() -> None:
    angles, draws = np.radians(np.arange(36) * 10.0), np.random.default_rng(4)
    clean = 1.0 + np.cos(2.0 * (angles - 0.7)) + draws.normal(0.0, 1e-3, 36)
    fit, harmonics = fit_scan(angles, clean + 0.02 * np.cos(4.0 * angles))
    assert float(fit.phase_error_rad()) < 2.0 * float(fit_fourier(angles, clean).phase_error_rad())
    assert {one.order for one in harmonics if one.is_seen} == {4}
    assert {one.order: one.amplitude for one in harmonics}[4] == pytest.approx(0.02, rel=0.1)


@pytest.mark.parametrize(("order", "seen"), [(1, True), (3, True), (4, False), (6, True)])
def test_the_false_dolp_of_a_harmonic_is_that_of_its_frames(order: int, seen: bool) -> None:
    angles = np.radians([0.0, 90.0, 45.0, 135.0])
    found = false_dolp(Harmonic(order=order, amplitude=0.01, std_error=0.001), angles)
    worst = 0.0
    for phase in np.linspace(0.0, 2.0 * np.pi, 361):
        i0, i90, i45, i135 = 1.0 + 0.01 * np.cos(order * angles - phase)
        worst = max(worst, float(np.hypot(i0 - i90, i45 - i135) / (0.5 * (i0 + i90 + i45 + i135))))
    # To first order in the amplitude.
    assert found == pytest.approx(worst, rel=0.02, abs=1e-12)
    assert bool(found > 1e-9) is seen


@pytest.mark.parametrize("angles_deg", [np.arange(36) * 5.0, np.arange(8) * 22.5, np.arange(8) * 45.0])
@pytest.mark.parametrize("sizes", [{}, {1: 0.02}, {3: 0.02}, {6: 0.02}, {1: 0.01, 3: 0.03, 4: 0.02, 5: 0.01, 6: 0.01}])
def test_the_error_of_a_scan_that_cannot_tell_harmonics_allows_for_them(
    angles_deg: FloatArray, sizes: dict[int, float]
) -> None:
    angles, draws, scores = np.radians(angles_deg), np.random.default_rng(7), []
    for axis in draws.uniform(0.0, np.pi, 200):
        waves = [size * np.cos(order * angles - draws.uniform(0.0, 6.3)) for order, size in sizes.items()]
        clean = 1000.0 * (1.0 + 0.99 * np.cos(2.0 * (angles - axis)) + np.sum(waves, axis=0))
        fit, harmonics = fit_scan(angles, clean + draws.normal(0.0, 0.3, angles.size))
        assert harmonics == ()
        scores.append(float(half_turn(fit.phase_rad - axis) / fit.phase_error_rad()))
    for sigmas, share in ((1.0, 0.6827), (1.96, 0.95)):
        assert np.mean(np.abs(scores) < sigmas) > share - 3.0 * np.sqrt(share * (1.0 - share) / len(scores))
