"""What each level of each knob is likely to leave out and to cost in a scene, before anything is computed."""

from collections.abc import Mapping
from dataclasses import dataclass

from model.accuracy.knobs import KNOBS, WAVELENGTHS, Plan, at_level, settings_at
from model.accuracy.spectral_error import spectral_error
from model.lit_scene import Air, LitScene


@dataclass(frozen=True, kw_only=True, eq=False)
class Outlook:
    """Likely errors and efforts of a scene.

    Attributes
    ----------
    errors
        Knob to the likely relative error of the light at each of its levels, falling.
    efforts
        Knob to by what the time of its stage is multiplied at each of its levels, over the lowest.
    """

    errors: Mapping[str, tuple[float, ...]]
    efforts: Mapping[str, tuple[float, ...]]

    def error(self, plan: Plan, scales: Mapping[str, float]) -> float:
        """Return the sum of the errors that are to be expected, each multiplied by a scale of its knob."""
        return sum(scales[name] * self.errors[name][level] for name, level in plan.items())


def outlook(scene: LitScene) -> Outlook:
    """Return the likely errors and efforts of all levels of all knobs.

    Parameters
    ----------
    scene
        To be predicted.

    Notes
    -----
    The wavelengths alone are looked at for the scene itself: a narrow band needs one where a wide one needs four.

    References
    ----------
    Definition.
    """
    errors = {name: tuple(level.error for level in knob.levels) for name, knob in KNOBS.items()}
    efforts = {name: tuple(level.effort for level in knob.levels) for name, knob in KNOBS.items()}
    found = [_of_wavelengths(air) for air in _computed(scene)]
    if found:
        errors[WAVELENGTHS] = tuple(max(each) for each in zip(*(error for error, _ in found), strict=True))
        efforts[WAVELENGTHS] = tuple(max(each) for each in zip(*(effort for _, effort in found), strict=True))
    return Outlook(errors=errors, efforts=efforts)


def _computed(scene: LitScene) -> list[Air]:
    airs = [] if scene.air is None else [scene.air, scene.air.alternative]
    return [air for air in airs if air is not None and air.state is not None]


def _of_wavelengths(air: Air) -> tuple[tuple[float, ...], tuple[float, ...]]:
    lowest = settings_at(dict.fromkeys(KNOBS, 0), 1e-2)
    levels = range(len(KNOBS[WAVELENGTHS].levels))
    found = [spectral_error(air, at_level(lowest, WAVELENGTHS, level)) for level in levels]
    return tuple(one.scattered for one in found), tuple(float(one.rule.wavelength_m.size) for one in found)
