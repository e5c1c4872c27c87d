"""Whole studies, on a scheduler in this process and on processes that are killed."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("distributed", reason="pip install 'rigctl[cluster]'")

from rigctl import study as study_case
from rigctl.base.destination import origin_of
from rigctl.errors import ConfigError, DataError
from rigctl.files.scene_file import load_scene
from rigctl.mapped import PARTS_FOLDER, Engine, client_of, held_folder, require_same_code
from rigctl.prediction.predict import ScenePredictor
from rigctl.study import Batch, compute
from rigctl.verbs.study import StudyResult, study
from tests.rigctl.study.study_files import EFFICIENCY, EXPOSURE, GRID, study_file


@pytest.fixture
def scheduler():
    """Return the address of a scheduler and two workers in this process."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, processes=False, dashboard_address=":0") as cluster:
        yield cluster.scheduler_address


def computed(path: Path, scheduler: str) -> StudyResult:
    return study(path, out=path.parent / "out", scheduler=scheduler)


def opened(path: Path):
    import xarray as xr

    return xr.open_zarr(path.parent / "out" / "study.zarr")


def test_a_grid_is_what_predict_says_bit_for_bit(tmp_path, scheduler):
    path = study_file(tmp_path, GRID)
    found = computed(path, scheduler)
    assert (found.outcome, found.failed, found.done_before) == ("whole", 0, 0)
    store = opened(path)
    predictor = ScenePredictor(load_scene(tmp_path / "small.toml"), None)
    for exposure in store[EXPOSURE].values:
        for efficiency in store[EFFICIENCY].values:
            said = predictor.predictions({EXPOSURE: exposure, EFFICIENCY: efficiency})
            here = store.sel({EXPOSURE: exposure, EFFICIENCY: efficiency, "scene": "small"})
            for region in ("left", "right"):
                quantities = said[region].quantities
                assert float(here.dolp_mean.sel(region=region)) == quantities["dolp"]["mean"]
                assert float(here.s0_std.sel(region=region)) == quantities["s0"]["std"]
    assert store[EXPOSURE].attrs["units"] == "ms"
    assert store.s0_mean.attrs["units"] == "DN"
    assert "small.toml" in " ".join(store.attrs)
    assert store.attrs["created_by"] == f"rigctl {study_case.code_version()}"


def test_others_read_the_tables(tmp_path, scheduler):
    path = study_file(tmp_path, GRID)
    computed(path, scheduler)
    import duckdb
    import pandas as pd
    import polars as pl

    table = pd.read_parquet(tmp_path / "out" / "study.parquet")
    assert len(table) == 10 * 2
    assert list(table.columns[:5]) == ["case", "scene", EXPOSURE, EFFICIENCY, "region"]
    right = table[(table.case == 3) & (table.region == "right")].iloc[0]
    store = opened(path).sel({EXPOSURE: right[EXPOSURE], EFFICIENCY: right[EFFICIENCY]})
    assert right["dolp_mean"] == float(store.dolp_mean.sel(region="right").values[0])
    asked = f"SELECT dolp_mean FROM '{tmp_path / 'out' / 'study.parquet'}' WHERE \"case\" = 3 AND region = 'right'"
    assert duckdb.sql(asked).fetchall() == [(right["dolp_mean"],)]
    pairs = pl.read_parquet(tmp_path / "out" / "detection.parquet")
    assert pairs.shape == (10 * 2 * 4, 8)
    one = pairs.filter((pl.col("case") == 3) & (pl.col("pair") == "left on right") & (pl.col("p_false_alarm") == 1e-3))
    assert one["p_detection"][0] == float(store.p_detection.sel(pair="left on right", p_false_alarm=1e-3).values[0])


def test_what_is_done_is_not_done_again(tmp_path, scheduler):
    path = study_file(tmp_path, GRID)
    computed(path, scheduler)
    parts = sorted((tmp_path / "out" / PARTS_FOLDER).iterdir())
    times = {part: part.stat().st_mtime_ns for part in parts}
    study_file(tmp_path, GRID.replace("[0.3, 0.5]", "[0.3, 0.4, 0.5]"))
    more = computed(path, scheduler)
    assert (len(more.table.cases), more.done_before) == (15, 10)
    assert {part: part.stat().st_mtime_ns for part in parts} == times
    # Another scene is other cases.
    (tmp_path / "small.toml").write_text(
        (tmp_path / "small.toml").read_text().replace("f_number = 2.0", "f_number = 2.8")
    )
    assert computed(path, scheduler).done_before == 0


def test_a_damaged_part_is_computed_again(tmp_path, scheduler):
    path = study_file(tmp_path, GRID)
    before = computed(path, scheduler)
    part = min((tmp_path / "out" / PARTS_FOLDER).iterdir())
    part.write_bytes(part.read_bytes()[:-40])
    after = computed(path, scheduler)
    assert len(after.damaged) == 1
    assert 0 < after.done_before < 10
    np.testing.assert_array_equal(after.table.numbers.values, before.table.numbers.values)


def test_a_case_that_fails_is_a_row_with_its_reason(tmp_path, scheduler):
    # Without light there is no DoLP; the scene's numbers allow it.
    cases = '\nkind = "list"\n[cases.parameters]\n"regions.left.stokes_radiance.0" = { values = [10.0, 2.0] }\n'
    path = study_file(tmp_path, cases)
    found = computed(path, scheduler)
    # S0 = 2 with S1 = 3: more polarized light than light.
    assert found.failed == 1
    store = opened(path)
    assert set(store.dims) == {"case", "region", "pair", "p_false_alarm"}
    assert np.isnan(store.dolp_mean.values[1]).all()
    assert np.isfinite(store.dolp_mean.values[0]).all()
    assert "allowed is DoLP <= 1" in str(store.reason.values[1])
    assert str(store.reason.values[0]) == ""


def test_a_batch_to_a_tolerance_is_one_series_of_which_a_case_may_fail(tmp_path):
    cases = f"""
kind = "list"
[cases.parameters]
"regions.left.stokes_radiance.0" = {{ values = [10.0, 2.0, 11.0, 12.0] }}
"{EXPOSURE}" = {{ values = [0.01, 0.01, 0.02, 0.03] }}
"""
    found = study(study_file(tmp_path, cases), out=tmp_path / "out", workers=1, tolerance=0.01).table.numbers
    alone = ScenePredictor(load_scene(tmp_path / "small.toml"), None)
    assert [bool(reason) for reason in found.reasons] == [False, True, False, False]
    for place, s0, exposure in ((0, 10.0, 0.01), (2, 11.0, 0.02), (3, 12.0, 0.03)):
        expected = alone.predictions({"regions.left.stokes_radiance.0": s0, EXPOSURE: exposure})["left"]
        assert found.values[place, 0, 0] == pytest.approx(expected.quantities["dolp"]["mean"], abs=0.01)


def test_sobol_ranks_what_matters(tmp_path, scheduler):
    cases = f'\nkind = "sobol"\nn = 32\n[cases.parameters]\n"{EXPOSURE}" = {{ range = [0.02, 0.03] }}\n'
    cases += f'"{EFFICIENCY}" = {{ std = 0.001 }}\n'
    found = computed(study_file(tmp_path, cases, quantities='["s0.mean"]'), scheduler)
    by_input = {row.input: row for row in found.sobol if row.region == "right"}
    assert by_input[EXPOSURE].total > 0.9
    assert by_input[EFFICIENCY].total < 0.1
    written = json.loads((tmp_path / "out" / "sensitivity.json").read_text())
    assert {row["input"] for row in written["rows"]} == {EXPOSURE, EFFICIENCY}
    assert (tmp_path / "out" / "sensitivity.png").stat().st_size > 5000


def test_an_unknown_quantity_is_refused_with_what_there_is(tmp_path, scheduler):
    with pytest.raises(ConfigError, match=r"no scene gives dolq\.mean; there are .*dolp"):
        computed(study_file(tmp_path, GRID, quantities='["dolq.mean"]'), scheduler)


def test_a_worker_of_another_version_is_refused(tmp_path):
    class OldWorkers:
        def wait_for_workers(self, workers, timeout):
            assert workers == 1

        def run(self, function, packages):
            return {"tcp://10.0.0.7:41001": "0.0.1+old", "tcp://10.0.0.8:41001": study_case.code_version()}

    with pytest.raises(ConfigError, match=r"and tcp://10\.0\.0\.7:41001 has 0\.0\.1\+old: install the same"):
        require_same_code(OldWorkers(), study_case.PACKAGES)
    # One that comes later refuses its first batch.
    study = study_file(tmp_path, GRID).parent / "small.toml"
    wanted = study_case.Wanted(columns=(), detection=False, roc=None, tolerance=None)
    with pytest.raises(ConfigError, match=r"a worker has rigctl .*, the study 0\.0\.1\+old"):
        compute(Batch(scene=study_case.study_scene(study), wanted=wanted, cases=(), code="0.0.1+old"))


def test_a_scheduler_without_workers_is_told():
    class Lonely:
        def wait_for_workers(self, workers, timeout):
            raise TimeoutError

    with pytest.raises(ConfigError, match="it has no workers; start some"):
        require_same_code(Lonely(), study_case.PACKAGES)


def test_workers_that_do_not_start_are_told(monkeypatch):
    def cluster(**_):
        raise RuntimeError("Nanny failed to start.")

    monkeypatch.setattr("distributed.LocalCluster", cluster)
    with (
        pytest.raises(DataError, match=r"workers do not start on this machine: Nanny failed to start\. They need"),
        client_of(Engine(scheduler=None, workers=1), command="study", packages=study_case.PACKAGES),
    ):
        pass


def test_no_scheduler_is_a_clear_error(tmp_path, monkeypatch):
    monkeypatch.setattr("rigctl.mapped._CONNECT_S", 0.5)
    with pytest.raises(ConfigError, match="no dask scheduler answers there"):
        computed(study_file(tmp_path, GRID), "tcp://127.0.0.1:9")


def test_a_folder_takes_one_study_at_a_time(tmp_path, scheduler):
    with held_folder(tmp_path / "out"), pytest.raises(DataError, match="another command"):
        computed(study_file(tmp_path, GRID), scheduler)


_SLOW = '\nkind = "random"\nn = 600\n[cases.parameters]\n"acquisition.exposure_ms" = { range = [0.01, 0.03] }\n'


# The command, whose every part after the first waits until the test has sent its signal.
_GATED = """
import sys, time
from pathlib import Path
from rigctl import study
from rigctl.cli import main

go, write_part, written = Path(sys.argv.pop(1)), study.write_part, []

def gated(*args):
    while written and not go.exists():
        time.sleep(0.01)
    write_part(*args)
    written.append(args)

study.write_part = gated
sys.exit(main())
"""


@pytest.mark.slow
def test_a_study_is_stopped_killed_and_gone_on_with(tmp_path):
    path, out = study_file(tmp_path, _SLOW), tmp_path / "out"
    words = ["study", str(path), "--out", str(out), "--workers", "1", "--json"]
    for ended_by, code in ((signal.SIGINT, 75), (signal.SIGKILL, -signal.SIGKILL)):
        before = len(list((out / PARTS_FOLDER).glob("*.npz")))
        go = tmp_path / ended_by.name
        gated = [sys.executable, "-c", _GATED, str(go), *words]
        with subprocess.Popen(gated, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            end_s = time.monotonic() + 120.0
            while len(list((out / PARTS_FOLDER).glob("*.npz"))) == before:
                assert process.poll() is None
                assert time.monotonic() < end_s
                time.sleep(0.01)
            process.send_signal(ended_by)
            go.touch()
            assert process.wait(60) == code
    words = [sys.executable, "-m", "rigctl", *words]
    kept = {part: part.stat().st_mtime_ns for part in (out / PARTS_FOLDER).glob("*.npz")}
    done = subprocess.run(words, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert (said["outcome"], said["cases"], said["failed"]) == ("whole", 600, 0)
    assert 0 < said["done_before"] < 600
    assert {part: part.stat().st_mtime_ns for part in kept} == kept


def test_work_that_is_refused_leaves_nothing_behind(tmp_path):
    with pytest.raises(ConfigError, match="no dask"), held_folder(tmp_path / "many" / "out"):
        raise ConfigError("no dask")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine").write_text("")
    with pytest.raises(ConfigError, match="no dask"), held_folder(tmp_path / "out"):
        raise ConfigError("no dask")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["mine"]


def test_results_are_those_of_a_study_wherever_it_is_computed():
    one, other = (origin_of("study", {"tolerance": 0.1, "workers": workers}, []) for workers in (1, 8))
    assert one == other
    assert one != origin_of("study", {"tolerance": 0.2, "workers": 1}, [])
