"""Gain, read noise, dark current and axis through the years, with control limits."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from rigctl.numbers.utc_time import utc_moment
from rigctl.reports.figures.figure_style import png

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from rigctl.calibrations.history import History

_TITLES = {
    "gain_dn_per_e": "gain [DN per electron]",
    "read_noise_e": "read noise [electrons]",
    "dark_current_e_per_s": "dark current [electrons/s]",
    "offset_deg": "axis: offset of the polarizer [deg]",
}
_COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:purple", "tab:brown", "tab:cyan")


def history_png(histories: "Sequence[History]") -> bytes:
    """Return the picture: one panel a quantity, one colour a device, points outside the limits ringed in red."""
    quantities = [name for name in _TITLES if any(one.quantity == name for one in histories)]
    figure = Figure(figsize=(9.0, 2.6 * len(quantities) + 0.6), layout="constrained")
    panels = figure.subplots(len(quantities), 1, sharex=True, squeeze=False)[:, 0]
    for axes, quantity in zip(panels, quantities, strict=True):
        of_quantity = [one for one in histories if one.quantity == quantity]
        for place, one in enumerate(of_quantity):
            _draw(axes, one, _COLOURS[place % len(_COLOURS)])
        axes.set_ylabel(_TITLES[quantity], fontsize=8)
        axes.grid(visible=True, alpha=0.3)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7, frameon=False)
    panels[0].set_title("dashed: control limits by the stated errors; ringed: outside them", fontsize=8, loc="left")
    panels[-1].set_xlabel("when the frames were taken (UTC)")
    for label in panels[-1].get_xticklabels():
        label.set_rotation(20)
    return png(figure)


def _draw(axes: "Axes", one: "History", colour: str) -> None:
    times = np.array([utc_moment(point.utc).replace(tzinfo=None) for point in one.points], dtype="datetime64[s]")
    values = [point.value for point in one.points]
    drift = "" if one.drift_per_year is None else f"\n{one.drift_per_year:+.2g} +- {one.drift_error:.1g} a year"
    axes.errorbar(
        times, values, [point.std_error for point in one.points], fmt="o-", ms=4, lw=0.8, color=colour, capsize=2,
        label=one.device + drift,
    )  # fmt: skip
    lower, upper = zip(*(point.limits for point in one.points), strict=True)
    axes.plot(times, lower, "--", lw=0.7, color=colour)
    axes.plot(times, upper, "--", lw=0.7, color=colour)
    outside = np.array([not point.is_inside for point in one.points])
    axes.plot(times[outside], np.array(values)[outside], "o", ms=10, mfc="none", mec="tab:red")
