"""The tables of a scene file that say what a session adds to the scene, and which effects are forced on or off."""

from dataclasses import dataclass
from math import inf
from typing import Annotated

from pydantic import AfterValidator, Field

from model.effects.names import Effect
from rigctl.files.config import Allowed, Section, Uncertain


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


@dataclass(frozen=True, kw_only=True)
class ErrorNumber:
    """What a number of [errors] is to the rest of the program: written beside its key, and nowhere else.

    Attributes
    ----------
    field : str
        Of `model.sensor.Imperfections`, which takes the number; an angle in radians.
    unit : str
        Of the file; empty for a pure number.
    meaning : str
        One line.
    most : float
        Up to where it may be varied; it begins at 0.
    """

    field: str
    unit: str
    meaning: str
    most: float = inf


Drift = Annotated[Uncertain, _between(-1, 1), Allowed("from -1, to 1")]
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

    polarizer_angle_std_deg: Annotated[
        Uncertain,
        _between(0, 20),
        Allowed("from 0, to 20"),
        ErrorNumber(
            field="polarizer_angle_std_rad",
            unit="deg",
            meaning="scatter of the polarizer's angle from frame to frame",
        ),
    ] = Uncertain(value=0.0)
    """Scatter of the polarizer's angle from frame to frame. Example: `0.1`."""
    misregistration_px: Annotated[
        Uncertain,
        _between(0, 1e4),
        Allowed("from 0, to 10000"),
        ErrorNumber(
            field="misregistration_pixels",
            unit="pixels",
            meaning="shift of the picture from frame to frame, along each axis",
        ),
    ] = Uncertain(value=0.0)
    """Shift of the picture from frame to frame, along each axis. Example: `0.2`."""
    texture_correlation_px: Annotated[
        Uncertain,
        _positive_up_to(1e4),
        Allowed("above 0, to 10000"),
        ErrorNumber(
            field="texture_correlation_pixels",
            unit="pixels",
            meaning="distance at which the texture's correlation is 0.61",
        ),
    ] = Uncertain(value=1.0)
    """Distance at which the texture's correlation is 0.61. Example: `3.0`."""
    illumination_drift: Drift = Uncertain(value=0.0)
    """Change of the light from the first frame of a cycle to the last, over its mean. Example: `0.01`."""
    surround_albedo: Annotated[
        Annotated[Uncertain, _between(0, 1), Allowed("from 0, to 1")] | None,
        ErrorNumber(field="surround_albedo", unit="", meaning="albedo of the near surroundings", most=1.0),
    ] = None
    """Albedo of the near surroundings, where it is not `atmosphere.ground_albedo`. Example: `0.2`."""
    off_axis_falloff: bool = False
    """Light falls as cos^4 over a region's extent (no flat field). Example: `true`."""


def error_numbers() -> dict[str, ErrorNumber]:
    """Return the numbers of [errors] that are parameters of a scene, by their keys."""
    return {
        key: one
        for key, field in ErrorsSection.model_fields.items()
        for one in field.metadata
        if isinstance(one, ErrorNumber)
    }


class EffectsSection(Section):
    """Effects that act whatever their bound (`with`), and that are left out (`without`)."""

    switched_on: tuple[EffectName, ...] = Field(default=(), alias="with")
    """Effects that act whatever their bound. Example: `["misregistration"]`."""
    left_out: tuple[EffectName, ...] = Field(default=(), alias="without")
    """Effects that are left out whatever their bound. Example: `["adjacency"]`."""


def effect_names() -> tuple[str, ...]:
    """Return the effects as files and options call them: without spaces."""
    return tuple(effect.value.replace(" ", "-") for effect in Effect)


def effect_of(name: str) -> Effect:
    """Return the effect that a file or an option calls so."""
    return tuple(Effect)[effect_names().index(name)]
