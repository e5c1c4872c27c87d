"""The plot of a stage's characterisation."""

import io
from typing import TYPE_CHECKING

from rigctl.devices.characterise import SIDES, Characterisation, Side

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Two colours that a colour-blind reader tells apart, and that differ in grey.
_COLOURS: dict[Side, str] = {"forward": "#0b3c6f", "backward": "#d1701a"}
_DOTS_PER_INCH = 150


def characterisation_png(result: Characterisation) -> bytes:
    """Return a plot as a PNG file: above, readback errors by angle and side; below, how each visit came to rest."""
    from matplotlib.figure import Figure  # half a second, wanted for a plot only

    figure = Figure(figsize=(7.0, 6.5), layout="constrained")
    above, below = figure.subplots(2, 1)
    for side in SIDES:
        _draw_errors(above, result, side)
        _draw_settling(below, result, side)
    title = f"{result.identity.model} {result.identity.serial_number}: backlash {result.backlash_deg:.4f} deg"
    above.set(xlabel="angle [deg]", ylabel="readback - target [deg]", title=title)
    below.axhspan(-result.band_deg, result.band_deg, color="0.9")
    below.axvline(result.settle_s, color="0.5", lw=1, label=f"at rest after {result.settle_s:.2f} s")
    below.set(xlabel="time since the end of the move [s]", ylabel="reading - rest [deg]")
    for axes in (above, below):
        axes.grid(alpha=0.3, lw=0.4)
        axes.legend(fontsize="small")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DOTS_PER_INCH)
    return buffer.getvalue()


def _draw_errors(axes: "Axes", result: Characterisation, side: Side) -> None:
    chosen = [visit for visit in result.visits if visit.side == side]
    angles, errors = [visit.angle_deg for visit in chosen], [visit.error_deg for visit in chosen]
    marker = ">" if side == "forward" else "<"
    axes.plot(angles, errors, marker, ms=5, color=_COLOURS[side], label=side, alpha=0.7)


def _draw_settling(axes: "Axes", result: Characterisation, side: Side) -> None:
    for visit in result.visits:
        if visit.side == side:
            times, offs = zip(*visit.watched, strict=True)
            axes.plot(times, offs, lw=0.8, color=_COLOURS[side], alpha=0.6)
