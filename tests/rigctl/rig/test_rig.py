"""How a stage of a rig file is opened."""

import json
import tomllib
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from benchmarks.trials.kills import mislabelled
from drivers.errors import NotConnectedError
from rigctl.base.numbers import NS_PER_S
from rigctl.cli import main
from rigctl.errors import ConfigError, DataError
from rigctl.files.rig_file import RenderingSection, RigFile, StageSection, load_rig
from rigctl.files.scene_file import load_scene
from rigctl.files.toml import load
from rigctl.rig.rig import open_rig, open_stage
from rigctl.rig.roof import CLOUD_S, LitRoof, changed_roof, cloud_factor
from rigctl.rig.simulated_parts import FreshNoise, NoiseNumbers, number_after, rendering_effect, split_truth
from rigctl.rig.simulation import with_simulation
from rigctl.runs.folder import read_run
from rigctl.runs.records import RunEvent
from rigctl.runs.writer import RunWriter
from rigctl.scene.scene import get, scene_of_file
from rigctl.session.take import take_session
from rigctl.web.pictures import sharpness_of
from sim_devices.exposure import Detector, Lens
from sim_devices.truth_log import read_truth
from tests.rigctl.example_files import EXAMPLES, small_rig, small_session
from tests.sim_devices.camera_builders import small_camera

FAMILIES = {"ellx": "ELL14", "zaber": "Zaber 50931", "apt": "K10CR1"}


def section(driver: str = "ellx", *, port: str | None = None, **more: object) -> StageSection:
    given = {"driver": driver, "port": port or f"sim:{driver}?speed=50"} | more
    return StageSection.model_validate(given)


@pytest.mark.parametrize("driver", list(FAMILIES))
def test_every_family_is_opened_by_its_entry_point_and_its_simulated_address(driver: str) -> None:
    with open_stage(section(driver), warn=pytest.fail) as stage:
        assert stage.identify().model == FAMILIES[driver]


def test_a_missing_driver_is_refused_with_the_installed_drivers() -> None:
    with (
        pytest.raises(ConfigError, match=r"no driver 'newport'; installed are: .*apt.*ellx.*zaber"),
        open_stage(section("newport", port="sim:ellx"), warn=pytest.fail),
    ):
        pass


def test_options_reach_the_driver() -> None:
    port = "sim:zaber?cycle=0&speed=50"
    with open_stage(section("zaber", port=port, options={"steps_per_turn": 24000}), warn=pytest.fail) as stage:
        assert stage.identify().serial_number == "114821"


def test_an_unknown_option_of_a_driver_is_refused_with_the_known_ones() -> None:
    with (
        pytest.raises(ConfigError, match=r"driver 'ellx' has no option colour; it takes address, tolerance_deg"),
        open_stage(section(options={"colour": 3}), warn=pytest.fail),
    ):
        pass


def test_another_stage_than_the_rig_files_is_refused() -> None:
    with (
        pytest.raises(NotConnectedError, match="serial number 11401326, and the rig file asks for 99"),
        open_stage(section(serial_number="99"), warn=pytest.fail),
    ):
        pass


def test_a_numbered_port_is_warned_about() -> None:
    warnings: list[str] = []
    with pytest.raises(NotConnectedError), open_stage(section(port="/dev/ttyUSB99"), warn=warnings.append):
        pass
    assert "/dev/ttyUSB99" in warnings[0]


def characterisation(tmp_path: Path, **changes: object) -> Path:
    content = {
        "schema_version": 1,
        "kind": "stage characterisation",
        "stage": {"model": "ELL14", "serial_number": "11401326", "firmware": "18"},
        "settle_s": 0.05,
        "is_settled": True,
    } | changes
    path = tmp_path / "stage.json"
    path.write_text(json.dumps(content))
    return path


def test_a_characterised_stage_is_given_the_time_to_settle(tmp_path: Path) -> None:
    with open_stage(section(characterisation=characterisation(tmp_path)), warn=pytest.fail) as stage:
        stage.home()
        assert stage.move_to(10.0).duration_s >= 0.05


def test_the_characterisation_of_another_stage_is_refused(tmp_path: Path) -> None:
    other = characterisation(tmp_path, stage={"model": "ELL14", "serial_number": "7", "firmware": "18"})
    with (
        pytest.raises(NotConnectedError, match="characterise it too"),
        open_stage(section(characterisation=other), warn=pytest.fail),
    ):
        pass


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"is_settled": False}, "not seen to rest"),
        ({"settle_s": -1}, "settle_s"),
        ({"kind": "noise"}, "kind"),
    ],
)
def test_a_characterisation_that_is_of_no_use_is_refused(
    tmp_path: Path, changes: dict[str, object], problem: str
) -> None:
    path = characterisation(tmp_path, **changes)
    with pytest.raises(DataError, match=problem), open_stage(section(characterisation=path), warn=pytest.fail):
        pass


def test_a_characterisation_is_sought_beside_the_rig_file(tmp_path: Path) -> None:
    text = (EXAMPLES / "rig-sim.toml").read_text()
    rig = tmp_path / "rig.toml"
    rig.write_text(text.replace("tolerance_deg", 'characterisation = "stage.json"\ntolerance_deg', 1))
    assert load_rig(rig).stage.characterisation == (tmp_path / "stage.json").resolve()


@pytest.fixture
def lens_rig(tmp_path: Path) -> Path:
    """Return a rig file with its scene beside it."""
    (tmp_path / "rig.toml").write_text((EXAMPLES / "rig-sim.toml").read_text())
    (tmp_path / "scene-panels.toml").write_text((EXAMPLES / "scene-panels.toml").read_text())
    return tmp_path / "rig.toml"


def turn(lens_rig: Path, defocus_mm: float) -> int:
    return main(["sim", "lens", str(lens_rig), "--defocus-mm", str(defocus_mm)])


def test_a_running_camera_sees_the_lens_turned_and_its_sharpness_falls_away_from_the_focus(lens_rig: Path) -> None:
    seen = []
    with open_rig(load_rig(lens_rig), session_name="focus") as devices:
        devices.camera.configure(exposure_s=3e-5, gain_db=0.0)
        for defocus_mm in (-0.1, -0.03, 0.0, 0.03, 0.1):
            assert turn(lens_rig, defocus_mm) == 0
            seen.append(sharpness_of(devices.camera.take_frame(timeout_s=5.0).counts))
        lens_rig.write_text("half a file [")
        devices.camera.take_frame(timeout_s=5.0)
    assert int(np.argmax(seen)) == 2
    assert seen[0] < seen[1] < 0.9 * seen[2]
    assert seen[4] < seen[3] < 0.9 * seen[2]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_only_the_one_key_of_the_file_changes(lens_rig: Path, end: str, capsys: pytest.CaptureFixture[str]) -> None:
    before = lens_rig.read_bytes().replace(b"\n", end.encode())
    lens_rig.write_bytes(before)
    assert turn(lens_rig, 0.25) == 0
    assert turn(lens_rig, -0.5) == 0
    capsys.readouterr()
    assert main(["sim", "lens", str(lens_rig), "--defocus-mm", "0.0166", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["defocus_mm"], told["was_mm"]) == (0.0166, -0.5)
    assert told["blur_px"] == pytest.approx(1.0)
    added = f"defocus_mm = 0.0166{end}".encode()
    assert lens_rig.read_bytes().replace(added, b"") == before
    assert load_rig(lens_rig).simulation.camera.defocus_mm == 0.0166


def test_a_note_behind_the_number_stays(lens_rig: Path) -> None:
    lens_rig.write_text(
        lens_rig.read_text().replace("bit_depth = 12", "bit_depth = 12\ndefocus_mm = 0.2   # as it came")
    )
    assert turn(lens_rig, 1.0) == 0
    assert "defocus_mm = 1   # as it came\n" in lens_rig.read_text()


@pytest.mark.parametrize("defocus_mm", [5.1, -7.0, float("nan"), float("inf")])
def test_a_lens_is_not_turned_out_of_its_mount(lens_rig: Path, defocus_mm: float) -> None:
    before = lens_rig.read_bytes()
    assert turn(lens_rig, defocus_mm) == 2
    assert lens_rig.read_bytes() == before


def test_a_file_of_no_simulated_camera_is_refused(lens_rig: Path) -> None:
    text = lens_rig.read_text()
    lens_rig.write_text(
        text[: text.index("# What the simulated rig")]
        .replace("sim:ellx?speed=20", "/dev/x")
        .replace("sim:gc780", "gige:x")
    )
    assert turn(lens_rig, 0.1) == 2
    assert turn(lens_rig.with_name("none.toml"), 0.1) == 2


def test_the_option_is_taken_off_the_address(tmp_path):
    address, log = split_truth(f"sim:gige?lost=0.1&truth={tmp_path / 'truth.jsonl'}&retakes=2")
    assert address == "sim:gige?lost=0.1&retakes=2"
    assert log is not None
    assert split_truth("sim:gc780") == ("sim:gc780", None)


@pytest.mark.parametrize("tail", ["truth=", "truth=a&truth=b", "truth=/no/such/folder/truth.jsonl"])
def test_a_truth_that_cannot_be_written_is_refused(tail):
    with pytest.raises(ConfigError, match="truth="):
        split_truth(f"sim:gc780?{tail}")


def test_labels_are_the_truth_where_the_stage_lands_beside_its_target(tmp_path):
    rig_file = small_rig(tmp_path, port="sim:ellx?speed=50&landing=0.02")
    camera = rig_file.camera.model_copy(update={"address": f"sim:gc780?truth={tmp_path / 'truth.jsonl'}"})
    take_session(rig_file.model_copy(update={"camera": camera}), small_session(), tmp_path / "run", files={})
    run = read_run(tmp_path / "run")
    off = [r.polarizer_angle_deg - r.polarizer_angle_target_deg for r in run.frames if r.kind == "scene"]
    # The commands would not do as labels: some are off by more than the half step of the encoder that is allowed.
    assert max(abs((value + 90) % 180 - 90) for value in off) > 0.003
    assert mislabelled(run, read_truth(tmp_path / "truth.jsonl")) == []


@pytest.fixture
def run(tmp_path):
    """A session of a simulated rig, whole."""
    take_session(small_rig(tmp_path), small_session(), tmp_path / "run", files={})
    return tmp_path / "run"


def metered(next_camera_frame):
    return RunEvent(event="metered", facts={"round": 0, "exposure_s": 0.01, "next_camera_frame": next_camera_frame})


def test_steps_that_are_left_out_use_up_their_numbers():
    camera = small_camera()
    noise = NoiseNumbers(camera, None)
    assert not noise.begin_step(0)
    camera.take_frame(timeout_s=1.0)
    assert not noise.begin_step(1)
    camera.take_frame(timeout_s=1.0)
    assert noise.begin_step(5)
    assert camera.next_sequence == 5


def test_a_run_that_is_not_there_yet_begins_with_the_first_number(tmp_path):
    camera = small_camera()
    assert not NoiseNumbers(camera, tmp_path / "none").begin_step(3)
    assert camera.next_sequence == 0


def test_a_step_that_is_taken_again_has_its_number_again(run):
    camera = small_camera()
    assert NoiseNumbers(camera, run).begin_step(3)
    assert camera.next_sequence == read_run(run).frames[3].camera_frame


def test_numbers_that_metering_used_up_are_not_used_again(run):
    frames = read_run(run).frames
    assert number_after(frames, [], 4) == 4
    assert number_after(frames, [metered(None), metered(9)], 4) == 9
    assert number_after([], [metered(9)], 0) == 9


def test_noise_over_the_network_is_drawn_anew_after_each_beginning(run):
    first, second = small_camera(), small_camera()
    assert not FreshNoise(first, run).begin_step(2)
    assert first.next_sequence == 0
    with RunWriter.append(run) as writer:
        writer.event("resumed")
    noise = FreshNoise(second, run)
    assert not noise.begin_step(2)
    begun = second.next_sequence
    assert begun > 1_000_000
    noise.begin_step(3)
    assert second.next_sequence == begun


TABLES = """
effects = [
  { effect = "point-spread", sigma_px = 0.8 },
  { effect = "vignetting" },
  { effect = "fixed-pattern", column_offset_e = 2.0 },
  { effect = "drift", rate_per_frame = 1e-4, flicker_std = 1e-3 },
  { effect = "beam-wander", radius_px = 0.3 },
  { effect = "smear", row_transfer_us = 0.1 },
  { effect = "cosmic-hits", rate_per_s = 1.0, mean_e = 500.0 },
]
"""


def rig_with(tmp_path, effects):
    text = (EXAMPLES / "rig-sim.toml").read_text(encoding="utf-8")
    path = tmp_path / "rig.toml"
    path.write_text(text.replace("flat_radiance = 60.0", f"flat_radiance = 60.0\n{effects}\n#"), encoding="utf-8")
    return path


@pytest.mark.parametrize("index", range(7))
def test_each_table_makes_the_effect_of_its_name(index):
    table = tomllib.loads(TABLES)["effects"][index]
    section = TypeAdapter(RenderingSection).validate_python(table)
    detector = Detector(width=8, height=6)
    assert rendering_effect(section, lens=Lens(), detector=detector, pattern_seed=1).name == table["effect"]


def test_rig_file_names_its_effects_in_order(tmp_path):
    rig = load(rig_with(tmp_path, TABLES), RigFile)
    assert [section.effect for section in rig.simulation.effects][:3] == ["point-spread", "vignetting", "fixed-pattern"]


def test_effect_named_twice_is_refused(tmp_path):
    path = rig_with(tmp_path, 'effects = [{ effect = "vignetting" }, { effect = "vignetting" }]')
    with pytest.raises(ConfigError, match="names vignetting more than once"):
        load(path, RigFile)


def test_unknown_effect_is_refused_with_those_there_are(tmp_path):
    with pytest.raises(ConfigError, match="point-spread"):
        load(rig_with(tmp_path, 'effects = [{ effect = "coma" }]'), RigFile)


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
