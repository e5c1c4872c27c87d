"""Numerical settings of the chain: each with its levels, its convergence, and its likely cost.

The errors and times of the levels are those of one scene (23 km visibility, sun at 50 deg, one core): where to begin
(`model.accuracy.planning.forecast`). What a result states is estimated on its own scene
(`model.accuracy.estimates.light_error`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from model.accuracy.evaluation.settings import Settings
from model.atmosphere.lighting.fidelity import SolverSettings

STREAMS, LAYERS, WAVELENGTHS, SKY_GRID, HEMISPHERE, TILES, DOLP, ROC = (
    "streams",
    "layers",
    "wavelengths",
    "sky grid",
    "hemisphere",
    "tiles",
    "DoLP order",
    "ROC",
)


@dataclass(frozen=True, kw_only=True)
class Level:
    """One position of a setting.

    Attributes
    ----------
    label
        In words.
    error
        Likely relative error of the light, or of what the setting acts on.
    effort
        By what the time of its stage is likely to be multiplied, over the lowest level.
    """

    label: str
    error: float
    effort: float


@dataclass(frozen=True, kw_only=True)
class NumericalSetting:
    """One thing that costs time and buys accuracy.

    Attributes
    ----------
    name, stage
        Of the setting, and the stage of `model.accuracy.evaluation.chain` whose time it costs.
    convergence
        How its error falls.
    estimate
        How the error of a result is estimated.
    levels
        From cheap to fine.
    """

    name: str
    stage: str
    convergence: str
    estimate: str
    levels: tuple[Level, ...]


# Level of each setting by its name.
Plan = Mapping[str, int]

_STREAMS = (4, 6, 8, 12, 16, 24, 32)
# Cuts of each layer of the coarse profile, and whether they are extrapolated with twice as many.
_LAYERS = ((1, False), (2, False), (1, True), (2, True), (4, True), (8, True))
_ELEMENT_DEPTH = 0.1
# How many, and whether each stretch between the entries of the aerosol's tables has its part of them.
_WAVELENGTHS = ((1, False), (2, False), (3, False), (3, True), (4, True), (6, True), (8, True), (12, True), (16, True))
_GRIDS = ((16, 14), (24, 20), (36, 32), (48, 44))
_TILES = (2, 3, 4, 5, 6, 8, 10, 13, 16, 20)
_TOLERANCES = (3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 1e-5, 1e-6, 1e-7)
# Orders of scattering, and the statistics, cost so little that they are always finer than what is asked for.
_OF_ORDERS, _FINER = 0.003, 0.02


def _levels(labels: tuple[str, ...], errors: tuple[float, ...], efforts: tuple[float, ...]) -> tuple[Level, ...]:
    return tuple(
        Level(label=label, error=error, effort=effort)
        for label, error, effort in zip(labels, errors, efforts, strict=True)
    )


NUMERICAL_SETTINGS: Mapping[str, NumericalSetting] = MappingProxyType(
    {
        setting.name: setting
        for setting in (
            NumericalSetting(
                name=STREAMS,
                stage="sky",
                convergence="geometric above the length of the phase function's expansion",
                estimate="the shortest wavelength, coarse layers, beside the next level",
                levels=_levels(
                    tuple(f"{n} a hemisphere" for n in _STREAMS),
                    (5e-3, 1.5e-3, 5e-4, 6e-5, 4e-6, 3e-7, 1e-7),
                    (0.7, 1.0, 1.3, 2.2, 3.5, 6.0, 9.0),
                ),
            ),
            NumericalSetting(
                name=LAYERS,
                stage="sky",
                convergence="square of the thickness; its fourth power where two are extrapolated to none",
                estimate="the shortest wavelength, few streams, beside the next level",
                levels=_levels(
                    tuple(f"{15 * n} and {30 * n}" if both else f"{15 * n}" for n, both in _LAYERS),
                    (1.5e-3, 4e-4, 1e-5, 5e-7, 6e-8, 6e-9),
                    (1.0, 1.3, 2.3, 3.3, 5.5, 10.0),
                ),
            ),
            NumericalSetting(
                name=WAVELENGTHS,
                stage="sky",
                convergence="geometric; below 1e-4 only between the entries of the aerosol's tables",
                estimate="the same rule for functions of depth, albedo and asymmetry",
                levels=_levels(
                    tuple(f"{n} split" if split else str(n) for n, split in _WAVELENGTHS),
                    (5e-2, 2e-3, 2e-4, 1e-4, 1e-5, 1e-6, 2e-7, 5e-8, 1e-8),
                    (1.0, 2.0, 3.0, 5.0, 6.0, 8.0, 10.0, 14.0, 18.0),
                ),
            ),
            NumericalSetting(
                name=SKY_GRID,
                stage="sky",
                convergence="geometric, as fast as the aureole lets it",
                estimate="both ends of the band, as the panel reflects them, beside a finer grid",
                levels=_levels(
                    tuple(f"{z} x {a}" for z, a in _GRIDS), (4e-4, 1.6e-4, 3e-5, 6e-6), (1.0, 2.2, 5.0, 9.4)
                ),
            ),
            NumericalSetting(
                name=HEMISPHERE,
                stage="light",
                convergence="geometric; of the square root of the nodes where a horizon lies in the lobe",
                estimate="finer rules in corners and middle",
                levels=_levels(
                    tuple(f"{t:g}" for t in _TOLERANCES),
                    (1.5e-2, 5e-3, 1.5e-3, 5e-4, 1.5e-4, 5e-5, 5e-6, 5e-7, 2e-7),
                    (1.0, 1.1, 1.3, 1.6, 1.9, 2.3, 3.3, 6.4, 32.0),
                ),
            ),
            NumericalSetting(
                name=TILES,
                stage="light",
                convergence="geometric over a smooth field; slower where the shadowing has its kink in it",
                estimate="one more tile along each side",
                levels=_levels(
                    tuple(f"{n} x {n}" for n in _TILES),
                    (1.5e-2, 1.5e-3, 1e-4, 2e-5, 1e-5, 3e-6, 1e-6, 4e-7, 1e-7, 5e-8),
                    tuple(float(n**2 + (n + 1) ** 2 + 5) for n in _TILES),
                ),
            ),
        )
    }
)

# Both have a tolerance of their own and estimate their error themselves.
STATISTICS: Mapping[str, str] = MappingProxyType(
    {
        DOLP: "first order 1/SNR^2, second order 1/SNR^4, then quadrature (1e-13)",
        ROC: "geometric in the nodes of the contour",
    }
)


def settings_at(plan: Plan, tolerance: float, *, face_m: float = 0.0) -> Settings:
    """Return the settings of a plan.

    Parameters
    ----------
    plan
        Level of each setting of `NUMERICAL_SETTINGS`.
    tolerance
        That is asked for; statistics and orders of scattering follow it.
    face_m
        Height of the sensor [m], at which a layer ends: extrapolation is of what is read between layers.
    """
    zeniths, azimuths = _GRIDS[plan[SKY_GRID]]
    count, split_at_kinks = _WAVELENGTHS[plan[WAVELENGTHS]]
    solver = SolverSettings(
        fine_layers=False,
        nodes=_STREAMS[plan[STREAMS]],
        element_depth=_ELEMENT_DEPTH,
        tolerance=min(max(_OF_ORDERS * tolerance, 1e-9), 1e-4),
        matrix_tolerance=min(0.3 * tolerance, 3e-3),
        face_m=face_m,
    )
    return Settings(
        wavelengths=count,
        split_at_kinks=split_at_kinks,
        solver=_in_layers(solver, plan[LAYERS]),
        sky_zeniths=zeniths,
        sky_azimuths=azimuths,
        hemisphere_tolerance=_TOLERANCES[plan[HEMISPHERE]],
        tiles_per_side=_TILES[plan[TILES]],
        negligible_spread=0.0,
        dolp_tolerance=max(_FINER * tolerance, 1e-11),
        roc_tolerance=max(_FINER * tolerance, 1e-12),
    )


def tiles_per_side(level: int) -> int:
    """Return the tiles along each side of the field at a level of TILES."""
    return _TILES[level]


def streams(level: int) -> int:
    """Return the streams of a hemisphere at a level of STREAMS."""
    return _STREAMS[level]


def at_level(settings: Settings, setting: str, level: int) -> Settings:
    """Return settings with one setting of the sky at another level.

    Parameters
    ----------
    settings
        To be changed.
    setting
        STREAMS, LAYERS or WAVELENGTHS.
    level
        Its new level.
    """
    if setting == STREAMS:
        return replace(settings, solver=replace(settings.solver, nodes=_STREAMS[level]))
    if setting == WAVELENGTHS:
        count, split_at_kinks = _WAVELENGTHS[level]
        return replace(settings, wavelengths=count, split_at_kinks=split_at_kinks)
    return replace(settings, solver=_in_layers(settings.solver, level))


def _in_layers(solver: SolverSettings, level: int) -> SolverSettings:
    cuts, extrapolated = _LAYERS[level]
    return replace(solver, layer_cuts=cuts, extrapolated=extrapolated, element_depth=_ELEMENT_DEPTH / cuts)
