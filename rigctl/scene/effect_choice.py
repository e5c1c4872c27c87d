"""Effects that act by a user's own choice, from the scene file and from options."""

from collections.abc import Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING

from model.effects.names import ALL, Effect
from rigctl.errors import ConfigError
from rigctl.files.effect_sections import EffectsSection, effect_names, effect_of

if TYPE_CHECKING:
    from rigctl.files.scene_file import SceneFile
    from rigctl.scene.scene_record import Scene


def with_choices(scene: "SceneFile", *, switched_on: Sequence[str], left_out: Sequence[str]) -> "SceneFile":
    """Return the scene with effects forced by options, which go before those of the file.

    Raises
    ------
    ConfigError
        There is no such effect, or it is both switched on and left out.
    """
    for name in (*switched_on, *left_out):
        if name not in effect_names():
            close = get_close_matches(name, effect_names(), n=1)
            alike = f"did you mean {close[0]}?" if close else f"allowed are {', '.join(effect_names())}"
            raise ConfigError(f"effect {name!r} is not known; {alike}")
    mine = {*switched_on, *left_out}
    section = EffectsSection.model_validate(
        {
            "with": (*switched_on, *(one for one in scene.effects.switched_on if one not in mine)),
            "without": (*left_out, *(one for one in scene.effects.left_out if one not in mine)),
        }
    )
    chosen = scene.model_copy(update={"effects": section})
    forced_effects(chosen)
    return chosen


def without_effects(scene: "SceneFile", effects: frozenset[Effect]) -> "SceneFile":
    """Return the scene with some effects left out, beside those that it leaves out itself."""
    names = tuple(name for name in effect_names() if effect_of(name) in effects)
    return with_choices(scene, switched_on=(), left_out=names)


def forced_effects(scene: "SceneFile | Scene") -> dict[Effect, bool]:
    """Return the effects that are forced on (True) or off (False).

    Raises
    ------
    ConfigError
        An effect is both.
    """
    both = sorted(set(scene.effects.switched_on) & set(scene.effects.left_out))
    if both:
        raise ConfigError(f"scene {scene.name}: effects {', '.join(both)} are both switched on and left out")
    return {effect_of(name): True for name in scene.effects.switched_on} | {
        effect_of(name): False for name in scene.effects.left_out
    }


def acting_effects(scene: "SceneFile | Scene") -> frozenset[Effect]:
    """Return the effects that act where no tolerance leaves any out: all but those that the user did."""
    return ALL - {effect for effect, acts in forced_effects(scene).items() if not acts}


def choice_remarks(scene: "SceneFile") -> tuple[str, ...]:
    """Return what has to be said of every result: which effects are left out by request."""
    names = scene.effects.left_out
    if not names:
        return ()
    return (f"left out by request: {', '.join(names)}; rigctl effects says what that may change",)
