"""Numbers of a region: errors that are neither too small nor too large."""

import os
from pathlib import Path

import numpy as np
import pytest

from benchmarks.trials.coverage import CASES, covered, judged
from model.processing.reconstruction import design, reconstruct
from model.processing.samples import repeated
from rigctl.errors import ConfigError, DataError
from rigctl.files.regions import Rectangle, Region
from rigctl.measure.frames import RunCalibrations
from rigctl.measure.measure import measure, measure_region
from rigctl.runs.folder import read_run
from rigctl.verbs.import_images import import_images
from tests.rigctl.made_runs import at, make_run
from tests.rigctl.noise_records import noise_parameters

SIZE = (40, 50)
REGION = Region(name="middle", rectangle=Rectangle(x=5, y=5, width=30, height=30))


def _picture(level, seed=0):
    return np.random.default_rng(seed).normal(level, 5.0, SIZE).round()


def _run(tmp_path, levels, **session):
    frames = [(at(a), _picture(level, k)) for k, (a, level) in enumerate(levels)]
    return make_run(tmp_path / "run", frames, session={"origin": "import", **session})


def _pseudo_inverse_stokes(run, *, black=0.0, extinction=np.inf):
    """An independent way: the pseudo-inverse of the analyser matrix written out, pixel by pixel."""
    scene = [record for record in run.frames if record.kind == "scene"]
    angles = np.deg2rad([record.polarizer_angle_deg for record in scene])
    leak = 1 / extinction
    m = 0.5 * np.stack([(1 + leak) + 0 * angles, (1 - leak) * np.cos(2 * angles), (1 - leak) * np.sin(2 * angles)], 1)
    counts = np.stack([run.counts(record).astype(float) - black for record in scene])
    return np.einsum("kn,nij->kij", np.linalg.pinv(m), counts)


@pytest.mark.parametrize(
    ("levels", "extinction"),
    [([(0, 900), (45, 700), (90, 400), (135, 600)], np.inf), ([(0, 900), (60, 700), (120, 400)], 10.0)],
)
def test_stokes_equal_an_independent_pseudo_inverse(tmp_path, levels, extinction):
    rig = {} if np.isinf(extinction) else {"rig": {"polarizer": {"extinction_ratio": extinction}}}
    run = _run(tmp_path, levels, **rig)
    found = measure(run, regions=[])
    expected = _pseudo_inverse_stokes(run, extinction=extinction)
    # Counts below 1e3 and a condition of sqrt 2: rounding is some 1e-13 of S0.
    assert np.max(np.abs(reconstruct(found.plan, found.channels) - expected)) < 1e-9 * expected[0].max()


def test_dark_frames_of_the_same_exposure_are_taken_off(tmp_path):
    frames = [(at(a, exposure_s=0.1, black_level_dn=None), np.full(SIZE, 500)) for a in (0, 60, 120)]
    frames += [({"kind": "dark", "exposure_s": 0.1}, np.full(SIZE, 64 + k)) for k in (0, 2)]
    frames += [({"kind": "dark", "exposure_s": 9.0}, np.full(SIZE, 300))]
    found = measure(make_run(tmp_path / "run", frames), regions=[])
    assert found.frames.dark_level.level_dn == pytest.approx([65, 65, 65])
    assert np.all(found.channels == 435)
    assert "2 dark frames" in found.frames.dark_level.source


def test_a_calibration_gives_the_dark_level_where_the_run_says_nothing(tmp_path):
    frames = [(at(a, exposure_s=0.5, black_level_dn=None), np.full(SIZE, 500)) for a in (0, 60, 120)]
    noise = noise_parameters(
        {
            "black_level_dn": {"value": 60.0, "std_error": 0.1, "n": 2},
            "gain_dn_per_e": {"value": 0.25, "std_error": 0.01, "n": 2},
            "dark_current_e_per_s": {"value": 40.0, "std_error": 1.0, "n": 2},
        }
    )
    found = measure(make_run(tmp_path / "run", frames), regions=[], calibrations=RunCalibrations(noise=noise))
    assert found.frames.dark_level.level_dn == pytest.approx([65, 65, 65])


def test_saturated_and_missing_pixels_are_left_out_of_a_region_and_counted(tmp_path):
    frames = [(at(a, missing_dn=0.0), _picture(900, a)) for a in (0, 60, 120)]
    frames[1][1][6, 7] = 4095
    frames[2][1][6, 8] = 0
    frames[2][1][0, 0] = 0
    found = measure(make_run(tmp_path / "run", frames), regions=[REGION])
    assert found.regions["middle"].excluded == 2
    assert found.regions["middle"].pixels == 898
    assert found.frames.saturated.sum() == 1
    assert found.frames.missing.sum() == 2


OUTSIDE = Region(name="far", rectangle=Rectangle(x=45, y=5, width=30, height=30))


@pytest.mark.parametrize(
    ("frames", "regions", "error", "message"),
    [
        ([(at(a, black_level_dn=None), 500) for a in (0, 60, 120)], [], DataError, "without light"),
        ([(at(a), 4095) for a in (0, 60, 120)], [REGION], DataError, "middle: 0 pixels are left of 900"),
        ([(at(a), 900) for a in (0, 90, 180)], [], DataError, r"have 2 angles that differ.*0, 90 deg.*three"),
        ([(at(a), 900) for a in (0, 60, 120)], [OUTSIDE], ConfigError, "far"),
    ],
    ids=["no dark level", "saturated", "singular angles", "outside"],
)
def test_a_run_that_cannot_be_measured_is_refused_with_the_reason(tmp_path, frames, regions, error, message):
    run = make_run(tmp_path / "run", [(facts, np.full(SIZE, counts)) for facts, counts in frames])
    with pytest.raises(error, match=message):
        measure(run, regions=regions)


def test_quantities_of_a_known_region(tmp_path):
    # S = (1200, 480, -360): DoLP 0.5, AoLP = atan2(-360, 480) / 2 = -18.43 deg = 161.57 deg.
    levels = [
        (a, 0.5 * (1200 + 480 * np.cos(2 * np.deg2rad(a)) - 360 * np.sin(2 * np.deg2rad(a)))) for a in (0, 45, 90, 135)
    ]
    found = measure(_run(tmp_path, levels), regions=[REGION]).regions["middle"].quantities
    # 900 pixels with sigma 5 DN: the error of S is some 0.3 DN; five of the errors that it states itself.
    for name, expected in (("s0", 1200), ("s1", 480), ("s2", -360), ("s1n", 0.4), ("s2n", -0.3), ("dolp", 0.5)):
        sample = found[name]["mean"]
        assert abs(sample.value - expected) < 5 * sample.std_error, name
    assert found["aolp_deg"]["mean"].value == pytest.approx(161.565, abs=5 * found["aolp_deg"]["mean"].std_error)
    assert found["s0"]["mean"].std_error == pytest.approx(5 / 30, rel=0.1)


REAL_DATA = os.environ.get("RIGCTL_REAL_DATA")
needs_real_data = pytest.mark.skipif(REAL_DATA is None, reason="set RIGCTL_REAL_DATA to the folder of real frames")


@needs_real_data
def test_real_mosaic_equals_an_independent_pseudo_inverse(tmp_path):
    file = Path(REAL_DATA) / "imx250_fruits" / "fruits_IMX250MZR.png"
    import_images(tmp_path / "run", [file], kind="scene", mosaic=(90, 45, 135, 0), black_level_dn=0)
    run = read_run(tmp_path / "run")
    found = measure(run, regions=[])
    expected = _pseudo_inverse_stokes(run)
    assert np.max(np.abs(reconstruct(found.plan, found.channels) - expected)) < 1e-9 * expected[0].max()


@needs_real_data
def test_real_corona_is_polarized_tangentially(tmp_path):
    """Thomson scattering polarizes the K corona at right angles to the radius, whatever else the picture holds."""
    folder = Path(REAL_DATA) / "lasco_c2_triplet"
    import_images(
        tmp_path / "run",
        [folder / f"lasco_{name}.fts" for name in ("0", "+60", "-60")],
        kind="scene",
        angles=(0, 60, -60),
        exposure_key="EXPTIME",
        black_level_key="OFFSET",
        bit_depth=16,
    )
    found = measure(read_run(tmp_path / "run"), regions=[])
    assert found.grid.unit == "DN/s"
    s0, s1, s2 = reconstruct(found.plan, found.channels)
    polarized = np.hypot(s1, s2)
    y, x = np.mgrid[: s0.shape[0], : s0.shape[1]]
    # The occulter's centre in this picture, to some pixels; y runs down.
    dx, dy = x - 252.0, 262.0 - y
    radius, twice = np.hypot(dx, dy), 2 * np.arctan2(dy, dx)
    corona = (polarized > 0.08 * s0) & (radius > 110) & (radius < 230) & found.frames.usable
    tangential = -(s1 * np.cos(twice) + s2 * np.sin(twice)) / polarized
    # With the sign of the two angles, or the rows, the wrong way round it is a quarter of the pixels.
    assert np.mean(tangential[corona] > 0.9) > 0.99


def test_pixels_along_the_border_are_left_out_of_a_region_and_counted(tmp_path):
    frames = [(at(a), _picture(900, a)) for a in (0, 60, 120)]
    whole = measure(make_run(tmp_path / "run", frames), regions=[REGION]).regions["middle"]
    inner = measure(read_run(tmp_path / "run"), regions=[REGION.model_copy(update={"edge_px": 1})]).regions["middle"]
    assert whole.edge == 0
    assert inner.edge > 0
    assert inner.pixels + inner.edge == whole.pixels


CYCLES, SIDE, RUNS = 8, 20, 60
ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)


def measured(pixels):
    plan = design(np.deg2rad(ANGLES_DEG))
    return measure_region(
        name="paint",
        pixels=repeated(pixels, plan.inverse),
        inside=np.ones((SIDE, SIDE), dtype=bool),
        excluded=0,
        edge=0,
        channel_names=("dn_0", "dn_45", "dn_90", "dn_135"),
        plan=plan,
        level_std_error=np.zeros(4),
        relative_error=np.zeros(4),
    )


def test_noise_of_pixels_is_counted_once_in_the_errors_of_ratios():
    draw = np.random.default_rng(5)
    scores = []
    for _ in range(RUNS):
        found = measured(1000.0 + 30.0 * draw.standard_normal((CYCLES, 4, SIDE**2)))
        scores += [one.value / one.std_error for one in (found.quantities[name]["mean"] for name in ("s1n", "s2n"))]
    # Twice as large a variance of the error would make it 0.5; 120 scores know theirs to 0.13.
    assert 0.62 < np.var(scores) < 1.4


def test_light_that_does_not_repeat_itself_is_in_the_errors():
    draw = np.random.default_rng(6)
    wander = 1.0 + 0.02 * draw.standard_normal((CYCLES, 4, 1))
    found = measured(1000.0 * wander + 3.0 * draw.standard_normal((CYCLES, 4, SIDE**2)))
    # 2 % from cycle to cycle, over eight; 28 degrees of freedom know it to a seventh.
    assert abs(found.repeatability.own - 0.02 / np.sqrt(CYCLES)) < 0.5 * 0.02 / np.sqrt(CYCLES)
    # An angle's own wander is no light that all angles share.
    assert found.repeatability.common < 0.02 / np.sqrt(CYCLES)


def test_light_that_wanders_alike_behind_all_angles_is_in_the_errors_of_counts_and_not_of_ratios():
    draw = np.random.default_rng(7)
    wander = 1.0 + 0.02 * draw.standard_normal((CYCLES, 1, 1))
    noise = 3.0 * draw.standard_normal((CYCLES, 4, SIDE**2))
    still, found = measured(1000.0 + noise), measured(1000.0 * wander + noise)
    # Seven degrees of freedom know it to a quarter; its slope by chance is some tenth of it.
    assert abs(found.repeatability.common * np.sqrt(CYCLES) - 0.02) < 0.01
    assert found.repeatability.own < 0.4 * found.repeatability.common
    assert found.quantities["s0"]["mean"].std_error > 20.0 * still.quantities["s0"]["mean"].std_error


def test_light_that_drifts_reaches_the_angles_one_after_the_other():
    draw = np.random.default_rng(8)
    drift = 1.0 + 0.01 * (np.arange(CYCLES * 4) / 4.0).reshape(CYCLES, 4, 1)
    found = measured(1000.0 * drift + 3.0 * draw.standard_normal((CYCLES, 4, SIDE**2)))
    for name in ("s1n", "s2n"):
        one = found.quantities[name]["mean"]
        # Half a cycle between its two angles, where any two are 0.41 apart in the root mean square of all orders.
        assert 1.0 < abs(one.value) / one.std_error < 1.5


def test_what_rounding_leaves_of_zero_is_zero():
    # 0.1 is no binary number: its sums leave 1e-17 of what is nothing.
    found = measured(np.full((CYCLES, 4, SIDE**2), 0.1)).quantities
    for quantity, statistics in found.items():
        for statistic, sample in statistics.items():
            assert sample.std_error == 0.0, (quantity, statistic)
            assert abs(sample.value) > 0.01 or sample.value == 0.0, (quantity, statistic)


SEEDS = range(5000, 5020)
EDGES = (
    "clipped at 0",
    "near saturation",
    "8 bits, noise 0.4",
    "unpolarized",
    "hit",
    "hit, two cycles",
    "hit, one cycle",
    "drift 1 %",
)


@pytest.mark.parametrize("name", EDGES)
def test_intervals_hold_the_light_that_was_drawn(name):
    found = [covered(CASES[name], seed) for seed in SEEDS]
    for number in found[0]:
        z, narrow, wide = np.array([one[number] for one in found], dtype=float).T
        # Of twenty, 68 % are 14 +- 2 and 95 % are 19 +- 1: four errors below.
        assert narrow.sum() >= 6, number
        assert wide.sum() >= 15, number
        # The length of a vector is not normal: its score at no polarization is not either.
        assert number == "dolp" or abs(z.mean()) < 4.0 / np.sqrt(len(SEEDS)), number


@pytest.mark.parametrize("name", ["clipped at 0", "8 bits, noise 0.4", "8 bits, unpolarized", "hit"])
def test_sound_runs_at_the_edges_do_not_disagree(name):
    for seed in SEEDS[:4]:
        for kind, found in judged(CASES[name], seed).items():
            assert found.verdict != "disagrees", (kind, seed)
            assert found.z or (name, kind) == ("clipped at 0", "itself")
