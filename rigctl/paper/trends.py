"""Checks of sections II-C, III and V-B to V-D: low light, the rooftop, height, geometry of the scene, noise."""

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np

from rigctl.paper.airborne import BACKGROUND, TARGET, TOLERANCE, WHITE, Geometry
from rigctl.paper.numbers import Number, Reading, Test, above, differ, falls, peak_within, some_step_rises
from rigctl.paper.statement import (
    HEIGHTS_M,
    MUCH,
    NOISE_FACTORS,
    ROC_NOISE_FACTORS,
    SIGNIFICANT,
    SUNS_DEG,
    VIEWS_DEG,
    PaperScenes,
    both_azimuths,
    one_reading,
)

_MOMENTS: tuple[Literal["mean", "std"], ...] = ("mean", "std")


def fig5_diverges(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the first order gets worse towards low light."""
    return _both_decibels(
        lambda scale: tuple(
            above(_off(scenes, first, moment, scale), _off(scenes, second, moment, scale))
            for moment in _MOMENTS
            for first, second in ((0.0, 10.0), (10.0, 20.0))
        )
    )


def fig5_agrees_above_20(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that at 20 dB first order is better than below."""
    return _both_decibels(
        lambda scale: tuple(
            above(_off(scenes, decibel, moment, scale), _off(scenes, 20.0, moment, scale))
            for moment in _MOMENTS
            for decibel in (0.0, 4.0, 8.0, 12.0, 16.0)
        )
    )


def _both_decibels(tests: Callable[[float], tuple[Test, ...]]) -> tuple[Reading, ...]:
    """Return the readings of decibels, which the paper does not define: of an amplitude, and of a power."""
    return (
        Reading(name="20 dB is an SNR of 10", tests=tests(1.0)),
        Reading(name="20 dB is an SNR of 100", tests=tests(2.0)),
    )


def _off(scenes: PaperScenes, decibel: float, moment: Literal["mean", "std"], scale: float) -> Number:
    return replace(
        scenes.low_light.relative_error(scale * decibel, moment), label=f"first-order {moment} at {decibel:g} dB off by"
    )


def all_above_20(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that all scenes are brighter than 20 dB."""
    least = min((*scenes.airborne.s0_snrs(), *scenes.rooftop.s0_snrs()), key=lambda one: one.value)
    return _both_decibels(
        lambda scale: (
            above(
                Number(
                    label=f"least {least.label} [dB]",
                    value=20.0 / scale * float(np.log10(least.value)),
                    error=20.0 / scale / float(np.log(10.0)) * least.error / least.value,
                ),
                Number(label="20 dB", value=20.0),
            ),
        )
    )


def fig8_black_is_higher(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the black panel has more DoLP, the white one more light."""
    black, white = (scenes.rooftop.number(name, "dolp_pixels", "mean") for name in (TARGET, WHITE))
    bright, dark = (scenes.rooftop.number(name, "s0", "mean") for name in (WHITE, TARGET))
    return one_reading(above(black, white), above(bright, dark))


def fig8_white_is_narrower(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the white panel scatters less, and has the higher ratio of S0 to its noise."""
    number = scenes.rooftop.number
    black, white = scenes.rooftop.s0_snrs()
    return one_reading(
        *(above(number(TARGET, quantity, "std"), number(WHITE, quantity, "std")) for quantity in _NORMALIZED),
        above(white, black),
    )


_NORMALIZED = ("s1n", "s2n", "dolp_pixels")


def _heights(scenes: PaperScenes, source: str, *, turned: bool = False) -> list[Number]:
    snr = scenes.airborne.snr
    return [
        snr(
            Geometry(sun=50.0, view=50.0, height_m=height),
            source="reflected" if source == "reflected" else "total",
            turned=turned,
            label=f"{source} {height / 1000:g} km",
        )
        for height in HEIGHTS_M
    ]


def fig10_reflected_falls(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the reflected ratio falls with height."""
    return one_reading(*falls(_heights(scenes, "reflected")))


def fig10_total_does_not(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the total ratio does not fall all along."""
    return both_azimuths(lambda turned: (some_step_rises(_heights(scenes, "total", turned=turned)),))


def fig10_total_misleads(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test two heights of which the higher has more total and less reflected ratio: the clearest pair."""

    def tests(turned: bool) -> tuple[Test, ...]:
        total, reflected = _heights(scenes, "total", turned=turned), _heights(scenes, "reflected")
        pairs = [
            (above(total[high], total[low]), above(reflected[low], reflected[high]))
            for low in range(len(total))
            for high in range(low + 1, len(total))
        ]
        return max(pairs, key=lambda pair: min(test.margin for test in pair))

    return both_azimuths(tests)


def fig10_path_grows(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the path gains light with height."""
    found = []
    for height in HEIGHTS_M:
        at = Geometry(sun=50.0, view=50.0, height_m=height)
        found.append(scenes.airborne.radiance(at, "path", label=f"path {height / 1000:g} km"))
    return (
        Reading(name="rises", tests=falls(found[::-1])),
        Reading(
            name=f"at 9 km {SIGNIFICANT:g} times that at 3 km", tests=(above(found[-1], found[0], factor=SIGNIFICANT),)
        ),
    )


def _fig11_detection(scenes: PaperScenes) -> list[Number]:
    at = [Geometry(sun=50.0, view=50.0, height_m=height) for height in HEIGHTS_M]
    return [scenes.airborne.p_detection(one, label=f"{one.height_m / 1000:g} km") for one in at]


def fig11_falls(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that detection falls with height."""
    return one_reading(*falls(_fig11_detection(scenes)))


def fig11_as_fig10(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that detection and the reflected ratio fall together."""
    return one_reading(*falls(_fig11_detection(scenes)), *falls(_heights(scenes, "reflected")))


def fig11_much_higher_low(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the reflected ratio is much higher low down."""
    found = _heights(scenes, "reflected")
    return (
        Reading(name=f"at 3 km {MUCH:g} times that at 9 km", tests=(above(found[0], found[-1], factor=MUCH),)),
        Reading(name="at 3 km above that at 9 km", tests=(above(found[0], found[-1]),)),
    )


def _fig12(scenes: PaperScenes, view: float, kn: float = 1.0) -> list[Number]:
    label = f"view {view:g}" + ("" if kn == 1.0 else f" Kn {kn:g}")
    return [scenes.airborne.snr(scenes.at(sun, view, kn=kn), label=f"sun {sun:g} {label}") for sun in SUNS_DEG]


def fig12_oblique_is_higher(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the oblique view has the higher ratio at every sun."""
    return one_reading(
        *(above(more, less) for more, less in zip(_fig12(scenes, 40.0), _fig12(scenes, 20.0), strict=True))
    )


def fig12_peaks(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the ratio, and the polarization itself, are largest at a sun of 40 to 60 deg."""
    ratios = {view: peak_within(_fig12(scenes, view), SUNS_DEG, *_PEAK_DEG) for view in VIEWS_DEG}
    degrees = (peak_within(_fig12_dolp(scenes, view), SUNS_DEG, *_PEAK_DEG) for view in VIEWS_DEG)
    return (
        Reading(name="DoLP SNR at view 40", tests=(ratios[40.0],)),
        Reading(name="DoLP SNR at view 20", tests=(ratios[20.0],)),
        Reading(name="DoLP itself at both views", tests=tuple(degrees)),
    )


_PEAK_DEG = (40.0, 60.0)


def _fig12_dolp(scenes: PaperScenes, view: float) -> list[Number]:
    return [_dolp(scenes, TARGET, sun, view) for sun in SUNS_DEG]


def _dolp(scenes: PaperScenes, region: str, sun: float, view: float) -> Number:
    value = scenes.airborne.quantity(scenes.at(sun, view), region, "dolp")
    # What the light is computed to, in parts of S0.
    return Number(label=f"DoLP {region} sun {sun:g} view {view:g}", value=value, error=TOLERANCE)


def _fig13(scenes: PaperScenes, sun: float, view: float) -> Number:
    return scenes.airborne.p_detection(scenes.at(sun, view), label=f"sun {sun:g} view {view:g}")


def fig13_sun_50_is_better(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that detection is better with the lower sun."""
    return one_reading(*(above(_fig13(scenes, 50.0, view), _fig13(scenes, 10.0, view)) for view in VIEWS_DEG))


def fig13_view_40_at_10(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that with the high sun the oblique view detects better, and has the higher ratio."""
    steep, oblique = (scenes.airborne.snr(scenes.at(10.0, view), label=f"sun 10 view {view:g}") for view in VIEWS_DEG)
    return one_reading(above(_fig13(scenes, 10.0, 40.0), _fig13(scenes, 10.0, 20.0)), above(oblique, steep))


def fig13_view_20_at_50(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that with the lower sun the steep view detects better."""
    return one_reading(above(_fig13(scenes, 50.0, 20.0), _fig13(scenes, 50.0, 40.0)))


def fig13_not_as_snr(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the ratio is higher at the oblique view with every sun, and detection worse there at a sun of 50."""
    steep, oblique = (_fig12(scenes, view) for view in VIEWS_DEG)
    return one_reading(
        *(above(more, less) for more, less in zip(oblique, steep, strict=True)),
        above(_fig13(scenes, 50.0, 20.0), _fig13(scenes, 50.0, 40.0)),
    )


def fig13_background_counts(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the ratio of the target and detection on the background go different ways at a sun of 50."""
    steep, oblique = (scenes.airborne.snr(scenes.at(50.0, view), label=f"sun 50 view {view:g}") for view in VIEWS_DEG)
    return one_reading(above(oblique, steep), above(_fig13(scenes, 50.0, 20.0), _fig13(scenes, 50.0, 40.0)))


def fig13_background_is_polarized(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the asphalt is polarized, and that detection would not be the same were it not."""
    nothing = Number(label="none", value=0.0)
    unpolarized = scenes.airborne.p_detection_on_unpolarized
    places = [(sun, view) for sun in (10.0, 50.0) for view in VIEWS_DEG]
    return one_reading(
        *(above(_dolp(scenes, BACKGROUND, sun, view), nothing) for sun, view in places),
        *(
            differ(_fig13(scenes, sun, view), unpolarized(scenes.at(sun, view), label=f"sun {sun:g} view {view:g}"))
            for sun, view in places
        ),
    )


def fig14_falls(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the ratio falls with noise."""
    by_noise = [_fig12(scenes, 40.0, kn) for kn in NOISE_FACTORS]
    return one_reading(*(test for numbers in zip(*by_noise, strict=True) for test in falls(numbers)))


def fig14_peaks(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the peak stays with every noise."""
    by_noise = [_fig12(scenes, 40.0, kn) for kn in NOISE_FACTORS]
    both = tuple(
        above(found[SUNS_DEG.index(high)], found[SUNS_DEG.index(low)])
        for found in by_noise
        for high in (40.0, 60.0)
        for low in (10.0, 20.0, 30.0, 70.0, 80.0)
    )
    return (
        Reading(
            name="largest at a sun of 40 to 60", tests=tuple(peak_within(n, SUNS_DEG, *_PEAK_DEG) for n in by_noise)
        ),
        Reading(name="at 40 and at 60 above 10 to 30, 70 and 80", tests=both),
    )


def _fig15(scenes: PaperScenes, view: float) -> list[Number]:
    detected = scenes.airborne.p_detection
    return [detected(scenes.at(50.0, view, kn=kn), label=f"view {view:g} Kn {kn:g}") for kn in ROC_NOISE_FACTORS]


def fig15_falls(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that detection falls with noise."""
    return tuple(Reading(name=f"view {view:g}", tests=falls(_fig15(scenes, view))) for view in VIEWS_DEG)


def fig15_significantly(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that detection falls by much with noise."""
    found = []
    for view in VIEWS_DEG:
        first, *_, last = _fig15(scenes, view)
        found.append(Reading(name=f"view {view:g}", tests=(above(first, last, factor=SIGNIFICANT),)))
    return tuple(found)
