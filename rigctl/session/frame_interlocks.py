"""Interlocks on one frame: what must be so before it counts."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.files.interlock_section import InterlockSection
from rigctl.numbers.angles import wrapped
from rigctl.session.captured_frame import CapturedFrame
from rigctl.session.interlocks import InterlockViolation


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameAsTaken:
    """One frame as it came, with what was asked for.

    Attributes
    ----------
    kind : str
        "scene", "dark" or "flat".
    captured : CapturedFrame
        The frame, and how it came about.
    tolerance_deg : float
        How far the readback may be off.
    last_counts : array or None
        The frame before.
    """

    kind: str
    captured: CapturedFrame
    tolerance_deg: float
    last_counts: NDArray[np.uint16] | None


def frame_violations(taken: FrameAsTaken, section: InterlockSection) -> Iterator[InterlockViolation]:
    """Give every interlock that a frame violates."""
    captured = taken.captured
    yield from _stage_violations(captured, taken.tolerance_deg)
    yield from captured.violations
    if captured.frame.settings != captured.settings:
        text = f"camera: was set to {captured.settings} and took the frame with {captured.frame.settings}"
        yield InterlockViolation(name="settings", message=f"{text}: switch its automatic exposure and gain off")
    if _is_stale(taken):
        text = f"camera: frame {captured.frame.sequence} is identical to the one before, down to the noise"
        yield InterlockViolation(name="identical", message=f"{text}: it sent an old picture again. Restart the camera")
    if _is_blank(taken):
        text = f"camera: frame {captured.frame.sequence} has the value {captured.frame.counts.flat[0]} everywhere"
        yield InterlockViolation(name="black", message=f"{text}: no picture came. Check cable, bandwidth and lens cap")
    elif taken.kind == "scene":
        yield from _light_violations(captured, section)


def _light_violations(captured: CapturedFrame, section: InterlockSection) -> Iterator[InterlockViolation]:
    if captured.saturated_fraction > section.saturated_fraction:
        text = f"{100 * captured.saturated_fraction:.2f} % of the pixels are saturated"
        yield InterlockViolation(
            name="saturated", message=f"{text}, allowed are {100 * section.saturated_fraction:g} %"
        )
    level_dn = section.low_signal_level * (2**captured.frame.settings.bit_depth - 1)
    low = float(np.count_nonzero(captured.frame.counts < level_dn) / captured.frame.counts.size)
    if low > section.low_signal_fraction:
        text = f"{100 * low:.1f} % of the pixels have less than {level_dn:.0f} DN"
        allowed = f"allowed are {100 * section.low_signal_fraction:g} %"
        yield InterlockViolation(name="low_signal", message=f"{text}, {allowed}: expose longer, or bracket")


def _stage_violations(captured: CapturedFrame, tolerance_deg: float) -> Iterator[InterlockViolation]:
    if captured.move is None or not captured.is_new_move:
        return
    move = captured.move
    off_deg = wrapped(move.position.angle_deg - move.target_deg, turn=360.0)
    if abs(off_deg) > tolerance_deg:
        text = f"stage: asked for {move.target_deg:g} deg it stands at {move.position.angle_deg:g} deg"
        yield InterlockViolation(name="angle", message=f"{text}, allowed are {tolerance_deg:g} deg")
    if move.remarks:
        yield InterlockViolation(name="button", message=f"stage: {'; '.join(move.remarks)}: was it touched?")


def _is_stale(taken: FrameAsTaken) -> bool:
    """Return whether a picture has the very noise of the last one; one of a single value has none to know it by."""
    counts, last = taken.captured.frame.counts, taken.last_counts
    return last is not None and not _is_flat(counts) and np.array_equal(counts, last)


def _is_blank(taken: FrameAsTaken) -> bool:
    counts = taken.captured.frame.counts
    if taken.kind != "scene":
        return not counts.any()
    is_saturated = counts.flat[0] >= 2**taken.captured.settings.bit_depth - 1
    return _is_flat(counts) and not is_saturated


def _is_flat(counts: NDArray[np.uint16]) -> bool:
    return bool(counts.min() == counts.max())
