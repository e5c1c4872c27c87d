"""One record for each effect: what it changes, where it acts, and what it costs."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from model.effects.names import Effect


@dataclass(frozen=True, kw_only=True)
class EffectFacts:
    """What is to be known of an effect.

    Attributes
    ----------
    changes
        What it changes.
    place
        The one place where it acts.
    cost
        What computing it takes.
    """

    changes: str
    place: str
    cost: str


_RECORD = "model.effects.acting"
_STORE = "model.accuracy.evaluation.light_store"
_CHAIN = "model.accuracy.evaluation.chain"
_LITTLE = "microseconds"

FACTS: Mapping[Effect, EffectFacts] = MappingProxyType(
    {
        Effect.FIELD_OF_VIEW: EffectFacts(
            changes="mean light and its spread over a region", place=_STORE, cost="a light for each tile"
        ),
        Effect.TEXTURE: EffectFacts(changes="covariance over pixels", place=_RECORD, cost=_LITTLE),
        Effect.SKYLIGHT: EffectFacts(changes="mean light", place=_STORE, cost="sky, and an integral over it a view"),
        Effect.PATH_RADIANCE: EffectFacts(changes="mean light", place=_STORE, cost="one ray a view"),
        Effect.LEAKAGE: EffectFacts(changes="counts, noise of S1 and S2", place=_RECORD, cost=_LITTLE),
        Effect.DARK_CURRENT: EffectFacts(changes="temporal noise", place=_RECORD, cost=_LITTLE),
        Effect.SHOT_NOISE: EffectFacts(changes="temporal noise", place=_RECORD, cost=_LITTLE),
        Effect.READ_NOISE: EffectFacts(changes="temporal noise", place=_RECORD, cost=_LITTLE),
        Effect.QUANTISATION: EffectFacts(changes="temporal noise", place=_RECORD, cost=_LITTLE),
        Effect.WAVELENGTHS: EffectFacts(changes="light of sky and path", place=_CHAIN, cost="a solution for each"),
        Effect.POLARIZER_ANGLE: EffectFacts(
            changes="degree of polarization, temporal noise", place=_RECORD, cost=_LITTLE
        ),
        Effect.MISREGISTRATION: EffectFacts(
            changes="correlation of texture between frames", place=_RECORD, cost=_LITTLE
        ),
        Effect.DRIFT: EffectFacts(changes="mean Stokes parameters", place=_RECORD, cost=_LITTLE),
        Effect.NONUNIFORMITY: EffectFacts(changes="covariance over pixels", place=_RECORD, cost=_LITTLE),
        Effect.SATURATION: EffectFacts(
            changes="warnings; the share of pixels for which the model is void", place=_RECORD, cost=_LITTLE
        ),
        Effect.FALLOFF: EffectFacts(changes="counts and their spread over a region", place=_CHAIN, cost=_LITTLE),
        Effect.ADJACENCY: EffectFacts(changes="mean light", place=_CHAIN, cost=_LITTLE),
    }
)
