"""Every sentence of [MK14] sections II-C to VI about what a figure shows, as a typed record with its check.

The sentences are the paper's own words. A sentence that allows several readings has all of them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rigctl.paper.airborne import BACKGROUND, TARGET, WHITE, Airborne, Geometry
from rigctl.paper.low_light import LowLight
from rigctl.paper.numbers import Number, Reading, Test, above, falls, peak_within, some_step_rises
from rigctl.paper.rooftop import GEOMETRY as ROOFTOP_GEOMETRY
from rigctl.paper.rooftop import Rooftop

HEIGHTS_M = (3000.0, 5000.0, 7000.0, 9000.0)
SUNS_DEG = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)
VIEWS_DEG = (20.0, 40.0)
NOISE_FACTORS = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5)
ROC_NOISE_FACTORS = (1.0, 2.0, 3.0)
AZIMUTHS_DEG = (0.0, 90.0, 180.0)
# Of words for which the paper has no number.
MUCH, SIGNIFICANT = 1.5, 1.5
_PATH_TURNED = "azimuth of the path radiance turned by 180 deg"
_AS_STATED = "as stated"
_NEEDS_DATA = "their measured points: not at hand; --digitised overlays points of whoever has the figures"


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperScenes:
    """Scenes in which the statements are checked; `height_m` is that where the paper names none."""

    airborne: Airborne
    rooftop: Rooftop
    low_light: LowLight
    height_m: float = 3000.0

    def at(self, sun: float, view: float, phi: float = 180.0, kn: float = 1.0) -> Geometry:
        """Return a geometry of section V at the height that is taken where none is stated."""
        return Geometry(sun=sun, view=view, phi=phi, height_m=self.height_m, kn=kn)


@dataclass(frozen=True, kw_only=True)
class Statement:
    """A sentence and its check.

    Attributes
    ----------
    id, figure : str
        Its own name, and that of the figure.
    sentence : str
        The paper's words.
    geometry, check : str
        Where, and what is compared.
    readings : callable
        Scenes to the readings of the sentence.
    """

    id: str
    figure: str
    sentence: str
    geometry: str
    check: str
    readings: Callable[[PaperScenes], tuple[Reading, ...]]


def _one(*tests: Test) -> tuple[Reading, ...]:
    return (Reading(name=_AS_STATED, tests=tests),)


def _both_azimuths(tests: Callable[[bool], tuple[Test, ...]]) -> tuple[Reading, ...]:
    return (Reading(name=_AS_STATED, tests=tests(False)), Reading(name=_PATH_TURNED, tests=tests(True)))


def _unseen(_: PaperScenes) -> tuple[Reading, ...]:
    return (Reading(name="without their data", tests=()),)


def _fig5_diverges(scenes: PaperScenes) -> tuple[Reading, ...]:
    low = scenes.low_light
    return _one(
        *(
            above(low.relative_error(first, moment), low.relative_error(second, moment))
            for moment in ("mean", "std")
            for first, second in ((0.0, 10.0), (10.0, 20.0))
        )
    )


def _fig5_agrees_above_20(scenes: PaperScenes) -> tuple[Reading, ...]:
    low = scenes.low_light
    return _one(
        *(
            above(low.relative_error(decibel, moment), low.relative_error(20.0, moment))
            for moment in ("mean", "std")
            for decibel in (0.0, 4.0, 8.0, 12.0, 16.0)
        )
    )


def _all_above_20(scenes: PaperScenes) -> tuple[Reading, ...]:
    ratio = scenes.airborne.least_s0_snr()
    least = Number(label="least SNR of S0 [dB]", value=float(20.0 * np.log10(ratio)))
    return _one(above(least, Number(label="20 dB", value=20.0)))


def _fig8_black_is_higher(scenes: PaperScenes) -> tuple[Reading, ...]:
    black, white = (scenes.rooftop.number(name, "dolp_pixels", "mean") for name in (TARGET, WHITE))
    bright, dark = (scenes.rooftop.number(name, "s0", "mean") for name in (WHITE, TARGET))
    return _one(above(black, white), above(bright, dark))


def _fig8_white_is_narrower(scenes: PaperScenes) -> tuple[Reading, ...]:
    number = scenes.rooftop.number
    return _one(*(above(number(TARGET, quantity, "std"), number(WHITE, quantity, "std")) for quantity in _NORMALIZED))


_NORMALIZED = ("s1n", "s2n", "dolp_pixels")


def _fig9_total_differs(scenes: PaperScenes) -> tuple[Reading, ...]:
    def tests(turned: bool) -> tuple[Test, ...]:
        found = (
            _differ(
                scenes.airborne.snr(at, label=f"total {_place(at)}", turned=turned),
                scenes.airborne.snr(at, source="reflected", label=f"reflected {_place(at)}"),
            )
            for at in _fig9(scenes, (10.0, 50.0))
        )
        return tuple(test for test in found if test.verdict != "noise_floor")

    return _both_azimuths(tests)


def _fig9_path_above_reflected(scenes: PaperScenes) -> tuple[Reading, ...]:
    def tests(turned: bool) -> tuple[Test, ...]:
        return tuple(
            above(
                scenes.airborne.snr(at, source="path", label=f"path phi {at.phi:g}", turned=turned),
                scenes.airborne.snr(at, source="reflected", label=f"reflected phi {at.phi:g}"),
            )
            for at in _fig9(scenes, (10.0,))
            if at.phi < 180.0
        )

    return _both_azimuths(tests)


def _fig9_total_much_higher_at_0(scenes: PaperScenes) -> tuple[Reading, ...]:
    snr, at = scenes.airborne.snr, scenes.at(25.0, 10.0, 0.0)
    reflected = snr(at, source="reflected", label="reflected phi 0")

    def total(turned: bool) -> Number:
        return snr(at, label="total phi 0", turned=turned)

    def others(turned: bool) -> tuple[Test, ...]:
        return tuple(
            above(total(turned), snr(one, label=f"total phi {one.phi:g}", turned=turned), factor=MUCH)
            for one in (scenes.at(25.0, 10.0, 90.0), scenes.at(25.0, 10.0, 180.0))
        )

    return tuple(
        Reading(name=f"{name}; {azimuth}", tests=found)
        for turned, azimuth in ((False, _AS_STATED), (True, _PATH_TURNED))
        for name, found in (
            (f"{MUCH:g} times that of the reflected radiance there", (above(total(turned), reflected, factor=MUCH),)),
            (f"{MUCH:g} times that of the total at 90 and 180 deg", others(turned)),
        )
    )


def _fig9_path_dominates(scenes: PaperScenes) -> tuple[Reading, ...]:
    def tests(turned: bool) -> tuple[Test, ...]:
        path = scenes.airborne.stokes(scenes.at(25.0, 10.0, 180.0 if turned else 0.0), "path")
        reflected = scenes.airborne.stokes(scenes.at(25.0, 10.0, 0.0), "reflected")
        return (above(_polarized("path", path), _polarized("reflected", reflected)),)

    return _both_azimuths(tests)


def _fig9_total_misleads(scenes: PaperScenes) -> tuple[Reading, ...]:
    """Two geometries of which the one with the higher total has the lower reflected ratio: the clearest pair."""

    def tests(turned: bool) -> tuple[Test, ...]:
        points = _fig9(scenes, (10.0, 50.0))
        total = [scenes.airborne.snr(at, label=f"total {_place(at)}", turned=turned) for at in points]
        reflected = [scenes.airborne.snr(at, source="reflected", label=f"reflected {_place(at)}") for at in points]
        pairs = [
            (above(total[i], total[j]), above(reflected[j], reflected[i]))
            for i in range(len(points))
            for j in range(len(points))
            if i != j
        ]
        return max(pairs, key=lambda pair: min(test.margin for test in pair))

    return _both_azimuths(tests)


def _fig9_reflected_rises(scenes: PaperScenes) -> tuple[Reading, ...]:
    tests: list[Test] = []
    for view in (10.0, 50.0):
        found = [
            scenes.airborne.snr(at, source="reflected", label=f"reflected {_place(at)}")
            for at in _fig9(scenes, (view,))
        ]
        tests += falls(found[::-1])
    return _one(*tests)


def _fig9_oblique_is_higher(scenes: PaperScenes) -> tuple[Reading, ...]:
    snr = scenes.airborne.snr
    return _one(
        *(
            above(
                snr(scenes.at(25.0, 50.0, phi), source="reflected", label=f"reflected view 50 phi {phi:g}"),
                snr(scenes.at(25.0, 10.0, phi), source="reflected", label=f"reflected view 10 phi {phi:g}"),
            )
            for phi in AZIMUTHS_DEG
        )
    )


def _fig9(scenes: PaperScenes, views: tuple[float, ...]) -> list[Geometry]:
    return [scenes.at(25.0, view, phi) for view in views for phi in AZIMUTHS_DEG]


def _place(at: Geometry) -> str:
    return f"view {at.view:g} phi {at.phi:g}"


def _differ(one: Number, other: Number) -> Test:
    return Test(numbers=(one, other), margin=abs(one.value - other.value), error=one.error + other.error)


def _polarized(name: str, stokes: np.ndarray) -> Number:
    value = float(np.hypot(stokes[1], stokes[2]))
    # Three thousandths of S0 is what the light is computed to.
    return Number(label=f"sqrt(S1^2 + S2^2) {name} [W m-2 sr-1]", value=value, error=1e-4 * float(stokes[0]))


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


def _fig10_reflected_falls(scenes: PaperScenes) -> tuple[Reading, ...]:
    return _one(*falls(_heights(scenes, "reflected")))


def _fig10_total_does_not(scenes: PaperScenes) -> tuple[Reading, ...]:
    return _both_azimuths(lambda turned: (some_step_rises(_heights(scenes, "total", turned=turned)),))


def _fig10_path_grows(scenes: PaperScenes) -> tuple[Reading, ...]:
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


def _fig11_falls(scenes: PaperScenes) -> tuple[Reading, ...]:
    return _one(*falls(_fig11_detection(scenes)))


def _fig11_much_higher_low(scenes: PaperScenes) -> tuple[Reading, ...]:
    found = _heights(scenes, "reflected")
    return (
        Reading(name=f"at 3 km {MUCH:g} times that at 9 km", tests=(above(found[0], found[-1], factor=MUCH),)),
        Reading(name="at 3 km above that at 9 km", tests=(above(found[0], found[-1]),)),
    )


def _fig12(scenes: PaperScenes, view: float, kn: float = 1.0) -> list[Number]:
    label = f"view {view:g}" + ("" if kn == 1.0 else f" Kn {kn:g}")
    return [scenes.airborne.snr(scenes.at(sun, view, kn=kn), label=f"sun {sun:g} {label}") for sun in SUNS_DEG]


def _fig12_oblique_is_higher(scenes: PaperScenes) -> tuple[Reading, ...]:
    return _one(*(above(more, less) for more, less in zip(_fig12(scenes, 40.0), _fig12(scenes, 20.0), strict=True)))


def _fig12_peaks(scenes: PaperScenes) -> tuple[Reading, ...]:
    return _one(peak_within(_fig12(scenes, 40.0), SUNS_DEG, 40.0, 60.0))


def _fig13(scenes: PaperScenes, sun: float, view: float) -> Number:
    return scenes.airborne.p_detection(scenes.at(sun, view), label=f"sun {sun:g} view {view:g}")


def _fig13_sun_50_is_better(scenes: PaperScenes) -> tuple[Reading, ...]:
    return _one(*(above(_fig13(scenes, 50.0, view), _fig13(scenes, 10.0, view)) for view in VIEWS_DEG))


def _fig13_view_40_at_10(scenes: PaperScenes) -> tuple[Reading, ...]:
    return _one(above(_fig13(scenes, 10.0, 40.0), _fig13(scenes, 10.0, 20.0)))


def _fig13_view_20_at_50(scenes: PaperScenes) -> tuple[Reading, ...]:
    return _one(above(_fig13(scenes, 50.0, 20.0), _fig13(scenes, 50.0, 40.0)))


def _fig13_not_as_snr(scenes: PaperScenes) -> tuple[Reading, ...]:
    steep, oblique = (scenes.airborne.snr(scenes.at(50.0, view), label=f"sun 50 view {view:g}") for view in VIEWS_DEG)
    return _one(above(oblique, steep), above(_fig13(scenes, 50.0, 20.0), _fig13(scenes, 50.0, 40.0)))


def _fig13_background_is_polarized(scenes: PaperScenes) -> tuple[Reading, ...]:
    nothing = Number(label="none", value=0.0)
    return _one(
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


def _fig14_falls(scenes: PaperScenes) -> tuple[Reading, ...]:
    by_noise = [_fig12(scenes, 40.0, kn) for kn in NOISE_FACTORS]
    return _one(*(test for numbers in zip(*by_noise, strict=True) for test in falls(numbers)))


def _fig14_peaks(scenes: PaperScenes) -> tuple[Reading, ...]:
    return _one(*(peak_within(_fig12(scenes, 40.0, kn), SUNS_DEG, 40.0, 60.0) for kn in NOISE_FACTORS))


def _fig15(scenes: PaperScenes, view: float) -> list[Number]:
    detected = scenes.airborne.p_detection
    return [detected(scenes.at(50.0, view, kn=kn), label=f"view {view:g} Kn {kn:g}") for kn in ROC_NOISE_FACTORS]


def _fig15_falls(scenes: PaperScenes) -> tuple[Reading, ...]:
    return tuple(Reading(name=f"view {view:g}", tests=falls(_fig15(scenes, view))) for view in VIEWS_DEG)


def _fig15_significantly(scenes: PaperScenes) -> tuple[Reading, ...]:
    found = []
    for view in VIEWS_DEG:
        first, *_, last = _fig15(scenes, view)
        found.append(Reading(name=f"view {view:g}", tests=(above(first, last, factor=SIGNIFICANT),)))
    return tuple(found)


_SUN_25 = "sun 25; view 10 and 50; phi 0, 90, 180"
_SUN_25_STEEP = "sun 25; view 10; phi 0, 90, 180"
_HEIGHTS = "sun 50, view 50, phi 180; 3, 5, 7, 9 km"
_FOUR = "sun 10 and 50, view 20 and 40, phi 180"
_SUNS = "sun 10 to 80; view 20 and 40; phi 180"
_AT_RATE = "P_D at P_FA 1e-3"


def _statement(
    name: str,
    figure: str,
    sentence: str,
    geometry: str,
    check: str,
    readings: Callable[[PaperScenes], tuple[Reading, ...]],
) -> Statement:
    return Statement(id=name, figure=figure, sentence=sentence, geometry=geometry, check=check, readings=readings)


STATEMENTS: tuple[Statement, ...] = (
    _statement(
        "5a", "5",
        "It is shown that the analytical-model-predicted statistics of DoLP diverge at low SNR.",
        "S = (1, 0.5, 0.5), four angles, shot noise",
        "relative error of the first-order mean and deviation against the exact law grows from 20 to 10 to 0 dB",
        _fig5_diverges,
    ),
    _statement(
        "5b", "5",
        "... the S0 SNR larger than 20 dB to guarantee the model-predicted DoLP statistics have better agreement with "
        "the true values.",
        "S = (1, 0.5, 0.5), 20 dB",
        "relative error of the first-order mean and deviation at 20 dB below those at 0, 4, 8, 12, 16 dB",
        _fig5_agrees_above_20,
    ),
    _statement(
        "7a", "7",
        "It can be seen that the analytical model can predict the trend of the data very well, although some "
        "discrepancy between the model predictions and real measurements can be seen in magnitude.",
        ROOFTOP_GEOMETRY, _NEEDS_DATA, _unseen,
    ),
    _statement(
        "8a", "8",
        "It is shown that the black paint and white paint exhibit different polarization properties, and the black "
        "paint shows higher DoLP due to its lower reflectance.",
        ROOFTOP_GEOMETRY, "mean DoLP of pixels: black above white; S0: white above black", _fig8_black_is_higher,
    ),
    _statement(
        "8b", "8",
        "The white paint shows smaller variance than the black paint in both Stokes parameters and DoLP since the "
        "signal, as measured from the white paint, has a higher SNR.",
        ROOFTOP_GEOMETRY, "deviation of s1, s2, DoLP of pixels: black above white", _fig8_white_is_narrower,
    ),
    _statement(
        "8c", "8",
        "It is shown that the predicted statistics have a close match with the measured data.",
        ROOFTOP_GEOMETRY, _NEEDS_DATA, _unseen,
    ),
    _statement(
        "8d", "8",
        "However, the results show that the analytical model is able to predict the general polarization behavior of "
        "different materials and data trends at different scene geometries ...",
        ROOFTOP_GEOMETRY, _NEEDS_DATA, _unseen,
    ),
    _statement(
        "9a", "9",
        "In Fig. 9, it is shown that the DoLP SNR calculated based on the total radiance is different from the "
        "radiance truly reflected from the object surface, which is due to the contamination from the upwelling "
        "radiance.",
        _SUN_25, "DoLP SNR: total differs from reflected wherever it is above the noise floor", _fig9_total_differs,
    ),
    _statement(
        "9b", "9a",
        "At certain scene geometries, such as 25 deg and 10 deg, as shown in Fig. 9(a), the upwelling radiance results "
        "in an even higher DoLP SNR than the reflected radiance at 0 and 90 deg.",
        "sun 25; view 10; phi 0, 90", "DoLP SNR: path above reflected at both", _fig9_path_above_reflected,
    ),
    _statement(
        "9c", "9a",
        "... the DoLP SNR of the total radiance is much higher at 0 deg ...",
        _SUN_25_STEEP, f"DoLP SNR of the total at phi 0, much taken as {MUCH:g} times", _fig9_total_much_higher_at_0,
    ),
    _statement(
        "9d", "9a",
        "... the polarization information obtained at this azimuth angle is dominated by the upwelling radiance and "
        "reflects very little information about the polarimetric signature of the object.",
        "sun 25; view 10; phi 0", "polarized radiance: path above reflected", _fig9_path_dominates,
    ),
    _statement(
        "9e", "9",
        "... a higher DoLP SNR does not necessarily mean a stronger polarimetric signature.",
        _SUN_25, "two geometries: the one with the higher total has the lower reflected DoLP SNR",
        _fig9_total_misleads,
    ),
    _statement(
        "9f", "9",
        "... the general trend that the DoLP SNR of reflected radiance increases when the azimuth angle changes from 0 "
        "to 180 deg ...",
        _SUN_25, "DoLP SNR of reflected rises from phi 0 to 90 to 180", _fig9_reflected_rises,
    ),
    _statement(
        "9g", "9",
        "A higher DoLP SNR of reflected radiance is also observed at an oblique viewing angle, such as 50 deg shown in "
        "Fig. 9(b).",
        _SUN_25, "DoLP SNR of reflected: view 50 above view 10", _fig9_oblique_is_higher,
    ),
    _statement(
        "10a", "10a",
        "It is shown that the DoLP SNR of reflected radiance decreases at higher altitude and therefore results in a "
        "weaker polarimetric signature.",
        _HEIGHTS, "DoLP SNR of reflected falls with height", _fig10_reflected_falls,
    ),
    _statement(
        "10b", "10b",
        "However, this trend is not followed in Fig. 10(b) when DoLP SNR is calculated based on the total radiance.",
        _HEIGHTS, "DoLP SNR of total: some step upward with height", _fig10_total_does_not,
    ),
    _statement(
        "10c", "10",
        "This is because, at higher altitudes, upwelling radiance is increased significantly.",
        _HEIGHTS, f"S0 of path rises with height; significantly taken as {SIGNIFICANT:g} times from 3 to 9 km",
        _fig10_path_grows,
    ),
    _statement(
        "11a", "11",
        "It is shown that the detection performance decreases by increasing the altitude.",
        _HEIGHTS, f"{_AT_RATE} falls with height", _fig11_falls,
    ),
    _statement(
        "11b", "11",
        "At a lower platform altitude, the DoLP SNR of reflected radiance from target is much higher; therefore, "
        "stronger polarimetric signature is present.",
        _HEIGHTS, f"DoLP SNR of reflected: 3 km above 9 km; much taken as {MUCH:g} times", _fig11_much_higher_low,
    ),
    _statement(
        "12a", "12",
        "It is shown that, at an oblique viewing angle 40 deg, the black paint shows higher DoLP SNR ... (section V-C "
        "later: is always higher than the DoLP SNR at 20 deg)",
        _SUNS, "DoLP SNR: view 40 above view 20 at every sun", _fig12_oblique_is_higher,
    ),
    _statement(
        "12b", "12",
        "... and stronger polarization can be found around 40-60 deg incident angles.",
        "sun 10 to 80; view 40; phi 180", "largest DoLP SNR at a sun of 40 to 60", _fig12_peaks,
    ),
    _statement(
        "13a", "13",
        "It is shown that, at an oblique solar incident angle 50 deg, the detection performance is enhanced.",
        _FOUR, f"{_AT_RATE}: sun 50 above sun 10, at both views", _fig13_sun_50_is_better,
    ),
    _statement(
        "13b", "13",
        "When 10 deg, the detection at an oblique sensor viewing angle 40 deg outperforms the detection at 20 deg, and "
        "the result is in accordance with the DoLP SNR analysis shown in Fig. 12.",
        "sun 10, view 20 and 40, phi 180", f"{_AT_RATE}: view 40 above view 20", _fig13_view_40_at_10,
    ),
    _statement(
        "13c", "13",
        "When 50 deg, the detection at 20 deg outperforms the detection at 40 deg.",
        "sun 50, view 20 and 40, phi 180", f"{_AT_RATE}: view 20 above view 40", _fig13_view_20_at_50,
    ),
    _statement(
        "13d", "13",
        "This result however does not follow the observation that we have in Fig. 12, where the DoLP SNR of black "
        "paint at 40 deg is always higher than the DoLP SNR at 20 deg.",
        "sun 50, view 20 and 40, phi 180", f"DoLP SNR: view 40 above view 20, and {_AT_RATE} the other way",
        _fig13_not_as_snr,
    ),
    _statement(
        "13e", "13",
        "In this simulation, the background object asphalt is not randomly polarized, and its polarization properties "
        "also determine the target detection performance.",
        _FOUR, "DoLP of asphalt above 0", _fig13_background_is_polarized,
    ),
    _statement(
        "14a", "14",
        "It is shown that, with a larger sensor noise factor, the DoLP SNR of black paint decreases.",
        "sun 10 to 80; view 40; phi 180; Kn 1 to 3.5", "DoLP SNR falls with Kn at every sun", _fig14_falls,
    ),
    _statement(
        "14b", "14",
        "The black paint presents higher DoLP SNR at an incident zenith angle of around 40 and 60 deg, showing good "
        "agreement with the results presented earlier.",
        "sun 10 to 80; view 40; phi 180; Kn 1 to 3.5", "largest DoLP SNR at a sun of 40 to 60, for every Kn",
        _fig14_peaks,
    ),
    _statement(
        "15a", "15",
        "The PD value at a constant false alarm rate decreases when the sensor noise factor is increased.",
        "sun 50; view not stated (20 and 40); phi 180; Kn 1, 2, 3", f"{_AT_RATE} falls with Kn", _fig15_falls,
    ),
    _statement(
        "15b", "15",
        "The target detection performance is affected significantly by the level of sensor noise.",
        "sun 50; view not stated (20 and 40); phi 180; Kn 1, 3",
        f"{_AT_RATE}: at Kn 1 {SIGNIFICANT:g} times that at Kn 3", _fig15_significantly,
    ),
    _statement(
        "V-a", "9 to 15",
        "In this paper, all the experiments are performed with the S0 SNR larger than 20 dB ...",
        "all geometries of Figs 9 to 15", "least SNR of S0 above 20 dB", _all_above_20,
    ),
    _statement(
        "VI-a", "7, 8",
        "The results based on model prediction have shown good agreement with experimental measurement.",
        ROOFTOP_GEOMETRY, _NEEDS_DATA, _unseen,
    ),
)  # fmt: skip
