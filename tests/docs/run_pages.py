"""Runs the code blocks of pages, each page from top to bottom in a folder of a rig that has been set up.

Usage: python -m tests.docs.run_pages [PAGE ...]; without a page all that have a block to run. Keys of JSON files that
docs/outputs.md does not tell are printed, and are no failure.
"""

import contextlib
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterable, Iterator
from functools import partial
from multiprocessing import Pool
from pathlib import Path

from docs.reference_pages import codes_page, frames_page, keys_page, parameters_page
from rigctl import cli
from tests.docs.blocks import NOT_RUN, ROOT, Block, blocks_of, pages

# Pages of that folder go on from a rig that has been set up; the others begin with nothing but the examples.
_OF_A_RIG = "how-to"


def run_pages(chosen: list[Path]) -> bool:
    """Run pages, print how long each took and every failure, and return whether there is none."""
    failures = 0
    with tempfile.TemporaryDirectory() as scratch, Pool(2) as pool:
        start = make_start(Path(scratch) / "start")
        for text, problems, untold in pool.imap(partial(run_page, start=start), chosen):
            failures += len(problems)
            print(text, *untold, *problems, sep="\n", end="\n" if text else "", flush=True)
    print(f"{failures} failures")
    return not failures


def run_page(page: Path, *, start: Path) -> tuple[str, list[str], list[str]]:
    """Run a page in a copy of the start; return a line on it, empty where nothing runs, what failed, untold keys."""
    blocks = [block for block in blocks_of(page) if runs(block)]
    if not blocks:
        return "", [], []
    begin_s, folder = time.monotonic(), start.parent / f"{page.stem}-{os.getpid()}"
    if page.parent.name == _OF_A_RIG:
        copy_of(start, folder)
    else:
        shutil.copytree(ROOT / "examples", folder / "examples")
    problems, untold = run_blocks(blocks, folder), untold_keys(folder)
    shutil.rmtree(folder)
    return f"{page.relative_to(ROOT)}: {len(blocks)} blocks, {time.monotonic() - begin_s:.1f} s", problems, untold


def runs(block: Block) -> bool:
    """Return whether there is something to run, or to write into a file."""
    return block.mark not in NOT_RUN and (block.language in ("sh", "python") or block.mark == "file")


def untold_keys(folder: Path) -> list[str]:
    """Return the keys of JSON files of a folder that no page of the reference has; names that people gave are none."""
    made = (keys_page(), parameters_page(), frames_page(), codes_page())
    texts = [(ROOT / "docs" / "outputs.md").read_text(encoding="utf-8"), *made]
    words = [word.strip("[]") for text in texts for word in re.findall(r"`([^`\n]+)`", text)]
    told = {part for word in words for part in (word, *word.split("."))}
    given = {name for file in folder.rglob("*.toml") for name in re.findall(r'^name = "(.*)"', file.read_text(), re.M)}
    lacking = {
        key: file.name
        for file in sorted(folder.rglob("*.json"))
        for key in _keys(json.loads(file.read_text(encoding="utf-8")))
        if key not in told | given and not re.match(r"(dn_|ratio_)?[-\d.]+$", key)
    }
    return [f"docs/outputs.md lacks {key!r} of {name}" for key, name in lacking.items()]


def _keys(content: object) -> Iterator[str]:
    """Yield the keys of nested tables."""
    inner: Iterable[object] = content if isinstance(content, list) else ()
    if isinstance(content, dict):
        yield from content
        inner = content.values()
    for one in inner:
        yield from _keys(one)


def make_start(folder: Path) -> Path:
    """Return the folder of `rigctl new --simulated` once its README has been followed, with the examples beside it."""
    with _in(folder.parent):
        _ours(["new", str(folder), "--simulated"])
    problems = run_blocks([block for block in blocks_of(folder / "README.md") if runs(block)], folder)
    if problems:
        raise RuntimeError("\n".join(problems))
    shutil.copytree(ROOT / "examples", folder / "examples")
    return folder


def copy_of(start: Path, folder: Path) -> Path:
    """Return a copy of the start; frames, which nothing changes, are links."""
    shutil.copytree(
        start, folder, copy_function=lambda a, b: os.link(a, b) if a.endswith(".fits") else shutil.copy2(a, b)
    )
    return folder


def run_blocks(blocks: list[Block], folder: Path) -> list[str]:
    """Run blocks in a folder, up to the first that fails; return what is wrong."""
    names: dict[str, object] = {}
    with _in(folder):
        for block in blocks:
            try:
                _run(block, names)
            except Exception:
                return [f"{block.place}: {traceback.format_exc(limit=-3)}"]
    return []


def _run(block: Block, names: dict[str, object]) -> None:
    if block.mark == "file":
        Path(block.note).write_text(block.text, encoding="utf-8")
    elif block.language == "python":
        with contextlib.redirect_stdout(io.StringIO()):
            exec(compile(block.text, block.place, "exec"), names)
    else:
        wanted = int(block.mark.removeprefix("exit ")) if block.mark.startswith("exit") else 0
        for words in block.commands:
            words = [name for word in words for name in _expanded(word)]
            last = words if words == block.commands[-1] else None
            code, said = _ours(words[1:]) if Path(words[0]).name == "rigctl" else _other(words)
            if code != (wanted if last else 0):
                raise RuntimeError(f"{' '.join(words)}\nends with {code}:\n{said}")


def _expanded(word: str) -> list[str]:
    """Return the files that a word with a star stands for; the word itself where there are none, as a shell does."""
    found = sorted(map(str, Path().glob(word))) if "*" in word and not word.startswith("/") else []
    return found or [word]


def _ours(words: list[str]) -> tuple[int, str]:
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = cli.main(words)
    return code, said.getvalue()


def _other(words: list[str]) -> tuple[int, str]:
    if words[0] == "cd":
        os.chdir(words[1])
        return 0, ""
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    return done.returncode, done.stdout + done.stderr


@contextlib.contextmanager
def _in(folder: Path):
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


if __name__ == "__main__":
    os.environ["MPLBACKEND"] = "agg"
    sys.exit(not run_pages([Path(name).resolve() for name in sys.argv[1:]] or pages()))
