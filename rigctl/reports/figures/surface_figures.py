"""Plots of a material as PNG: DoLP and reflectance against angle, and over the hemisphere of camera directions."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from numpy.typing import NDArray

from rigctl.reports.figures.figure_style import MEASURED, PREDICTED, png
from rigctl.scene.reflected_light import ReflectedMaps, SurfaceSheet

FloatArray = NDArray[np.float64]

_UNPOLARISED, _POLARISED, _SPECULAR = PREDICTED, MEASURED, "0.45"
# Decades of F00 below its largest value that are shown.
_DECADES_OF_HEMISPHERE, _DECADES_OF_CURVE = 4.0, 8.0
_MARGIN = 1.2
_LEAST_DEGREE = 0.01


def against_angle(sheet: SurfaceSheet, maps: ReflectedMaps) -> bytes:
    """Return F00 and DoLP in the principal plane, and reflectance against the angle of incidence."""
    figure = Figure(figsize=(12.5, 3.9), layout="constrained")
    intensity, polarization, reflectance = figure.subplots(1, 3)
    stokes = maps.curve_stokes
    intensity.semilogy(maps.curve_deg, _positive(stokes[:, 0]), color=_UNPOLARISED)
    intensity.set_ylim(*_shown_range(stokes[:, 0], _DECADES_OF_CURVE))
    intensity.set_ylabel("F00 [1/sr]")
    polarization.plot(maps.curve_deg, _degree(stokes), color=_UNPOLARISED)
    polarization.set_ylabel("DoLP of unpolarised light")
    polarization.set_ylim(-0.02, 1.02)
    for ax in (intensity, polarization):
        _mark_sun(ax, sheet.sun_zenith_deg)
    _draw_reflectance(reflectance, sheet)
    figure.suptitle(_title(sheet))
    return png(figure)


def hemisphere(sheet: SurfaceSheet, maps: ReflectedMaps) -> bytes:
    """Return F00 and DoLP over all directions of the camera, seen from above, the sun's azimuth at the top."""
    figure = Figure(figsize=(11.0, 5.6), layout="constrained")
    azimuth_rad, stokes = np.deg2rad(maps.azimuth_deg), maps.hemisphere_stokes
    brightness, degree = _positive(stokes[..., 0]), _degree(stokes)
    panels = (
        (brightness, LogNorm(*_shown_range(stokes[..., 0], _DECADES_OF_HEMISPHERE)), "F00 [1/sr]", "viridis"),
        (degree, Normalize(0.0, np.nanmax(degree, initial=_LEAST_DEGREE)), "DoLP of unpolarised light", "magma"),
    )
    axes = figure.subplots(1, 2, subplot_kw={"projection": "polar"})
    for ax, (values, norm, label, cmap) in zip(axes, panels, strict=True):
        shown = ax.pcolormesh(azimuth_rad, maps.zenith_deg, values, norm=norm, cmap=cmap, shading="gouraud")
        _finish_hemisphere(ax, sheet.sun_zenith_deg)
        figure.colorbar(shown, ax=ax, label=label, shrink=0.8, extend="min" if isinstance(norm, LogNorm) else "neither")
    figure.suptitle(_title(sheet))
    return png(figure)


def _draw_reflectance(ax: Axes, sheet: SurfaceSheet) -> None:
    zenith_deg = [given.zenith_deg for given in sheet.reflectance]
    for values, colour, style, label in (
        ([given.total for given in sheet.reflectance], _UNPOLARISED, "-", "unpolarised light"),
        ([given.horizontal for given in sheet.reflectance], _POLARISED, "--", "polarised horizontally"),
        ([given.vertical for given in sheet.reflectance], _POLARISED, ":", "polarised vertically"),
        ([given.specular for given in sheet.reflectance], _SPECULAR, "-.", "unpolarised, specular lobe alone"),
    ):
        ax.plot(zenith_deg, values, style, color=colour, label=label)
    ax.axhline(1.0, color="0.7", linewidth=0.8)
    ax.set_ylim(0.0, 1.05 * max(1.0, *(given.total for given in sheet.reflectance)))
    ax.set_xlabel("angle of incidence [deg]")
    ax.set_ylabel("directional-hemispherical reflectance")
    ax.legend(fontsize=8)


def _mark_sun(ax: Axes, sun_zenith_deg: float) -> None:
    for angle, label in ((-sun_zenith_deg, "sun"), (sun_zenith_deg, "mirror direction")):
        ax.axvline(angle, color="0.6", linewidth=0.8, linestyle="--")
        ax.annotate(label, (angle, 0.02), xycoords=("data", "axes fraction"), rotation=90, fontsize=7, ha="right")
    ax.set_xlabel("camera zenith [deg], positive towards the glint")
    ax.set_xlim(-90.0, 90.0)


def _finish_hemisphere(ax: PolarAxes, sun_zenith_deg: float) -> None:
    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    ax.set_rlim(0.0, 90.0)
    ax.set_rticks([30.0, 60.0], ["30°", "60°"], color="white", fontsize=8)
    ax.set_rlabel_position(100.0)
    phi_deg = np.arange(0, 360, 45)
    ax.set_thetagrids(phi_deg, [_phi_label(int(angle)) for angle in phi_deg], fontsize=8)
    ax.set_facecolor("0.85")  # where nothing is reflected
    ax.grid(color="white", alpha=0.35, linewidth=0.6)
    ax.plot(0.0, sun_zenith_deg, marker="*", markersize=13, color="#ffd400", markeredgecolor="black")


def _phi_label(clockwise_deg: int) -> str:
    phi_deg = -clockwise_deg if clockwise_deg < 180 else 360 - clockwise_deg
    return {0: "phi 0\n(sun)", 180: "180 (glint)"}.get(phi_deg, f"{phi_deg:+d}")


def _positive(intensity: FloatArray) -> FloatArray:
    return np.asarray(np.where(intensity > 0.0, intensity, np.nan))


def _shown_range(intensity: FloatArray, decades: float) -> tuple[float, float]:
    """Return the ends of a logarithmic axis, which a surface that is black or the same everywhere has too."""
    highest = float(np.max(intensity)) or 1.0
    return max(float(np.min(intensity)), highest * 10.0**-decades) / _MARGIN, highest * _MARGIN


def _degree(stokes: FloatArray) -> FloatArray:
    """DoLP, NaN where nothing is reflected."""
    return np.asarray(np.hypot(stokes[..., 1], stokes[..., 2]) / _positive(stokes[..., 0]))


def _title(sheet: SurfaceSheet) -> str:
    assumed = [given.name for given in sheet.properties if given.assumed]
    note = f"; assumed: {', '.join(assumed)}" if assumed else ""
    return f"{sheet.material} at {sheet.wavelength_nm:g} nm, sun at {sheet.sun_zenith_deg:g} deg{note}"
