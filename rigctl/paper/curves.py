"""The curves of [MK14] Figs 5 and 7 to 15 with one set of materials."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.paper.airborne import Geometry, Source
from rigctl.paper.rooftop import ANGLES, PANELS
from rigctl.paper.statement import (
    HEIGHTS_M,
    NOISE_FACTORS,
    ROC_NOISE_FACTORS,
    SUNS_DEG,
    VIEWS_DEG,
    PaperScenes,
)

FloatArray = NDArray[np.float64]

FIGURES = (2, *range(5, 16))
_AZIMUTHS_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0)
_SNR = "DoLP SNR of black paint"
_P_FA, _P_D = "probability of false alarm", "probability of detection"


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A line, or points where `marker` says so."""

    label: str
    x: FloatArray
    y: FloatArray
    marker: str = "."
    line: str = "-"


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """Curves over one pair of axes."""

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    log_x: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperFigure:
    """A figure of the paper as the model has it."""

    number: int
    title: str
    panels: tuple[Panel, ...]


def _curve(label: str, x: Sequence[float] | FloatArray, y: Sequence[float] | FloatArray, **look: str) -> Curve:
    return Curve(label=label, x=np.asarray(x, dtype=np.float64), y=np.asarray(y, dtype=np.float64), **look)


def _fig5(scenes: PaperScenes) -> PaperFigure:
    found = scenes.low_light.found
    decibel = 20.0 * np.log10(found.snr)
    panels = tuple(
        Panel(
            title=f"({letter}) {name} of DoLP",
            x_label="SNR of S0 [dB, amplitude]",
            y_label=f"{name} of DoLP",
            curves=(
                _curve("1e4 Poisson draws", decibel, drawn, marker="o", line=""),
                _curve("first order, [MK14]", decibel, first, marker="", line="--"),
                _curve("exact: Poisson to 16 dB, Gaussian above", decibel, exact, marker=""),
            ),
        )
        for letter, name, drawn, first, exact in (
            ("a", "mean", found.drawn_mean, found.first_mean, found.true_mean),
            ("b", "deviation", found.drawn_std, found.first_std, found.true_std),
        )
    )
    return PaperFigure(number=5, title="DoLP under shot noise, S = (1, 0.5, 0.5)", panels=panels)


def _fig7(scenes: PaperScenes) -> PaperFigure:
    angles = [float(angle) for angle in ANGLES]
    panels = tuple(
        Panel(
            title=f"({letter}) {name}",
            x_label="angle of the polarizer [deg]",
            y_label=f"{name} of the counts [DN]",
            curves=tuple(
                _curve(label, angles, [scenes.rooftop.number(panel, f"dn_{a}", statistic).value for a in ANGLES])
                for panel, label in PANELS.items()
            ),
        )
        for letter, name, statistic in (("a", "mean", "mean"), ("b", "deviation", "std"))
    )
    return PaperFigure(number=7, title="counts of the panels: sun 22, view 53, phi 180", panels=panels)


def _fig9(scenes: PaperScenes) -> PaperFigure:
    sources: tuple[tuple[Source, str], ...] = (("reflected", "reflected"), ("path", "upwelling"), ("total", "total"))
    panels = []
    for letter, view in (("a", 10.0), ("b", 50.0)):
        at = [scenes.at(25.0, view, phi) for phi in _AZIMUTHS_DEG]
        snr = scenes.airborne.snr
        curves = [
            _curve(name, _AZIMUTHS_DEG, [snr(one, source=source).value for one in at]) for source, name in sources
        ]
        turned = [snr(one, turned=True).value for one in at]
        curves.append(_curve("total, azimuth of path turned by 180 deg", _AZIMUTHS_DEG, turned, line=":"))
        panels.append(_snr_panel(f"({letter}) sun 25, view {view:g}", "relative azimuth phi [deg]", curves))
    return PaperFigure(number=9, title="parts of the light", panels=tuple(panels))


def _snr_panel(title: str, x_label: str, curves: Sequence[Curve]) -> Panel:
    return Panel(title=title, x_label=x_label, y_label=_SNR, curves=tuple(curves))


def _fig10(scenes: PaperScenes) -> PaperFigure:
    at = [Geometry(sun=50.0, view=50.0, height_m=height) for height in HEIGHTS_M]
    km = [height / 1000.0 for height in HEIGHTS_M]
    parts: tuple[tuple[str, Source, str], ...] = (("a", "reflected", "reflected"), ("b", "total", "total"))
    snr = scenes.airborne.snr
    panels = []
    for letter, source, name in parts:
        curves = [_curve(name, km, [snr(one, source=source).value for one in at])]
        if source == "total":
            turned = [snr(one, turned=True).value for one in at]
            curves.append(_curve("total, azimuth of path turned by 180 deg", km, turned, line=":"))
        panels.append(_snr_panel(f"({letter}) {name} radiance", "height of the camera [km]", curves))
    return PaperFigure(number=10, title="sun 50, view 50, phi 180", panels=tuple(panels))


def _roc(scenes: PaperScenes, title: str, points: Sequence[tuple[str, Geometry]]) -> Panel:
    curves = []
    for label, at in points:
        found = scenes.airborne.roc(at)
        curves.append(_curve(label, found.p_false_alarm, found.p_detection, marker=""))
    return Panel(title=title, x_label=_P_FA, y_label=_P_D, curves=tuple(curves), log_x=True)


def _fig11(scenes: PaperScenes) -> PaperFigure:
    points = [(f"{h / 1000:g} km", Geometry(sun=50.0, view=50.0, height_m=h)) for h in HEIGHTS_M]
    return PaperFigure(number=11, title="ROC by height", panels=(_roc(scenes, "sun 50, view 50, phi 180", points),))


def _fig12(scenes: PaperScenes) -> PaperFigure:
    snr = scenes.airborne.snr
    curves = [
        _curve(f"view {view:g} deg", SUNS_DEG, [snr(scenes.at(sun, view)).value for sun in SUNS_DEG])
        for view in VIEWS_DEG
    ]
    panel = _snr_panel("phi 180", "solar zenith angle [deg]", curves)
    return PaperFigure(number=12, title="DoLP SNR by sun and view", panels=(panel,))


def _fig13(scenes: PaperScenes) -> PaperFigure:
    points = [(f"sun {sun:g}, view {view:g}", scenes.at(sun, view)) for sun in (10.0, 50.0) for view in VIEWS_DEG]
    return PaperFigure(number=13, title="ROC by geometry", panels=(_roc(scenes, "phi 180", points),))


def _fig14(scenes: PaperScenes) -> PaperFigure:
    snr = scenes.airborne.snr
    curves = [
        _curve(f"sun {sun:g} deg", NOISE_FACTORS, [snr(scenes.at(sun, 40.0, kn=kn)).value for kn in NOISE_FACTORS])
        for sun in SUNS_DEG
    ]
    panel = _snr_panel("view 40, phi 180", "noise factor Kn", curves)
    return PaperFigure(number=14, title="DoLP SNR by noise factor", panels=(panel,))


def _fig15(scenes: PaperScenes) -> PaperFigure:
    panels = tuple(
        _roc(
            scenes,
            f"sun 50, view {view:g} (not stated), phi 180",
            [(f"Kn {kn:g}", scenes.at(50.0, view, kn=kn)) for kn in ROC_NOISE_FACTORS],
        )
        for view in VIEWS_DEG
    )
    return PaperFigure(number=15, title="ROC by noise factor", panels=panels)


_MADE: dict[int, Callable[[PaperScenes], PaperFigure]] = {
    5: _fig5, 7: _fig7, 9: _fig9, 10: _fig10, 11: _fig11, 12: _fig12, 13: _fig13, 14: _fig14, 15: _fig15,
}  # fmt: skip


def curves_of(number: int, scenes: PaperScenes, *, as_paper: PaperScenes | None = None) -> PaperFigure | None:
    """Return the curves of a figure; None for Figs 2, 6 and 8, which are pictures and laws.

    Parameters
    ----------
    number : int
        Of the figure.
    scenes : PaperScenes
        Of one set of materials.
    as_paper : PaperScenes or None
        The same computed as the authors did: dashed curves beside the others.
    """
    made = _MADE.get(number)
    if made is None:
        return None
    figure = made(scenes)
    if as_paper is None or number < 9:
        return figure
    other = made(as_paper)
    panels = tuple(
        replace(
            one, curves=(*one.curves, *(replace(c, label=f"{c.label}, as the paper", line="--") for c in two.curves))
        )
        for one, two in zip(figure.panels, other.panels, strict=True)
    )
    return replace(figure, panels=panels)
