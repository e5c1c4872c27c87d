"""A simulated roof: its sun is that of the clock, its light moves slowly, its changes are as said."""

from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest

from rigctl.base.numbers import NS_PER_S
from rigctl.errors import ConfigError
from rigctl.files.rig_file import load_rig
from rigctl.files.scene_file import load_scene
from rigctl.rig.roof import CLOUD_S, LitRoof, changed_roof, cloud_factor
from rigctl.rig.simulation import with_simulation
from rigctl.scene.scene import get, scene_of_file
from tests.rigctl.example_files import EXAMPLES

MORNING_NS = 1_274_796_580 * NS_PER_S  # 2010-05-25T14:09:40Z
SCENE = load_scene(EXAMPLES / "scene-roof.toml")


def rig(clock_ns=MORNING_NS, perturb=None):
    return with_simulation(load_rig(EXAMPLES / "rig-roof.toml"), clock_ns=clock_ns, perturb=perturb)


@pytest.fixture(scope="module")
def morning() -> LitRoof:
    return LitRoof(SCENE, rig())


def test_the_sun_is_that_of_the_clock(morning):
    text = morning.sun_text(MORNING_NS)
    assert "zenith 43.02 deg, azimuth 106.45 deg, phi 106.45 deg, 2010-05-25T14:09:40Z" in text
    assert "the run's simulated clock" in text


def test_light_between_minutes_is_near_that_of_the_moment(morning):
    """Linear between minutes; the moment itself by a roof whose scene file states that sun."""
    later_ns = MORNING_NS + 50 * NS_PER_S  # half a minute past a full one
    moment = datetime.fromisoformat("2010-05-25T14:10:30Z")
    stated = SCENE.model_copy(update={"sun": SCENE.sun.model_copy(update={"time": moment})})
    for one, other in zip(morning.at(later_ns).values(), LitRoof(stated, rig(None)).at(later_ns).values(), strict=True):
        assert one.mean == pytest.approx(other.mean, abs=1e-5 * other.mean[0])


def test_a_mismatch_of_time_is_remarked_on(morning):
    assert any(remark.startswith("time: the clock begins at 2010-05-25T14:09Z") for remark in morning.record.remarks)


def test_a_mismatch_of_place_is_remarked_on():
    moved = rig().model_copy(update={"site": SCENE.site.model_copy(update={"latitude_deg": 40.0})})
    assert any("place: the rig stands at 40, -77.68" in remark for remark in LitRoof(SCENE, moved).record.remarks)


def test_there_is_no_light_at_night(morning):
    with pytest.raises(ConfigError, match="no light at 2010-05-26T02:09Z"):
        morning.require_day(MORNING_NS + 12 * 3600 * NS_PER_S)


def test_a_clock_needs_a_site():
    nowhere = rig().model_copy(update={"site": None})
    with pytest.raises(ConfigError, match=r"needs \[site\]"):
        LitRoof(SCENE.model_copy(update={"site": None}), nowhere)


@pytest.mark.parametrize(
    ("what", "key", "value"),
    [
        ("visibility", "atmosphere.visibility_km", 16.1),
        ("dhr", "regions.black_panel.dhr", 1.2),
        ("tilt", "regions.black_panel.tilt_deg", 3.0),
    ],
)
def test_a_change_is_of_its_documented_size(what, key, value):
    scene = scene_of_file(SCENE)
    changed, text = changed_roof(scene, what)
    expected = value * get(scene, key).value if what == "dhr" else value
    assert get(changed, key).value == pytest.approx(expected)
    assert key in text


def test_another_aerosol():
    changed, _ = changed_roof(scene_of_file(SCENE), "aerosol")
    assert changed.atmosphere.aerosol == "spheres"


def test_a_cloud_dims_and_is_gone():
    assert cloud_factor(0) == 1.0
    assert cloud_factor(round(0.5 * CLOUD_S * NS_PER_S)) == pytest.approx(0.9)
    assert cloud_factor(round(CLOUD_S * NS_PER_S)) == 1.0


def test_a_clock_is_for_simulated_rigs():
    real = load_rig(EXAMPLES / "rig-roof.toml")
    real = real.model_copy(update={"stage": real.stage.model_copy(update={"port": "/dev/ttyUSB0"})})
    with pytest.raises(ConfigError, match="--clock"):
        with_simulation(real, clock_ns=MORNING_NS, perturb=None)


def test_the_record_states_the_limits_of_a_simulated_run(morning):
    (proves,) = morning.record.caution
    assert "computed by the same model" in proves
    changed = replace(morning.record, perturbed="tilt: ...")
    assert np.size(changed.caution) == 2
