"""Jobs over an archive, on a scheduler in this process: rows, reasons, resumption, and what single runs give."""

import json
import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("distributed", reason="pip install 'rigctl[cluster]'")

import distributed

from rigctl import mapped as on_dask
from rigctl.archive.index import find, update_index
from rigctl.cli import main
from rigctl.errors import ConfigError, DataError
from rigctl.mapped import PARTS_FOLDER, Engine
from rigctl.runs.folder import read_run
from rigctl.session.take import take_session
from rigctl.verbs.compare import compare_run
from rigctl.verbs.over_runs import ArchiveJob, RunTask, rows_of, run_over_archive
from rigctl.verbs.stokes import stokes
from tests.rigctl.example_files import small_rig, small_session

AXIS = {"schema_version": 2, "sense": -1, "offset_deg": {"value": 36.7, "std_error": 0.01}}


@pytest.fixture(autouse=True)
def notes_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture(scope="module")
def engine():
    """Return an engine on a scheduler and two workers in this process."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, dashboard_address=":0"
    ) as cluster:
        yield Engine(scheduler=cluster.scheduler_address, workers=1)


@pytest.fixture(scope="module")
def taken(tmp_path_factory):
    """Return a folder with the scene and a small run of it."""
    folder = tmp_path_factory.mktemp("taken")
    take_session(small_rig(folder), small_session(), folder / "run", files={})
    return folder


@pytest.fixture
def root(taken, tmp_path):
    """Return an archive of two whole runs and five that are damaged in different ways."""
    archive = tmp_path / "runs"
    for name in ("a", "deep/b", "frame", "gone", "line", "session", "empty"):
        shutil.copytree(taken / "run", archive / name)
    frames = {name: sorted((archive / name / "frames").iterdir()) for name in ("frame", "gone")}
    frames["frame"][-1].write_bytes(frames["frame"][-1].read_bytes()[:-100])
    frames["gone"][-1].unlink()
    manifest = archive / "line" / "manifest.jsonl"
    manifest.write_bytes(manifest.read_bytes().replace(b'"kind"', b'"kinb"', 1))
    (archive / "session" / "session.json").unlink()
    (archive / "empty" / "manifest.jsonl").write_bytes(b"")
    return archive


def request(root, verb, engine, **others):
    return ArchiveJob(verb=verb, root=root, out=root.parent / verb, engine=engine, **others)


def by_run(found):
    return {row.run: row for row in found.rows}


def test_compared_runs_are_what_single_ones_are_and_damaged_ones_are_rows(root, taken, engine):
    scene = taken / "scene.toml"
    found = run_over_archive(replace(request(root, "compare", engine, scene=scene), out=root / "compared"))
    assert (found.runs, found.done_before, found.exit_code) == (7, 0, 4)
    rows = by_run(found)
    assert {name for name, row in rows.items() if row.verdict != "failed"} == {"a", "deep/b"}
    assert all(row.exit_code == 4 and row.reason for name, row in rows.items() if row.verdict == "failed")
    single = compare_run(root / "a", scene=scene)
    dolp = next(row for row in single.rows if (row.region, row.quantity, row.statistic) == ("left", "dolp", "mean"))
    (left,) = (region for region in rows["deep/b"].regions if region.region == "left")
    assert (left.dolp, left.dolp_predicted, left.dolp_z) == (dolp.measured, dolp.predicted, dolp.z)
    assert rows["a"].verdict == single.verdict
    # The results lie below the root: the index has the verdicts.
    update_index(root)
    assert {row["run"] for row in find(root, "region = 'left' and dolp > 0.3")} >= {"a", "deep/b"}
    page = (root / "compared" / "archive.html").read_text()
    assert "7 runs compared with the model" in page
    assert "damaged or replaced" in page
    lines = (root / "compared" / "archive.csv").read_text().splitlines()
    assert len(lines) == 1 + 5 + 2 * 2
    assert json.loads((root / "compared" / "archive.json").read_text())["verdicts"]["failed"] == 5


def test_only_runs_that_changed_are_done_again(root, engine):
    job = request(root, "verify", engine)
    first = run_over_archive(job)
    assert {name: row.verdict for name, row in by_run(first).items()} == {
        "a": "whole", "deep/b": "whole", "frame": "damaged", "gone": "damaged", "line": "damaged", "session": "damaged",
        "empty": "damaged",
    }  # fmt: skip
    assert by_run(first)["gone"].reason
    kept = {part: part.stat().st_mtime_ns for part in (job.out / PARTS_FOLDER).iterdir()}
    assert run_over_archive(job).done_before == 7
    frame = min((root / "a" / "frames").iterdir())
    frame.write_bytes(bytes([frame.read_bytes()[0] ^ 1]) + frame.read_bytes()[1:])
    os.utime(frame, ns=(1, 1))
    again = run_over_archive(job)
    assert (again.done_before, by_run(again)["a"].verdict) == (6, "damaged")
    assert {part: part.stat().st_mtime_ns for part in kept} == kept
    # Parts that are damaged are named, and their runs are done again: all but the one that has a later part.
    for part in kept:
        part.write_bytes(b"{")
    mended = run_over_archive(job)
    assert (len(mended.damaged), mended.done_before) == (len(kept), 1)
    assert mended.rows == tuple(
        replace(row, seconds=new.seconds) for row, new in zip(again.rows, mended.rows, strict=True)
    )


def test_regions_of_a_whole_archive_where_an_expression_holds(root, taken, engine):
    options = {"calibrations": Path("none")}
    job = request(root, "stokes", engine, scene=taken / "scene.toml", options=options, where="run = 'a'", full=True)
    found = run_over_archive(job)
    assert [row.run for row in found.rows] == ["a"]
    measured = stokes(root / "a", regions=read_regions(taken)).measurement
    assert found.rows[0].regions[0].dolp == measured.regions["left"].quantities["dolp"]["mean"].value
    assert (root.parent / "stokes" / "runs" / "a" / "stokes.fits").is_file()


def read_regions(folder):
    from rigctl.files.scene_file import load_scene

    return list(load_scene(folder / "scene.toml").regions)


def test_another_axis_turns_every_angle_and_no_frame(root, taken, engine):
    (root.parent / "polarizer.json").write_text(json.dumps(AXIS))
    job = request(
        root,
        "recalibrate",
        engine,
        scene=taken / "scene.toml",
        options={"polarizer": root.parent / "polarizer.json", "calibrations": Path("none")},
        where="state = 'whole' and run != 'frame'",
    )
    found = run_over_archive(job)
    assert {row.run for row in found.rows} == {"a", "deep/b"}
    for row in found.rows:
        assert "polarizer polarizer.json" in row.calibrations
        for region in row.regions:
            # The rig file says 31.7 deg, the calibration 36.7.
            assert (region.aolp_deg - region.aolp_before_deg) % 180.0 == pytest.approx(5.0, abs=1e-9)
            assert region.dolp == pytest.approx(region.dolp_before, rel=1e-9)
    numbers = json.loads((job.out / "runs" / "a" / "stokes.json").read_text())
    assert "left" in numbers["regions"]
    # Another calibration under the same name is another job.
    (root.parent / "polarizer.json").write_text(json.dumps(AXIS | {"offset_deg": {"value": 32.0, "std_error": 0.01}}))
    assert run_over_archive(job).done_before == 0
    assert read_run(root / "a").session.polarizer.offset_deg == 31.7


def test_what_all_runs_need_is_refused_at_once(root, engine):
    with pytest.raises(ConfigError, match="no such calibration"):
        run_over_archive(request(root, "stokes", engine, options={"noise": root / "none.json"}))
    with pytest.raises(ConfigError, match=r"there is no column 'sate'; did you mean state"):
        run_over_archive(request(root, "verify", engine, where="sate = 'whole'"))
    with pytest.raises(ConfigError, match=r"a worker has rigctl .*, the client 0\.0\.1\+old"):
        rows_of(RunTask(names=("a",), job=request(root, "verify", engine), code="0.0.1+old"))


def test_without_dask_the_command_says_what_to_install(root, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["archive", "verify", str(root), "--out", str(root.parent / "out"), "--workers", "1"]) == 2
    assert "rigctl archive verify needs dask.distributed" in capsys.readouterr().err
    assert not (root.parent / "out").exists()
    assert main(["archive", "recalibrate", str(root), "--out", str(root.parent / "out")]) == 2
    assert "give --regions FILE" in capsys.readouterr().err


class Finished:
    """A future that is done: its result, or the error that it ended with."""

    def __init__(self, key, result):
        self.key, self._result = key, result

    def result(self):
        if isinstance(self._result, Exception):
            raise self._result
        return self._result


class PatientQueue(list):
    """What `as_completed` is: futures in the order in which they were added."""

    add = list.append

    def __next__(self):
        if not self:
            raise StopIteration
        return self.pop(0)


class DeadlyClient:
    """A client whose workers end at every task that holds an odd number."""

    def __init__(self):
        self.given = []

    def nthreads(self):
        return {"one": 1}

    def submit(self, work, task, *, pure):
        self.given.append(task)
        killed = distributed.KilledWorker("task", SimpleNamespace(address="tcp://10.0.0.7:41001"), 10)
        return Finished(str(len(self.given)), killed if any(number % 2 for number in task) else work(task))


def test_a_task_that_ends_its_workers_is_taken_apart_and_costs_no_other(monkeypatch):
    monkeypatch.setattr(distributed, "as_completed", PatientQueue)
    client, kept = DeadlyClient(), {}
    tasks = [(0, 2), (4, 5), (6, 8), (10, 12), (14, 16)]
    on_dask.compute_all(
        client,
        lambda task: "done",
        iter(tasks),
        kept.__setitem__,
        parts=lambda task: tuple((number,) for number in task),
        lost=lambda task, reason: reason,
    )
    assert kept.pop((5,)).startswith("every worker with this task ended")
    assert kept == {(0, 2): "done", (4,): "done", (6, 8): "done", (10, 12): "done", (14, 16): "done"}


def test_a_scheduler_that_goes_away_is_told(monkeypatch):
    class Gone(DeadlyClient):
        def submit(self, work, task, *, pure):
            return Finished(str(task), OSError("gone"))

    monkeypatch.setattr(distributed, "as_completed", PatientQueue)
    with pytest.raises(DataError, match="the scheduler was lost with"):
        on_dask.compute_all(
            Gone(), str, iter([(0,)]), lambda *_: None, parts=lambda task: (task,), lost=lambda task, reason: reason
        )
