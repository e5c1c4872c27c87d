"""Checks of sections II-C, III and V-B to V-D: low light, the rooftop, height, geometry of the scene, noise."""

import numpy as np

from rigctl.paper.airborne import BACKGROUND, TARGET, WHITE, Geometry
from rigctl.paper.numbers import Number, Reading, Test, above, falls, peak_within, some_step_rises
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


def fig5_diverges(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the first order gets worse towards low light."""
    low = scenes.low_light
    return one_reading(
        *(
            above(low.relative_error(first, moment), low.relative_error(second, moment))
            for moment in ("mean", "std")
            for first, second in ((0.0, 10.0), (10.0, 20.0))
        )
    )


def fig5_agrees_above_20(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that at 20 dB first order is better than below."""
    low = scenes.low_light
    return one_reading(
        *(
            above(low.relative_error(decibel, moment), low.relative_error(20.0, moment))
            for moment in ("mean", "std")
            for decibel in (0.0, 4.0, 8.0, 12.0, 16.0)
        )
    )


def all_above_20(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that all scenes are brighter than 20 dB."""
    ratio = scenes.airborne.least_s0_snr()
    least = Number(label="least SNR of S0 [dB]", value=float(20.0 * np.log10(ratio)))
    return one_reading(above(least, Number(label="20 dB", value=20.0)))


def fig8_black_is_higher(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the black panel has more DoLP, the white one more light."""
    black, white = (scenes.rooftop.number(name, "dolp_pixels", "mean") for name in (TARGET, WHITE))
    bright, dark = (scenes.rooftop.number(name, "s0", "mean") for name in (WHITE, TARGET))
    return one_reading(above(black, white), above(bright, dark))


def fig8_white_is_narrower(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the white panel scatters less."""
    number = scenes.rooftop.number
    return one_reading(
        *(above(number(TARGET, quantity, "std"), number(WHITE, quantity, "std")) for quantity in _NORMALIZED)
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
        value = float(scenes.airborne.stokes(Geometry(sun=50.0, view=50.0, height_m=height), "path")[0])
        found.append(Number(label=f"S0 path {height / 1000:g} km [W m-2 sr-1]", value=value, error=3e-3 * value))
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
    """Test that the ratio is largest at a sun of 40 to 60 deg."""
    return one_reading(peak_within(_fig12(scenes, 40.0), SUNS_DEG, 40.0, 60.0))


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
    """Test that ratio and detection go different ways."""
    steep, oblique = (scenes.airborne.snr(scenes.at(50.0, view), label=f"sun 50 view {view:g}") for view in VIEWS_DEG)
    return one_reading(above(oblique, steep), above(_fig13(scenes, 50.0, 20.0), _fig13(scenes, 50.0, 40.0)))


def fig13_background_is_polarized(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the asphalt is polarized."""
    nothing = Number(label="none", value=0.0)
    return one_reading(
        *(
            above(
                Number(
                    label=f"DoLP {BACKGROUND} sun {sun:g} view {view:g}",
                    value=scenes.airborne.quantity(scenes.at(sun, view), BACKGROUND, "dolp"),
                    error=3e-3,
                ),
                nothing,
            )
            for sun in (10.0, 50.0)
            for view in VIEWS_DEG
        )
    )


def fig14_falls(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the ratio falls with noise."""
    by_noise = [_fig12(scenes, 40.0, kn) for kn in NOISE_FACTORS]
    return one_reading(*(test for numbers in zip(*by_noise, strict=True) for test in falls(numbers)))


def fig14_peaks(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Test that the peak stays with every noise."""
    return one_reading(*(peak_within(_fig12(scenes, 40.0, kn), SUNS_DEG, 40.0, 60.0) for kn in NOISE_FACTORS))


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
