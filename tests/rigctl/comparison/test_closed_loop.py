import numpy as np
import pytest

from rigctl.comparison.compare import compare_with_itself
from rigctl.errors import DataError
from rigctl.files.regions import Rectangle, Region
from rigctl.measure.diagnose import measure_run
from rigctl.measure.frames import RunCalibrations
from tests.rigctl.made_runs import at, make_run
from tests.rigctl.noise_records import noise_parameters

SIZE = (80, 90)
REGION = Region(name="a", rectangle=Rectangle(x=5, y=5, width=70, height=60))
GAIN, READ_NOISE_E, BLACK_DN = 0.25, 8.0, 64.0
NOISE = {
    "gain_dn_per_e": {"value": GAIN, "std_error": 1e-4, "n": 10},
    "read_noise_e": {"value": READ_NOISE_E, "std_error": 0.01, "n": 10},
    "dark_current_e_per_s": None,
    "black_level_dn": {"value": BLACK_DN, "std_error": 0.01, "n": 10},
    "covariance": {"names": ["gain_dn_per_e", "read_noise_e"], "matrix": [[1e-8, 0.0], [0.0, 1e-4]]},
}


def _run(tmp_path, *, cycles, seed=1, gain=GAIN, dolp=0.3, level_e=3000.0):
    """Frames of a textured, polarised scene, drawn here with numpy alone."""
    rng = np.random.default_rng(seed)
    texture = 1.0 + 0.02 * rng.normal(size=SIZE)
    frames = []
    for cycle in range(cycles):
        for angle in (0.0, 45.0, 90.0, 135.0):
            light = level_e * texture * (1 + dolp * np.cos(2 * np.deg2rad(angle - 20))) / 2
            electrons = rng.poisson(light) + rng.normal(0, READ_NOISE_E, SIZE)
            facts = at(angle, cycle=cycle, exposure_s=0.01, black_level_dn=BLACK_DN)
            frames.append((facts, np.round(gain * electrons + BLACK_DN)))
    return make_run(tmp_path / "run", frames)


def _compared(run, content, **options):
    noise = None if content is None else noise_parameters(content)
    return compare_with_itself(measure_run(run, [REGION], RunCalibrations(noise=noise)), alpha=1e-3, **options)


def test_a_sound_run_agrees_with_its_calibration_and_its_law(tmp_path):
    found = _compared(_run(tmp_path, cycles=4), NOISE)
    assert found.agrees
    tested = {(row.quantity, row.statistic) for row in found.rows if row.agrees is not None}
    assert {("dn_45", "std_temporal"), ("s1", "std_temporal"), ("dolp_pixels", "std"), ("dolp_snr", "mean")} <= tested
    assert {("dn_45", "std"), ("s0", "std"), ("s0", "std_spatial_mean")} <= tested


def test_another_gain_shows_in_every_temporal_deviation_and_points_to_the_noise(tmp_path):
    found = _compared(_run(tmp_path, cycles=4, gain=1.1 * GAIN), NOISE)
    temporal = [row for row in found.rows if row.statistic == "std_temporal"]
    assert len(temporal) == 7
    assert not any(row.agrees for row in temporal)
    assert found.points_to == ("noise",)


def test_means_are_no_test_of_themselves(tmp_path):
    found = _compared(_run(tmp_path, cycles=2), NOISE)
    fitted = [row for row in found.rows if row.statistic == "mean" and row.quantity.startswith("dn_")]
    assert fitted
    assert all(row.agrees is None and row.z is None for row in fitted)


def test_one_cycle_without_calibration_tests_the_law_alone(tmp_path):
    found = _compared(_run(tmp_path, cycles=1, dolp=0.05, level_e=800.0), None)
    assert {(row.quantity, row.statistic) for row in found.rows if row.agrees is not None} == {
        ("dolp_pixels", "mean"), ("dolp_pixels", "std"), ("dolp_snr", "mean"),
    }  # fmt: skip
    assert found.agrees
    assert any("no noise calibration" in text for text in found.not_tested)


def test_numbers_of_the_law_that_are_the_measured_ones_are_named_and_not_counted(tmp_path):
    # DoLP 0.3 at a signal-to-noise of 16: its mean over pixels is that of their mean, and so is its deviation.
    found = _compared(_run(tmp_path, cycles=1), None)
    assert not [row for row in found.rows if row.agrees is not None]
    assert any("a: dolp_pixels mean" in text and "the measured number itself" in text for text in found.not_tested)


def test_pixels_that_are_not_gaussian_are_found(tmp_path):
    run = _run(tmp_path, cycles=1)
    rng = np.random.default_rng(5)
    patches = rng.random(SIZE) < 0.05
    frames = []
    for record in run.frames:
        counts = run.counts(record).astype(float)
        # One pixel in twenty is polarised the other way: the mixture has no Gaussian law.
        counts[patches] = run.counts(run.frames[(record.sequence + 2) % 4]).astype(float)[patches]
        frames.append((at(record.polarizer_angle_deg, black_level_dn=BLACK_DN), counts))
    found = _compared(make_run(tmp_path / "mixed", frames), None)
    assert not found.agrees
    # Nobody gave a noise calibration: nothing points there.
    assert found.points_to == ("not-normal",)


_OF_HALVES = {(quantity, statistic) for quantity in ("dn_0", "s1") for statistic in ("std", "std_spatial_mean")}
_OF_LAW = {("dolp_pixels", "mean"), ("dolp_pixels", "std"), ("dolp_snr", "mean")}


@pytest.mark.parametrize(
    ("made", "noise", "rows"),
    [({"cycles": 2}, NOISE, _OF_HALVES), ({"cycles": 1, "dolp": 0.05, "level_e": 800.0}, None, _OF_LAW)],
    ids=["one half predicts the other", "law of DoLP"],
)
def test_scores_are_standard_normal_over_seeds(tmp_path, made, noise, rows):
    scores = {row: [] for row in rows}
    for seed in range(30):
        for row in _compared(_run(tmp_path / str(seed), seed=seed, **made), noise).rows:
            if row.z is not None and (row.quantity, row.statistic) in rows:
                scores[row.quantity, row.statistic].append(row.z)
    for name, z in scores.items():
        # Mean and variance of 30 standard normal scores: standard errors 0.18 and 0.26; four of them, and below 1 no
        # more than three, since a variance of few scores leans to the right.
        assert abs(np.mean(z)) < 4 * 0.18, name
        assert 1 - 3 * 0.26 < np.var(z, ddof=1) < 1 + 4 * 0.26, name


def test_pixels_without_light_are_said_and_not_tested(tmp_path):
    frames = [
        (at(a, black_level_dn=500.0), np.random.default_rng(k).normal(500, 9, SIZE)) for k, a in enumerate((0, 60, 120))
    ]
    found = _compared(make_run(tmp_path / "run", frames), None)
    assert any("no light" in remark for remark in found.remarks)
    assert all(row.agrees is None for row in found.rows)


def test_a_calibration_without_read_noise_is_refused(tmp_path):
    with pytest.raises(DataError, match="no read_noise_e"):
        _compared(_run(tmp_path, cycles=2), NOISE | {"read_noise_e": None})
