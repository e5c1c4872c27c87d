"""Finished runs with one damage each (a bit, a cut, a swap, a deletion, an addition), in every kind of file.

Required: `verify` calls none of them whole, and no reader gives numbers from one without a warning. A damage that
changes no frame, no label and not the set of frames, such as an empty line at the end of a session file, may pass.
"""

import contextlib
import io
import random
import shutil
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

import rigctl
from rigctl import cli
from rigctl.errors import ConfigError, DataError
from rigctl.runs.folder import read_run
from rigctl.session.take import take_session
from rigctl.verbs.verify import verification_of
from tests.rigctl.example_files import small_rig, small_session

_LOOSE = ("status.json", "writer.lock")
# One reader a case, in turn; the quick ones more often.
_READERS: tuple[tuple[str, ...] | None, ...] = (
    ("export", "RUN", "--to", "tiff", "--out", "OUT"),
    None,
    ("status", "RUN", "--contents", "--json"),
    ("calibrate", "radiometric", "RUN", "--panel", "left", "--scene", "scene.toml", "--out", "OUT.json"),
    ("calibrate", "axis", "RUN", "--reference-deg", "0", "--reference-deg", "0", "--out", "OUT.json"),
    ("export", "RUN", "--to", "hdf5", "--out", "OUT.h5"),
    None,
    ("detect", "RUN", "--background", "left", "--target", "right", "--scene", "scene.toml", "--out", "OUT"),
    ("stokes", "RUN", "--out", "OUT", "--json"),
    ("status", "RUN", "--page", "OUT.html"),
    ("compare", "RUN", "scene.toml", "--out", "OUT"),
)
_SAYING = ("unfinished", "damaged", "unreliable", "missing", "cannot be read")
_HEAVY, _HEAVY_SHARE = ("compare",), 0.2
Damage = Callable[[Path, random.Random], str]


def make_run(folder: Path) -> Path:
    """Return a finished run, as a session on simulated devices takes it."""
    folder.mkdir(parents=True, exist_ok=True)
    rig_file, session = small_rig(folder), small_session()
    (folder / "rig.toml").write_text("# the rig file\n" * 20)
    take_session(rig_file, session, folder / "run", files={"rig": folder / "rig.toml"})
    return folder / "run"


def damaged_copy(run: Path, out: Path, case: random.Random) -> str:
    """Make a copy of a run with one damage; return what was done."""
    shutil.copytree(run, out)
    return case.choice(_DAMAGES)(out, case)


def fault(run: Path, whole: Path, reader: tuple[str, ...] | None) -> str | None:
    """Return what was let pass in a damaged run by `verify` and one reader (None: the Python interface), or None."""
    is_same = _is_same(run, whole)
    if not is_same and verification_of(run).state == "whole":
        return "verify calls it whole"
    said = _said_by_python(run) if reader is None else _said_by(reader, run)
    if reader is not None and "--contents" in reader:
        is_same = is_same or _has_same_labels(run, whole)  # it looks into no frame
    if said is None or is_same or any(word in said for word in _SAYING):
        return None
    return f"{'open_run' if reader is None else ' '.join(reader)} gives numbers and says nothing"


def _said_by(reader: tuple[str, ...], run: Path) -> str | None:
    """Return what a command says beside its numbers; None where it gives none."""
    err = io.StringIO()
    words = [
        str(run) if word == "RUN" else str(run.parent / word) if word.startswith("OUT") else word for word in reader
    ]
    words = [str(run.parent / word) if word.endswith(".toml") and "/" not in word else word for word in words]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(err):
        code = cli.main([*words])
    for left in run.parent.glob("OUT*"):
        shutil.rmtree(left) if left.is_dir() else left.unlink()
    if code not in (0, 2, 3, 4, 5):
        return f"exit {code}"
    return err.getvalue() if code in (0, 5) else None


def _said_by_python(run: Path) -> str | None:
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            rigctl.open_run(run).frames()
        except (DataError, ConfigError):
            return None
    return " ".join(str(one.message) for one in said)


def _is_same(run: Path, whole: Path) -> bool:
    """Return whether frames, labels and the set of frames are what they were."""
    before = read_run(whole)
    try:
        now = read_run(run)
        if not _has_same_labels(run, whole):
            return False
        return all(np.array_equal(now.counts(one), before.counts(one)) for one in now.frames)
    except DataError:
        return False


def _has_same_labels(run: Path, whole: Path) -> bool:
    try:
        now, before = read_run(run), read_run(whole)
    except DataError:
        return False
    return (now.frames, now.session_json) == (before.frames, before.session_json)


def _files(run: Path) -> list[Path]:
    return sorted(file for file in run.rglob("*") if file.is_file() and file.name not in _LOOSE)


def _bit(run: Path, case: random.Random) -> str:
    file = case.choice(_files(run))
    data = bytearray(file.read_bytes())
    place, bit = case.randrange(len(data)), case.randrange(8)
    data[place] ^= 1 << bit
    file.write_bytes(data)
    return f"bit {bit} of byte {place} of {file.relative_to(run)}"


def _cut(run: Path, case: random.Random) -> str:
    file = case.choice(_files(run))
    length = case.randrange(file.stat().st_size)
    file.write_bytes(file.read_bytes()[:length])
    return f"{file.relative_to(run)} cut to {length} bytes"


def _cut_line(run: Path, case: random.Random) -> str:
    file = case.choice([run / "manifest.jsonl", run / "events.jsonl"])
    lines = file.read_bytes().splitlines(keepends=True)
    number = case.randrange(len(lines))
    file.write_bytes(b"".join(lines[:number] + lines[number + 1 :]))
    return f"line {number} of {file.name} taken out"


def _swap_lines(run: Path, case: random.Random) -> str:
    file = run / "manifest.jsonl"
    lines = file.read_bytes().splitlines(keepends=True)
    one, other = case.sample(range(len(lines)), 2)
    lines[one], lines[other] = lines[other], lines[one]
    file.write_bytes(b"".join(lines))
    return f"lines {one} and {other} of {file.name} swapped"


def _swap_frames(run: Path, case: random.Random) -> str:
    one, other = case.sample(sorted((run / "frames").iterdir()), 2)
    first, second = one.read_bytes(), other.read_bytes()
    one.write_bytes(second)
    other.write_bytes(first)
    return f"{one.name} and {other.name} swapped"


def _delete(run: Path, case: random.Random) -> str:
    file = case.choice(_files(run))
    file.unlink()
    return f"{file.relative_to(run)} deleted"


def _delete_with_line(run: Path, case: random.Random) -> str:
    file = case.choice(sorted((run / "frames").iterdir()))
    file.unlink()
    manifest = run / "manifest.jsonl"
    lines = manifest.read_bytes().splitlines(keepends=True)
    manifest.write_bytes(b"".join(line for line in lines if file.name.encode() not in line))
    return f"{file.name} and its line deleted"


def _add(run: Path, case: random.Random) -> str:
    file = case.choice(_files(run))
    addition = case.randbytes(case.randint(1, 300))
    file.write_bytes(file.read_bytes() + addition)
    return f"{len(addition)} bytes added to {file.relative_to(run)}"


def _add_line_again(run: Path, case: random.Random) -> str:
    file = case.choice([run / "manifest.jsonl", run / "events.jsonl"])
    lines = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(file.read_bytes() + case.choice(lines))
    return f"a line of {file.name} stands again"


def _add_frame(run: Path, case: random.Random) -> str:
    file = case.choice(sorted((run / "frames").iterdir()))
    (run / "frames" / "000900_scene_a000.fits").write_bytes(file.read_bytes())
    return f"{file.name} stands again under another name"


_DAMAGES: tuple[Damage, ...] = (
    _bit,
    _cut,
    _cut_line,
    _swap_lines,
    _swap_frames,
    _delete,
    _delete_with_line,
    _add,
    _add_line_again,
    _add_frame,
)


def faults(cases: int, *, seed: int, folder: Path) -> list[str]:
    """Return what was let pass in so many damaged runs."""
    whole, found = make_run(folder), []
    for number in range(cases):
        out = folder / f"case-{number}"
        case = random.Random(f"{seed}-{number}")
        done = damaged_copy(whole, out, case)
        reader = _READERS[number % len(_READERS)]
        if reader is not None and reader[0] in _HEAVY and case.random() > _HEAVY_SHARE:
            reader = None
        problem = fault(out, whole, reader)
        if problem is not None:
            found.append(f"case {number} of seed {seed}: {done}: {problem}")
        shutil.rmtree(out)
    return found


def run_damaged(*, cases: int = 500, seed: int = 1) -> bool:
    """Run the trial; return whether nothing was let pass."""
    with tempfile.TemporaryDirectory() as folder:
        found = faults(cases, seed=seed, folder=Path(folder))
    for text in found:
        print(text)
    print(f"{cases} damaged runs, {len(found)} let pass")
    return not found
