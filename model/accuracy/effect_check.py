"""True changes by effects that are left out: the chain evaluated with and without them."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from model.accuracy.evaluation.chain import ChainResult, evaluate
from model.accuracy.evaluation.light_store import LightStore
from model.accuracy.evaluation.quantities import Reading, Readings, differences, readings
from model.accuracy.evaluation.settings import Settings
from model.effects.bound import Bound
from model.effects.names import ALL, Effect
from model.effects.planner import LIGHT
from model.prediction.quantity_table import SHARES, is_counts
from model.scene.lit_scene import LitScene

_DOLP_TOLERANCE = 1e-11
# The least of so many times is taken: another program's turn on the processor is not counted.
_REPEATS = 3
# Means that are computed in two ways differ by this share of S0. Where DoLP is 0 but for rounding, as of a level panel
# under a sun at the zenith seen from straight above, its SNR and deviation have no digits that could be compared.
_ROUNDING = 1e-14
_NONE = 1e-11
_RADIANCE = frozenset({"radiance", "s0", "s1", "s2"})


@dataclass(frozen=True, kw_only=True)
class CheckedEffect:
    """An effect with what leaving it out truly changes.

    Attributes
    ----------
    effect
        Which.
    bound, actual
        Guaranteed and found.
    with_s, without_s
        Time of the chain with all effects and without this one, nothing being kept from before [s]; of an effect that
        acts behind the lens, of the chain behind the lens.
    """

    effect: Effect
    bound: Bound
    actual: Bound
    with_s: float
    without_s: float

    @property
    def holds(self) -> bool:
        """True if the change is within its bound."""
        return self.bound.holds(self.actual)


def check_effects(
    scene: LitScene,
    settings: Settings,
    bounds: dict[Effect, Bound],
    *,
    make_store: Callable[[], LightStore] = LightStore,
) -> tuple[CheckedEffect, ...]:
    """Return what leaving out each of some effects changes, one at a time.

    Parameters
    ----------
    scene
        All that the scene is.
    settings
        Numerical settings of both evaluations.
    bounds
        Effects to leave out, with their bounds.
    make_store
        Gives an empty store of lights; every effect of the light has its own, so that times can be compared.

    Raises
    ------
    ValueError
        A number of the scene is outside its range.
    """
    # Of the distribution of DoLP the error must not hide what is to be seen.
    settings = replace(settings, dolp_tolerance=min(settings.dolp_tolerance, _DOLP_TOLERANCE))
    store = make_store()
    whole, whole_s = _evaluated(scene, settings, ALL, store)
    # What acts behind the lens is compared by the time behind the lens: the light of the store is the same.
    _, behind_s = _evaluated(scene, settings, ALL, store)
    found = []
    for effect, bound in bounds.items():
        is_light = effect in LIGHT
        without, without_s = _evaluated(scene, settings, ALL - {effect}, make_store() if is_light else store)
        actual = change(whole, without)
        with_s = whole_s if is_light else behind_s
        found.append(CheckedEffect(effect=effect, bound=bound, actual=actual, with_s=with_s, without_s=without_s))
    return tuple(found)


def chain_time_s(
    scene: LitScene,
    settings: Settings,
    effects: frozenset[Effect],
    *,
    make_store: Callable[[], LightStore] = LightStore,
) -> float:
    """Return the time of one evaluation with some effects, nothing being kept from before [s].

    Parameters
    ----------
    scene, settings, effects
        As `model.accuracy.evaluation.chain.evaluate` takes them.
    make_store
        Gives an empty store of lights.
    """
    return min(
        sum(evaluate(scene, settings, effects=effects, store=make_store()).stage_s.values()) for _ in range(_REPEATS)
    )


def change(whole: Readings, without: Readings) -> Bound:
    """Return the largest difference of each kind between two sets of readings, but for rounding of no polarization.

    Parameters
    ----------
    whole, without
        Readings with all effects and without one, of the same scene and settings.
    """
    found = Bound()
    for reading, apart in differences(whole, without).items():
        if apart > _rounding(reading, whole):
            found = found.worse(Bound(**{kind_of(reading): apart}))
    return found


def _rounding(reading: Reading, whole: Readings) -> float:
    dolp = whole.get(Reading(reading.place, "dolp", "mean"))
    rests_on_direction = reading.quantity == "dolp_snr" or reading[1:] == ("dolp", "std")
    if not rests_on_direction or dolp is None:
        return 0.0
    return _ROUNDING / dolp.number if dolp.number > _NONE else np.inf


def kind_of(reading: Reading) -> str:
    """Return which number of a `Bound` speaks of a reading.

    Parameters
    ----------
    reading
        A number of a prediction.
    """
    if reading.quantity in {"p_detection", "auc"}:
        return "detection"
    if reading.quantity in SHARES and reading.statistic == "mean":
        return "ratios"
    is_level = reading.quantity in _RADIANCE or is_counts(reading.quantity)
    if is_level and (reading.statistic == "mean" or reading.quantity == "radiance"):
        return "radiance"
    return "deviations"


def readings_of(result: ChainResult) -> Readings:
    """Return all that a tolerance speaks of, of one evaluation.

    Parameters
    ----------
    result
        One evaluation of the chain.
    """
    return readings(result.scenario, result.predictions, result.detections)


def _evaluated(
    scene: LitScene, settings: Settings, effects: frozenset[Effect], store: LightStore
) -> tuple[Readings, float]:
    result = evaluate(scene, settings, effects=effects, store=store)
    return readings_of(result), sum(result.stage_s.values())
