import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import rigctl
from rigctl.errors import ConfigError, RunFolderError
from rigctl.files.regions import load_regions
from rigctl.report import document
from rigctl.verbs.predict import Prediction
from rigctl.verbs.stokes import StokesResult
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.made_runs import at, make_run

NAMES = {
    "open_run", "load_scene", "load_rig", "load_noise", "load_polarizer", "predict", "compare", "sweep", "sky",
    "surface", "stokes", "acquire", "open_archive", "infer",
}  # fmt: skip
SCENE = EXAMPLES / "scene-panels.toml"


@pytest.fixture(scope="module")
def run_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("interface") / "run"
    rng = np.random.default_rng(5)
    frames = [
        (at(angle, cycle=cycle, exposure_s=0.01), rng.normal(400 + 80 * np.cos(np.radians(2 * angle)), 5, (20, 24)))
        for cycle in range(2)
        for angle in (0.0, 45.0, 90.0, 135.0)
    ]
    make_run(path, frames)
    return path


@pytest.fixture
def regions_file(tmp_path):
    path = tmp_path / "regions.toml"
    path.write_text('[[regions]]\nname = "panel"\nrectangle = { x = 2, y = 2, width = 16, height = 14 }\n')
    return path


def test_the_names_are_those_that_are_documented():
    assert set(rigctl.__all__) == NAMES
    assert set(dir(rigctl)) >= NAMES
    assert all(getattr(rigctl, name).__doc__ for name in NAMES)


def test_no_module_takes_the_place_of_a_name():
    package = Path(rigctl.__file__).parent
    assert [name for name in NAMES if (package / name).exists() or (package / f"{name}.py").exists()] == []


def test_importing_it_imports_nothing_heavy():
    code = "import sys, rigctl; print(sorted({'numpy', 'pydantic', 'cyclopts', 'matplotlib'} & set(sys.modules)))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'predictt'"):
        rigctl.predictt  # noqa: B018


def test_frames_come_as_one_array_with_their_measured_angles(run_path):
    frames = rigctl.open_run(run_path).frames(kind="scene")
    assert frames.counts.shape == (8, 20, 24)
    assert frames.polarizer_angle_deg.tolist() == [0.0, 45.0, 90.0, 135.0] * 2
    assert np.asarray(frames).dtype == np.uint16
    assert len(frames) == len(list(frames)) == 8


def test_a_run_that_is_not_whole_says_so(run_path, tmp_path):
    unfinished = Path(shutil.copytree(run_path, tmp_path / "unfinished"))
    (unfinished / "events.jsonl").write_bytes(b"")
    with pytest.warns(UserWarning, match="is unfinished: 8 frames so far"):
        run = rigctl.open_run(unfinished)
    assert run.wholeness == "unfinished"
    assert "unfinished: 8 frames" in repr(run)
    damaged = Path(shutil.copytree(run_path, tmp_path / "damaged"))
    (damaged / "events.jsonl").write_bytes(b"{}\n")
    with pytest.warns(UserWarning, match="is damaged, and its numbers are unreliable"):
        assert rigctl.open_run(damaged).wholeness == "damaged"


def test_frames_of_a_kind_that_there_is_not_say_what_there_is(run_path):
    with pytest.raises(ConfigError, match="no frames of kind 'dark'; there are scene"):
        rigctl.open_run(run_path).frames(kind="dark")


def test_stokes_are_pictures_and_a_table(run_path, regions_file):
    run = rigctl.open_run(run_path)
    found = run.stokes(regions=regions_file)
    assert isinstance(found, StokesResult)
    assert found.dolp.shape == found.s1.shape == (20, 24)
    table = run.regions(regions_file)
    assert list(table.columns) == ["region", "quantity", "statistic", "value", "std_error"]
    dolp = table[(table.quantity == "dolp") & (table.statistic == "mean")].iloc[0]
    assert dolp.value == pytest.approx(0.2, abs=5 * dolp.std_error)
    assert "<table" in found._repr_html_()
    assert "data:image/png" in found._repr_html_()


def test_regions_may_be_records(run_path, regions_file):
    assert set(rigctl.stokes(run_path, regions=load_regions(regions_file)).table().region) == {"panel"}


def test_regions_that_nobody_names_are_asked_for(run_path):
    with pytest.raises(ConfigError, match="rigctl regions draw"):
        rigctl.open_run(run_path).regions()


def test_a_run_is_an_xarray_dataset(run_path):
    dataset = rigctl.open_run(run_path).to_xarray()
    assert dataset.counts.dims == ("frame", "y", "x")
    assert dataset.dolp.dims == ("y", "x")
    assert dataset.counts.polarizer_angle_deg.values[1] == 45.0


def test_a_table_may_be_of_polars(run_path, regions_file):
    pytest.importorskip("polars", reason="pip install 'rigctl[notebook]'")
    table = rigctl.open_run(run_path).regions(regions_file, backend="polars")
    assert type(table).__module__.startswith("polars")


def test_a_missing_extra_says_the_pip_line(monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(document.importlib, "import_module", missing)
    with pytest.raises(ImportError, match=r"pip install 'rigctl\[notebook\]'"):
        document.optional("polars")


def test_a_changed_scene_is_predicted_as_a_changed_file_is(tmp_path):
    changed = tmp_path / "scene.toml"
    changed.write_text(SCENE.read_text().replace("f_number = 2.0", "f_number = 2.1"))
    by_key = rigctl.predict(SCENE, changes={"sensor.f_number": 2.1})
    assert isinstance(by_key, Prediction)
    by_file = rigctl.predict(rigctl.load_scene(changed))
    assert by_key.table().value.tolist() == by_file.table().value.tolist()
    assert rigctl.predict(str(SCENE)).table().value.tolist() != by_key.table().value.tolist()


def test_a_sweep_has_a_row_for_each_number_at_each_value():
    found = rigctl.sweep(SCENE, "sensor.f_number", [2.0, 2.2])
    assert set(found.table()["sensor.f_number"]) == {2.0, 2.2}
    assert "data:image/png" in found._repr_html_()


def test_a_comparison_is_the_job_s_and_shows_its_verdict(run_path, regions_file):
    found = rigctl.compare(rigctl.open_run(run_path), regions=regions_file)
    assert found.agrees is found.comparison.agrees
    assert set(found.table().columns) >= {"region", "predicted", "measured", "agrees"}
    assert found._repr_html_().startswith("<p>")


def test_a_surface_is_a_table_over_the_camera_s_angle():
    found = rigctl.surface("black-paint")
    assert list(found.table().columns) == ["camera_zenith_deg", "f00_per_sr", "s1n", "dolp"]
    assert repr(found) == "<black paint at 550 nm, sun at 45 deg>"


def test_figures_leave_the_caller_s_pyplot_alone():
    code = "import sys, rigctl.report.drawing; print('matplotlib.pyplot' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "False"


def test_a_registration_can_be_forced_as_by_the_command(run_path, regions_file, monkeypatch):
    asked = []

    def refused(paths):
        asked.append(paths)
        raise ConfigError("asked")

    monkeypatch.setattr("rigctl.measure.frames.selected_for_run", lambda paths, *_: refused(paths))
    for call in (rigctl.stokes, rigctl.compare):
        with pytest.raises(ConfigError, match="asked"):
            call(run_path, regions=regions_file, register="registration.json", force_registration=True)
    assert [paths.force_registration for paths in asked] == [True, True]


@pytest.fixture
def archive(tmp_path, run_path):
    """Return an archive of a run, its copy, one of larger frames, and one that cannot be read."""
    for name in ("a", "deep/b", "torn"):
        shutil.copytree(run_path, tmp_path / name)
    make_run(tmp_path / "large", [(at(angle), np.full((30, 24), 500)) for angle in (0.0, 45.0, 90.0)])
    (tmp_path / "torn" / "session.json").unlink()
    return tmp_path


def test_an_archive_is_one_lazy_array(archive, run_path, monkeypatch):
    pytest.importorskip("dask.array", reason="pip install 'rigctl[cluster]'")
    with pytest.raises(ConfigError, match=r"frames of 2 sizes .* 16 of shape=\(20, 24\), 3 of shape=\(30, 24\)"):
        rigctl.open_archive(archive)
    with pytest.warns(UserWarning, match="1 runs are left out"):
        found = rigctl.open_archive(archive, shape=(20, 24), kind="scene")
    assert found.counts.chunks == ((1,) * 16, (20,), (24,))
    assert list(dict.fromkeys(found.run.values)) == ["a", "deep/b"]
    assert "session.json" in found.attrs["left_out"]
    frames = rigctl.open_run(run_path).frames("scene")
    second = found.where(found.run == "deep/b", drop=True)
    np.testing.assert_array_equal(second.counts.values, frames.counts)
    np.testing.assert_array_equal(second.polarizer_angle_deg.values, frames.polarizer_angle_deg)
    assert set(found.coords) == {"run", "sequence", "kind", "time", "polarizer_angle_deg", "exposure_s"}
    # Only what is asked for is read: of one frame the others may be gone.
    shutil.rmtree(archive / "deep" / "b" / "frames")
    assert int(found.counts[0].sum()) == int(frames.counts[0].sum())
    with pytest.raises(RunFolderError, match="cannot be read"):
        found.counts[-1].values  # noqa: B018
    assert rigctl.open_archive(archive, where="run = 'a'").sizes["frame"] == 8
