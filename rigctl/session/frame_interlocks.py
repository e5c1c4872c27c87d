"""Interlocks on one frame: what must be so before it counts."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.angles import wrapped
from rigctl.files.interlock_section import InterlockSection
from rigctl.session.captured_frame import CapturedFrame
from rigctl.session.interlocks import InterlockViolation


@dataclass(frozen=True, kw_only=True, eq=False)
class Taken:
    """One frame as it came, with what was asked for.

    Attributes
    ----------
    kind : str
        "scene", "dark" or "flat".
    shot : CapturedFrame
        The frame, and how it came about.
    tolerance_deg : float
        How far the readback may be off.
    last_counts : array or None
        The frame before.
    """

    kind: str
    shot: CapturedFrame
    tolerance_deg: float
    last_counts: NDArray[np.uint16] | None


def frame_violations(taken: Taken, section: InterlockSection) -> Iterator[InterlockViolation]:
    """Give every interlock that a frame violates."""
    shot = taken.shot
    yield from _stage_violations(shot, taken.tolerance_deg)
    yield from shot.violations
    if shot.frame.settings != shot.settings:
        text = f"camera: was set to {shot.settings} and took the frame with {shot.frame.settings}"
        yield InterlockViolation(name="settings", message=f"{text}: switch its automatic exposure and gain off")
    if _is_repeated(taken):
        text = f"camera: frame {shot.frame.sequence} is identical to the one before, down to the noise"
        yield InterlockViolation(name="identical", message=f"{text}: it sent an old picture again. Restart the camera")
    if _is_black(taken):
        text = f"camera: frame {shot.frame.sequence} has the value {shot.frame.counts.flat[0]} everywhere"
        yield InterlockViolation(name="black", message=f"{text}: no picture came. Check cable, bandwidth and lens cap")
    elif taken.kind == "scene":
        yield from _light_violations(shot, section)


def _light_violations(shot: CapturedFrame, section: InterlockSection) -> Iterator[InterlockViolation]:
    if shot.saturated_fraction > section.saturated_fraction:
        text = f"{100 * shot.saturated_fraction:.2f} % of the pixels are saturated"
        yield InterlockViolation(
            name="saturated", message=f"{text}, allowed are {100 * section.saturated_fraction:g} %"
        )
    level_dn = section.low_signal_level * (2**shot.frame.settings.bit_depth - 1)
    low = float(np.count_nonzero(shot.frame.counts < level_dn) / shot.frame.counts.size)
    if low > section.low_signal_fraction:
        text = f"{100 * low:.1f} % of the pixels have less than {level_dn:.0f} DN"
        allowed = f"allowed are {100 * section.low_signal_fraction:g} %"
        yield InterlockViolation(name="low_signal", message=f"{text}, {allowed}: expose longer, or bracket")


def _stage_violations(shot: CapturedFrame, tolerance_deg: float) -> Iterator[InterlockViolation]:
    if shot.move is None or not shot.is_new_move:
        return
    move = shot.move
    off_deg = wrapped(move.position.angle_deg - move.target_deg, turn=360.0)
    if abs(off_deg) > tolerance_deg:
        text = f"stage: asked for {move.target_deg:g} deg it stands at {move.position.angle_deg:g} deg"
        yield InterlockViolation(name="angle", message=f"{text}, allowed are {tolerance_deg:g} deg")
    if move.remarks:
        yield InterlockViolation(name="button", message=f"stage: {'; '.join(move.remarks)}: was it touched?")


def _is_repeated(taken: Taken) -> bool:
    """Return whether a picture has the very noise of the last one; one of a single value has none to know it by."""
    counts, last = taken.shot.frame.counts, taken.last_counts
    return last is not None and not _is_flat(counts) and np.array_equal(counts, last)


def _is_black(taken: Taken) -> bool:
    counts = taken.shot.frame.counts
    if taken.kind != "scene":
        return not counts.any()
    is_saturated = counts.flat[0] >= 2**taken.shot.settings.bit_depth - 1
    return _is_flat(counts) and not is_saturated


def _is_flat(counts: NDArray[np.uint16]) -> bool:
    return bool(counts.min() == counts.max())
