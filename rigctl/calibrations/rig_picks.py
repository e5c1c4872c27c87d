"""Calibrations that the store has for a rig, before any device is opened: picks, and what expires or is missing."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.calibrations.fitness import age_days
from rigctl.calibrations.made_for import MadeFor, made_for_rig
from rigctl.calibrations.picking import Choice, choice_lines, choices_json, choose
from rigctl.calibrations.store import KINDS, CalibrationKind, CalibrationStore, UnreadFile, read_store, store_beside
from rigctl.console.json_text import Json
from rigctl.console.terminal import note, warn
from rigctl.errors import ConfigError
from rigctl.numbers.utc_time import utc_text

if TYPE_CHECKING:
    from rigctl.files.rig_file import RigFile

NONE = Path("none")
# Without these nothing is compared; the others are warned of where the store has had them once.
_NEEDED: tuple[CalibrationKind, ...] = ("noise", "polarizer")
_SOON_DAYS = 14.0
# Clocks of two computers may differ by less.
_CLOCK_DAYS = 0.5


@dataclass(frozen=True, kw_only=True)
class RigPicks:
    """What the store has for a rig: a choice for each kind, and files that cannot be read; None: there is no store."""

    store: Path | None = None
    choices: tuple[Choice, ...] = ()
    damaged: tuple[UnreadFile, ...] = ()

    @property
    def files(self) -> dict[CalibrationKind, Path]:
        """Files that were picked, by kind."""
        return {one.kind: one.pick.file for one in self.choices if one.pick is not None}

    @property
    def lines(self) -> tuple[str, ...]:
        """What was picked and why, a line for each kind of which the store has any."""
        return choice_lines(self.choices, self.damaged)

    def report(self) -> None:
        """Report what was picked; warn where there are calibrations of a kind and none fits."""
        for choice in self.choices:
            if choice.pick is not None:
                note(choice.line)
            elif choice.others:
                warn(choice.line)
        for file in self.damaged:
            note(file.line)

    def as_json(self) -> dict[str, Json]:
        """Return what results say of it; nothing where there is no store."""
        return {} if self.store is None else choices_json(self.choices, self.damaged)


def picked_for_rig(
    rig: "RigFile",
    rig_path: Path,
    *,
    now_ns: int,
    store: Path | None = None,
    named: Mapping[CalibrationKind, Path | None],
) -> RigPicks:
    """Return what the store has for a rig.

    Parameters
    ----------
    rig, rig_path
        The rig file; the store beside it is taken unless another is named.
    now_ns : int
        When frames are to be taken [ns since 1970 UTC].
    store : Path or None
        The store; ``none`` picks nothing.
    named : mapping
        The kinds that can be used; those that have a file are not picked.

    Raises
    ------
    ConfigError
        The store that is named is no folder.
    """
    found = _store(rig_path, store)
    if found is None:
        return RigPicks()
    used = made_for_rig(rig, now_utc=utc_text(now_ns))
    wanted = [kind for kind, path in named.items() if path is None]
    choices = (choose(found, kind, used, require_usable=_usable(kind, rig, used)) for kind in wanted)
    return RigPicks(store=found.folder, choices=tuple(choices), damaged=found.damaged)


def store_doubts(rig: "RigFile", rig_path: Path, *, now_ns: int) -> tuple[str, ...]:
    """Return what the store beside a rig file lacks or what in it expires soon, in words; nothing without a store."""
    store = _store(rig_path, None)
    if store is None:
        return ()
    used = made_for_rig(rig, now_utc=utc_text(now_ns))
    doubts = (doubt for kind in KINDS for doubt in _doubts(store, kind, rig, used))
    return (*doubts, *(one.line for one in store.damaged))


def _store(rig_path: Path, store: Path | None) -> CalibrationStore | None:
    if store is not None and store != NONE and not store.is_dir():
        raise ConfigError(f"--calibrations: {store}: there is no such folder")
    folder = store_beside(rig_path) if store is None else store
    return None if folder is None or folder == NONE else read_store(folder)


def _doubts(store: CalibrationStore, kind: CalibrationKind, rig: "RigFile", used: MadeFor) -> Iterable[str]:
    there = store.of(kind)
    if not there:
        if kind in _NEEDED:
            yield f"{store.folder} has no {kind} calibration"
        return
    choice = choose(store, kind, used, require_usable=_usable(kind, rig, used))
    if choice.pick is None:
        yield choice.line
        return
    made = next(one.made_for for one in there if one.file == choice.pick.file)
    days = age_days(made, used)
    if days is not None and days < -_CLOCK_DAYS:
        yield f"{kind} calibration: {choice.pick.file} is of {-days:.0f} days from now: look at the clock, then and now"
    left = None if days is None or made.valid_days is None else made.valid_days - days
    if left is not None and left < _SOON_DAYS:
        yield f"{kind} calibration: {choice.pick.file} expires in {left:.0f} days: make a new one"


def _usable(kind: CalibrationKind, rig: "RigFile", used: MadeFor) -> Callable[[Path], object] | None:
    """Return what holds a file against the rig; None where its devices and settings are all there is to hold."""
    from rigctl.calibrations.noise.noise_file import read_noise_file, require_noise_fits
    from rigctl.calibrations.polarizer.polarizer_file import read_polarizer_file, require_polarizer_fits

    if kind == "noise":
        return lambda path: require_noise_fits(read_noise_file(path), used)
    if kind == "polarizer":
        return lambda path: require_polarizer_fits(read_polarizer_file(path), used, polarizer=rig.polarizer)
    return None


def picked_for_scene(scene: Path | None, used: MadeFor, store: Path | None, named: Path | None) -> RigPicks:
    """Return the noise calibration that a prediction takes where none is named.

    Parameters
    ----------
    scene : Path or None
        The scene file: the store beside it is taken unless another is named.
    used : MadeFor
        Format and time; a prediction names no camera.
    store : Path or None
        The store; ``none`` picks nothing.
    named : Path or None
        The noise calibration that is named.

    Raises
    ------
    ConfigError
        The store that is named is no folder.
    """
    found = None if named is not None or (store is None and scene is None) else _store(scene or Path(), store)
    if found is None:
        return RigPicks()
    from rigctl.calibrations.noise.noise_file import read_noise_file, require_noise_fits

    choice = choose(found, "noise", used, require_usable=lambda path: require_noise_fits(read_noise_file(path), used))
    return RigPicks(store=found.folder, choices=(choice,), damaged=found.damaged)
