"""Runs that outgrow memory: 1/50 of 10 000 frames of 5 megapixels, measured in less than their pixels take."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rigctl.files.regions import Region
from rigctl.measure import measure as measurement
from rigctl.measure.measure import measure
from tests.rigctl.made_runs import at, make_run

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
