"""Pairs of lightings whose difference stands for what a knob of the sky costs; cheap beside the evaluation itself."""

from dataclasses import dataclass, replace

import numpy as np

from model.accuracy.knobs import KNOBS, LAYERS, STREAMS, WAVELENGTHS, Plan, at_level
from model.accuracy.light_store import LightStore
from model.accuracy.settings import Settings
from model.accuracy.spectral_error import left_out
from model.atmosphere.lighting.analytic_sky import AnalyticLighting
from model.atmosphere.lighting.band_lighting import BandLighting
from model.atmosphere.lighting.lighting import Lighting
from model.atmosphere.lighting.mixed_lighting import MixedLighting
from model.lit_scene import Air

# Streams do not care for layers nor layers for streams: each is compared with few of the other.
_CHEAPEST = 0
# What lies beyond the next level, in its difference from this one.
_BEYOND = {STREAMS: 1.3, LAYERS: 1.4, WAVELENGTHS: 1.5}


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


def companions(air: Air, plan: Plan, settings: Settings, lighting: Lighting, store: LightStore) -> dict[str, Pair]:
    """Return knob to a pair of lightings that shows its error.

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
    A table has no such knob, and light scattered once only that of wavelengths.

    References
    ----------
    Definition.
    """
    if isinstance(lighting, MixedLighting) and air.alternative is not None:
        return _mixed(air, air.alternative, plan, settings, lighting, store)
    band = lighting.path_and_beam if isinstance(lighting, AnalyticLighting) else lighting
    if not isinstance(band, BandLighting) or air.state is None:
        return {}
    found = {}
    if len(band.columns) > 1:
        fewer = left_out(band, band=air.band, state=air.state)
        other = _as_analytic(lighting, fewer.lighting) if isinstance(lighting, AnalyticLighting) else fewer.lighting
        found[WAVELENGTHS] = Pair(one=lighting, other=other, factor=_BEYOND[WAVELENGTHS] * fewer.ratio)
    if air.is_solved:
        found |= {knob: _next_level(air, plan, settings, band, knob, store) for knob in (STREAMS, LAYERS)}
    return found


def one_wavelength(band: BandLighting) -> BandLighting:
    """Return the shortest wavelength of a band, with the light of all of it.

    Parameters
    ----------
    band
        With solutions.
    """
    total = np.array([np.sum(band.irradiance)])
    return replace(band, columns=band.columns[:1], solutions=band.solutions[:1], irradiance=total)


def _next_level(air: Air, plan: Plan, settings: Settings, band: BandLighting, knob: str, store: LightStore) -> Pair:
    """Return one wavelength at this level and at the next, or at the one before where there is none."""
    coarse = at_level(settings, LAYERS if knob == STREAMS else STREAMS, _CHEAPEST)
    finest = len(KNOBS[knob].levels) - 1
    neighbour = plan[knob] + 1 if plan[knob] < finest else plan[knob] - 1
    here, there = (_solved(air, at_level(coarse, knob, level), band, store) for level in (plan[knob], neighbour))
    return Pair(one=here, other=there, factor=_BEYOND[knob])


def _solved(air: Air, settings: Settings, band: BandLighting, store: LightStore) -> BandLighting:
    column, chosen = band.columns[0], settings.solver
    solution = store.solver(
        column.layers(
            fine=chosen.fine_layers,
            aerosol=air.aerosol,
            matrix_tolerance=chosen.matrix_tolerance,
            cuts=chosen.layer_cuts,
        ),
        mu0=band.solutions[0].mu0,
        albedo=air.ground_albedo,
        aerosol=air.aerosol,
        nodes=chosen.nodes,
        element_depth=chosen.element_depth,
        tolerance=chosen.tolerance,
    )
    return replace(one_wavelength(band), solutions=(solution,))


def _as_analytic(lighting: AnalyticLighting, band: BandLighting) -> AnalyticLighting:
    zenith = float(band.sky(zenith_rad=0.0, phi_rad=0.0)[0])
    return replace(lighting, path_and_beam=band, zenith_radiance=zenith)


def _mixed(
    air: Air, alternative: Air, plan: Plan, settings: Settings, lighting: MixedLighting, store: LightStore
) -> dict[str, Pair]:
    alone = companions(replace(air, alternative=None, share=0.0), plan, settings, lighting.first, store)
    other = companions(alternative, plan, settings, lighting.second, store)
    return {
        knob: Pair(
            one=MixedLighting(first=pair.one, second=other[knob].one, share=air.share),
            other=MixedLighting(first=pair.other, second=other[knob].other, share=air.share),
            factor=max(pair.factor, other[knob].factor),
        )
        for knob, pair in alone.items()
    }
