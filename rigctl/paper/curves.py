"""The curves of [MK14] Figs 5 and 7 to 15 with one set of materials."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.paper.scenes import (
    ANGLES_DEG,
    DECIBELS,
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
    low_light,
)
from rigctl.paper.statements import ALL_DETECTED, UNPOLARIZED_SNR

FloatArray = NDArray[np.float64]

FIGURES = (2, *range(5, 16))
_AZIMUTHS_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0)
_TURNED = "total, azimuth of path turned by 180 deg"


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


def _fig5(_: PaperScenes) -> PaperFigure:
    law = low_light()
    panels = tuple(
        Panel(
            letter=letter,
            title=f"({letter}) {name} of DoLP",
            x_label="SNR of S0 [dB, amplitude]",
            y_label=f"{name} of DoLP",
            curves=(
                _curve("1e4 Poisson draws", DECIBELS, drawn, marker="o", line=""),
                _curve("first order, [MK14]", DECIBELS, first, marker="", line="--"),
                _curve("exact: Poisson counts", DECIBELS, exact, marker=""),
            ),
        )
        for letter, name, drawn, first, exact in (
            ("a", "mean", law.drawn_mean, law.first_mean, law.true_mean),
            ("b", "deviation", law.drawn_std, law.first_std, law.true_std),
        )
    )
    return PaperFigure(number=5, title="DoLP under shot noise, S = (1, 0.5, 0.5)", panels=panels)


def _fig7(scenes: PaperScenes) -> PaperFigure:
    panels = tuple(
        Panel(
            letter=letter,
            title=f"({letter}) {name}",
            x_label="angle of the polarizer [deg]",
            y_label=f"{name} of the counts [DN]",
            curves=tuple(
                _curve(label, ANGLES_DEG, [scenes.panel(panel, f"dn_{angle}", of).value for angle in ANGLES_DEG])
                for panel, label in PANELS.items()
            ),
        )
        for letter, name, of in (("a", "mean", "mean"), ("b", "deviation", "std"))
    )
    return PaperFigure(number=7, title="counts of the panels: sun 22, view 53, phi 180", panels=panels)


def _fig9(scenes: PaperScenes) -> PaperFigure:
    panels = []
    for letter, view in (("a", 10.0), ("b", 50.0)):
        at = [scenes.at(25.0, view, phi) for phi in _AZIMUTHS_DEG]
        curves = [
            _snr_curve(scenes, "reflected", _AZIMUTHS_DEG, at, source="reflected"),
            _snr_curve(scenes, "upwelling", _AZIMUTHS_DEG, at, source="path"),
            _snr_curve(scenes, "total", _AZIMUTHS_DEG, at),
            _snr_curve(scenes, _TURNED, _AZIMUTHS_DEG, at, turned=True),
        ]
        if scenes.snr_form == "exact":
            label = f"of unpolarised light, {UNPOLARIZED_SNR:.3f}"
            curves.append(_curve(label, _AZIMUTHS_DEG, [UNPOLARIZED_SNR] * len(at), marker="", line="-."))
        title = f"({letter}) sun 25, view {view:g}"
        panels.append(_snr_panel(scenes, letter, title, "relative azimuth phi [deg]", curves))
    return PaperFigure(number=9, title="parts of the light", panels=tuple(panels))


def _fig10(scenes: PaperScenes) -> PaperFigure:
    at = [scenes.at(50.0, 50.0, height_m=height) for height in HEIGHTS_M]
    km, x_label = [height / 1000.0 for height in HEIGHTS_M], "height of the camera [km]"
    reflected = [_snr_curve(scenes, "reflected", km, at, source="reflected")]
    total = [_snr_curve(scenes, "total", km, at), _snr_curve(scenes, _TURNED, km, at, turned=True)]
    panels = (
        _snr_panel(scenes, "a", "(a) reflected radiance", x_label, reflected),
        _snr_panel(scenes, "b", "(b) total radiance", x_label, total),
    )
    return PaperFigure(number=10, title="sun 50, view 50, phi 180", panels=panels)


def _snr_curve(
    scenes: PaperScenes,
    label: str,
    x: Sequence[float],
    at: Sequence[Geometry],
    *,
    source: Source = "total",
    turned: bool = False,
) -> Curve:
    values = [scenes.snr(one, source=source, turned=turned).value for one in at]
    return _curve(label, x, values, line=":" if turned else "-")


def _snr_panel(scenes: PaperScenes, letter: str, title: str, x_label: str, curves: Sequence[Curve]) -> Panel:
    form = {"exact": "exact law", "first-order": "first order"}[scenes.snr_form]
    y_label = f"DoLP SNR of black paint, {form}"
    return Panel(letter=letter, title=title, x_label=x_label, y_label=y_label, curves=tuple(curves))


def _fig11(scenes: PaperScenes) -> PaperFigure:
    points = {f"{height / 1000:g} km": scenes.at(50.0, 50.0, height_m=height) for height in HEIGHTS_M}
    return PaperFigure(number=11, title="ROC by height", panels=_roc(scenes, "a", "sun 50, view 50, phi 180", points))


def _roc(scenes: PaperScenes, letter: str, title: str, points: Mapping[str, Geometry]) -> tuple[Panel, ...]:
    """Return the curves, and those of misses where all lie at 1 from the rate of the statements on."""
    rocs = {label: scenes.roc(at) for label, at in points.items()}
    curves = tuple(_curve(label, roc.p_false_alarm, roc.p_detection, marker="") for label, roc in rocs.items())
    shown = Panel(
        letter=letter,
        title=title,
        x_label="probability of false alarm",
        y_label="probability of detection",
        curves=curves,
        log_x=True,
    )
    place = int(np.argmin(np.abs(curves[0].x - P_FALSE_ALARM)))
    if any(curve.y[place] <= ALL_DETECTED for curve in curves):
        return (shown,)
    missed = tuple(
        _curve(label, roc.p_false_alarm[roc.p_miss > 0.0], roc.p_miss[roc.p_miss > 0.0], marker="")
        for label, roc in rocs.items()
    )
    return shown, replace(
        shown,
        letter=f"{letter} missed",
        title=f"{title}: the same, 1 - P_D",
        y_label="probability of a miss",
        curves=missed,
        log_y=True,
    )


def _fig12(scenes: PaperScenes) -> PaperFigure:
    curves = [
        _snr_curve(scenes, f"view {view:g} deg", SUNS_DEG, [scenes.at(sun, view) for sun in SUNS_DEG])
        for view in VIEWS_DEG
    ]
    panel = _snr_panel(scenes, "a", "phi 180", "solar zenith angle [deg]", curves)
    return PaperFigure(number=12, title="DoLP SNR by sun and view", panels=(panel,))


def _fig13(scenes: PaperScenes) -> PaperFigure:
    points = {f"sun {sun:g}, view {view:g}": scenes.at(sun, view) for sun in (10.0, 50.0) for view in VIEWS_DEG}
    return PaperFigure(number=13, title="ROC by geometry", panels=_roc(scenes, "a", "phi 180", points))


def _fig14(scenes: PaperScenes) -> PaperFigure:
    curves = [
        _snr_curve(scenes, f"sun {sun:g} deg", NOISE_FACTORS, [scenes.at(sun, 40.0, kn=kn) for kn in NOISE_FACTORS])
        for sun in SUNS_DEG
    ]
    panel = _snr_panel(scenes, "a", "view 40, phi 180", "noise factor Kn", curves)
    return PaperFigure(number=14, title="DoLP SNR by noise factor", panels=(panel,))


def _fig15(scenes: PaperScenes) -> PaperFigure:
    panels: list[Panel] = []
    for letter, view in zip("ab", VIEWS_DEG, strict=True):
        points = {f"Kn {kn:g}": scenes.at(50.0, view, kn=kn) for kn in ROC_NOISE_FACTORS}
        panels += _roc(scenes, letter, f"sun 50, view {view:g} (not stated), phi 180", points)
    return PaperFigure(number=15, title="ROC by noise factor", panels=tuple(panels))


_DRAWN: dict[int, Callable[[PaperScenes], PaperFigure]] = {
    5: _fig5, 7: _fig7, 9: _fig9, 10: _fig10, 11: _fig11, 12: _fig12, 13: _fig13, 14: _fig14, 15: _fig15
}  # fmt: skip


def curves_of(number: int, scenes: PaperScenes, *, as_paper: PaperScenes | None = None) -> PaperFigure | None:
    """Return the curves of a figure; None for Figs 2, 6 and 8, which are pictures and laws."""
    drawn = _DRAWN.get(number)
    if drawn is None:
        return None
    figure = drawn(scenes)
    if as_paper is None or number < 9:
        return figure
    theirs = {panel.letter: panel.curves for panel in drawn(as_paper).panels}
    panels = tuple(
        replace(
            panel,
            curves=(
                *panel.curves,
                *(
                    replace(curve, label=f"{curve.label}, as the paper", line="--")
                    for curve in theirs.get(panel.letter, ())
                ),
            ),
        )
        for panel in figure.panels
    )
    return replace(figure, panels=panels)
