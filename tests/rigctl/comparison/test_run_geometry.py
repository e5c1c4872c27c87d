from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.comparison.predict_run import scene_of_run
from rigctl.errors import DataError
from rigctl.files.scene_file import load_scene
from rigctl.runs.folder import Run
from rigctl.runs.records import FrameRecord, session_record
from rigctl.runs.writer import RunWriter
from rigctl.scene.reading import scene_of_file
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.scene_texts import SCENE, written

SITE = {"latitude_deg": 43.085, "longitude_deg": -77.68, "elevation_m": 168.0}
AT_NOON = "2010-05-25T17:07:40.000000000Z"


@pytest.fixture
def scene(tmp_path):
    return scene_of_file(load_scene(written(tmp_path)))


def run_of(*, origin="device", **session):
    content = {"origin": origin} | session
    return Run(
        path=Path("run"),
        session=session_record(content),
        session_json=content,
        frames=(),
        created_by="test",
        created_utc=AT_NOON,
    )


def frame(**facts):
    return FrameRecord(kind="scene", sequence=0, bit_depth=12, saturation_dn=4095.0, **facts)


def test_the_sun_of_time_and_site_wins(scene):
    found, said = scene_of_run(scene, run_of(rig={"site": SITE}), [frame(start_utc=AT_NOON)])
    assert found.sun.zenith_deg.value == pytest.approx(22.067, abs=0.01)
    # The ephemeris of the moment; the day alone is within 1e-3 of it.
    assert found.sun.distance_factor.value == pytest.approx(0.974729, abs=1e-5)
    assert "sun.zenith_deg: 22.07 of the run, not 50.00 of the scene file" in said


def test_the_site_may_stand_in_the_session(scene):
    found, _ = scene_of_run(scene, run_of(session={"site": SITE}), [frame(start_utc=AT_NOON)])
    assert found.sun.zenith_deg.value == pytest.approx(22.067, abs=0.01)


def test_the_sun_that_the_frames_recorded_wins_over_a_computed_one(scene):
    recorded = frame(start_utc=AT_NOON, sun_azimuth_deg=170.0, sun_elevation_deg=60.0)
    found, said = scene_of_run(scene, run_of(rig={"site": SITE}), [recorded])
    assert found.sun.zenith_deg.value == pytest.approx(30.0)
    assert found.sun.azimuth_deg.value == pytest.approx(170.0)
    assert len(said) == 2


def test_frames_share_a_mean_sun(scene):
    frames = [frame(sun_azimuth_deg=azimuth, sun_elevation_deg=45.0) for azimuth in (359.0, 1.0)]
    found, _ = scene_of_run(scene, run_of(), frames)
    assert found.sun.azimuth_deg.value == pytest.approx(0.0, abs=1e-9) or found.sun.azimuth_deg.value == pytest.approx(
        360.0
    )


def test_the_cameras_place_in_the_rig_file_wins(scene):
    rig = {"geometry": {"camera_zenith_deg": 53.0, "camera_azimuth_deg": 0.0, "camera_roll_deg": 1.5}}
    found, said = scene_of_run(scene, run_of(rig=rig), [frame()])
    assert found.geometry.camera_zenith_deg.value == 53.0
    assert "geometry.camera_zenith_deg: 53.00 of the run, not 50.00 of the scene file" in said
    assert "geometry.camera_roll_deg: 1.50 of the run, not 0.00 of the scene file" in said
    assert len(said) == 2


def test_a_run_that_says_nothing_leaves_the_scene_alone(scene):
    assert scene_of_run(scene, run_of(rig={"site": None}), [frame()]) == (scene, ())


def test_one_frame_without_a_sun_leaves_the_scene_alone(scene):
    frames = [frame(start_utc=AT_NOON), frame()]
    assert scene_of_run(scene, run_of(rig={"site": SITE}), frames) == (scene, ())


def test_a_simulated_clock_says_nothing_of_the_sun(scene):
    assert scene_of_run(scene, run_of(origin="simulated", rig={"site": SITE}), [frame(start_utc=AT_NOON)])[1] == ()


def test_a_scene_given_by_radiance_has_no_sun(scene):
    panels = scene_of_file(load_scene(EXAMPLES / "scene-panels.toml"))
    assert scene_of_run(panels, run_of(rig={"site": SITE}), [frame(start_utc=AT_NOON)]) == (panels, ())


def test_phi_is_kept_and_said_so(tmp_path):
    by_phi = SCENE.replace("azimuth_deg = 180.0\n", "", 1).replace("camera_azimuth_deg = 0.0", "phi_deg = 180")
    scene = scene_of_file(load_scene(written(tmp_path, by_phi)))
    found, said = scene_of_run(scene, run_of(rig={"site": SITE}), [frame(start_utc=AT_NOON)])
    assert found.geometry.phi_deg.value == 180.0
    assert any("phi_deg: kept as stated" in text for text in said)


def test_a_damaged_site_is_refused(tmp_path):
    damaged = {"rig": {"site": {"latitude_deg": 143.0, "longitude_deg": 0.0}}}
    with pytest.raises(DataError, match=r"session\.rig\.site\.latitude_deg"):
        RunWriter.create(tmp_path / "run", damaged)


def test_an_agreeing_run_needs_no_word(scene):
    same = frame(sun_azimuth_deg=180.0, sun_elevation_deg=40.0)
    _, said = scene_of_run(scene, run_of(), [same, replace(same, sequence=1)])
    assert said == ()


def test_frames_without_a_date_keep_the_day_of_the_scene(scene):
    found, _ = scene_of_run(scene, run_of(), [frame(sun_azimuth_deg=170.0, sun_elevation_deg=60.0)])
    assert found.sun.distance_factor == scene.sun.distance_factor


def test_a_number_that_the_run_states_as_exact_keeps_the_uncertainty_of_the_scene_file(tmp_path):
    told = SCENE.replace("camera_zenith_deg = 50.0", "camera_zenith_deg = { value = 50.0, std = 0.5 }").replace(
        "zenith_deg = 50.0\nazimuth", "zenith_deg = { value = 50.0, std = 0.2 }\nazimuth"
    )
    rig = {"geometry": {"camera_zenith_deg": 53.0, "camera_azimuth_deg": {"value": 0.0, "std": 2.0}}, "site": SITE}
    found, _ = scene_of_run(
        scene_of_file(load_scene(written(tmp_path, told))), run_of(rig=rig), [frame(start_utc=AT_NOON)]
    )
    assert (found.geometry.camera_zenith_deg.value, found.geometry.camera_zenith_deg.std) == (53.0, 0.5)
    assert found.geometry.camera_azimuth_deg.std == 2.0
    assert found.sun.zenith_deg.std == 0.2


def test_a_site_that_is_not_known_makes_the_sun_of_the_run_uncertain(scene):
    site = SITE | {"latitude_deg": {"value": 43.085, "std": 0.5}}
    found, _ = scene_of_run(scene, run_of(rig={"site": site}), [frame(start_utc=AT_NOON)])
    # At noon the sun's zenith angle goes with the latitude.
    assert found.sun.zenith_deg.std == pytest.approx(0.5, rel=1e-3)


def test_a_distance_that_is_not_known_stays_so_on_the_day_of_the_run(tmp_path):
    told = SCENE.replace("day_of_year = 145", "distance_factor = { value = 1.0, std = 0.02 }")
    found, _ = scene_of_run(
        scene_of_file(load_scene(written(tmp_path, told))), run_of(rig={"site": SITE}), [frame(start_utc=AT_NOON)]
    )
    # 25 May: 0.9748 (NREL).
    assert found.sun.distance_factor.value == pytest.approx(0.9748, abs=1e-3)
    assert found.sun.distance_factor.std == 0.02


def test_angles_whose_errors_the_run_states_go_together_with_nothing(tmp_path):
    text = SCENE.replace("camera_zenith_deg = 50.0", "camera_zenith_deg = { value = 50.0, std = 1.0 }")
    text = text.replace("camera_azimuth_deg = 0.0", "camera_azimuth_deg = { value = 0.0, std = 2.0 }")
    text = text.replace('material = "black-paint"', 'material = "black-paint"\ntilt_deg = { value = 9.0, std = 1.0 }')
    names = ["geometry.camera_zenith_deg", "geometry.camera_azimuth_deg", "regions.paint.tilt_deg"]
    rows = [[1.0, 0.1, 0.7], [0.1, 1.0, 0.2], [0.7, 0.2, 1.0]]
    joint = f"[pointing]\nparameters = {names}\ncorrelation = {rows}\n"
    scene = scene_of_file(load_scene(written(tmp_path, text + joint)))
    exact = {"camera_zenith_deg": 50.0, "camera_azimuth_deg": {"value": 1.0, "std": 5.0}}
    found, said = scene_of_run(scene, run_of(rig={"geometry": exact}), [frame(start_utc=AT_NOON)])
    assert found.pointing.parameters == (names[0], names[2])
    assert found.pointing.correlation == ((1.0, 0.7), (0.7, 1.0))
    assert any("pointing: set aside for geometry.camera_azimuth_deg" in line for line in said)
    stated = {"camera_zenith_deg": {"value": 50.0, "std": 0.5}, "camera_azimuth_deg": {"value": 1.0, "std": 5.0}}
    found, _ = scene_of_run(scene, run_of(rig={"geometry": stated}), [frame(start_utc=AT_NOON)])
    assert found.pointing is None
