"""What would explain a disagreement, on runs whose truth is drawn from what the scene file states."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.trials.uncertain_panels import STATED, drawn_truth, scene_text, take_run
from rigctl.comparison.compare import Comparison, compare_with_scene
from rigctl.comparison.explain import _remark
from rigctl.files.scene_file import load_scene
from rigctl.measure.diagnose import measure_run
from rigctl.scene.scene import scene_of_file


def compared(
    folder: Path, *, seed: int, moved: str | None = None, by_std: float = 5.0, text: str | None = None
) -> Comparison:
    draws = np.random.default_rng([seed, 77])
    (folder / "scene.toml").write_text(scene_text() if text is None else text)
    scene = load_scene(folder / "scene.toml")
    run = take_run(folder / f"run-{seed}", drawn_truth(draws, moved=moved, by_std=by_std), draws)
    return compare_with_scene(measure_run(run, list(scene.regions)), scene_of_file(scene), alpha=1e-3)


def test_inputs_drawn_from_what_is_stated_agree_and_have_standard_normal_scores(tmp_path: Path) -> None:
    seeds = 4
    found = [compared(tmp_path, seed=seed) for seed in range(seeds)]
    assert all(comparison.agrees for comparison in found)
    # The scores of the attribution are standard normal each; of 4 x 20 of them, which go together a little, the mean
    # square stays within five standard errors of 1: 5 sqrt(2 / 80) = 0.8.
    attributions = [comparison.attribution for comparison in found]
    scores = [move.score for one in attributions if one is not None for move in one.moves]
    assert np.mean(np.square(scores)) == pytest.approx(1.0, abs=0.8)


# Of these the chance to be outranked is below 5 % by their own estimate; eight standard uncertainties leave 1e-4.
@pytest.mark.parametrize("name", ["errors.illumination_drift", "noise.prnu", "regions.black.stokes_radiance.1"])
def test_an_input_that_is_off_is_named_first(tmp_path: Path, name: str) -> None:
    attribution = compared(tmp_path, seed=3, moved=name, by_std=8.0).attribution
    assert attribution is not None
    assert attribution.moves[0].name == name
    # A normal draw of its own, resolved to a few hundredths, stands on the eight: five of them.
    assert attribution.moves[0].move_std == pytest.approx(8.0, abs=5.0)
    assert attribution.moves[0].removes


def test_inputs_that_act_alike_are_said_to_be_indistinguishable(tmp_path: Path) -> None:
    attribution = compared(tmp_path, seed=5, moved="sensor.quantum_efficiency", by_std=8.0).attribution
    assert attribution is not None
    first = attribution.moves[0]
    assert first.name == "sensor.quantum_efficiency"
    assert {"sensor.optics_transmittance", "rig.exposure_ratio"} <= set(first.indistinguishable_from)
    assert "cannot distinguish it from" in attribution.remark


def test_the_joint_update_is_marked_as_fitted_and_narrows_what_the_data_see(tmp_path: Path) -> None:
    attribution = compared(tmp_path, seed=6).attribution
    assert attribution is not None
    fitted = {one.name: one for one in attribution.fitted}
    assert fitted["errors.illumination_drift"].std < 0.2 * STATED["errors.illumination_drift"].std
    assert fitted["sensor.extinction_ratio"].std == pytest.approx(STATED["sensor.extinction_ratio"].std, rel=0.02)


def test_without_uncertain_inputs_nothing_is_explained_and_that_is_said(tmp_path: Path) -> None:
    plain = scene_text()
    for number in STATED.values():
        plain = plain.replace(f"{{ value = {number.value!r}, std = {number.std!r} }}", repr(number.value))
    found = compared(tmp_path, seed=1, text=plain)
    assert found.attribution is None
    assert any("none is stated" in text for text in found.not_tested)


def test_a_range_is_an_uncertainty_too(tmp_path: Path) -> None:
    stated = STATED["sensor.quantum_efficiency"]
    text = scene_text().replace(f"{{ value = {stated.value!r}, std = {stated.std!r} }}", "{ range = [0.42, 0.48] }")
    found = compared(tmp_path, seed=1, text=text)
    assert found.inputs is not None
    place = found.inputs.names.index("sensor.quantum_efficiency")
    assert found.inputs.values[place] == pytest.approx(0.45)
    # A rectangle 0.06 wide.
    assert found.inputs.cov[place, place] == pytest.approx(0.06**2 / 12.0)


def test_the_trend_over_regions_and_angles_is_predicted(tmp_path: Path) -> None:
    trends = {(found.quantity, found.over): found for found in compared(tmp_path, seed=2).trends}
    assert trends["s0", "regions"].predicted is True
    assert trends["counts", "angles of black"].predicted is True
    # Three numbers in order are one order of six.
    assert trends["dolp", "regions"].order.p_value == pytest.approx(1 / 6)


def test_scale_free_rows_are_blind_to_the_scale(tmp_path: Path) -> None:
    found = compared(tmp_path, seed=5, moved="sensor.quantum_efficiency", by_std=30.0)
    off = {row.quantity for row in found.disagreements}
    assert "s0" in off
    assert not {name for name in off if name.startswith("ratio_") or name in ("s1n", "s2n", "dolp", "aolp_deg")}


def test_light_that_is_off_by_half_of_itself_is_named_first_beside_a_well_known_sensor(tmp_path: Path) -> None:
    # Means and temporal variances go with the light; over so far a move a deviation is bent by more than its error.
    text = scene_text().replace("value = 8.0, std = 0.4", "value = 8.0, std = 0.9")
    for name in ("gain_dn_per_e", "read_noise_e"):
        number = STATED[f"noise.{name}"]
        text = text.replace(
            f"{number.value!r}, std = {number.std!r}", f"{number.value!r}, std = {0.001 * number.value!r}"
        )
    path = tmp_path / "scene.toml"
    path.write_text(text)
    scene = load_scene(path)
    truth = {name: number.value for name, number in STATED.items()} | {"regions.black.stokes_radiance.0": 3.5}
    run = take_run(tmp_path / "run", truth, np.random.default_rng(5))
    found = compare_with_scene(measure_run(run, list(scene.regions)), scene_of_file(scene), alpha=1e-3)
    assert found.attribution is not None
    best = found.attribution.best
    assert best is not None
    assert best.name == "regions.black.stokes_radiance.0"
    assert best.move_std == pytest.approx(-5.0, abs=0.1)
    assert best.removes


def test_where_no_input_explains_enough_nobody_is_named():
    move = SimpleNamespace(name="noise.prnu", score=9.0, removes=False, move_std=3.0, indistinguishable_from=())
    text = _remark((move,), 1e-12, ("sensor.f_number", "rig.polarizer_offset_deg"))
    assert text == (
        "none of the stated inputs; not considered, because no uncertainty is given: "
        "sensor.f_number, rig.polarizer_offset_deg"
    )
