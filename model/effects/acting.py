"""The record of a scene with effects left out: what is gone from it is computed by nobody."""

from model.effects.names import ALL, Effect
from model.scene.lit_scene import LightParts, LitScene


def acting(scene: LitScene, effects: frozenset[Effect]) -> LitScene:
    """Return the scene with all effects left out that do not act.

    Parameters
    ----------
    scene
        With all effects.
    effects
        That act.
    """
    if effects >= ALL:
        return scene
    from model.effects.effect_models import EFFECT_MODELS  # with their bounds, wanted where one is left out

    for effect, entry in EFFECT_MODELS.items():
        if effect not in effects:
            scene = entry.removed(scene)
    return scene


def acting_parts(effects: frozenset[Effect]) -> LightParts:
    """Return the parts of the light that are computed where some effects act.

    Parameters
    ----------
    effects
        That act.
    """
    return LightParts(
        field_of_view=Effect.FIELD_OF_VIEW in effects,
        skylight=Effect.SKYLIGHT in effects,
        path_radiance=Effect.PATH_RADIANCE in effects,
        wavelengths=Effect.WAVELENGTHS in effects,
    )
