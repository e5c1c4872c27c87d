"""The tables of a scene file that say what a session adds to the scene, and which effects are forced on or off."""

from typing import Annotated

from pydantic import AfterValidator, Field

from model.effects.names import Effect
from rigctl.files.config import Section, Uncertain


def _known(name: str) -> str:
    if name not in effect_names():
        raise ValueError(f"is {name!r}; allowed are {', '.join(effect_names())}")
    return name


def _between(least: float, most: float) -> AfterValidator:
    def check(number: Uncertain) -> Uncertain:
        if not least <= number.value <= most:
            raise ValueError(f"is {number.value:g}, must lie in [{least:g}, {most:g}]")
        return number

    return AfterValidator(check)


def _positive_up_to(most: float) -> AfterValidator:
    def check(number: Uncertain) -> Uncertain:
        if not 0.0 < number.value <= most:
            raise ValueError(f"is {number.value:g}, must be above 0 and at most {most:g}")
        return number

    return AfterValidator(check)


Drift = Annotated[Uncertain, _between(-1, 1)]
EffectName = Annotated[str, AfterValidator(_known)]


class ErrorsSection(Section):
    """Errors that a session adds to a scene; by default none. These are random or known, and predicted with the rest.

    `polarizer_angle_std_deg` is how far each angle misses on its own, `misregistration_px` how far the picture shifts
    from frame to frame along each axis (both standard deviations), `texture_correlation_px` the distance at which the
    correlation of the texture has fallen to 0.61, `illumination_drift` the change of the light from the first frame of
    a cycle to the last over its mean, `surround_albedo` that of the near surroundings where it is not
    atmosphere.ground_albedo, `off_axis_falloff` whether light falls as cos^4 over a region's extent (no flat field).
    Each number may have a standard uncertainty.
    """

    polarizer_angle_std_deg: Annotated[Uncertain, _between(0, 20)] = Uncertain(value=0.0)
    misregistration_px: Annotated[Uncertain, _between(0, 1e4)] = Uncertain(value=0.0)
    texture_correlation_px: Annotated[Uncertain, _positive_up_to(1e4)] = Uncertain(value=1.0)
    illumination_drift: Drift = Uncertain(value=0.0)
    surround_albedo: Annotated[Uncertain, _between(0, 1)] | None = None
    off_axis_falloff: bool = False


class EffectsSection(Section):
    """Effects that act whatever their bound (`with`), and that are left out (`without`)."""

    switched_on: tuple[EffectName, ...] = Field(default=(), alias="with")
    left_out: tuple[EffectName, ...] = Field(default=(), alias="without")


def effect_names() -> tuple[str, ...]:
    """Return the effects as files and options call them: without spaces."""
    return tuple(effect.value.replace(" ", "-") for effect in Effect)


def effect_of(name: str) -> Effect:
    """Return the effect that a file or an option calls so."""
    return tuple(Effect)[effect_names().index(name)]
