"""``rigctl calibrate pointing`` and ``calibrate lens``: from a run and what somebody measured to the scene file."""

import json

import cv2
import numpy as np
import pandas as pd
import pytest
from pvlib import solarposition

from benchmarks.trials.pointing import panel_corners, seen
from calibration.pointing.pose import Lens, camera_axes, direction
from rigctl import cli
from rigctl.errors import ConfigError, DataError
from rigctl.files.scene_file import load_scene
from rigctl.verbs.pointing import pointing
from tests.calibration.pointing.test_pointing import STANDS, _board
from tests.docs.blocks import ROOT
from tests.rigctl.made_runs import at, make_run

# The rooftop of [MK14]: Rochester, NY.
SITE = {"latitude_deg": 43.08, "longitude_deg": -77.67, "elevation_m": 160.0}
UTC = "2010-05-25T17:07:40Z"
LENS = Lens(parameters=np.array([900.0, 900.0, 159.5, 119.5, 0.0, 0.0, 0.0, 0.0]), covariance=np.zeros((8, 8)))
FOCAL = "900 +- 0.001"


@pytest.fixture
def run(tmp_path):
    facts = {f"site_{name}": value for name, value in SITE.items()} | {"start_utc": UTC}
    session = {"origin": "import", "session": {"site": SITE}}
    make_run(tmp_path / "run", [(at(0.0, **facts), np.zeros((240, 320)))], session=session)
    return tmp_path / "run"


def _pvlib_sun():
    times = pd.DatetimeIndex([UTC])
    found = solarposition.spa_python(times, SITE["latitude_deg"], SITE["longitude_deg"], altitude=SITE["elevation_m"])
    return float(found["azimuth"].iloc[0]), float(found["apparent_elevation"].iloc[0])


def test_the_azimuth_by_the_sun_is_that_of_another_almanac(run):
    azimuth_deg, elevation_deg = _pvlib_sun()
    looks = np.radians([azimuth_deg + 4.0, elevation_deg - 3.0, 0.5])
    sun = direction(np.radians(azimuth_deg), np.radians(elevation_deg))
    x, y = seen(sun[None, :], looks, LENS)[0]
    found = pointing(
        run,
        focal_px="900 +- 1",
        sun=f"{x},{y}",
        level=f"{np.degrees(looks[1])},{np.degrees(looks[2])} +- 0.05",
        pixel_std=0.3,
    )
    off_deg = np.degrees(found.pose.angles_rad[0] - looks[0])
    assert abs(off_deg) < 2.0 * np.degrees(found.pose.std_rad[0])
    # The axis of a lens without a calibration lies within 3.2 pixels of the middle: 0.2 deg, over the cosine of 65 deg.
    assert np.degrees(found.pose.std_rad[0]) < 1.0
    assert found.sun_deg == pytest.approx((azimuth_deg, elevation_deg), abs=0.01)


def _seen_in(run, looks_deg, **more):
    return pointing(run, focal_px=FOCAL, **more), np.radians(looks_deg)


def test_compass_level_and_outlines_tell_everything(run, tmp_path):
    looks = np.radians([140.0, -40.0, 2.0])
    forward = camera_axes(looks)[2]
    leaning = panel_corners(19.0 * forward, np.radians(30.0), np.radians(320.0), 1.0, np.array([2.0, 1.5]))
    outlines = tmp_path / "outlines.toml"
    corners = np.round(seen(leaning, looks, LENS), 4).tolist()
    outlines.write_text(f'[[regions]]\nname = "black"\npolygon = {corners}\n')
    found = pointing(
        run,
        focal_px="900 +- 1",
        compass="145 +- 1",
        declination="5 W +- 0.3",
        level="-40,2 +- 0.2",
        outlines=outlines,
        panel=("black=2x1.5",),
        pixel_std=0.05,
    )
    geometry = found.geometry
    assert geometry["camera_azimuth_deg"][0] == pytest.approx(320.0, abs=3.0 * geometry["camera_azimuth_deg"][1])
    assert geometry["camera_zenith_deg"][0] == pytest.approx(50.0, abs=3.0 * geometry["camera_zenith_deg"][1])
    tilt = found.regions["black"]
    assert tilt["tilt_deg"][0] == pytest.approx(30.0, abs=4.0 * tilt["tilt_deg"][1])
    assert tilt["tilt_azimuth_deg"][0] == pytest.approx(320.0, abs=4.0 * tilt["tilt_azimuth_deg"][1])
    assert max(one[1] for one in (*geometry.values(), *tilt.values())) < 2.0
    names, covariance = found.joint
    assert names[:2] == ("geometry.camera_azimuth_deg", "geometry.camera_zenith_deg")
    assert np.sqrt(np.diag(covariance))[[0, 3]] == pytest.approx([geometry[names[0][9:]][1], tilt["tilt_deg"][1]])
    # The panel leans whereto the camera's azimuth says.
    together = dict(zip(found.pointing.parameters, found.pointing.correlation[0], strict=True))
    assert together["regions.black.tilt_azimuth_deg"] > 0.5


def test_angles_are_written_into_the_scene_with_their_errors(run, tmp_path, capsys):
    scene = tmp_path / "scene.toml"
    text = (ROOT / "examples/scene-rooftop-noon.toml").read_text()
    scene.write_text(text)
    options = ["--compass", "171 +- 2", "--declination", "-11.3 +- 0.3", "--level", "-35,0.4 +- 0.3"]
    assert cli.main(["calibrate", "pointing", str(run), *options, "--write", str(scene), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    geometry = load_scene(scene).geometry
    assert geometry.camera_azimuth_deg.value == pytest.approx(339.7, abs=1e-3)
    assert geometry.camera_azimuth_deg.std == pytest.approx(np.hypot(2.0, 0.3), abs=1e-3)
    assert (geometry.camera_zenith_deg.value, geometry.camera_zenith_deg.std) == pytest.approx((55.0, 0.3), abs=1e-3)
    assert geometry.phi_deg is None
    assert told["geometry"]["camera_roll_deg"]["value"] == pytest.approx(0.4, abs=1e-3)
    kept = [line for line in text.splitlines() if line.strip().startswith("#")]
    assert all(line in scene.read_text() for line in kept)
    assert "[pointing]" not in scene.read_text()  # a compass and a level have no error in common
    assert cli.main(["calibrate", "pointing", str(run), *options, "--write", str(scene)]) == 0


def test_errors_that_go_together_are_written_once(run, tmp_path):
    scene, looks = tmp_path / "scene.toml", np.radians([180.0, -37.0, 1.0])
    text = (ROOT / "examples/scene-rooftop-noon.toml").read_text()
    forward = camera_axes(looks)[2]
    leaning = panel_corners(19.0 * forward, np.radians(30.0), np.radians(10.0), 1.0, np.array([2.0, 1.5]))
    polygon = f"polygon = {np.round(seen(leaning, looks, LENS), 4).tolist()}"
    scene.write_text(text.replace("rectangle = { x = 70, y = 190, width = 150, height = 130 }", polygon))
    request = {
        "focal_px": "900 +- 1",
        "compass": "180 +- 2",
        "declination": "0.5 E +- 0.1",
        "level": "-37,1 +- 0.3",
        "outlines": scene,
        "panel": ("black_panel=2x1.5",),
        "pixel_std": 0.05,
        "write": scene,
    }
    first = pointing(run, **request)
    found = load_scene(scene).pointing
    assert found == first.pointing
    assert found.parameters[-1] == "regions.black_panel.tilt_azimuth_deg"
    assert found.correlation[0][-1] > 0.95
    assert not pointing(run, **request).changes
    assert scene.read_text().count("[pointing]") == 1
    once = scene.read_text()
    assert all(line in once for line in text.splitlines() if line.startswith("#"))
    pointing(run, compass="180 +- 2", declination="0.5E +- 0.1", write=scene)
    assert load_scene(scene).pointing is None


def test_contradicting_sources_are_said(run, capsys):
    places = ["--camera-at", "43.08,-77.67,180 +- 0.5", "--target-at", "43.081,-77.67,160 +- 0.5"]
    options = ["--compass", "40 +- 2", "--declination", "0 +- 0.1", "--level", "-10,0 +- 0.3"]
    assert cli.main(["calibrate", "pointing", str(run), *options, *places]) == 0
    assert "compass contradicts the other sources" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({}, "no source gives the direction of the camera"),
        ({"compass": "10 +- 1"}, "give both"),
        ({"compass": "10", "declination": "1 +- 1"}, "--compass: is '10'; write 1 number and an error"),
        ({"compass": "nan +- 1", "declination": "1 +- 1"}, "--compass"),
        ({"level": "1 +- 1"}, "--level: is '1 .- 1'; write 2 numbers"),
        ({"level": "95,0 +- 1"}, "95 is not between -90 and 90"),
        ({"compass": "10 +- 1", "declination": "-3 W +- 1"}, "not both"),
        ({"compass": "10 +- 1", "declination": "200 +- 1"}, "200 is not between"),
        ({"sun": "400,10", "focal_px": FOCAL}, "400,10 is outside of the pictures, which have 320 x 240"),
        ({"panel": ("a=1.2.3x1",), "outlines": ROOT / "examples/regions.toml"}, "--panel: is 'a=1.2.3x1'"),
        ({"sun": "10,10"}, "--lens: directions of pixels need a lens"),
        ({"sun": "10", "focal_px": FOCAL}, "--sun: is '10'; write two numbers"),
        ({"panel": ("a=1x1",)}, "--outlines FILE"),
        ({"camera_at": "1,1,1 +- 1"}, "give both"),
        ({"camera_at": "1,1,1 +- 1", "target_at": "1,1,1 +- 1"}, "closer to each other than their errors"),
    ],
)
def test_what_is_not_enough_is_refused(run, more, said):
    with pytest.raises(ConfigError, match=said):
        pointing(run, **more)


def test_sources_that_exclude_one_another_are_said_where_none_can_be_named(run, capsys):
    # The sun stands 67 deg high and in the picture of a camera that looks down, says the level.
    options = ["--sun", "160,120", "--focal-px", FOCAL, "--level", "-35,0 +- 0.3"]
    assert cli.main(["calibrate", "pointing", str(run), *options]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "level and sun in the picture contradict one another" in said


def test_a_compass_may_lie_west_of_north(run):
    looks = [
        pointing(run, compass="171 \u00b1 2", declination=text).pose.angles_rad[0]
        for text in ("-11.3 +- 0.3", "11.3 W +/- 0.3", "11.3w +- 0.3")
    ]
    assert np.degrees(looks) == pytest.approx(159.7)


def test_places_on_either_side_of_the_date_line_are_near(run):
    found = pointing(run, camera_at="10,179.9999,20 +- 0.1", target_at="10,-179.9999,20 +- 0.1")
    assert np.degrees(found.pose.angles_rad[0]) == pytest.approx(90.0)


def test_what_a_long_run_moves_the_sun_is_in_its_error(tmp_path):
    site = {f"site_{name}": value for name, value in SITE.items()}
    frames = [(at(0.0, **site, start_utc=f"2010-05-25T{hour}:07:40Z"), np.zeros((240, 320))) for hour in (16, 17)]
    make_run(tmp_path / "long", frames)
    of_run = pointing(tmp_path / "long", sun="160,120", focal_px=FOCAL)
    of_moment = pointing(tmp_path / "long", sun="160,120", focal_px=FOCAL, at="2010-05-25T16:37:40Z")
    assert of_run.sun_deg == pytest.approx(of_moment.sun_deg)
    # 14 deg in an hour at 23 deg from the pole of its path: 4 deg, of a rectangular law.
    assert np.degrees(of_run.pose.std_rad[1]) > 2.0 > np.degrees(of_moment.pose.std_rad[1])


def test_a_run_without_site_has_no_sun(tmp_path):
    make_run(tmp_path / "r", [(at(0.0, start_utc=UTC), np.zeros((4, 4)))])
    with pytest.raises(DataError, match="has no site"):
        pointing(tmp_path / "r", sun="1,1", focal_px=FOCAL)


def test_a_lens_from_pictures_is_for_pictures_of_its_size(run, tmp_path, capsys):
    pictures = []
    for place, stand in enumerate(STANDS):
        pictures.append(str(tmp_path / f"board-{place}.png"))
        cv2.imwrite(pictures[-1], _board(LENS, stand, (0.0, 0.01, 0.8)))
    out = tmp_path / "lens.json"
    board = ["--board", "7x5", "--square-mm", "30", "--out", str(out)]
    assert cli.main(["calibrate", "lens", *pictures, *board]) == 0
    assert "5 pictures, corners" in capsys.readouterr().out
    request = {"lens": out, "sun": "100,100", "level": "60,0 +- 0.5"}
    assert np.isfinite(pointing(run, **request).pose.std_rad).all()
    out.write_text(json.dumps(json.loads(out.read_text()) | {"width": 640}))
    with pytest.raises(DataError, match="is for pictures of 640 x 240 pixels"):
        pointing(run, **request)
    assert cli.main(["calibrate", "lens", *pictures[:1], *board[:4], "--out", str(tmp_path / "x.json")]) == 4
    assert (
        cli.main(
            ["calibrate", "lens", *pictures, "--square-mm", "30", "--out", str(tmp_path / "x.json"), "--board", "7"]
        )
        == 2
    )
