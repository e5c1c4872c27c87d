"""An archive of thousands of runs, some of them damaged: indexed, verified, compared, changed.

The runs are one simulated session, copied with a start time of its own each. Required: every damaged run is a row with
its reason and no whole run is; rows are what single runs give; after changes only what changed is done again.
"""

import os
import random
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.trials.damaged_runs import damaged_copy
from rigctl.archive.index import update_index
from rigctl.archive.rows import RunRow, Verb
from rigctl.mapped import Engine
from rigctl.runs.folder import INPUTS_FOLDER, Run, read_run
from rigctl.runs.writer import RunWriter
from rigctl.session.take import take_session
from rigctl.verbs.archive import find
from rigctl.verbs.compare import compare_run
from rigctl.verbs.note import note
from rigctl.verbs.over_runs import ArchiveJob, ArchiveRows, run_over_archive
from rigctl.verbs.verify import verification_of
from tests.monkey.mutations import damage_run
from tests.rigctl.example_files import small_rig, small_session

_A_FOLDER = 100
_QUESTION = "verdict = 'agrees' and region = 'left' and dolp > 0.3"


def make_archive(folder: Path, runs: int, damaged: int, draws: random.Random) -> dict[str, str]:
    """Make so many runs below a folder, some of them damaged; return these, with what verify says of each."""
    rig = small_rig(folder)
    take_session(rig, small_session(cycles=1), folder / "taken", files={})
    taken = read_run(folder / "taken")
    counts = [taken.counts(record) for record in taken.frames]
    with _unflushed():
        for k in range(runs):
            _again(taken, counts, folder / "runs" / f"{k // _A_FOLDER:02d}" / f"run{k:05d}", timedelta(hours=k))
    told: dict[str, str] = {}
    for k in draws.sample(range(runs), damaged):
        path = folder / "runs" / f"{k // _A_FOLDER:02d}" / f"run{k:05d}"
        told[path.relative_to(folder / "runs").as_posix()] = _damage(path, folder / "whole", draws)
    return told


@contextmanager
def _unflushed() -> Iterator[None]:
    """Write runs without waiting for the disk: they are made for this trial."""
    flush, os.fsync = os.fsync, lambda _: None
    try:
        yield
    finally:
        os.fsync = flush


def _again(taken: Run, counts: list[NDArray[np.uint16]], path: Path, later: timedelta) -> None:
    def moved(text: str | None) -> str | None:
        if text is None:
            return None
        seconds, _, rest = text.partition(".")
        return f"{(datetime.fromisoformat(seconds) + later).isoformat()}.{rest}"

    path.parent.mkdir(parents=True, exist_ok=True)
    with RunWriter.create(path, dict(taken.session_json)) as writer:
        if (taken.path / INPUTS_FOLDER).is_dir():
            shutil.copytree(taken.path / INPUTS_FOLDER, path / INPUTS_FOLDER, dirs_exist_ok=True)
        for record, picture in zip(taken.frames, counts, strict=True):
            writer.write_frame(
                replace(record, start_utc=moved(record.start_utc), end_utc=moved(record.end_utc)), picture
            )
        writer.closing_event("finished", frames=len(counts))


def _damage(path: Path, spare: Path, draws: random.Random) -> str:
    """Damage a run until verify sees it; return what it says."""
    path.rename(spare)
    while True:
        if draws.random() < 0.5:
            damaged_copy(spare, path, draws)
        else:
            shutil.copytree(spare, path)
            damage_run(path, draws)
        try:
            state = verification_of(path).state
        except Exception as error:  # whatever it says of such a folder, it is not whole
            state = type(error).__name__
        if state != "whole" and any((path / name).is_file() for name in ("session.json", "manifest.jsonl")):
            shutil.rmtree(spare)
            return state
        shutil.rmtree(path)


def run_archive(*, runs: int = 2000, damaged: int = 20, seed: int = 1) -> bool:
    """Return whether an archive is indexed, asked, verified and compared as it should be."""
    draws = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        told = make_archive(folder, runs, damaged, draws)
        root = folder / "runs"
        sound = _indexed(root, runs, draws, told)
        engine = Engine(scheduler=None, workers=2)
        sound &= _verified(root, folder / "checked", engine, told)
        return _compared(root, folder, engine, told) and sound


def _indexed(root: Path, runs: int, draws: random.Random, told: dict[str, str]) -> bool:
    first, again = update_index(root), update_index(root)
    whole = [path for path in sorted(root.glob("*/*")) if path.relative_to(root).as_posix() not in told]
    for path in draws.sample(whole, 5):
        note(path, "a cloud", by="trial")
    changed = update_index(root)
    print(f"index of {first.runs} runs, {first.damaged} damaged; after 5 changes {changed.changed} are read again")
    return (first.runs, first.new, again.new, again.changed, changed.changed) == (runs, runs, 0, 0, 5)


def _done(verb: Verb, root: Path, out: Path, engine: Engine, scene: Path | None) -> ArchiveRows:
    found = run_over_archive(ArchiveJob(verb=verb, root=root, out=out, engine=engine, scene=scene, where=None))
    print(f"{verb}: {found.runs} runs, {found.done_before} done before: {found.verdicts}", flush=True)
    return found


def _verified(root: Path, out: Path, engine: Engine, told: dict[str, str]) -> bool:
    found = _done("verify", root, out, engine, None)
    off = {row.run for row in found.rows if row.verdict != "whole"}
    reasons = all(row.reason or row.verdict == "unfinished" for row in found.rows if row.run in off)
    again = _done("verify", root, out, engine, None)
    print(
        f"damaged runs that verify names: {len(off & set(told))} of {len(told)}; whole ones that it names: "
        f"{len(off - set(told))}"
    )
    return off == set(told) and reasons and again.done_before == found.runs and again.rows == found.rows


def _compared(root: Path, folder: Path, engine: Engine, told: dict[str, str]) -> bool:
    scene = folder / "scene.toml"
    out = root / "compared"
    found = _done("compare", root, out, engine, scene)
    rows = {row.run: row for row in found.rows}
    single = {
        row.run: _dolp(root / row.run, scene)
        for row in found.rows[:: max(len(found.rows) // 10, 1)]
        if row.run not in told
    }
    same = all(_of_row(rows[name]) == dolp for name, dolp in single.items())
    failed = {row.run for row in found.rows if row.verdict == "failed"}
    changed = next(name for name in rows if name not in told)
    shutil.rmtree(root / next(name for name in rows if name not in told and name != changed))
    note(root / changed, "a bird", by="trial")
    again = _done("compare", root, out, engine, scene)
    update_index(root)
    agreeing = len(find(root, _QUESTION).runs)
    print(
        f"{len(single)} of them by `compare` alone: {'bit for bit the same' if same else 'DIFFER'}; whole runs that "
        f"failed: {len(failed - set(told))}; {agreeing} runs agree by the index"
    )
    wanted = (found.runs - 1, found.runs - 2)
    return same and failed <= set(told) and (again.runs, again.done_before) == wanted


def _of_row(row: RunRow) -> dict[str, float | None]:
    return {region.region: region.dolp for region in row.regions}


def _dolp(run: Path, scene: Path) -> dict[str, float | None]:
    rows = compare_run(run, scene=scene).rows
    return {row.region: row.measured for row in rows if (row.quantity, row.statistic) == ("dolp", "mean")}
