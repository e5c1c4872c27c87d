"""Which frame of a run is which angle of which cycle."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.polarimeter.pictures import flat_field
from calibration.results import CalibrationError
from model.prediction import as_processed
from model.scene.scene import Readout
from model.sensor import ChannelMoments
from rigctl.calibrations.flat import FlatFields
from rigctl.cli import main
from rigctl.console import EXIT_DATA
from rigctl.errors import DataError
from rigctl.files.regions import Rectangle, Region
from rigctl.measure import measure as measurement
from rigctl.measure.frames import RunCalibrations, arrange, flat_remarks
from rigctl.measure.measure import Measurement, measure
from rigctl.runs.folder import Run
from tests.rigctl.made_runs import at, make_run

PICTURE = np.arange(6).reshape(2, 3)


def grid_of(folder, *facts):
    return arrange(make_run(folder / "run", [(one, PICTURE) for one in facts]))


@pytest.mark.parametrize(
    ("asked", "names"),
    [
        ([at(a) for a in (0, 90, 45, 135)], ("dn_0", "dn_45", "dn_90", "dn_135")),
        ([at(a) for a in (0, 60, -60)], ("dn_0", "dn_60", "dn_120")),
        ([at(a, cycle=0) for a in (0, 60, 120, 180)], ("dn_0", "dn_0_2", "dn_60", "dn_120")),
    ],
)
def test_angles_are_sorted_and_named_by_what_was_asked_for(tmp_path, asked, names):
    grid = grid_of(tmp_path, *asked)
    assert grid.channel_names == names
    assert grid.polarizer_angles_rad == pytest.approx(np.deg2rad([float(name.split("_")[1]) for name in names]))


def test_a_readback_on_the_other_side_of_zero_is_averaged_as_an_axis(tmp_path):
    readbacks = [0.004, 179.998]
    asked = [
        at(a, cycle=c, polarizer_angle_deg=readbacks[c] if a == 0 else float(a)) for c in (0, 1) for a in (0, 60, 120)
    ]
    assert np.rad2deg(grid_of(tmp_path, *asked).polarizer_angles_rad[0]) == pytest.approx(0.001, abs=1e-9)


def test_an_incomplete_cycle_is_left_out_and_said(tmp_path):
    grid = grid_of(tmp_path, *[at(a, cycle=c) for c in (0, 1) for a in (0, 60, 120)][:-1])
    assert (grid.cycles, grid.left_out) == (1, ("cycle 1: incomplete, 2 of 3",))


def test_without_cycles_the_nth_frame_at_an_angle_is_of_cycle_n(tmp_path):
    grid = grid_of(tmp_path, *[at(a) for a in (0, 0, 60, 60, 120, 120)])
    assert [[record.sequence for record in cycle] for cycle in grid.records] == [[0, 2, 4], [1, 3, 5]]


def test_exposures_that_differ_make_it_counts_a_second(tmp_path):
    grid = grid_of(tmp_path, *[at(a, exposure_s=t) for a, t in ((0, 1.0), (60, 2.0), (120, 4.0))])
    assert grid.unit == "DN/s"
    assert grid.to_unit == pytest.approx([1.0, 0.5, 0.25])


@pytest.mark.parametrize(
    ("frames", "said"),
    [
        ([(at(0), PICTURE), (at(60, polarizer_angle_deg=None), PICTURE)], "angle of 1 frames is not known"),
        ([(at(0), PICTURE), (at(60), PICTURE), (at(120), PICTURE.T)], "differ in size"),
        ([({"kind": "dark"}, PICTURE)], "no scene frames"),
    ],
)
def test_frames_that_give_no_grid_are_refused(tmp_path, frames, said):
    with pytest.raises(DataError, match=said):
        arrange(make_run(tmp_path / "run", frames))


FloatArray = NDArray[np.float64]

SIZE = (100, 120)
ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
PASSED = (1.0, 0.99, 1.01, 1.0)
GAIN, BLACK_DN, PRNU, DUST = 0.25, 64.0, 0.03, 0.05
FLAT_E, SCENE_E, FLATS, CYCLES = 10_000.0, 4000.0, 8, 4
REGION = Region(name="a", rectangle=Rectangle(x=5, y=5, width=110, height=90))


def responses() -> FloatArray:
    draws = np.random.default_rng(3)
    response = np.repeat((1.0 + PRNU * draws.standard_normal(SIZE))[None], 4, axis=0)
    for k in range(4):
        response[k, 20 + 15 * k : 30 + 15 * k, 30:60] -= DUST
    response[:, 50, 60] = 0.02
    return response


def frame(electrons: FloatArray, draws: np.random.Generator) -> FloatArray:
    return np.rint(BLACK_DN + GAIN * draws.poisson(electrons))


def flats_run(path: Path, *, dark: bool = True, light_e: float = FLAT_E) -> Run:
    draws = np.random.default_rng(1)
    frames = [
        (
            at(angle, kind="flat", exposure_s=0.01, black_level_dn=None, stage_serial="7"),
            frame(light_e * passed * response, draws),
        )
        for response, angle, passed in zip(responses(), ANGLES_DEG, PASSED, strict=True)
        for _ in range(FLATS)
    ]
    darks = [({"kind": "dark", "exposure_s": 0.01}, np.full(SIZE, BLACK_DN))] * (2 if dark else 0)
    return make_run(path, [*frames, *darks])


def scene_run(path: Path, *, angles_deg: tuple[float, ...] = ANGLES_DEG, **facts: Any) -> Run:
    draws = np.random.default_rng(2)
    known = {"exposure_s": 0.01, "black_level_dn": BLACK_DN} | facts
    return make_run(
        path,
        [
            (at(angle, cycle=cycle, **known), frame(SCENE_E * response, draws))
            for cycle in range(CYCLES)
            for response, angle in zip(responses(), angles_deg, strict=True)
        ],
    )


@pytest.fixture(scope="module")
def flat_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flats")
    run, out = flats_run(folder / "flats"), folder / "flat.npz"
    assert main(["calibrate", "flat", str(run.path), "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def divided(flat_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Measurement:
    run = scene_run(tmp_path_factory.mktemp("scene") / "run")
    flats, _ = FlatFields.read_fitting(flat_file, run)
    return measure(run, regions=[REGION], calibrations=RunCalibrations(flat=flats))


def test_the_numbers_of_a_flat_are_found(flat_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with np.load(flat_file) as kept:
        facts = json.loads(kept["facts"].tobytes())
    for row, passed in zip(facts["angles"], PASSED, strict=True):
        assert row["frames"] == FLATS
        # 8 frames of 12 000 pixels of 10 000 e-, and the error from 8 means is itself good to a quarter.
        assert abs(row["throughput"]["value"] - passed) < 5.0 * 0.01 / np.sqrt(FLATS * 12_000)
        assert row["throughput"]["std_error"] < 2.0 * 0.01 / np.sqrt(FLATS * 12_000)
        # Shot noise of 1 % over sqrt(8), with the rounding to whole counts: 2 % of variance.
        assert row["noise_rms"] == pytest.approx(0.01 / np.sqrt(FLATS), rel=0.02)
        # PRNU of 3 %, the patch of dust (300 pixels) and the dead pixel.
        dust = DUST * np.sqrt(300.0 / 12_000.0)
        assert row["pattern_rms"] == pytest.approx(np.hypot(PRNU, dust), rel=0.06)


def test_pixels_are_even_but_for_noise_and_the_flats_own_error(divided: Measurement) -> None:
    region = divided.regions["a"]
    assert divided.flat is not None
    for k, name in enumerate(divided.grid.channel_names):
        mean = region.channels_mean.mean[k]
        temporal = (GAIN * mean + 1.0 / 12.0) * divided.noise_factor[k] / CYCLES
        predicted = np.sqrt(temporal + (mean * divided.flat.error[k]) ** 2)
        sample = region.quantities[name]["std_spatial_mean"]
        # 9900 pixels: 0.7 % each.
        assert sample.value == pytest.approx(predicted, rel=5.0 * 0.0071)
        assert sample.value < 0.5 * PRNU * mean


def test_dust_makes_no_polarization(divided: Measurement) -> None:
    undivided = measure(divided.run, regions=[REGION])
    dust = np.s_[20:30, 30:60]
    s0, s1, _ = np.einsum("kn,nij->kij", undivided.plan.inverse, undivided.channels)
    before = s1[dust].mean() / s0[dust].mean()
    s0, s1, _ = np.einsum("kn,nij->kij", divided.plan.inverse, divided.channels)
    after = s1[dust].mean() / s0[dust].mean()
    # 5 % less in one of four channels.
    assert before == pytest.approx(-DUST / 2.0, rel=0.1)
    # 300 pixels, four frames, 1.6 % of shot noise, and the flats': 0.06 %.
    assert abs(after) < 5.0 * 0.0006


def test_a_dead_pixel_is_missing(divided: Measurement) -> None:
    assert np.argwhere(divided.frames.missing).tolist() == [[50, 60]]
    assert divided.regions["a"].excluded == 1


def test_an_angle_without_a_flat_is_refused(flat_file: Path, tmp_path: Path) -> None:
    run = scene_run(tmp_path / "run", angles_deg=(0.0, 30.0, 90.0, 135.0))
    flats, _ = FlatFields.read_fitting(flat_file, run)
    with pytest.raises(DataError, match="no flat field at 30"):
        measure(run, regions=[], calibrations=RunCalibrations(flat=flats))


def test_flats_of_another_stage_or_size_are_refused(flat_file: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="stage serial number: calibrated 7, used 8"):
        FlatFields.read_fitting(flat_file, scene_run(tmp_path / "run", stage_serial="8"))
    small = make_run(tmp_path / "small", [(at(angle), np.full((4, 5), 100.0)) for angle in ANGLES_DEG])
    with pytest.raises(DataError, match="the run"):
        FlatFields.read_fitting(flat_file, small)


def test_what_is_no_flat_file_says_what_makes_one(tmp_path: Path) -> None:
    run, path = scene_run(tmp_path / "run"), tmp_path / "flat.npz"
    np.savez(path, other=np.ones(3))
    with pytest.raises(DataError, match="rigctl calibrate flat"):
        FlatFields.read_fitting(path, run)
    path.write_text("not an archive")
    with pytest.raises(DataError, match="rigctl calibrate flat"):
        FlatFields.read_fitting(path, run)


def test_stokes_divides(flat_file: Path, tmp_path: Path) -> None:
    run = scene_run(tmp_path / "run")
    assert main(["stokes", str(run.path), "--flat", str(flat_file), "--out", str(tmp_path / "stokes")]) == 0


def test_flats_without_a_dark_level_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = flats_run(tmp_path / "run", dark=False)
    assert main(["calibrate", "flat", str(run.path), "--out", str(tmp_path / "f.npz")]) == EXIT_DATA
    assert "no dark frames" in capsys.readouterr().err


@pytest.mark.parametrize(("light_e", "is_warned"), [(50.0, True), (FLAT_E, False)])
def test_flats_that_would_do_harm_are_warned_about(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], light_e: float, is_warned: bool
) -> None:
    # 14 % of shot noise over the root of 8 frames, beside 3 % of pattern.
    run = flats_run(tmp_path / "flats", light_e=light_e)
    assert main(["calibrate", "flat", str(run.path), "--out", str(tmp_path / "f.npz")]) == 0
    assert ("makes single pixels worse" in " ".join(capsys.readouterr().err.split())) is is_warned


def test_a_run_without_flats_says_how_to_take_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "flat", str(scene_run(tmp_path / "run").path), "--out", str(tmp_path / "f")]) == EXIT_DATA
    assert 'kind = "flat" with angles_deg' in capsys.readouterr().err


@pytest.mark.parametrize(("frames", "problem"), [(1, "two or more"), (2, "not brighter")])
def test_one_frame_or_no_light_is_refused(frames: int, problem: str) -> None:
    with pytest.raises(CalibrationError, match=problem):
        flat_field([np.full((3, 4), 60, dtype=np.uint16)] * frames, np.full((3, 4), 60.0))


def test_a_region_in_the_shade_of_the_lens_is_spoken_of(divided: Measurement) -> None:
    assert divided.flat is not None
    (only,) = flat_remarks(divided.flat, [REGION])
    assert "divided by flat fields" in only
    response = divided.flat.response.copy()
    response[:, :20, :20] = 0.7
    flat = replace(divided.flat, response=response)
    shade = Region(name="corner", rectangle=Rectangle(x=0, y=0, width=20, height=20))
    assert next(iter(flat_remarks(flat, [shade]))).startswith("corner: the flat field is 0.70 of its mean there")


def test_the_error_of_a_flat_is_a_pattern_of_each_angle_by_itself() -> None:
    channels = ChannelMoments(
        mean_dn=np.array([100.0, 200.0]),
        dark_signal_dn=0.0,
        scene_cov_dn2=np.zeros((2, 2)),
        temporal_var_dn2=np.array([3.0, 4.0]),
        fixed_pattern_cov_dn2=np.ones((2, 2)),
        saturation_probability=np.zeros(2),
        warnings=(),
    )
    readout = Readout(
        angles_rad=np.zeros(2),
        channel_names=("a", "b"),
        cycles=1,
        extinction_ratio=np.inf,
        noise_factor=np.array([0.5, 2.0]),
        flat_error=np.array([0.01, 0.02]),
    )
    found = as_processed(channels, readout)
    assert found.temporal_var_dn2.tolist() == [1.5, 8.0]
    assert found.fixed_pattern_cov_dn2 == pytest.approx(np.array([[2.0, 1.0], [1.0, 17.0]]), rel=1e-12)


SIDE, FRAMES, ANGLES = 320, 200, (0.0, 45.0, 90.0, 135.0)
_PIXELS = SIDE * SIDE
# One array of the pixels of all frames, as numbers.
_ALL_BYTES = 8 * _PIXELS * FRAMES

_TRIAL = """
import json, sys
from pathlib import Path
from calibration.sensor.levels import level_statistics
from rigctl.calibrations.noise_frames import run_frames
from rigctl.calibrations.registration import register_run
from rigctl.files.regions import Region
from rigctl.measure import measure as measurement
from rigctl.runs.folder import read_run

run, region = read_run(Path(sys.argv[1])), Region(name="all", rectangle=json.loads(sys.argv[2]))
measurement.MOST_HELD_BYTES //= 50

def memory(name):
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(name + ":"))

def grown(work):
    before = memory("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    work()
    return memory("VmHWM") - before

levels = run_frames(run.path).groups
print(json.dumps({
    "noise": grown(lambda: [level_statistics((load() for load in one.loaders), kind=one.kind, exposure_s=one.exposure_s)
                            for one in levels]),
    "registration": grown(lambda: register_run(run)),
    "measure": grown(lambda: measurement.measure(run, regions=[region])),
}))
"""
_WHOLE = {"x": 0, "y": 0, "width": SIDE, "height": SIDE}


def large_run(path: Path, *, side: int, frames: int):
    """Return a run of scene frames, with as many darks and flats among them as half of them."""
    rng = np.random.default_rng(3)
    picture = 400 + 200 * (np.add.outer(np.arange(side) // 20, np.arange(side) // 20) % 2)
    noise = [rng.integers(-20, 21, (side, side)) for _ in range(5)]
    made = []
    for k in range(frames // 2):
        angle = ANGLES[k % 4]
        light = 1.0 + 0.3 * np.cos(np.radians(2.0 * angle))
        counts = picture * light + noise[k % 5]
        made.append((at(angle, exposure_s=0.01, gain_db=0.0), counts))
    for k in range(frames // 4):
        made.append(({"kind": "dark", "exposure_s": 0.01, "gain_db": 0.0}, 100 + noise[k % 5]))
        made.append(({"kind": "flat", "exposure_s": 0.01, "gain_db": 0.0}, 2000 + 5 * noise[k % 5]))
    return make_run(path, made)


def test_memory_does_not_grow_with_the_number_of_frames(tmp_path):
    run = large_run(tmp_path / "run", side=SIDE, frames=FRAMES)
    words = [sys.executable, "-c", _TRIAL, str(run.path), json.dumps(_WHOLE)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=Path(__file__).parents[3])
    assert done.returncode == 0, done.stderr
    grown = json.loads(done.stdout)
    # Half of the frames are scene frames: their pixels as numbers are 80 MB, and code took two such arrays.
    assert grown["measure"] < 0.45 * _ALL_BYTES
    assert grown["noise"] < 0.25 * _ALL_BYTES
    assert grown["registration"] < 0.25 * _ALL_BYTES


@pytest.mark.parametrize("frames", [8, 24])
def test_frames_that_are_read_twice_give_the_same_numbers(tmp_path, monkeypatch, frames):
    run = large_run(tmp_path / "run", side=48, frames=4 * frames)
    regions = [Region(name="left", rectangle={"x": 2, "y": 2, "width": 20, "height": 30})]
    regions.append(Region(name="few", rectangle={"x": 30, "y": 2, "width": 3, "height": 3}))
    held = measure(run, regions=regions)
    monkeypatch.setattr(measurement, "MOST_HELD_BYTES", 0)
    streamed = measure(run, regions=regions)
    assert streamed.unmeasured == held.unmeasured != {}
    np.testing.assert_array_equal(streamed.channels, held.channels)
    one, other = streamed.regions["left"], held.regions["left"]
    for quantity, statistics in other.quantities.items():
        for statistic, sample in statistics.items():
            found = one.quantities[quantity][statistic]
            assert found.value == pytest.approx(sample.value, rel=1e-9, abs=1e-12), (quantity, statistic)
            assert found.std_error == pytest.approx(sample.std_error, rel=1e-6, abs=1e-12), (quantity, statistic)
    np.testing.assert_allclose(one.channels_mean.cov, other.channels_mean.cov, rtol=1e-9)
