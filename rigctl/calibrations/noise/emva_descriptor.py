"""The descriptor file of an EMVA 1288 data set: which image was taken at which exposure and light."""

from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Literal

from rigctl.errors import ConfigError
from rigctl.numbers.number_range import range_problem
from rigctl.storage.bounded_file import MOST_TEXT_BYTES, read_bounded

_S_PER_NS = 1e-9
_COMMENT = "#"


@dataclass(frozen=True, kw_only=True)
class EmvaGroup:
    """Images of one exposure and one light.

    Attributes
    ----------
    kind : {"dark", "flat"}
        A ``d`` or a ``b`` line.
    exposure_s : float
        Exposure time [s].
    photons : float or None
        Mean photons a pixel, as stated; None for dark images.
    files : tuple of Path
        In the order of the descriptor.
    """

    kind: Literal["dark", "flat"]
    exposure_s: float
    photons: float | None
    files: tuple[Path, ...]


@dataclass(frozen=True, kw_only=True)
class EmvaDescriptor:
    """An EMVA 1288 data set.

    Attributes
    ----------
    bit_depth : int
        Bits per sample.
    width, height : int
        Pixels.
    groups : tuple of EmvaGroup
        In the order of the descriptor.
    """

    bit_depth: int
    width: int
    height: int
    groups: tuple[EmvaGroup, ...]


def read_emva_descriptor(path: Path) -> EmvaDescriptor:
    """Return what an EMVA 1288 descriptor says, once all of it has been found right.

    Parameters
    ----------
    path : Path
        Text file of lines ``v VERSION``, ``n BITS WIDTH HEIGHT``, ``b NANOSECONDS PHOTONS``, ``d NANOSECONDS`` and
        ``i FILE``; a file belongs to the ``b`` or ``d`` line above it. Lines that begin with ``#`` are comments.
        File names are relative to the descriptor, with slashes or backslashes, and stay within its folder.

    Raises
    ------
    ConfigError
        The file cannot be read, or is wrong: every problem with its line.

    References
    ----------
    EMVA1288/emva1288 on GitHub, data set format.
    """
    try:
        text = read_bounded(path, MOST_TEXT_BYTES).decode("utf-8", errors="replace")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    reader = _Reader(folder=path.parent)
    for number, line in enumerate(text.splitlines(), start=1):
        reader.read(number, line.strip())
    return reader.finish(path)


def _lies_within(file: Path, folder: Path) -> bool:
    try:
        return file.resolve().is_relative_to(folder)
    except (OSError, RuntimeError, ValueError):  # links in a circle, a name that is too long or no name at all
        return False


@dataclass
class _OpenGroup:
    line: int
    kind: Literal["dark", "flat"]
    exposure_s: float
    photons: float | None
    files: list[Path] = field(default_factory=list)


class _Reader:
    """Takes the lines one by one and keeps every problem."""

    def __init__(self, *, folder: Path) -> None:
        self._folder, self._resolved_folder = folder, folder.resolve()
        self._problems: list[str] = []
        self._size: tuple[int, int, int] | None = None
        self._groups: list[_OpenGroup] = []
        self._first_use: dict[Path, int] = {}

    def read(self, number: int, line: str) -> None:
        if not line or line.startswith(_COMMENT):
            return
        tag, _, rest = line.partition(" ")
        readers = {"v": self._version, "n": self._image_size, "b": self._bright, "d": self._dark, "i": self._image}
        if tag not in readers:
            self._problem(number, f"{line!r} begins with {tag!r}; allowed are {', '.join(readers)} and {_COMMENT}")
            return
        readers[tag](number, rest.strip())

    def finish(self, path: Path) -> EmvaDescriptor:
        if self._size is None and not any(": n " in problem for problem in self._problems):
            self._problems.append("there is no line `n BITS WIDTH HEIGHT`")
        self._problems += [f"line {group.line}: no image follows" for group in self._groups if not group.files]
        self._problems += [
            f"there is no {what}"
            for what, kind in (("bright group (line `b NANOSECONDS PHOTONS`)", "flat"), ("dark group (`d`)", "dark"))
            if not any(group.kind == kind for group in self._groups)
        ]
        if self._problems or self._size is None:
            count = "1 problem" if len(self._problems) == 1 else f"{len(self._problems)} problems"
            raise ConfigError("\n  ".join([f"{path}: {count}", *self._problems]))
        bit_depth, width, height = self._size
        groups = tuple(
            EmvaGroup(kind=g.kind, exposure_s=g.exposure_s, photons=g.photons, files=tuple(g.files))
            for g in self._groups
        )
        return EmvaDescriptor(bit_depth=bit_depth, width=width, height=height, groups=groups)

    def _problem(self, number: int, text: str) -> None:
        self._problems.append(f"line {number}: {text}")

    def _numbers(self, number: int, text: str, *, names: tuple[str, ...]) -> list[float] | None:
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            values = []
        if len(values) != len(names) or not all(value >= 0.0 and range_problem(value) is None for value in values):
            self._problem(number, f"{text!r} has to be {len(names)} numbers, none below 0: {', '.join(names)}")
            return None
        return values

    def _version(self, number: int, text: str) -> None:
        self._numbers(number, text, names=("version",))

    def _image_size(self, number: int, text: str) -> None:
        values = self._numbers(number, text, names=("n bits", "width", "height"))
        if values is None:
            return
        if self._size is not None:
            self._problem(number, "n stands a second time")
        if not 1 <= values[0] <= 16 or min(values[1:]) < 1 or any(value % 1 for value in values):
            self._problem(
                number, f"n {text} is not 1 to 16 bits, and width and height of at least 1, all whole numbers"
            )
            return
        self._size = (int(values[0]), int(values[1]), int(values[2]))

    def _bright(self, number: int, text: str) -> None:
        values = self._numbers(number, text, names=("exposure in nanoseconds", "photons per pixel"))
        exposure_ns, photons = values or (0.0, 0.0)
        self._groups.append(_OpenGroup(line=number, kind="flat", exposure_s=exposure_ns * _S_PER_NS, photons=photons))

    def _dark(self, number: int, text: str) -> None:
        values = self._numbers(number, text, names=("exposure in nanoseconds",))
        exposure_s = values[0] * _S_PER_NS if values else 0.0
        self._groups.append(_OpenGroup(line=number, kind="dark", exposure_s=exposure_s, photons=None))

    def _image(self, number: int, text: str) -> None:
        if not self._groups:
            self._problem(number, f"image {text!r} stands before any b or d line")
            return
        file = self._folder / PurePosixPath(text.replace("\\", "/"))
        if not _lies_within(file, self._resolved_folder):
            self._problem(number, f"image {text!r} lies outside of the descriptor's folder; a data set has its own")
            return
        if file in self._first_use:
            self._problem(number, f"image {text!r} is listed a second time (first in line {self._first_use[file]})")
        elif not file.is_file():
            self._problem(number, f"image {text!r}: there is no such file ({file})")
        self._first_use.setdefault(file, number)
        self._groups[-1].files.append(file)
