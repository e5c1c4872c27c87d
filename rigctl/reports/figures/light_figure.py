"""Light of regions by where it comes from, as bars."""

from collections.abc import Mapping

import numpy as np

from model.scene.field_light import FieldLight, Source
from rigctl.reports.figures.figure_style import png, subplots
from rigctl.reports.tables.light_tables import PARTS

# What adds up to the light at the aperture, with its colour.
_SUMMANDS: dict[Source, str] = {"reflected_sun": "#e69f00", "reflected_sky": "#56b4e9", "path": "#999999"}
_COMPONENTS = ("S0", "S1", "S2")


def light_figure(lights: Mapping[str, FieldLight]) -> bytes:
    """Return the parts of the light of each region as bars, a panel a Stokes parameter; the stroke is the total."""
    figure, axes = subplots(1, 3, size=(11.0, 1.4 + 0.5 * len(lights)))
    names = list(lights)
    for component, ax in enumerate(axes):
        values = {part: np.array([light.mean(part)[component] for light in lights.values()]) for part in _SUMMANDS}
        up, down = np.zeros(len(names)), np.zeros(len(names))
        for part, colour in _SUMMANDS.items():
            # Parts of opposite sign stand on opposite sides of zero.
            left = np.where(values[part] >= 0.0, up, down)
            ax.barh(names, values[part], left=left, color=colour, label=PARTS[part], height=0.6)
            up, down = up + np.maximum(values[part], 0.0), down + np.minimum(values[part], 0.0)
        ax.plot(up + down, names, linestyle="none", marker="|", markersize=16, color="black", label="total")
        ax.axvline(0.0, color="0.3", linewidth=0.8)
        ax.set_xlabel(f"{_COMPONENTS[component]} [W m-2 sr-1]")
        ax.invert_yaxis()
        ax.tick_params(labelleft=component == 0)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4, fontsize=8)
    return png(figure)
