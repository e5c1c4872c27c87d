"""Another aerosol that the air of a scene might as well have."""

from dataclasses import dataclass

from model.atmosphere.profile import AtmosphereState
from model.atmosphere.transfer.phase import AerosolKind


@dataclass(frozen=True, kw_only=True)
class AlternativeAir:
    """Another aerosol, and its share in the light (`model.atmosphere.lighting.mixed_lighting`)."""

    aerosol: AerosolKind
    state: AtmosphereState
    share: float
