from dataclasses import replace

import numpy as np
import pytest

from benchmarks.uncertain_panels import drawn_truth, scene_text, take_run
from rigctl.comparison.predict_run import cycle_of_run
from rigctl.files.rig_file import PolarizerSection
from rigctl.files.scene_file import RigSection, SceneFile, load_scene
from rigctl.measure.measure import Measurement, frame_order, measure
from rigctl.runs.records import RigAsTaken
from rigctl.scene.reading import scene_of_file
from rigctl.scene.scene import ANGLE, EXPOSURE_RATIO, OFFSET, Inputs, cycle_of_file, gather, rig_errors, with_rig


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> tuple[SceneFile, Measurement]:
    folder = tmp_path_factory.mktemp("run")
    (folder / "scene.toml").write_text(scene_text())
    scene = load_scene(folder / "scene.toml")
    draws = np.random.default_rng(1)
    return scene, measure(take_run(folder / "run", drawn_truth(draws), draws), regions=list(scene.regions))


def inputs(given: tuple[SceneFile, Measurement], **section: object) -> Inputs:
    scene, measurement = given
    cycle = cycle_of_run(measurement, scene)
    return gather(with_rig(scene_of_file(scene), RigSection.model_validate(section), cycle))


def test_an_exact_rig_adds_no_inputs(given: tuple[SceneFile, Measurement]) -> None:
    found = inputs(given)
    assert OFFSET not in found.names
    assert rig_errors(found.scene) is None


def test_each_angle_is_an_input_of_its_own(given: tuple[SceneFile, Measurement]) -> None:
    found = inputs(given, angle_std_deg=0.2)
    names = [name for name in found.names if name.startswith(ANGLE)]
    assert names == [f"{ANGLE}{angle}" for angle in ("0", "45", "90", "135")]
    places = [found.names.index(name) for name in names]
    np.testing.assert_allclose(found.cov[np.ix_(places, places)], 0.04 * np.eye(4))


def test_a_stated_offset_turns_every_angle(given: tuple[SceneFile, Measurement]) -> None:
    errors = rig_errors(inputs(given, polarizer_offset_deg=1.5).scene)
    assert errors is not None
    np.testing.assert_allclose(errors.turned_rad, np.deg2rad(1.5))


def test_drift_follows_the_order_in_which_the_angles_were_taken(given: tuple[SceneFile, Measurement]) -> None:
    assert frame_order(given[1]).tolist() == [0, 2, 1, 3]


def test_the_offset_of_a_rig_file_may_have_an_uncertainty() -> None:
    found = PolarizerSection.model_validate({"sense": 1, "offset_deg": {"value": 12.3, "std": 0.05}})
    assert (found.offset_deg, found.offset_std_deg) == (12.3, 0.05)


def test_the_uncertainty_of_the_rig_files_offset_is_an_input(given: tuple[SceneFile, Measurement]) -> None:
    scene, measurement = given
    session = measurement.run.session
    rig = replace(session.rig or RigAsTaken(), polarizer=replace(session.polarizer, offset_std_deg=0.3))
    told = replace(measurement, run=replace(measurement.run, session=replace(session, rig=rig)))
    found = gather(with_rig(scene_of_file(scene), RigSection(), cycle_of_run(told, scene)))
    place = found.names.index(OFFSET)
    assert found.cov[place, place] == pytest.approx(0.09)


def test_the_cycle_of_a_scene_file_is_in_the_order_of_its_angles(given: tuple[SceneFile, Measurement]) -> None:
    # The file's angles are 0, 90, 45, 135 in time; its channels are 0, 45, 90, 135.
    cycle = cycle_of_file(given[0])
    assert cycle.angle_names == ("0", "45", "90", "135")
    assert cycle.frame_order == (0, 2, 1, 3)


def test_the_uncertainty_of_the_exposure_is_that_of_its_ratio(given: tuple[SceneFile, Measurement]) -> None:
    scene, measurement = given
    stated = scene.acquisition.model_validate({"exposure_ms": {"value": 0.03, "std": 0.0003}})
    told = scene.model_copy(update={"acquisition": stated})
    found = gather(with_rig(scene_of_file(told), RigSection(), cycle_of_run(measurement, told)))
    place = found.names.index(EXPOSURE_RATIO)
    assert found.cov[place, place] == pytest.approx(1e-4)
