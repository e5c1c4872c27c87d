"""The scene of a run: which sun, camera and rig it is predicted with, and what of that differs from the scene file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from benchmarks.trials.uncertain_panels import drawn_truth, scene_text, take_run
from rigctl.comparison.predict_run import differences, run_predictor, scene_of_run
from rigctl.errors import DataError
from rigctl.files.rig_file import PolarizerSection
from rigctl.files.scene_file import load_scene
from rigctl.measure.measure import measure
from rigctl.runs.folder import Run
from rigctl.runs.records import FrameRecord, RigAsTaken, SessionRecord
from rigctl.runs.writer import RunWriter
from rigctl.scene.scene import OFFSET, scene_of_file
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.scene_texts import SCENE, written

SITE = {"latitude_deg": 43.085, "longitude_deg": -77.68, "elevation_m": 168.0}
AT_NOON = "2010-05-25T17:07:40.000000000Z"
BY_RIG = {"rig": {"site": SITE}}


@pytest.fixture
def scene(tmp_path):
    return scene_of_file(load_scene(written(tmp_path)))


def frame(**facts):
    return FrameRecord(kind="scene", sequence=0, bit_depth=12, saturation_dn=4095.0, **facts)


def seen(scene, *frames, origin="device", **session):
    """Return the scene of a run, and what is said of it."""
    content = {"origin": origin} | session
    run = Run(
        path=Path("run"),
        session=TypeAdapter(SessionRecord).validate_python(content),
        session_json=content,
        frames=(),
        created_by="test",
        created_utc=AT_NOON,
    )
    found = scene_of_run(scene, run, frames or [frame(start_utc=AT_NOON)])
    return found, tuple(differences(scene, found))


@pytest.mark.parametrize("session", [BY_RIG, {"session": {"site": SITE}}])
def test_the_sun_of_time_and_site_wins(scene, session):
    found, said = seen(scene, **session)
    assert found.sun.zenith_deg.value == pytest.approx(22.067, abs=0.01)
    # The ephemeris of the moment; the day alone is within 1e-3 of it.
    assert found.sun.distance_factor.value == pytest.approx(0.974729, abs=1e-5)
    assert "sun.zenith_deg: 22.07 of the run, not 50.00 of the scene file" in said


def test_the_sun_that_the_frames_recorded_wins_over_a_computed_one(scene):
    found, said = seen(scene, frame(start_utc=AT_NOON, sun_azimuth_deg=170.0, sun_elevation_deg=60.0), **BY_RIG)
    assert (found.sun.zenith_deg.value, found.sun.azimuth_deg.value) == pytest.approx((30.0, 170.0))
    assert len(said) == 2


def test_frames_share_a_mean_sun(scene):
    frames = [frame(sun_azimuth_deg=azimuth, sun_elevation_deg=45.0) for azimuth in (359.0, 1.0)]
    azimuth_deg = seen(scene, *frames)[0].sun.azimuth_deg.value
    assert (azimuth_deg + 180.0) % 360.0 == pytest.approx(180.0)


def test_the_cameras_place_in_the_rig_file_wins(scene):
    rig = {"geometry": {"camera_zenith_deg": 53.0, "camera_azimuth_deg": 0.0, "camera_roll_deg": 1.5}}
    found, said = seen(scene, frame(), rig=rig)
    assert found.geometry.camera_zenith_deg.value == 53.0
    assert set(said) == {
        "geometry.camera_zenith_deg: 53.00 of the run, not 50.00 of the scene file",
        "geometry.camera_roll_deg: 1.50 of the run, not 0.00 of the scene file",
    }


@pytest.mark.parametrize(
    ("frames", "session"),
    [
        ([frame()], {"rig": {"site": None}}),
        ([frame(start_utc=AT_NOON), frame()], BY_RIG),
        ([], {"origin": "simulated", **BY_RIG}),
    ],
    ids=["no site", "one frame without a sun", "a simulated clock"],
)
def test_a_run_that_does_not_know_its_sun_leaves_the_scene_alone(scene, frames, session):
    assert seen(scene, *frames, **session) == (scene, ())


def test_a_scene_given_by_radiance_has_no_sun():
    panels = scene_of_file(load_scene(EXAMPLES / "scene-panels.toml"))
    assert seen(panels, **BY_RIG) == (panels, ())


def test_phi_is_kept_and_said_so(tmp_path):
    by_phi = SCENE.replace("azimuth_deg = 180.0\n", "", 1).replace("camera_azimuth_deg = 0.0", "phi_deg = 180")
    found, said = seen(scene_of_file(load_scene(written(tmp_path, by_phi))), **BY_RIG)
    assert found.geometry.phi_deg.value == 180.0
    assert any("phi_deg: kept as stated" in text for text in said)


def test_a_damaged_site_is_refused(tmp_path):
    damaged = {"rig": {"site": {"latitude_deg": 143.0, "longitude_deg": 0.0}}}
    with pytest.raises(DataError, match=r"session\.rig\.site\.latitude_deg"):
        RunWriter.create(tmp_path / "run", damaged)


def test_an_agreeing_run_needs_no_word(scene):
    same = frame(sun_azimuth_deg=180.0, sun_elevation_deg=40.0)
    assert seen(scene, same, replace(same, sequence=1))[1] == ()


def test_frames_without_a_date_keep_the_day_of_the_scene(scene):
    found, _ = seen(scene, frame(sun_azimuth_deg=170.0, sun_elevation_deg=60.0))
    assert found.sun.distance_factor == scene.sun.distance_factor


def test_a_number_that_the_run_states_as_exact_keeps_the_uncertainty_of_the_scene_file(tmp_path):
    text = SCENE.replace("camera_zenith_deg = 50.0", "camera_zenith_deg = { value = 50.0, std = 0.5 }")
    text = text.replace("zenith_deg = 50.0\nazimuth", "zenith_deg = { value = 50.0, std = 0.2 }\nazimuth")
    rig = {"geometry": {"camera_zenith_deg": 53.0, "camera_azimuth_deg": {"value": 0.0, "std": 2.0}}, "site": SITE}
    found, _ = seen(scene_of_file(load_scene(written(tmp_path, text))), rig=rig)
    assert (found.geometry.camera_zenith_deg.value, found.geometry.camera_zenith_deg.std) == (53.0, 0.5)
    assert found.geometry.camera_azimuth_deg.std == 2.0
    assert found.sun.zenith_deg.std == 0.2


def test_a_site_that_is_not_known_makes_the_sun_of_the_run_uncertain(scene):
    found, _ = seen(scene, rig={"site": SITE | {"latitude_deg": {"value": 43.085, "std": 0.5}}})
    # At noon the sun's zenith angle goes with the latitude.
    assert found.sun.zenith_deg.std == pytest.approx(0.5, rel=1e-3)


def test_a_distance_that_is_not_known_stays_so_on_the_day_of_the_run(tmp_path):
    text = SCENE.replace("day_of_year = 145", "distance_factor = { value = 1.0, std = 0.02 }")
    factor = seen(scene_of_file(load_scene(written(tmp_path, text))), **BY_RIG)[0].sun.distance_factor
    # 25 May: 0.9748 (NREL).
    assert (factor.value, factor.std) == (pytest.approx(0.9748, abs=1e-3), 0.02)


def test_angles_whose_errors_the_run_states_go_together_with_nothing(tmp_path):
    text = SCENE.replace("camera_zenith_deg = 50.0", "camera_zenith_deg = { value = 50.0, std = 1.0 }")
    text = text.replace("camera_azimuth_deg = 0.0", "camera_azimuth_deg = { value = 0.0, std = 2.0 }")
    text = text.replace('material = "black-paint"', 'material = "black-paint"\ntilt_deg = { value = 9.0, std = 1.0 }')
    names = ["geometry.camera_zenith_deg", "geometry.camera_azimuth_deg", "regions.paint.tilt_deg"]
    rows = [[1.0, 0.1, 0.7], [0.1, 1.0, 0.2], [0.7, 0.2, 1.0]]
    joint = f"[pointing]\nparameters = {names}\ncorrelation = {rows}\n"
    scene = scene_of_file(load_scene(written(tmp_path, text + joint)))
    exact = {"camera_zenith_deg": 50.0, "camera_azimuth_deg": {"value": 1.0, "std": 5.0}}
    found, said = seen(scene, rig={"geometry": exact})
    assert found.pointing.parameters == (names[0], names[2])
    assert found.pointing.correlation == ((1.0, 0.7), (0.7, 1.0))
    assert any("pointing: set aside for geometry.camera_azimuth_deg" in line for line in said)
    stated = exact | {"camera_zenith_deg": {"value": 50.0, "std": 0.5}}
    assert seen(scene, rig={"geometry": stated})[0].pointing is None


def test_the_uncertainty_of_the_rig_files_offset_is_an_input(tmp_path):
    (tmp_path / "scene.toml").write_text(scene_text())
    scene, draws = load_scene(tmp_path / "scene.toml"), np.random.default_rng(1)
    measurement = measure(take_run(tmp_path / "run", drawn_truth(draws), draws), regions=list(scene.regions))
    assert measurement.grid.frame_order.tolist() == [0, 2, 1, 3]
    session = measurement.run.session
    rig = replace(session.rig or RigAsTaken(), polarizer=replace(session.polarizer, offset_std_deg=0.3))
    measurement.frames.run = replace(measurement.run, session=replace(session, rig=rig))
    exact = scene.model_copy(update={"rig": type(scene.rig)()})
    found = run_predictor(measurement, scene_of_file(exact)).inputs
    place = found.names.index(OFFSET)
    assert found.cov[place, place] == pytest.approx(0.09)
    section = PolarizerSection.model_validate({"sense": 1, "offset_deg": {"value": 12.3, "std": 0.05}})
    assert (section.offset_deg, section.offset_std_deg) == (12.3, 0.05)
