"""Sessions of a simulated camera with polarizers on its pixels: one exposure, four frames, no stage."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.interfaces import CameraSettings, DeviceIdentity, Frame
from rigctl.calibrations.noise_frames import run_frames
from rigctl.comparison.compare import Comparison, compare_with_scene
from rigctl.errors import ConfigError, DataError
from rigctl.files.rig_file import RigFile, load_rig
from rigctl.files.scene_file import load_scene
from rigctl.files.session_file import SessionFile
from rigctl.measure.diagnose import measure_run
from rigctl.measure.measure import measure
from rigctl.rig.checkup import RigCheckup
from rigctl.rig.rig import Rig, open_rig, require_cell
from rigctl.runs.check import repair_run
from rigctl.runs.folder import Run, read_run
from rigctl.runs.records import FrameRecord
from rigctl.scene.scene import scene_of_file
from rigctl.session.take import resume_session, take_session
from rigctl.verbs.verify import verification_of
from rigctl.web.rig import REST, LiveRig, Task
from tests.rigctl.example_files import EXAMPLES, SMALL_SCENE
from tests.rigctl.session.made_rig import events_of

REAL_DATA = os.environ.get("RIGCTL_REAL_DATA")
TAKES = [
    {"kind": "dark", "exposure_ms": 0.03, "cycles": 2},
    {"kind": "flat", "exposure_ms": 0.03, "cycles": 2},
    {"kind": "scene", "exposure_ms": 0.03, "cycles": 3},
]


def mosaic_rig(folder: Path, *, options: str = "", interpolation: str = "none", cell=(90, 45, 135, 0)) -> RigFile:
    """Return the example rig with frames of 96 x 48 pixels."""
    (folder / "scene.toml").write_text(SMALL_SCENE)
    text = (EXAMPLES / "rig-mosaic.toml").read_text()
    width, height = (192, 96) if interpolation == "none" else (96, 48)
    for before, after in (
        ('"scene-panels.toml"', f'"{folder / "scene.toml"}"'),
        ('"sim:mosaic"', f'"sim:mosaic{options}"'),
        ("[90, 45, 135, 0]", str(list(cell))),
        ('interpolation = "none"', f'interpolation = "{interpolation}"'),
        ("width = 1564", f"width = {width}"),
        ("height = 1164", f"height = {height}"),
    ):
        assert before in text
        text = text.replace(before, after, 1)
    (folder / "rig.toml").write_text(text)
    return load_rig(folder / "rig.toml")


def mosaic_session(**changes) -> SessionFile:
    return SessionFile.model_validate({"name": "mosaic", "take": TAKES, **changes})


def taken(folder: Path, rig: RigFile, session: SessionFile | None = None) -> Run:
    take_session(rig, session or mosaic_session(), folder / "run", files={})
    return read_run(folder / "run")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("mosaic")
    return taken(folder, mosaic_rig(folder))


def exposures(run: Run) -> list[list[FrameRecord]]:
    by_id: dict[int, list[FrameRecord]] = {}
    for record in run.frames:
        assert record.exposure_id is not None
        by_id.setdefault(record.exposure_id, []).append(record)
    return list(by_id.values())


def test_four_frames_are_one_exposure(run: Run) -> None:
    found = exposures(run)
    assert [len(parts) for parts in found] == [4] * 7
    for parts in found:
        assert len({(one.start_utc, one.start_monotonic_ns, one.camera_frame, one.cycle) for one in parts}) == 1
        assert [one.polarizer_angle_deg for one in parts] == [90.0, 45.0, 135.0, 0.0]
        assert {(one.width, one.height, one.stage_angle_deg, one.stage_model) for one in parts} == {
            (96, 48, None, None)
        }
    assert len({parts[0].start_utc for parts in found}) == 7
    assert verification_of(run.path).state == "whole"
    assert "homed" not in [event["event"] for event in events_of(run.path)]


def compared(run: Run) -> Comparison:
    scene = load_scene(run.path.parent / "scene.toml")
    return compare_with_scene(measure_run(run, list(scene.regions)), scene_of_file(scene), alpha=0.001)


def test_model_and_samples_agree(run: Run) -> None:
    found = compared(run)
    assert found.agrees
    assert {row.quantity for row in found.rows if row.statistic == "std"} == {"dn_0", "dn_45", "dn_90", "dn_135"}
    assert any("pixels of its own" in text for text in found.not_tested)


def test_model_and_interpolated_pictures_agree_in_noise_too(tmp_path: Path) -> None:
    run = taken(tmp_path, mosaic_rig(tmp_path, interpolation="bilinear"))
    assert {(one.width, one.height) for one in run.frames} == {(96, 48)}
    found = compared(run)
    assert found.agrees
    temporal = [row for row in found.rows if row.statistic == "std_temporal"]
    assert len(temporal) == 14
    assert np.sqrt(np.mean([(row.z or 0.0) ** 2 for row in temporal])) < 2.0
    assert np.mean([row.measured / row.predicted for row in temporal]) == pytest.approx(1.0, abs=0.02)


def test_frames_for_a_calibration_are_pictures_of_the_whole_sensor(run: Run) -> None:
    groups = {group.kind: group for group in run_frames(run.path).groups}
    assert {kind: len(group.loaders) for kind, group in groups.items()} == {"dark": 2, "flat": 2}
    picture = groups["flat"].loaders[0]()
    first = next(record for record in run.frames if record.kind == "flat")
    assert picture.shape == (96, 192)
    np.testing.assert_array_equal(picture[::2, ::2], run.counts(first))


def test_interpolated_frames_make_no_calibration(tmp_path: Path) -> None:
    run = taken(tmp_path, mosaic_rig(tmp_path, interpolation="bilinear"), mosaic_session(take=TAKES[:1]))
    with pytest.raises(DataError, match="share their noise"):
        run_frames(run.path)


def test_an_exposure_that_is_not_whole_is_taken_again(run: Run, tmp_path: Path) -> None:
    rig = mosaic_rig(tmp_path)
    again = taken(tmp_path, rig)
    lost = again.frames[-2]
    (again.path / lost.file).unlink()
    repair = repair_run(again.path)
    assert [len(parts) for parts in exposures(read_run(again.path))] == [4] * 6
    assert len(repair.set_aside) == 4
    assert resume_session(again.path).frames == 28
    resumed = read_run(again.path)
    assert [len(parts) for parts in exposures(resumed)] == [4] * 7
    assert verification_of(again.path).state == "whole"
    for before, after in zip(run.frames, resumed.frames, strict=True):
        np.testing.assert_array_equal(run.counts(before), resumed.counts(after))


def test_light_that_contradicts_the_cell_stops_the_session(tmp_path: Path) -> None:
    rig = mosaic_rig(tmp_path, options="?cell=45,90,135,0")
    session = mosaic_session(take=TAKES[2:])
    with pytest.raises(DataError, match=r"does not fit the light.*lower left"):
        take_session(rig, session, tmp_path / "run", files={})
    noted = session.model_copy(update={"interlocks": session.interlocks.model_copy(update={"cell": "note"})})
    take_session(rig, noted, tmp_path / "noted", files={})
    assert "cell" in [event.get("facts", {}).get("interlock") for event in events_of(tmp_path / "noted")]
    found = {finding.what: finding for finding in RigCheckup(rig, frames=1).findings()}
    assert "does not fit the light" in (found["cell"].advice or "")


def test_a_camera_that_tells_its_cell_is_asked(tmp_path: Path) -> None:
    rig = mosaic_rig(tmp_path)
    with open_rig(rig, session_name="facts") as opened:
        told = replace(opened.camera.facts(), mosaic_deg=(0.0, 45.0, 135.0, 90.0))

    class _Telling:
        def facts(self):
            return told

    with pytest.raises(ConfigError, match=r"says that its cell is \[0, 45, 135, 90\]"):
        require_cell(rig, _Telling())
    stageless = rig.model_copy(update={"camera": rig.camera.model_copy(update={"mosaic_deg": None})})
    with pytest.raises(ConfigError, match=r"state mosaic_deg = \[0, 45, 135, 90\]"):
        require_cell(stageless, _Telling())


def dolp_of(run: Run) -> float:
    scene = load_scene(run.path.parent / "scene.toml")
    return measure(run, regions=list(scene.regions)).regions["left"].quantities["dolp"]["mean"].value


def test_crosstalk_takes_polarization_away_and_turned_polarizers_turn_it(run: Run, tmp_path: Path) -> None:
    session = mosaic_session(take=[TAKES[0], TAKES[2]])
    (tmp_path / "leaks").mkdir()
    leaks = taken(tmp_path / "leaks", mosaic_rig(tmp_path / "leaks", options="?crosstalk=0.02"), session)
    # Of each pixel 0.92 is its own; in light of S1 and S2 its neighbours have the other angles, 4 * 0.02 of it.
    assert dolp_of(leaks) == pytest.approx(0.92 * dolp_of(run), rel=0.01)
    (tmp_path / "turned").mkdir()
    rig = mosaic_rig(tmp_path / "turned", options="?cell=93,48,138,3", cell=(93, 48, 138, 3))
    turned = taken(tmp_path / "turned", rig, session)
    assert [record.polarizer_angle_target_deg for record in turned.frames[:4]] == [90.0, 45.0, 135.0, 0.0]
    assert [record.polarizer_angle_deg for record in turned.frames[:4]] == [93.0, 48.0, 138.0, 3.0]
    assert dolp_of(turned) == pytest.approx(dolp_of(run), rel=0.01)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"angles_deg": [0, 60, 120]}, "leave angles_deg out"),
        ({"closing_repeat": True}, "one exposure"),
    ],
)
def test_takes_that_a_cell_cannot_give_are_refused(tmp_path: Path, change: dict, words: str) -> None:
    session = mosaic_session(take=[{**TAKES[2], **change}])
    with pytest.raises(ConfigError, match=words):
        take_session(mosaic_rig(tmp_path), session, tmp_path / "run", files={})


def test_exposures_are_metered_once_for_all_angles(tmp_path: Path) -> None:
    session = mosaic_session(take=[{"kind": "scene", "exposure_ms": "auto", "cycles": 1, "bracket": [1.0, 2.0]}])
    run = taken(tmp_path, mosaic_rig(tmp_path), session)
    metered = next(event for event in events_of(run.path) if event["event"] == "metered")
    assert list(metered["facts"]["shares"]) == ["90.0", "45.0", "135.0", "0.0"]
    exposed = [parts[0].exposure_s for parts in exposures(run)]
    assert exposed[1] == pytest.approx(2.0 * exposed[0], abs=1e-6)


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("mosaic_deg = [90, 45, 135, 0]", "mosaic_deg = [90, 45, 135, 92]", "must differ"),
        ("mosaic_deg = [90, 45, 135, 0]\n", "", "interpolation|stage: is missing"),
        ('"sim:mosaic"', '"sim:gc780"', "no polarizers on its pixels"),
        ("[simulation]\n", '[stage]\ndriver = "ellx"\nport = "sim:ellx"\n[simulation]\n', "leave one of them out"),
    ],
)
def test_a_rig_that_cannot_be_is_refused(tmp_path: Path, before: str, after: str, words: str) -> None:
    mosaic_rig(tmp_path)
    file = tmp_path / "rig.toml"
    file.write_text(file.read_text().replace(before, after).replace('interpolation = "none"', ""))
    with pytest.raises(ConfigError, match=words):
        take_session(load_rig(file), mosaic_session(), tmp_path / "run", files={})


def test_each_picture_has_its_maps_in_the_browser(tmp_path: Path) -> None:
    mosaic_rig(tmp_path)
    rig = LiveRig(str(tmp_path / "rig.toml"))
    rig.begin(Task(kind="polarimetry", exposure_ms=0.03))
    while rig.look().maps_sequence < 2 and not rig.look().problem:
        pass
    look = rig.look()
    rig.begin(REST)
    assert look.problem == ""
    assert (look.width, look.height) == (96, 48)
    assert abs(look.maps_sequence - look.sequence) <= 1
    assert rig.picture("dolp") is not None
    assert rig.picture("aolp") is not None


class _RealMosaic:
    """A camera that gives a part of a real frame, taken anew each time."""

    def __init__(self, counts: np.ndarray) -> None:
        self._counts, self._number = counts, 0

    def identify(self) -> DeviceIdentity:
        return DeviceIdentity(model="IMX250MZR", serial_number="1", firmware="0")

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        height, width = self._counts.shape
        self._settings = CameraSettings(exposure_s=exposure_s, gain_db=gain_db, width=width, height=height, bit_depth=8)
        return self._settings

    def take_frame(self, *, timeout_s: float) -> Frame:
        self._number += 1
        counts = self._counts.copy()
        counts[0, 0] = self._number  # a sensor never gives one picture twice
        return Frame(
            counts=counts,
            settings=self._settings,
            sequence=self._number,
            start_utc_ns=time.time_ns(),
            end_utc_ns=time.time_ns(),
            start_monotonic_ns=time.monotonic_ns(),
        )


@pytest.mark.skipif(REAL_DATA is None, reason="set RIGCTL_REAL_DATA to the folder of real frames (imx250_fruits, ...)")
def test_a_real_frame_gives_the_same_live_and_imported(tmp_path: Path) -> None:
    file = Path(REAL_DATA or "") / "imx250_fruits" / "fruits_IMX250MZR.png"
    picture = np.asarray(cv2.imread(str(file), cv2.IMREAD_UNCHANGED))[800:1000, 1000:1300].astype(np.uint16)
    rig = RigFile.model_validate(
        {"name": "real", "camera": {"address": "none:", "mosaic_deg": [90, 45, 135, 0]}, "site": None}
    )
    camera = _RealMosaic(picture)

    @contextmanager
    def opened() -> Iterator[Rig]:
        yield Rig(
            stage=None,
            camera=camera,
            stage_identity=None,
            camera_identity=camera.identify(),
            present=lambda _: None,
            origin="device",
        )

    take_session(rig, mosaic_session(take=[{**TAKES[2], "cycles": 1}]), tmp_path / "run", files={}, opener=opened)
    run = read_run(tmp_path / "run")
    for record, (row, column) in zip(run.frames, ((0, 0), (0, 1), (1, 0), (1, 1)), strict=True):
        np.testing.assert_array_equal(run.counts(record)[1:], picture[row::2, column::2][1:])
    swapped = rig.model_copy(update={"camera": rig.camera.model_copy(update={"mosaic_deg": [0, 90, 45, 135]})})
    with pytest.raises(DataError, match="does not fit the light"):
        take_session(swapped, mosaic_session(take=TAKES[2:]), tmp_path / "swapped", files={}, opener=opened)
