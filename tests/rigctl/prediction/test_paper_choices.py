"""Choices of the paper, and a user's, beside ours."""

import pytest

from model.accuracy.chain import evaluate
from model.accuracy.plan import NUMERICAL_SETTINGS, settings_at
from rigctl.errors import ConfigError
from rigctl.files.scene_file import load_scene
from rigctl.prediction.predict import ScenePredictor
from rigctl.prediction.tradeoff import named_choices, settings_by
from tests.hard_cases.cases import HARD_CASES
from tests.rigctl.scene_texts import written

SETTINGS = settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 1), 0.01)


def test_a_user_states_settings_by_name():
    found = settings_by("tiles_per_side=3, rule=midpoint,streams=6", SETTINGS)
    assert (found.tiles_per_side, found.tile_rule, found.solver.nodes) == (3, "midpoint", 6)
    assert found.wavelengths == SETTINGS.wavelengths


@pytest.mark.parametrize("text", ["tiles=3", "tiles_per_side", "tiles_per_side=0", "rule=simpson", "wavelengths=x"])
def test_what_cannot_be_read_is_refused_with_its_words(text):
    with pytest.raises(ConfigError, match="--also"):
        settings_by(text, SETTINGS)


def test_draws_and_first_order_stand_beside_the_exact_statistics(tmp_path):
    # A target hardly told from its background, where the paper's draws and its first order both show.
    case = next(one for one in HARD_CASES if one.name == "background as the target")
    scene = ScenePredictor(load_scene(written(tmp_path, case.text)), None).lit_scene()
    result = evaluate(scene, SETTINGS)
    truth = result.readings
    found = {one.name: one for one in named_choices(scene, SETTINGS, truth, ("wavelengths=1",))}
    assert found["wavelengths=1"].by_user
    assert found["K = 9 midpoint tiles"].error == 0.0
    first = found["first-order DoLP"]
    assert 1e-5 < first.error < 0.1
    assert first.reading is not None
    assert first.reading.quantity == "dolp_pixels"
    # Standard errors of a share of about 0.1 by so many draws; six of them, and the threshold's own.
    assert found["ROC of 1e6 draws"].error < 10.0 * (0.3 / 1e3)
    assert found["ROC of 1e3 draws"].error < 10.0 * (0.3 / 31.0)
