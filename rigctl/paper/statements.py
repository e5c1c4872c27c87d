"""Every sentence of [MK14] sections II-C to VI about what a figure shows, as a typed record with its check.

The sentences are the paper's own words. A sentence that allows several readings has all of them.
"""

from collections.abc import Callable

from rigctl.paper.contributions import (
    fig9_forward_is_purest,
    fig9_forward_is_strongest,
    fig9_oblique_is_higher,
    fig9_path_above_reflected,
    fig9_path_dominates,
    fig9_reflected_rises,
    fig9_total_differs,
    fig9_total_misleads,
    fig9_total_much_higher_at_0,
)
from rigctl.paper.numbers import Reading
from rigctl.paper.rooftop import GEOMETRY as ROOFTOP_GEOMETRY
from rigctl.paper.statement import MUCH, SIGNIFICANT, PaperScenes, Statement, without_their_data
from rigctl.paper.trends import (
    all_above_20,
    fig5_agrees_above_20,
    fig5_diverges,
    fig8_black_is_higher,
    fig8_white_is_narrower,
    fig10_path_grows,
    fig10_reflected_falls,
    fig10_total_does_not,
    fig10_total_misleads,
    fig11_as_fig10,
    fig11_falls,
    fig11_much_higher_low,
    fig12_oblique_is_higher,
    fig12_peaks,
    fig13_background_counts,
    fig13_background_is_polarized,
    fig13_not_as_snr,
    fig13_sun_50_is_better,
    fig13_view_20_at_50,
    fig13_view_40_at_10,
    fig14_falls,
    fig14_peaks,
    fig15_falls,
    fig15_significantly,
)

_NEEDS_DATA = "their measured points: not at hand; --digitised overlays points of whoever has the figures"
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
        "It is shown that the analytical-model-predicted statistics of DoLP diverge at low SNR, which is accordance "
        "with the observation presented in [57].",
        "S = (1, 0.5, 0.5), four angles, shot noise",
        "relative error of the first-order mean and deviation against the exact law grows from 20 to 10 to 0 dB",
        fig5_diverges,
    ),
    _statement(
        "5b", "5",
        "... the S0 SNR larger than 20 dB to guarantee the model-predicted DoLP statistics have better agreement with "
        "the true values.",
        "S = (1, 0.5, 0.5), 20 dB",
        "relative error of the first-order mean and deviation at 20 dB below those at 0, 4, 8, 12, 16 dB",
        fig5_agrees_above_20,
    ),
    _statement(
        "7a", "7",
        "It can be seen that the analytical model can predict the trend of the data very well, although some "
        "discrepancy between the model predictions and real measurements can be seen in magnitude.",
        ROOFTOP_GEOMETRY, _NEEDS_DATA, without_their_data,
    ),
    _statement(
        "8a", "8",
        "It is shown that the black paint and white paint exhibit different polarization properties, and the black "
        "paint shows higher DoLP due to its lower reflectance.",
        ROOFTOP_GEOMETRY, "mean DoLP of pixels: black above white; S0: white above black", fig8_black_is_higher,
    ),
    _statement(
        "8b", "8",
        "The white paint shows smaller variance than the black paint in both Stokes parameters and DoLP since the "
        "signal, as measured from the white paint, has a higher SNR.",
        ROOFTOP_GEOMETRY, "deviation of s1, s2, DoLP of pixels: black above white; SNR of S0: white above black",
        fig8_white_is_narrower,
    ),
    _statement(
        "8c", "8",
        "It is shown that the predicted statistics have a close match with the measured data.",
        ROOFTOP_GEOMETRY, _NEEDS_DATA, without_their_data,
    ),
    _statement(
        "8d", "8",
        "However, the results show that the analytical model is able to predict the general polarization behavior of "
        "different materials and data trends at different scene geometries ...",
        ROOFTOP_GEOMETRY, _NEEDS_DATA, without_their_data,
    ),
    _statement(
        "8e", "8",
        "The discrepancy between the model predictions and real measurements are possibly due to differences between "
        "the real atmosphere and the predicted atmosphere by MODTRAN-P, any diversity between the estimated and actual "
        "material properties, or calibration error of the sensor.",
        ROOFTOP_GEOMETRY, _NEEDS_DATA, without_their_data,
    ),
    _statement(
        "9a", "9",
        "In Fig. 9, it is shown that the DoLP SNR calculated based on the total radiance is different from the "
        "radiance truly reflected from the object surface, which is due to the contamination from the upwelling "
        "radiance.",
        _SUN_25, "DoLP SNR: total differs from reflected wherever it is above the noise floor", fig9_total_differs,
    ),
    _statement(
        "9b", "9a",
        "At certain scene geometries, such as 25 deg and 10 deg, as shown in Fig. 9(a), the upwelling radiance results "
        "in an even higher DoLP SNR than the reflected radiance at 0 and 90 deg.",
        "sun 25; view 10; phi 0, 90", "DoLP SNR: path above reflected at both", fig9_path_above_reflected,
    ),
    _statement(
        "9c", "9a",
        "... the DoLP SNR of the total radiance is much higher at 0 deg ...",
        _SUN_25_STEEP, f"DoLP SNR of the total at phi 0, much taken as {MUCH:g} times", fig9_total_much_higher_at_0,
    ),
    _statement(
        "9d", "9a",
        "... the polarization information obtained at this azimuth angle is dominated by the upwelling radiance and "
        "reflects very little information about the polarimetric signature of the object.",
        "sun 25; view 10; phi 0", "polarized radiance: path above reflected", fig9_path_dominates,
    ),
    _statement(
        "9e", "9",
        "... a higher DoLP SNR does not necessarily mean a stronger polarimetric signature.",
        _SUN_25, "two geometries: the one with the higher total has the lower reflected DoLP SNR",
        fig9_total_misleads,
    ),
    _statement(
        "9f", "9",
        "... the general trend that the DoLP SNR of reflected radiance increases when the azimuth angle changes from 0 "
        "to 180 deg ...",
        _SUN_25, "DoLP SNR of reflected rises from phi 0 to 90 to 180", fig9_reflected_rises,
    ),
    _statement(
        "9g", "9",
        "A higher DoLP SNR of reflected radiance is also observed at an oblique viewing angle, such as 50 deg shown in "
        "Fig. 9(b).",
        _SUN_25, "DoLP SNR of reflected: view 50 above view 10", fig9_oblique_is_higher,
    ),
    _statement(
        "9h", "9",
        "... and therefore stronger polarimetric signature is expected to be captured at the forward reflection "
        "direction.",
        _SUN_25, "DoLP SNR of reflected: phi 180 above 0 and 90", fig9_forward_is_strongest,
    ),
    _statement(
        "9i", "9",
        "In the following performance studies, we will concentrate on the azimuth angle of 180 deg, at which more "
        "accurate polarimetric signatures of the object are expected to be captured.",
        _SUN_25, "polarized radiance of the path over that of the target: least at phi 180", fig9_forward_is_purest,
    ),
    _statement(
        "10a", "10a",
        "It is shown that the DoLP SNR of reflected radiance decreases at higher altitude and therefore results in a "
        "weaker polarimetric signature.",
        _HEIGHTS, "DoLP SNR of reflected falls with height", fig10_reflected_falls,
    ),
    _statement(
        "10b", "10b",
        "However, this trend is not followed in Fig. 10(b) when DoLP SNR is calculated based on the total radiance.",
        _HEIGHTS, "DoLP SNR of total: some step upward with height", fig10_total_does_not,
    ),
    _statement(
        "10c", "10",
        "This is because, at higher altitudes, upwelling radiance is increased significantly.",
        _HEIGHTS, f"S0 of path rises with height; significantly taken as {SIGNIFICANT:g} times from 3 to 9 km",
        fig10_path_grows,
    ),
    _statement(
        "10d", "10",
        "The observations suggest that, at higher altitudes, higher DoLP SNR does not necessarily mean a stronger "
        "polarimetric signature since the polarimetric signature may be severely contaminated by the upwelling "
        "radiance.",
        _HEIGHTS, "two heights: the higher one has more DoLP SNR of the total and less of the reflected",
        fig10_total_misleads,
    ),
    _statement(
        "11a", "11",
        "It is shown that the detection performance decreases by increasing the altitude.",
        _HEIGHTS, f"{_AT_RATE} falls with height", fig11_falls,
    ),
    _statement(
        "11c", "10, 11",
        "The observation is in accordance with the results shown in Fig. 10.",
        _HEIGHTS, f"{_AT_RATE} and DoLP SNR of reflected fall with height", fig11_as_fig10,
    ),
    _statement(
        "11b", "10, 11",
        "At a lower platform altitude, the DoLP SNR of reflected radiance from target is much higher; therefore, "
        "stronger polarimetric signature is present.",
        _HEIGHTS, f"DoLP SNR of reflected: 3 km above 9 km; much taken as {MUCH:g} times", fig11_much_higher_low,
    ),
    _statement(
        "12a", "12",
        "It is shown that, at an oblique viewing angle 40 deg, the black paint shows higher DoLP SNR ...",
        _SUNS, "DoLP SNR: view 40 above view 20 at every sun", fig12_oblique_is_higher,
    ),
    _statement(
        "12b", "12",
        "... and stronger polarization can be found around 40-60 deg incident angles.",
        _SUNS, "largest DoLP SNR, or DoLP, at a sun of 40 to 60", fig12_peaks,
    ),
    _statement(
        "13a", "13",
        "It is shown that, at an oblique solar incident angle 50 deg, the detection performance is enhanced.",
        _FOUR, f"{_AT_RATE}: sun 50 above sun 10, at both views", fig13_sun_50_is_better,
    ),
    _statement(
        "13b", "13",
        "When 10 deg, the detection at an oblique sensor viewing angle 40 deg outperforms the detection at 20 deg, and "
        "the result is in accordance with the DoLP SNR analysis shown in Fig. 12.",
        "sun 10, view 20 and 40, phi 180", f"{_AT_RATE} and DoLP SNR: view 40 above view 20", fig13_view_40_at_10,
    ),
    _statement(
        "13c", "13",
        "When 50 deg, the detection at 20 deg outperforms the detection at 40 deg.",
        "sun 50, view 20 and 40, phi 180", f"{_AT_RATE}: view 20 above view 40", fig13_view_20_at_50,
    ),
    _statement(
        "13d", "13",
        "This result however does not follow the observation that we have in Fig. 12, where the DoLP SNR of black "
        "paint at 40 deg is always higher than the DoLP SNR at 20 deg.",
        "sun 10 to 80, view 20 and 40, phi 180",
        f"DoLP SNR: view 40 above view 20 at every sun, and {_AT_RATE} at a sun of 50 the other way", fig13_not_as_snr,
    ),
    _statement(
        "13f", "13",
        "This is mainly due to the fact that the DoLP SNR is calculated solely based on the target object, but the "
        "detection performance is determined by the combined factors of both the target and background.",
        "sun 50, view 20 and 40, phi 180", f"the target's own DoLP SNR is higher where {_AT_RATE} is lower",
        fig13_background_counts,
    ),
    _statement(
        "13e", "13",
        "In this simulation, the background object asphalt is not randomly polarized, and its polarization properties "
        "also determine the target detection performance.",
        _FOUR, f"DoLP of asphalt above 0; {_AT_RATE} differs from that on asphalt whose mean S1 and S2 are 0",
        fig13_background_is_polarized,
    ),
    _statement(
        "14a", "14",
        "It is shown that, with a larger sensor noise factor, the DoLP SNR of black paint decreases.",
        "sun 10 to 80; view 40; phi 180; Kn 1 to 3.5", "DoLP SNR falls with Kn at every sun", fig14_falls,
    ),
    _statement(
        "14b", "14",
        "The black paint presents higher DoLP SNR at an incident zenith angle of around 40 and 60 deg, showing good "
        "agreement with the results presented earlier.",
        "sun 10 to 80; view 40; phi 180; Kn 1 to 3.5", "DoLP SNR by the sun, for every Kn: largest around 40 and 60",
        fig14_peaks,
    ),
    _statement(
        "15a", "15",
        "The PD value at a constant false alarm rate decreases when the sensor noise factor is increased.",
        "sun 50; view not stated (20 and 40); phi 180; Kn 1, 2, 3", f"{_AT_RATE} falls with Kn", fig15_falls,
    ),
    _statement(
        "15b", "15",
        "The target detection performance is affected significantly by the level of sensor noise.",
        "sun 50; view not stated (20 and 40); phi 180; Kn 1, 3",
        f"{_AT_RATE}: at Kn 1 {SIGNIFICANT:g} times that at Kn 3", fig15_significantly,
    ),
    _statement(
        "V-a", "7 to 15",
        "In this paper, all the experiments are performed with the S0 SNR larger than 20 dB ...",
        "all geometries of Figs 7 to 15", "least SNR of S0 above 20 dB", all_above_20,
    ),
    _statement(
        "VI-a", "7, 8",
        "The results based on model prediction have shown good agreement with experimental measurement.",
        ROOFTOP_GEOMETRY, _NEEDS_DATA, without_their_data,
    ),
)  # fmt: skip
