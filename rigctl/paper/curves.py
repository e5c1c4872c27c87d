"""The curves of [MK14] Figs 5 and 7 to 15 with one set of materials."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.paper.scenes import (
    ANGLES,
    HEIGHTS_M,
    NOISE_FACTORS,
    P_FALSE_ALARM,
    PANELS,
    ROC_NOISE_FACTORS,
    SUNS_DEG,
    VIEWS_DEG,
    Geometry,
    PaperScenes,
    Source,
)
from rigctl.paper.statements import ALL_DETECTED, UNPOLARIZED_SNR

FloatArray = NDArray[np.float64]

FIGURES = (2, *range(5, 16))
_AZIMUTHS_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0)
_P_FA, _P_D, _P_MISS = "probability of false alarm", "probability of detection", "probability of a miss"


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
    """Curves over one pair of axes; the letter is the paper's."""

    letter: str
    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    log_x: bool = False
    log_y: bool = False


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
            letter=letter,
            title=f"({letter}) {name} of DoLP",
            x_label="SNR of S0 [dB, amplitude]",
            y_label=f"{name} of DoLP",
            curves=(
                _curve("1e4 Poisson draws", decibel, drawn, marker="o", line=""),
                _curve("first order, [MK14]", decibel, first, marker="", line="--"),
                _curve("exact: Poisson counts", decibel, exact, marker=""),
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
            letter=letter,
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
        if scenes.airborne.snr_form == "exact":
            floor, label = [UNPOLARIZED_SNR] * len(at), f"of unpolarised light, {UNPOLARIZED_SNR:.3f}"
            curves.append(_curve(label, _AZIMUTHS_DEG, floor, marker="", line="-."))
        title = f"({letter}) sun 25, view {view:g}"
        panels.append(_snr_panel(scenes, letter, title, "relative azimuth phi [deg]", curves))
    return PaperFigure(number=9, title="parts of the light", panels=tuple(panels))


def _snr_panel(scenes: PaperScenes, letter: str, title: str, x_label: str, curves: Sequence[Curve]) -> Panel:
    form = {"exact": "exact law", "first-order": "first order"}[scenes.airborne.snr_form]
    y_label = f"DoLP SNR of black paint, {form}"
    return Panel(letter=letter, title=title, x_label=x_label, y_label=y_label, curves=tuple(curves))


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
        panels.append(_snr_panel(scenes, letter, f"({letter}) {name} radiance", "height of the camera [km]", curves))
    return PaperFigure(number=10, title="sun 50, view 50, phi 180", panels=tuple(panels))


def _roc(scenes: PaperScenes, letter: str, title: str, points: Sequence[tuple[str, Geometry]]) -> tuple[Panel, ...]:
    """Return the curves; where all of them lie at 1 from the rate of the statements on, what is missed beside them."""
    found = [(label, scenes.airborne.roc(at)) for label, at in points]
    curves = [_curve(label, one.p_false_alarm, one.p_detection, marker="") for label, one in found]
    shown = Panel(letter=letter, title=title, x_label=_P_FA, y_label=_P_D, curves=tuple(curves), log_x=True)
    place = int(np.argmin(np.abs(found[0][1].p_false_alarm - P_FALSE_ALARM)))
    if any(one.p_detection[place] <= ALL_DETECTED for _, one in found):
        return (shown,)
    missed = [
        _curve(label, one.p_false_alarm[one.p_miss > 0.0], one.p_miss[one.p_miss > 0.0], marker="")
        for label, one in found
    ]
    title = f"{title}: the same, 1 - P_D"
    return shown, replace(
        shown, letter=f"{letter} missed", title=title, y_label=_P_MISS, curves=tuple(missed), log_y=True
    )


def _fig11(scenes: PaperScenes) -> PaperFigure:
    points = [(f"{h / 1000:g} km", Geometry(sun=50.0, view=50.0, height_m=h)) for h in HEIGHTS_M]
    return PaperFigure(number=11, title="ROC by height", panels=_roc(scenes, "a", "sun 50, view 50, phi 180", points))


def _fig12(scenes: PaperScenes) -> PaperFigure:
    snr = scenes.airborne.snr
    curves = [
        _curve(f"view {view:g} deg", SUNS_DEG, [snr(scenes.at(sun, view)).value for sun in SUNS_DEG])
        for view in VIEWS_DEG
    ]
    panel = _snr_panel(scenes, "a", "phi 180", "solar zenith angle [deg]", curves)
    return PaperFigure(number=12, title="DoLP SNR by sun and view", panels=(panel,))


def _fig13(scenes: PaperScenes) -> PaperFigure:
    points = [(f"sun {sun:g}, view {view:g}", scenes.at(sun, view)) for sun in (10.0, 50.0) for view in VIEWS_DEG]
    return PaperFigure(number=13, title="ROC by geometry", panels=_roc(scenes, "a", "phi 180", points))


def _fig14(scenes: PaperScenes) -> PaperFigure:
    snr = scenes.airborne.snr
    curves = [
        _curve(f"sun {sun:g} deg", NOISE_FACTORS, [snr(scenes.at(sun, 40.0, kn=kn)).value for kn in NOISE_FACTORS])
        for sun in SUNS_DEG
    ]
    panel = _snr_panel(scenes, "a", "view 40, phi 180", "noise factor Kn", curves)
    return PaperFigure(number=14, title="DoLP SNR by noise factor", panels=(panel,))


def _fig15(scenes: PaperScenes) -> PaperFigure:
    panels = tuple(
        panel
        for letter, view in zip("ab", VIEWS_DEG, strict=True)
        for panel in _roc(
            scenes,
            letter,
            f"sun 50, view {view:g} (not stated), phi 180",
            [(f"Kn {kn:g}", scenes.at(50.0, view, kn=kn)) for kn in ROC_NOISE_FACTORS],
        )
    )
    return PaperFigure(number=15, title="ROC by noise factor", panels=panels)


_MADE: dict[int, Callable[[PaperScenes], PaperFigure]] = {
    5: _fig5,
    7: _fig7,
    9: _fig9,
    10: _fig10,
    11: _fig11,
    12: _fig12,
    13: _fig13,
    14: _fig14,
    15: _fig15,
}


def curves_of(number: int, scenes: PaperScenes, *, as_paper: PaperScenes | None = None) -> PaperFigure | None:
    """Return the curves of a figure; None for Figs 2, 6 and 8, which are pictures and laws."""
    made = _MADE.get(number)
    if made is None:
        return None
    figure = made(scenes)
    if as_paper is None or number < 9:
        return figure
    theirs = {panel.letter: panel.curves for panel in made(as_paper).panels}
    panels = tuple(
        replace(one, curves=(*one.curves, *(_as_paper(curve) for curve in theirs.get(one.letter, ()))))
        for one in figure.panels
    )
    return replace(figure, panels=panels)


def _as_paper(curve: Curve) -> Curve:
    return replace(curve, label=f"{curve.label}, as the paper", line="--")
