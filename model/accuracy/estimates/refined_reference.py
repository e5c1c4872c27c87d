"""Refined references of a sky: pairs of lightings whose difference estimates the error of a numerical setting."""

from dataclasses import dataclass, replace

import numpy as np

from model.accuracy.evaluation.light_store import LightStore
from model.accuracy.evaluation.settings import Settings
from model.accuracy.planning.numerical_settings import LAYERS, NUMERICAL_SETTINGS, STREAMS, Plan, at_level
from model.atmosphere.lighting.analytic_sky import AnalyticLighting
from model.atmosphere.lighting.band_lighting import BandLighting
from model.atmosphere.lighting.compute_lighting import analytic_lighting
from model.atmosphere.lighting.fidelity import Fidelity
from model.atmosphere.lighting.lighting import Lighting
from model.atmosphere.lighting.mixed_lighting import MixedLighting
from model.atmosphere.lighting.single_scattering import single_solution
from model.atmosphere.lighting.solve_column import solve_column
from model.scene.lit_scene import Air

# Streams do not care for layers nor layers for streams: each is compared with few of the other, layers with the second
# fewest streams, for with the fewest they seem to miss more. Up to this level of the layers the plan's own of both are
# as few, for they are solved already.
_FEW, _CHEAP = {STREAMS: 0, LAYERS: 1}, 1
# What lies beyond the next level, in its difference from this one, by the convergence of the setting; and in the
# difference from the level before, where there is no next one.
_BEYOND = {STREAMS: (1.6,) * 6, LAYERS: (4 / 3, 1.1, 1.1, 1.1, 1.1)}
_BEFORE = {STREAMS: 0.5, LAYERS: 0.1}


@dataclass(frozen=True, kw_only=True, eq=False)
class Pair:
    """Two lightings whose difference stands for an error.

    Attributes
    ----------
    one, other
        The lightings.
    factor
        By what their difference is to be multiplied.
    """

    one: Lighting
    other: Lighting
    factor: float


def refined_references(
    air: Air, plan: Plan, settings: Settings, lighting: Lighting, store: LightStore
) -> dict[str, Pair]:
    """Return setting to a pair of lightings that shows its error.

    Parameters
    ----------
    air, plan, settings
        As they were evaluated.
    lighting
        What was found.
    store
        Solves, and keeps the solutions.

    Notes
    -----
    Light scattered once has no streams, and a table has neither.
    """
    if isinstance(lighting, MixedLighting) and air.alternative is not None:
        return _mixed(air, air.alternative, plan, settings, lighting, store)
    band = lighting.path_and_beam if isinstance(lighting, AnalyticLighting) else lighting
    if not isinstance(band, BandLighting):
        return {}
    settings_of_sky = (STREAMS, LAYERS) if air.is_solved else (LAYERS,)
    return {setting: _next_level(air, plan, settings, band, setting, store) for setting in settings_of_sky}


def ends_of_band(lighting: Lighting) -> tuple[Lighting, ...]:
    """Return the shortest and the longest wavelength of computed light, each standing for all of its band.

    Parameters
    ----------
    lighting
        Of two mixed ones the first is taken; a sky by formula, and one wavelength, are their only end.

    Notes
    -----
    At the longest the air is thinnest: its sky is brighter toward the horizon, and changes faster, than at any other.
    """
    one = lighting.first if isinstance(lighting, MixedLighting) else lighting
    if not isinstance(one, BandLighting) or len(one.columns) == 1:
        return (one,)
    return (_alone(one, slice(1)), _alone(one, slice(-1, None)))


def _alone(band: BandLighting, at: slice) -> BandLighting:
    """Light of one of a band's wavelengths, standing for all of them."""
    total = np.array([np.sum(band.irradiance)])
    return replace(band, columns=band.columns[at], solutions=band.solutions[at], irradiance=total)


def _next_level(air: Air, plan: Plan, settings: Settings, band: BandLighting, setting: str, store: LightStore) -> Pair:
    """Return the shortest wavelength at this level and at the next, or at the one before where there is none."""
    other = LAYERS if setting == STREAMS else STREAMS
    coarse = settings if plan[LAYERS] <= _CHEAP else at_level(settings, other, _FEW[setting])
    is_finest = plan[setting] + 1 == len(NUMERICAL_SETTINGS[setting].levels)
    neighbour = plan[setting] - 1 if is_finest else plan[setting] + 1
    here, there = (_solved(air, at_level(coarse, setting, level), band, store) for level in (plan[setting], neighbour))
    beyond = _BEFORE[setting] if is_finest else _BEYOND[setting][plan[setting]]
    return Pair(one=_seen(air, here), other=_seen(air, there), factor=beyond)


def _seen(air: Air, band: BandLighting) -> Lighting:
    """Light as the fidelity level of the air has it."""
    if air.fidelity is not Fidelity.ANALYTIC:
        return band
    return analytic_lighting(band, mu0=float(np.cos(air.sun_zenith_rad)), dolp_max=air.dolp_max)


def _solved(air: Air, settings: Settings, band: BandLighting, store: LightStore) -> BandLighting:
    """Light of the shortest wavelength with settings of its own: most of it is scattered more than once."""
    shortest = _alone(band, slice(1))
    (column,), (known,) = shortest.columns, shortest.solutions
    solution = solve_column(
        store.solver if air.is_solved else single_solution,
        column,
        settings.solver,
        mu0=known.mu0,
        albedo=air.ground_albedo,
        aerosol=air.aerosol,
    )
    return replace(shortest, solutions=(solution,))


def _mixed(
    air: Air, alternative: Air, plan: Plan, settings: Settings, lighting: MixedLighting, store: LightStore
) -> dict[str, Pair]:
    alone = refined_references(replace(air, alternative=None, share=0.0), plan, settings, lighting.first, store)
    other = refined_references(alternative, plan, settings, lighting.second, store)
    return {
        setting: Pair(
            one=MixedLighting(first=pair.one, second=other[setting].one, share=air.share),
            other=MixedLighting(first=pair.other, second=other[setting].other, share=air.share),
            factor=max(pair.factor, other[setting].factor),
        )
        for setting, pair in alone.items()
    }
