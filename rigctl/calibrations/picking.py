"""Picking the calibration of a store that fits frames: which one, why, and why not the others."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rigctl.calibrations.fitness import age_days, is_beyond_exposures, is_too_old, misfits, temperature_step_k
from rigctl.calibrations.made_for import MadeFor
from rigctl.calibrations.store import CalibrationKind, CalibrationStore, StoredCalibration, UnreadFile
from rigctl.console.json_text import Json
from rigctl.errors import DataError
from rigctl.storage.bounded_file import sha256_of

# Whether a kind is one of the stage, and whether it depends on gain and format.
_TRAITS: dict[CalibrationKind, tuple[bool, bool]] = {
    "noise": (False, True),
    "polarizer": (True, False),
    "flat": (True, True),
    "radiometric": (False, True),
    "registration": (True, False),
}
_SHOWN = 5


@dataclass(frozen=True, kw_only=True)
class Pick:
    """A calibration that was picked.

    Attributes
    ----------
    kind : str
        Of `rigctl.calibrations.store.KINDS`.
    file : Path
        Where it stands.
    sha256 : str
        Of its content.
    why : str
        Why this one.
    age_days : float or None
        Days between it and the frames, below 0 where it came after; None is not known.
    """

    kind: CalibrationKind
    file: Path
    sha256: str
    why: str
    age_days: float | None

    def as_json(self) -> dict[str, Json]:
        """Return it as results hold it."""
        age = None if self.age_days is None else round(self.age_days, 3)
        return {"file": str(self.file), "sha256": self.sha256, "why": self.why, "age_days": age}


@dataclass(frozen=True, kw_only=True)
class NotPicked:
    """A calibration of the same kind that was not taken, and why; `is_unfit` unless another was merely nearer."""

    kind: CalibrationKind
    file: Path
    reason: str
    is_unfit: bool = True


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What was picked of a kind, None where nothing fits, and what was not."""

    kind: CalibrationKind
    pick: Pick | None
    others: tuple[NotPicked, ...]

    @property
    def line(self) -> str:
        """It in a line that a person reads."""
        if self.pick is not None:
            return f"{self.kind} calibration: {self.pick.file}: {self.pick.why}"
        reasons = "; ".join(f"{one.file.name}: {one.reason}" for one in self.others[-_SHOWN:])
        return f"no {self.kind} calibration: of {len(self.others)} in the store none fits: {reasons}"


def choices_json(choices: Sequence[Choice], damaged: Sequence[UnreadFile]) -> dict[str, Json]:
    """Return what a result says of calibrations where there is a store."""
    not_read: list[Json] = [{"file": str(one.file), "problem": one.problem} for one in damaged]
    return {
        "calibrations": {one.kind: one.pick.as_json() for one in choices if one.pick is not None},
        "calibrations_not_picked": [
            {"kind": one.kind, "file": str(one.file), "reason": one.reason}
            for choice in choices
            for one in choice.others
        ],
        **({"calibrations_not_read": not_read} if not_read else {}),
    }


def choice_lines(choices: Sequence[Choice], damaged: Sequence[UnreadFile]) -> tuple[str, ...]:
    """Return what was picked and why, a line for each kind of which the store has any, and what could not be read."""
    told = (choice.line for choice in choices if choice.pick is not None or choice.others)
    return (*told, *(one.line for one in damaged))


def choose(
    store: CalibrationStore,
    kind: CalibrationKind,
    used: MadeFor,
    *,
    require_usable: Callable[[Path], object] | None = None,
) -> Choice:
    """Return which calibration of a kind fits frames best: the newest that is not younger than they are.

    Parameters
    ----------
    store : CalibrationStore
        What there is.
    kind : str
        Which kind.
    used : MadeFor
        What the frames were, or will be, taken with. What one side does not know is not compared.
    require_usable : callable or None
        Raises DataError where a file cannot be used for the frames after all.

    Notes
    -----
    Refused are other devices and settings, and what is too old. One at the temperature and exposures of use goes before
    one that is not, one whose devices are stated before one that says nothing of them, one before the frames before
    one after them; then the nearest in time.
    """
    unfit: list[NotPicked] = []
    fitting: list[StoredCalibration] = []
    for one in store.of(kind):
        reason = _unfit(one, used)
        if reason is None:
            fitting.append(one)
        else:
            unfit.append(NotPicked(kind=kind, file=one.file, reason=reason))
    fitting.reverse()  # of those that are alike the newest goes first
    ranked = sorted(fitting, key=lambda one: _rank(one, used))
    for place, one in enumerate(ranked):
        try:
            if require_usable is not None:
                require_usable(one.file)
        except DataError as error:
            unfit.append(NotPicked(kind=kind, file=one.file, reason=_short(one.file, error)))
            continue
        rest = tuple(
            NotPicked(kind=kind, file=other.file, reason=_farther(other, used), is_unfit=False)
            for other in ranked[place + 1 :]
        )
        why = _why(one, used, fitting=1 + len(rest), unfit=unfit, store=store)
        same = [other.file.name for other in ranked[place + 1 :] if _rank(other, used) == _rank(one, used)]
        why += f"; taken at the same time: {', '.join(same)}; the last by name is used" if same else ""
        pick = Pick(
            kind=kind, file=one.file, sha256=sha256_of(one.file), why=why, age_days=age_days(one.made_for, used)
        )
        return Choice(kind=kind, pick=pick, others=(*unfit, *rest))
    return Choice(kind=kind, pick=None, others=tuple(unfit))


def _unfit(one: StoredCalibration, used: MadeFor) -> str | None:
    stage, gain = _TRAITS[one.kind]
    wrong = misfits(one.made_for, used, stage=stage, gain=gain)
    if wrong:
        return "; ".join(wrong)
    if is_too_old(one.made_for, used):
        days = age_days(one.made_for, used) or 0.0
        return f"too far in time: {abs(days):.0f} days from the frames, holds for {one.made_for.valid_days:g}"
    return None


def _rank(one: StoredCalibration, used: MadeFor) -> tuple[bool, bool, int, bool, float]:
    made = one.made_for
    days = age_days(made, used)
    stage, _ = _TRAITS[one.kind]
    pairs = [(made.camera_serial, used.camera_serial)] + ([(made.stage_serial, used.stage_serial)] if stage else [])
    silent = sum(calibrated is None and now is not None for calibrated, now in pairs)
    is_of_noise = one.kind == "noise"
    return (
        is_of_noise and temperature_step_k(made, used) is not None,
        is_of_noise and is_beyond_exposures(made, used),
        silent,
        days is None or days < 0.0,
        0.0 if days is None else abs(days),
    )


def _why(
    one: StoredCalibration, used: MadeFor, *, fitting: int, unfit: Sequence[NotPicked], store: CalibrationStore
) -> str:
    days, made = age_days(one.made_for, used), one.made_for
    taken = "at a time that nobody knows" if made.taken_utc is None else made.taken_utc[:10]
    apart = "" if days is None else f", {abs(days):.1f} days {'before' if days >= 0.0 else 'AFTER'} the frames"
    which = (
        "the only one that fits"
        if fitting == 1
        else f"the newest before the frames, of {fitting} of these devices and settings"
    )
    if days is None and fitting > 1:
        which = f"the newest of {fitting}, as the frames do not say when they were taken"
    if days is not None and days < 0.0:
        which = "the nearest, as none that fits came before the frames"
    text = f"{which}: taken {taken}{apart}, holds for {made.valid_days:g} days{_identity(one, used)}"
    refused = Counter(one.reason.partition(":")[0] for one in unfit)
    if refused:
        text += "; refused: " + ", ".join(f"{count} ({reason})" for reason, count in refused.items())
    cameras = {other.made_for.camera_serial for other in store.of(one.kind)} - {None}
    if used.camera_serial is None and len(cameras) > 1:
        text += f"; which camera it will be is not said, and the store has {len(cameras)}"
    return text


def _identity(one: StoredCalibration, used: MadeFor) -> str:
    made = one.made_for
    stage, gain = _TRAITS[one.kind]
    said = [f"camera {made.camera_serial}" if made.camera_serial else "its camera is not stated"]
    said += [f"stage {made.stage_serial}"] if stage and made.stage_serial else []
    said += [f"gain {made.gain_db:g} dB"] if gain and made.gain_db is not None else []
    said += [f"{made.bit_depth} bits"] if gain and made.bit_depth is not None else []
    step_k = temperature_step_k(made, used)
    said += [] if step_k is None or one.kind != "noise" else [f"but {abs(step_k):.1f} K away in temperature"]
    return f"; {', '.join(said)}"


def _farther(one: StoredCalibration, used: MadeFor) -> str:
    days = age_days(one.made_for, used)
    when = "" if days is None else f"{abs(days):.1f} days {'before' if days >= 0.0 else 'after'} the frames: "
    return f"{when}fits, and another is nearer"


def _short(file: Path, error: DataError) -> str:
    return str(error).removeprefix(f"{file}: ").partition("\n")[0]
