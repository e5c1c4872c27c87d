"""Computed skies kept between runs in the user's cache folder, by the hash of what they were computed from."""

import contextlib
import hashlib
import os
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from model.atmosphere.layers import Layer, ScatteringMatrix
from model.atmosphere.sky import Solver
from model.atmosphere.solver import ModeBlock, Solution, solve
from rigctl.scene.skies.record_codec import NotStorableError, decode, encode, fingerprint

_MAGIC = b"rigctl sky 1 sha256 "
_KINDS: dict[str, type] = {kind.__name__: kind for kind in (Solution, ModeBlock, Layer, ScatteringMatrix)}
# Of one wavelength some 1.5 MB: this holds the skies of eighty sun positions in four wavelengths.
LIMIT_BYTES = 500_000_000


def user_cache_folder() -> Path:
    """Return where this user's computed skies are kept: below XDG_CACHE_HOME, or ~/.cache."""
    stated = os.environ.get("XDG_CACHE_HOME", "")
    base = Path(stated) if Path(stated).is_absolute() else Path.home() / ".cache"
    return base / "rigctl" / "skies"


class SkyStore:
    """Solves an atmosphere, or takes the solution from the folder; stands in for `model.atmosphere.solver.solve`.

    What is taken is checked against its own checksum first; what fails is computed anew. The name of an entry is the
    hash of every input and of the solver's source code.
    """

    def __init__(self, folder: Path, *, solver: Solver = solve, limit_bytes: int = LIMIT_BYTES) -> None:
        self._folder, self._solver, self._limit_bytes = folder, solver, limit_bytes
        self.taken = 0
        self.computed = 0
        self.remarks: list[str] = []

    def __call__(self, layers: tuple[Layer, ...], **settings: Any) -> Solution:
        """Return the solution of an atmosphere; arguments as `model.atmosphere.solver.solve`."""
        try:
            path = self._folder / f"{_key(layers, settings)}.sky"
        except NotStorableError:
            return self._compute(layers, settings)
        kept = self._read(path)
        if kept is not None:
            self.taken += 1
            return kept
        solution = self._compute(layers, settings)
        self._write(path, solution)
        return solution

    def _compute(self, layers: tuple[Layer, ...], settings: dict[str, Any]) -> Solution:
        self.computed += 1
        return self._solver(layers, **settings)

    def _read(self, path: Path) -> Solution | None:
        try:
            data = path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            self.remarks.append(f"computed skies: {path} cannot be read ({error.strerror}); computed anew")
            return None
        solution = _checked(data)
        if solution is None:
            self.remarks.append(f"computed skies: {path} is damaged; computed anew")
            return None
        with contextlib.suppress(OSError):
            os.utime(path)  # the oldest by use goes first when the folder is full
        return solution

    def _write(self, path: Path, solution: Solution) -> None:
        try:
            body = encode(solution)
            self._folder.mkdir(parents=True, exist_ok=True)
            part = path.with_name(f"{path.name}.{os.getpid()}.part")
            # Not flushed: an entry that a power cut spoils fails its checksum.
            part.write_bytes(_MAGIC + hashlib.sha256(body).hexdigest().encode() + b"\n" + body)
            part.replace(path)
            self._make_room()
        except NotStorableError as what:
            self.remarks.append(f"computed skies: {what} in a solution cannot be kept")
        except OSError as error:
            self.remarks.append(f"computed skies: {self._folder} cannot be written ({error.strerror}); nothing is kept")

    def _make_room(self) -> None:
        """Remove the entries that were not used for longest until the rest fits."""
        entries = sorted(
            (path for path in self._folder.iterdir() if path.suffix == ".sky"), key=lambda path: path.stat().st_mtime_ns
        )
        size = sum(path.stat().st_size for path in entries)
        for path in entries:
            if size <= self._limit_bytes:
                return
            size -= path.stat().st_size
            path.unlink()


def _key(layers: tuple[Layer, ...], settings: dict[str, Any]) -> str:
    """Hash of the inputs and of the code that turns them into a solution."""
    return hashlib.sha256((_code_hash() + fingerprint((layers, settings))).encode()).hexdigest()


@cache
def _code_hash() -> str:
    """Hash of the sources of the atmosphere: another version of the solver takes nothing from this one."""
    digest = hashlib.sha256()
    for name, source in sorted(solver_sources().items()):
        digest.update(name.encode() + b"\0" + source.read_bytes() + b"\0")
    return digest.hexdigest()


def solver_sources() -> dict[str, Traversable]:
    """Return every source file that a solution depends on, by its path in the package of the atmosphere."""
    return sources_of(files("model.atmosphere"))


def sources_of(folder: Traversable, prefix: str = "") -> dict[str, Traversable]:
    """Return the sources of a package and of the packages in it, by their paths."""
    found: dict[str, Traversable] = {}
    for entry in folder.iterdir():
        if entry.is_dir():
            found |= sources_of(entry, f"{prefix}{entry.name}/")
        elif entry.name.endswith(".py"):
            found[prefix + entry.name] = entry
    return found


def _checked(data: bytes) -> Solution | None:
    """Solution of an entry, or None where the entry is not whole."""
    head, _, body = data.partition(b"\n")
    if head != _MAGIC + hashlib.sha256(body).hexdigest().encode():
        return None
    try:
        found = decode(body, _KINDS)
    except (KeyError, IndexError, TypeError, ValueError, OSError):
        return None
    return found if isinstance(found, Solution) else None
