"""What somebody who watches a session is told."""

import json
import math
from dataclasses import asdict

import numpy as np
import pytest

from rigctl.errors import ConfigError
from rigctl.files.regions import Region
from rigctl.files.session_file import SessionFile
from rigctl.runs.records import SessionNoise
from rigctl.session.numbers import LiveNumbers, RegionMeans
from rigctl.session.status import read_status
from rigctl.session.take import take_session
from tests.rigctl.example_files import small_rig
from tests.rigctl.live.made_frame_summaries import cycle_of, dark, seen

_LEFT = {"name": "left", "rectangle": {"x": 4, "y": 4, "width": 40, "height": 40}}
_RIGHT = {"name": "right", "polygon": [[52, 4], [91, 4], [91, 43], [52, 43]]}
_NOISE = SessionNoise(gain_dn_per_e=0.24, read_noise_e=10.0, dark_current_e_per_s=20.0, black_level_dn=64.0)


def _filled(*cycles, live=None):
    live = live or LiveNumbers()
    live.add(dark(), ends_cycle=False)
    for frames in cycles:
        for frame in frames[:-1]:
            live.add(frame, ends_cycle=False)
        live.add(frames[-1], ends_cycle=True)
    return live


def test_region_means_are_those_of_a_plain_mask():
    counts = np.random.default_rng(2).integers(0, 4096, (48, 96), dtype=np.uint16)
    found = RegionMeans([Region.model_validate(_LEFT), Region.model_validate(_RIGHT)]).of(counts)
    assert found["picture"].mean_dn == pytest.approx(counts.mean())
    assert (found["left"].mean_dn, found["left"].pixels) == (pytest.approx(counts[4:44, 4:44].mean()), 1600)
    # Pixel centres on the left and upper edges of a polygon are inside, those on the others are not.
    assert found["right"].pixels == 39 * 39
    assert found["right"].mean_dn == pytest.approx(counts[4:43, 52:91].mean(), rel=0.02)


def test_a_region_that_does_not_fit_is_told():
    with pytest.raises(ConfigError, match="lies outside of the picture of 20 x 10"):
        RegionMeans([Region.model_validate(_LEFT)]).of(np.zeros((10, 20), dtype=np.uint16))


def test_numbers_are_of_the_last_whole_cycle():
    live = _filled(cycle_of((800.0, 80.0, 0.0)))
    live.add(seen(0.0, level_dn=2000.0, cycle=1), ends_cycle=False)
    content = live.content()
    assert content.regions["panel"].dolp.value == pytest.approx(0.1)
    assert asdict(content.cycle) == {"round": None, "cycle": 0, "exposure_ms": 10.0}
    assert content.angles["0"].mean_dn == pytest.approx(2064.0)
    assert asdict(content.dark) == {"source": "dark frames", "mean_dn": 64.0}
    json.dumps(asdict(content), allow_nan=False)


def test_frames_grouped_by_angle_are_set_against_each_other_as_they_come():
    live = _filled()
    for cycle in range(2):
        for frame in cycle_of((800.0, 80.0, 0.0), cycle=cycle):
            live.add(frame, ends_cycle=False)
    assert live.content().regions["panel"].dolp.value == pytest.approx(0.1)


def test_a_saturated_bracket_is_left_to_its_shorter_exposure():
    short = cycle_of((800.0, 80.0, 0.0))
    long = cycle_of((800.0, 0.0, 0.0), exposure_s=0.04, saturated=0.3)
    both = [frame for pair in zip(short, long, strict=True) for frame in pair]
    content = _filled(both).content()
    assert content.cycle.exposure_ms == 10.0
    assert content.regions["panel"].dolp.value == pytest.approx(0.1)


def test_drift_is_that_of_the_reference_region_and_not_over_the_pause_between_rounds():
    live = LiveNumbers(reference="panel")
    assert _filled(cycle_of((800.0, 0, 0)), live=live).content().drift is None
    _filled(cycle_of((808.0, 0, 0), start_s=4.0, cycle=1), live=live)
    assert live.content().drift.region == "panel"
    assert live.content().drift.change == pytest.approx(8 / 804)
    _filled(cycle_of((900.0, 0, 0), start_s=604.0, round_number=1), live=live)
    assert live.content().drift is None


def test_a_session_tells_of_its_regions_and_their_sigma(tmp_path):
    session = SessionFile.model_validate(
        {
            "name": "watched",
            "take": [{"kind": "scene", "exposure_ms": 0.03, "cycles": 3}],
            "regions": [_LEFT, _RIGHT],
            "reference_region": "right",
            "darks": {"every_cycles": 3},
        }
    )
    take_session(small_rig(tmp_path), session, tmp_path / "run", files={}, noise=_NOISE)
    live = read_status(tmp_path / "run").numbers
    for name, truth in {"left": math.hypot(3, 1) / 10, "right": math.hypot(-2, 3) / 40}.items():
        found = live.regions[name].dolp
        # Temporal noise, and the dark level: the last dark frame's mean of 1600 pixels of 2.4 DN (0.06 DN), off by
        # five times that at most against a signal of 100 DN or more.
        assert found.value == pytest.approx(truth, abs=5 * found.sigma + truth * 5 * 0.06 / 100)
        assert 0.0 < found.sigma < 0.01
    assert live.sum_rule.value == pytest.approx(1.0, abs=5 * live.sum_rule.sigma + 1e-4)
    drift = live.drift
    assert drift.region == "right"
    assert abs(drift.per_min) < 5 * drift.sigma_per_min


@pytest.mark.parametrize(
    ("extra", "match"),
    [
        ({"regions": [_LEFT, _LEFT]}, "more than once"),
        ({"regions": [_LEFT | {"name": "picture"}]}, "'picture'"),
        ({"regions": [_LEFT], "reference_region": "white"}, r"'white'; \[\[regions\]\] has left"),
    ],
)
def test_regions_that_make_no_sense_are_refused(extra, match):
    with pytest.raises(ValueError, match=match):
        SessionFile.model_validate({"name": "x", "take": [{"kind": "scene", "exposure_ms": 1}], **extra})
