"""The faults that redundant angles can show, as directions in the space of what may be wrong with single frames."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Kinds of what may be wrong with one frame, in the order in which parameters stand; then what all frames share.
PER_FRAME = ("throughput", "angle", "dark level", "shift x", "shift y")
SHARED = ("response curvature", "response power law")
# How large faults of rigs are before anything is known (standard deviations), in the units of the parameters.
_THROUGHPUT, _ANGLE_RAD, _DARK_SHARE, _SHIFT_PIXELS, _CURVATURE, _POWER = 0.02, 0.0175, 0.01, 0.7, 0.2, 0.15
# Planes of a mosaic lie a quarter of their pixel to each side.
_PLANES_PIXELS = 0.25
# Of explanations that fit alike, what the pair sums say in any case is said first. A dark level of one frame alone is
# rare, and two frames off by opposite shares, where one turned polarizer does the same, rarer.
_PAIRS_LOG_ODDS, _DARK_LOG_ODDS, _WITHIN_LOG_ODDS = 4.0, -0.7, -2.0
# Of angles that are the same, or a quarter turn apart, to the resolution of what people write [rad].
_SAME_RAD = np.radians(0.5)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cause:
    """One thing that may be wrong.

    Attributes
    ----------
    name
        Its kind, such as "throughput".
    frame
        Number of the frame; None if several frames are meant.
    frames
        All that it changes.
    unit
        Of its value as it is printed.
    directions : (P, Q) array
        One unit of it in the parameters of single frames; Q is 2 for a shift.
    expected : (Q,) array
        How large it is in rigs (standard deviation).
    log_odds
        Of meeting it, before anything is known.
    is_fault
        False of how a camera is built: said after what is wrong.
    """

    name: str
    frame: int | None
    frames: tuple[int, ...]
    unit: str
    directions: FloatArray
    expected: FloatArray
    log_odds: float = 0.0
    is_fault: bool = True


def parameter_count(frames: int) -> int:
    """Return the number of parameters of single frames and of the response."""
    return len(PER_FRAME) * frames + len(SHARED)


def place(kind: str, frame: int, frames: int) -> int:
    """Return where a parameter stands: of one frame, or (frame 0) of all."""
    if kind in SHARED:
        return len(PER_FRAME) * frames + SHARED.index(kind)
    return PER_FRAME.index(kind) * frames + frame


def known_causes(angles_rad: FloatArray, order: Sequence[float], *, light: float) -> tuple[Cause, ...]:
    """Return every fault that is looked for in frames at some angles.

    Parameters
    ----------
    angles_rad
        Angles over the whole turn, shape (N,) [rad].
    order
        Mean time of each frame, in any unit; frames of the same time show no drift.
    light
        Mean counts [DN], which a dark level is held against.
    """
    frames = len(angles_rad)
    return (
        *_of_single_frames(frames, light),
        *_of_pairs(angles_rad),
        *_of_mosaics(angles_rad),
        *_of_all(frames),
        *_of_time(np.asarray(order, dtype=np.float64)),
        *_of_whole_turns(angles_rad),
    )


def _of_single_frames(frames: int, light: float) -> Iterator[Cause]:
    kinds = (
        ("throughput", _THROUGHPUT, "share", 0.0),
        ("angle", _ANGLE_RAD, "rad", 0.0),
        ("dark level", _DARK_SHARE * light, "DN", _DARK_LOG_ODDS),
    )
    for kind, expected, unit, log_odds in kinds:
        for frame in range(frames):
            one = _cause(kind, [(place(kind, frame, frames), 1.0)], expected, unit, frames, frame=frame)
            yield replace(one, log_odds=log_odds)
    for frame in range(frames):
        along = [_unit_vector(place(kind, frame, frames), frames) for kind in ("shift x", "shift y")]
        yield Cause(
            name="shift",
            frame=frame,
            frames=(frame,),
            unit="pixel",
            directions=np.column_stack(along),
            expected=np.full(2, _SHIFT_PIXELS),
        )


def _of_pairs(angles_rad: FloatArray) -> Iterator[Cause]:
    """Give the light of orthogonal pairs against one another, and of the two of a pair."""
    frames, quarter = len(angles_rad), np.pi / 2
    groups = _groups(angles_rad, quarter)
    complete = [group for group in groups if len(_groups(angles_rad[group], np.pi)) == 2]
    if len(groups) > 1 and len(complete) == len(groups):
        for group in groups[: 1 if len(groups) == 2 else None]:
            others = [frame for frame in range(frames) if frame not in group]
            shares = dict.fromkeys(group, 0.5) | dict.fromkeys(others, -0.5)
            one = None if len(groups) == 2 else int(group[0])
            yield _of_throughputs(
                "throughput of pairs", shares, frames, 2**0.5 * _THROUGHPUT, frame=one, log_odds=_PAIRS_LOG_ODDS
            )
    for group in complete:
        halves = _groups(angles_rad[group], np.pi)
        shares = {int(group[at]): sign for half, sign in zip(halves, (0.5, -0.5), strict=True) for at in half}
        yield _of_throughputs(
            "throughput within a pair",
            shares,
            frames,
            2**0.5 * _THROUGHPUT,
            frame=int(group[0]),
            log_odds=_WITHIN_LOG_ODDS,
        )


def _of_mosaics(angles_rad: FloatArray) -> Iterator[Cause]:
    """Give opposite shifts of the two of each pair, as the four planes of a mosaic of polarizers lie."""
    frames = len(angles_rad)
    pairs = _groups(angles_rad, np.pi / 2)
    if frames != 4 or [len(pair) for pair in pairs] != [2, 2] or len(_groups(angles_rad, np.pi)) < frames:
        return
    moved = np.zeros((parameter_count(frames), 4))
    for number, (one, other) in enumerate(pairs):
        for way, kind in enumerate(("shift x", "shift y")):
            moved[place(kind, int(one), frames), 2 * number + way] = 1.0
            moved[place(kind, int(other), frames), 2 * number + way] = -1.0
    yield Cause(
        name="planes of a mosaic",
        frame=None,
        frames=tuple(range(frames)),
        unit="pixel",
        directions=moved,
        expected=np.full(4, _PLANES_PIXELS),
        is_fault=False,
    )


def _of_all(frames: int) -> Iterator[Cause]:
    for kind, expected in zip(SHARED, (_CURVATURE, _POWER), strict=True):
        unit = "share at the mean light" if kind == "response curvature" else "exponent - 1"
        yield _cause(kind, [(place(kind, 0, frames), 1.0)], expected, unit, frames)


def _of_time(order: FloatArray) -> Iterator[Cause]:
    span = float(np.ptp(order))
    if span > 0.0:
        late = (order - order.mean()) / span
        yield _of_throughputs("drift", dict(enumerate(late)), len(order), _THROUGHPUT)


def _of_whole_turns(angles_rad: FloatArray) -> Iterator[Cause]:
    """Give what comes once a turn and not twice: a wedge in the light and a wobble of the picture."""
    frames = len(angles_rad)
    if len(_groups(angles_rad, 2 * np.pi)) < len(_groups(angles_rad, np.pi)) + 2:
        return
    once = np.array([np.cos(angles_rad), np.sin(angles_rad)])
    yield Cause(
        name="wedge",
        frame=None,
        frames=tuple(range(frames)),
        unit="share",
        directions=np.vstack([once.T, np.zeros((parameter_count(frames) - frames, 2))]),
        expected=np.full(2, _THROUGHPUT),
    )
    moved = np.zeros((parameter_count(frames), 4))
    for column, kind in enumerate(("shift x", "shift y")):
        start = place(kind, 0, frames)
        moved[start : start + frames, 2 * column : 2 * column + 2] = once.T
    yield Cause(
        name="wobble",
        frame=None,
        frames=tuple(range(frames)),
        unit="pixel",
        directions=moved,
        expected=np.full(4, _SHIFT_PIXELS),
    )


def _of_throughputs(
    name: str,
    shares: dict[int, float],
    frames: int,
    expected: float,
    *,
    frame: int | None = None,
    log_odds: float = 0.0,
) -> Cause:
    parts = [(place("throughput", index, frames), share) for index, share in shares.items()]
    cause = _cause(name, parts, expected, "share", frames, frame=frame, changed=tuple(shares))
    return replace(cause, log_odds=log_odds)


def _cause(
    name: str,
    parts: Sequence[tuple[int, float]],
    expected: float,
    unit: str,
    frames: int,
    *,
    frame: int | None = None,
    changed: tuple[int, ...] | None = None,
) -> Cause:
    direction = np.zeros(parameter_count(frames))
    for at, size in parts:
        direction[at] = size
    all_changed = tuple(range(frames)) if frame is None else (frame,)
    return Cause(
        name=name,
        frame=frame,
        frames=changed or all_changed,
        unit=unit,
        directions=direction[:, None],
        expected=np.array([expected]),
    )


def _unit_vector(at: int, frames: int) -> FloatArray:
    vector = np.zeros(parameter_count(frames))
    vector[at] = 1.0
    return vector


def _groups(angles_rad: FloatArray, period_rad: float) -> list[NDArray[np.intp]]:
    """Return the numbers of the angles that are the same modulo a period."""
    left, groups = list(range(len(angles_rad))), []
    while left:
        apart = np.mod(angles_rad[left] - angles_rad[left[0]] + period_rad / 2, period_rad) - period_rad / 2
        group = [frame for frame, distance in zip(left, apart, strict=True) if abs(distance) < _SAME_RAD]
        groups.append(np.array(group))
        left = [frame for frame in left if frame not in group]
    return groups
