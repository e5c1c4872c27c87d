"""The uncertainty budget as bars: what each cause makes of the error of each region's polarization."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from model.prediction.quantity_table import FOLLOWED, QUANTITIES
from rigctl.comparison.uncertainty_budget import FAULTS, RegionBudget
from rigctl.reports.figures.figure_style import png, subplots

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Of S0 the budget is a share of itself.
_TITLES = {name: QUANTITIES[name].label for name in FOLLOWED} | {"s0": "S0 (share of itself)"}
# Colours after Okabe and Ito, told apart by colour-blind readers; hatches tell them apart in grey. A cause has the same
# in every report.
_LOOKS = {
    "shot": ("#0072b2", ""),
    "read": ("#56b4e9", "//"),
    "fixed pattern": ("#009e73", ""),
    "texture": ("#f0e442", "xx"),
    "texture and fixed pattern": ("#f0e442", "xx"),
    "noise and texture": ("#0072b2", "\\\\"),
    "dark level": ("#999999", ""),
    "registration": ("#999999", ".."),
    FAULTS: ("#000000", "//"),
    "repeatability": ("#666666", "xx"),
    "angle": ("#e69f00", "//"),
    "drift": ("#cc79a7", ""),
    "inputs": ("#d55e00", ""),
}
# A cause below this share of the largest of a panel is not drawn to scale but at the edge.
_SHOWN_DECADES = 3.0


def budget_bars(budgets: Sequence[RegionBudget]) -> bytes:
    """Return bars of the standard uncertainty by cause, a panel a quantity, a group a region."""
    quantities = [q for q in _TITLES if any(q in found.parts for found in budgets)]
    causes = list(dict.fromkeys(cause for found in budgets for parts in found.parts.values() for cause in parts))
    height = 0.9 + 0.17 * len(budgets) * (len(causes) + 2)
    figure, axes = subplots(1, len(quantities), size=(2.6 * len(quantities) + 1.2, max(height, 2.6)))
    for ax, quantity in zip(axes, quantities, strict=True):
        _panel(ax, budgets, quantity, causes)
    axes[0].set_yticks(
        [_place(k, len(causes) / 2, causes) for k in range(len(budgets))], [found.region for found in budgets]
    )
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 5), fontsize=8)
    return png(figure)


def _panel(ax: "Axes", budgets: Sequence[RegionBudget], quantity: str, causes: list[str]) -> None:
    values = {
        (k, cause): found.parts.get(quantity, {}).get(cause, 0.0) for k, found in enumerate(budgets) for cause in causes
    }
    most = float(max(np.linalg.norm(list(found.parts.get(quantity, {}).values())) for found in budgets))
    floor = float(10.0 ** (np.floor(np.log10(most)) - _SHOWN_DECADES)) if most > 0.0 else 1e-12
    for place, cause in enumerate(causes):
        at = [_place(k, place + 1, causes) for k in range(len(budgets))]
        widths = [max(values[k, cause], floor) - floor for k in range(len(budgets))]
        ax.barh(
            at,
            widths,
            0.85,
            left=floor,
            color=_LOOKS[cause][0],
            hatch=_LOOKS[cause][1],
            edgecolor="white",
            linewidth=0.0,
            label=cause,
        )
    totals = [float(np.linalg.norm([values[k, cause] for cause in causes])) for k in range(len(budgets))]
    ax.barh(
        [_place(k, 0, causes) for k in range(len(budgets))],
        [max(total, floor) - floor for total in totals],
        0.85,
        left=floor,
        color="black",
        label="all",
    )
    ax.set_xscale("log")
    ax.set_xlim(floor, 3.0 * most if most > 0.0 else 1e-9)
    ax.invert_yaxis()
    ax.set_yticks([])
    ax.set_xlabel(f"std of {_TITLES[quantity]}", fontsize=9)
    ax.tick_params(axis="x", labelsize=8)


def _place(group: int, place: float, causes: list[str]) -> float:
    return group * (len(causes) + 2) + place
