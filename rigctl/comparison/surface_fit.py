"""A surface's parameters from regions of runs: measured Stokes parameters in, fitted material out."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments, propagate_linear
from model.processing.reconstruction import normalized_moments
from model.stokes import rotation
from model.surface.fit import Observation, SurfaceFit, fit_surface, gauss_interval, profile_interval, residuals, sunlit
from model.surface.materials import Material, constant, properties, surface_of
from model.surface.pbrdf import Surface, Tilt, local_geometry, tilted_mueller
from rigctl.base.numbers import p_value
from rigctl.console.terminal import note, progress
from rigctl.errors import ConfigError, DataError
from rigctl.files.materials import NM_PER_M, ObservationSection, SurfaceFitFile, find_material
from rigctl.files.regions import Region, load_regions
from rigctl.files.rig_file import unset_polarizer
from rigctl.measure.measure import measure
from rigctl.runs.check import used_run
from rigctl.runs.folder import read_run

FloatArray = NDArray[np.float64]

_LEVEL = 0.95
_ASSUMPTIONS = (
    "light: the sun alone, unpolarised; skylight and what the air adds are left out",
    "scale: radiance by count and irradiance of the sun are unknown; each run has one factor, which the fit finds",
)


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedRegion:
    """One observation beside the fitted surface, in the camera's axes."""

    run: str  #: Which.
    region: str
    measured: Moments  #: Of (S1/S0, S2/S0).
    fitted: FloatArray  #: The same of the fitted surface.
    chi_square: float  #: What the observation adds to the fit's.


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedMaterial:
    """A material as measured regions give it."""

    start: Material  #: Where the fit began.
    #: The same with the fitted values in it; None where the regions leave one of them undetermined.
    material: Material | None
    fit: SurfaceFit  #: Values, uncertainties, findings.
    regions: tuple[FittedRegion, ...]  #: Every observation, in the order of the file.
    intervals: tuple[tuple[float, float], ...]  #: Of each fitted value, that hold the truth in 95 % of such fits.
    interval_method: str  #: Where they come from.
    assumptions: tuple[str, ...]  #: What the values rest on, in words.


def fit_regions(
    file: SurfaceFitFile, *, beside: Path, profile: bool = False, ignore_exclusions: bool = False
) -> FittedMaterial:
    """Return the material that the regions of a fit file make."""
    start, surface = _start(file, beside)
    measured = _measured(file, ignore_exclusions=ignore_exclusions)
    observations = [
        _observation(section, moments, file.unmodelled_std)
        for section, moments in zip(file.observation, measured, strict=True)
    ]
    bounds = {str(name): limits for name, limits in file.bounds.items()}
    try:
        fit = fit_surface(observations, start=surface, free=file.free, bounds=bounds)
    except ValueError as error:
        raise ConfigError(f"{file.name}: {error}") from error
    return FittedMaterial(
        start=start,
        material=_fitted(file, start, fit),
        fit=fit,
        regions=_beside_fit(file, measured, fit),
        intervals=_profiles(fit) if profile else tuple(gauss_interval(fit, name, level=_LEVEL) for name in fit.names),
        interval_method="profile of chi-square" if profile else "first order",
        assumptions=(*_ASSUMPTIONS, _unmodelled_words(file.unmodelled_std), *_placeholders(file)),
    )


def _profiles(fit: SurfaceFit) -> tuple[tuple[float, float], ...]:
    from rich.progress import track

    note(f"profile of chi-square of {', '.join(fit.names)}: each is fitted again many times")
    names = track(fit.names, description="profiles", console=progress(), transient=True)
    return tuple(profile_interval(fit, name, level=_LEVEL) for name in names)


def _start(file: SurfaceFitFile, beside: Path) -> tuple[Material, Surface]:
    material = find_material(file.material, beside=beside)
    try:
        surface = surface_of(
            material, wavelength_m=file.wavelength_nm / NM_PER_M, shadowing=file.shadowing, diffuse=file.diffuse
        )
    except ValueError as error:
        raise ConfigError(str(error)) from error
    return material, surface


def _measured(file: SurfaceFitFile, *, ignore_exclusions: bool) -> list[Moments]:
    """Return the mean Stokes parameters of each observation's region in the camera's axes; each run is read once."""
    outlines = {region.name: region for region in load_regions(file.regions)}
    unknown = sorted({section.region for section in file.observation} - set(outlines))
    if unknown:
        raise ConfigError(f"{file.regions}: has no region {', '.join(unknown)}; it has {', '.join(outlines)}")
    by_run: dict[Path, dict[str, Moments]] = {}
    for run in {section.run for section in file.observation}:
        wanted = {section.region: outlines[section.region] for section in file.observation if section.run == run}
        by_run[run] = _stokes_of_run(run, list(wanted.values()), ignore_exclusions=ignore_exclusions)
    return [by_run[section.run][section.region] for section in file.observation]


def _stokes_of_run(path: Path, regions: list[Region], *, ignore_exclusions: bool) -> dict[str, Moments]:
    measurement = measure(used_run(path, ignore_exclusions=ignore_exclusions), regions=regions)
    stokes = {
        name: propagate_linear(region.channels_mean, measurement.plan.inverse)
        for name, region in measurement.regions.items()
    }
    dark = [name for name, moments in stokes.items() if not moments.mean[0] > 0.0]
    if dark:
        raise DataError(f"{path}: no light above the dark level in region {', '.join(dark)}")
    return stokes


def _observation(section: ObservationSection, measured: Moments, unmodelled_std: float) -> Observation:
    angles = _angles_rad(section)
    local = local_geometry(**angles, tilt=_tilt(section))
    turn_rad = float(local.reflected_rotation_rad) + float(np.deg2rad(section.camera_roll_deg))
    own = propagate_linear(measured, rotation(-turn_rad))
    cosine = float(np.cos(local.theta_i_rad))
    if cosine <= 0.0 or local.theta_r_rad >= 0.5 * np.pi:
        raise ConfigError(f"{section.run}, region {section.region}: its panel does not face sun and camera both")
    try:
        return sunlit(
            theta_i_rad=float(local.theta_i_rad),
            theta_r_rad=float(local.theta_r_rad),
            phi_rad=float(local.phi_rad),
            irradiance=cosine,
            stokes=own.mean,
            covariance=own.cov + (unmodelled_std * own.mean[0]) ** 2 * np.eye(3),
            scale=str(section.run),
        )
    except ValueError as error:
        raise DataError(f"{section.run}, region {section.region}: {error}") from error


def _angles_rad(section: ObservationSection) -> dict[str, float]:
    return {
        "sun_zenith_rad": float(np.deg2rad(section.sun_zenith_deg)),
        "sun_azimuth_rad": float(np.deg2rad(section.sun_azimuth_deg)),
        "camera_zenith_rad": float(np.deg2rad(section.camera_zenith_deg)),
        "camera_azimuth_rad": float(np.deg2rad(section.camera_azimuth_deg)),
    }


def _tilt(section: ObservationSection) -> Tilt:
    return Tilt(tilt_rad=float(np.deg2rad(section.tilt_deg)), azimuth_rad=float(np.deg2rad(section.tilt_azimuth_deg)))


def _beside_fit(file: SurfaceFitFile, measured: list[Moments], fit: SurfaceFit) -> tuple[FittedRegion, ...]:
    squares = np.sum(residuals(fit.problem, fit.internal).reshape(-1, 3) ** 2, axis=1)
    found = []
    for section, moments, square in zip(file.observation, measured, squares, strict=True):
        matrix = tilted_mueller(
            **_angles_rad(section),
            camera_roll_rad=np.deg2rad(section.camera_roll_deg),
            tilt=_tilt(section),
            surface=fit.surface,
        )
        found.append(
            FittedRegion(
                run=str(section.run),
                region=section.region,
                measured=normalized_moments(moments),
                fitted=matrix[1:, 0] / matrix[0, 0],
                chi_square=float(square),
            )
        )
    return tuple(found)


def _placeholders(file: SurfaceFitFile) -> Iterator[str]:
    """Yield the runs whose polarizer was not calibrated, in words."""
    for path in dict.fromkeys(section.run for section in file.observation):
        yield from unset_polarizer(path, placeholder=read_run(path).session.polarizer.placeholder)


def _unmodelled_words(unmodelled_std: float) -> str:
    if unmodelled_std == 0.0:
        return "uncertainties: the noise of the regions alone; unmodelled_std in the fit file adds what else there is"
    return f"uncertainties: the noise of the regions, and {unmodelled_std:g} of S0 for what is not modelled"


def _fitted(file: SurfaceFitFile, start: Material, fit: SurfaceFit) -> Material | None:
    """Return the material to begin with, its fitted properties replaced; None where one is not determined."""
    if not np.all(np.isfinite(fit.information.standard_uncertainty)):
        return None
    runs = ", ".join(dict.fromkeys(section.run.name for section in file.observation))
    found: dict[str, Any] = dict(properties(start))
    for name, value, spread in zip(fit.names, fit.values, fit.information.standard_uncertainty, strict=True):
        found[name] = constant(
            float(value),
            standard_uncertainty=float(spread),
            source=f"fitted at {file.wavelength_nm:g} nm to {runs} ({p_value(fit.p_value)})",
            confidence="low" if fit.findings else "medium",
            assumed=False,
        )
    fitted: Material = replace(start, name=file.name, diffuse=fit.surface.diffuse, **found)
    return fitted
