"""EMVA Standard 1288, Release 4.0 Linear, to the letter, for comparison with data sheets.

The standard fits unweighted straight lines and asks for no standard errors; `calibration.sensor.noise` has better
estimates of the same numbers. Errors here are by leaving out one level after another (jackknife).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibration.sensor.curves import QUANTISATION_LIMIT_DN2, match_darks, saturation_level
from calibration.sensor.levels import LevelStatistics, column
from model.counts import ROUNDING_VAR_DN2

# The levels as EMVA 1288 uses them: pairs for temporal noise, two stacks for the fixed pattern

FloatArray = NDArray[np.float64]

# A pair of frames is a point of the photon-transfer curve; more frames are a stack, for the fixed pattern.
_PAIR = 2
_LEAST_PAIRS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sweep:
    """Points of the standard's line fits."""

    signal_dn: FloatArray
    variance_dn2: FloatArray
    light: FloatArray | None
    light_is_photons: bool
    wander: float
    exposure_s: FloatArray
    dark_mean_dn: FloatArray
    dark_variance_dn2: FloatArray
    saturation: int | None
    full_signal_dn: float
    n_frames: NDArray[np.int64]
    n_dark_frames: int

    @property
    def saturation_signal_dn(self) -> float:
        """Signal at saturation, or at the ceiling if saturation is not reached [DN]."""
        return self.full_signal_dn if self.saturation is None else float(self.signal_dn[self.saturation])

    @property
    def has_exposures(self) -> bool:
        """True where a line against the exposure of the darks has more points than parameters."""
        return len(np.unique(self.exposure_s)) > 2


def _emva_sweep(flats: Sequence[LevelStatistics], darks: Sequence[LevelStatistics], *, ceiling_dn: int) -> _Sweep:
    """Return the sweep of a set of levels.

    If at least three levels are pairs, the others serve the fixed pattern, as in the standard's own data sets;
    otherwise all levels are points.
    """
    flats = sorted(_points(flats), key=lambda level: level.mean_dn)
    darks = sorted(_points(darks), key=lambda level: level.exposure_s or 0.0)
    weights = match_darks(flats, darks)
    dark_mean, dark_variance = column(darks, "mean_dn"), column(darks, "temporal_variance_dn2")
    signal = column(flats, "mean_dn") - weights @ dark_mean
    variance = column(flats, "temporal_variance_dn2") - weights @ dark_variance
    peak = saturation_level(signal_dn=signal, variance_dn2=variance)
    light, light_is_photons = _light(flats)
    return _Sweep(
        signal_dn=signal,
        variance_dn2=variance,
        light=light,
        light_is_photons=light_is_photons,
        wander=_wander(flats),
        exposure_s=np.nan_to_num(column(darks, "exposure_s")),
        dark_mean_dn=dark_mean,
        dark_variance_dn2=dark_variance,
        saturation=None if peak is None else peak.lower,
        full_signal_dn=ceiling_dn - float(dark_mean.min()),
        n_frames=(column(flats, "n_frames") + np.greater(weights, 0.0) @ column(darks, "n_frames")).astype(np.int64),
        n_dark_frames=sum(dark.n_frames for dark in darks),
    )


def _points(levels: Sequence[LevelStatistics]) -> list[LevelStatistics]:
    pairs = [level for level in levels if level.n_frames == _PAIR]
    return pairs if len(pairs) >= _LEAST_PAIRS else list(levels)


def _light(flats: Sequence[LevelStatistics]) -> tuple[FloatArray | None, bool]:
    """Return photons, or exposures if all differ, and whether they are photons; None where neither is known."""
    photons, exposures = column(flats, "photons"), column(flats, "exposure_s")
    if not np.isnan(photons).any():
        return photons, True
    swept = not np.isnan(exposures).any() and len(np.unique(exposures)) == len(flats)
    return (exposures if swept else None), False


def _wander(flats: Sequence[LevelStatistics]) -> float:
    relative = [np.std(flat.frame_means_dn, ddof=1) / flat.mean_dn for flat in flats if flat.mean_dn > 0.0]
    return float(np.sqrt(np.mean(np.square(relative)) / _PAIR)) if relative else 0.0


# The lines of EMVA 1288, unweighted as the standard has them, and the figures that follow from them

Mask = NDArray[np.bool_]

# Upper end of the fits of gain and responsivity, and range of the linearity fit, as shares of saturation.
_GAIN_RANGE = 0.7
_LINEARITY_RANGE = (0.05, 0.95)


def _temporal_figures(sweep: _Sweep, *, flats: Mask, darks: Mask) -> dict[str, float]:
    """Return the figures from means and temporal variances that exist.

    EMVA Standard 1288, Release 4.0 Linear, sections 6.5 to 6.9 and 7.1.
    """
    chosen = flats & (sweep.signal_dn <= _GAIN_RANGE * sweep.saturation_signal_dn)
    if not np.any(sweep.signal_dn[chosen] > 0.0):
        return {}
    gain = _slope(sweep.signal_dn[chosen], sweep.variance_dn2[chosen])
    if gain <= 0.0:
        return {}
    dark_variance, variance_slope = _dark_line(sweep, sweep.dark_variance_dn2, darks)
    dark_variance = max(dark_variance, QUANTISATION_LIMIT_DN2)
    found = {
        "gain_dn_per_e": gain,
        "temporal_dark_noise_dn": float(np.sqrt(dark_variance)),
        "temporal_dark_noise_e": float(np.sqrt(dark_variance - ROUNDING_VAR_DN2)) / gain,
        "threshold_e": float(np.sqrt(dark_variance)) / gain + 0.5,
    }
    if sweep.has_exposures:
        found["dark_current_mean_e_per_s"] = _dark_line(sweep, sweep.dark_mean_dn, darks)[1] / gain
        found["dark_current_variance_e_per_s"] = variance_slope / gain**2
    found |= _photon_figures(sweep, chosen, found)
    return found | _saturation_figures(sweep, found)


def _is_capped(sweep: _Sweep) -> bool:
    """Return whether the dark variance is below 0.24 DN^2, the standard's replacement."""
    every = np.ones(len(sweep.exposure_s), dtype=bool)
    return _dark_line(sweep, sweep.dark_variance_dn2, every)[0] < QUANTISATION_LIMIT_DN2


def _slope(x: FloatArray, y: FloatArray) -> float:
    """Return the unweighted least-squares slope of a line through the origin."""
    return float(x @ y / (x @ x))


def _dark_line(sweep: _Sweep, values: FloatArray, darks: Mask) -> tuple[float, float]:
    """Return value at no exposure and slope; with two exposures or fewer the value at the shortest, and 0."""
    if not sweep.has_exposures:
        return float(values[darks][0]), 0.0
    exposures_s, chosen = sweep.exposure_s[darks], values[darks]
    from_middle = exposures_s - exposures_s.mean()
    slope = _slope(from_middle, chosen)
    return float(chosen.mean() - slope * exposures_s.mean()), slope


def _photon_figures(sweep: _Sweep, chosen: Mask, found: dict[str, float]) -> dict[str, float]:
    if sweep.light is None or not sweep.light_is_photons:
        return {}
    responsivity = _slope(sweep.light[chosen], sweep.signal_dn[chosen])
    efficiency = responsivity / found["gain_dn_per_e"]
    return {
        "responsivity_dn_per_photon": responsivity,
        "quantum_efficiency": efficiency,
        "threshold_photons": found["threshold_e"] / efficiency,
    }


def _saturation_figures(sweep: _Sweep, found: dict[str, float]) -> dict[str, float]:
    if sweep.saturation is None:
        return {}
    figures = {}
    saturation_e = sweep.saturation_signal_dn / found["gain_dn_per_e"]
    if "quantum_efficiency" in found and sweep.light is not None:
        figures["saturation_photons"] = float(sweep.light[sweep.saturation])
        saturation_e = figures["saturation_photons"] * found["quantum_efficiency"]
    return figures | {
        "saturation_e": saturation_e,
        "dynamic_range": saturation_e / found["threshold_e"],
        "snr_max": float(np.sqrt(saturation_e)),
    }


def _linearity_deviation(sweep: _Sweep) -> FloatArray | None:
    """Return the relative deviations of the means within 5 to 95 % of saturation from their line.

    None where there is no saturation, no light that is known, or fewer than three levels. The line is fitted
    with weights 1 / signal^2.

    EMVA Standard 1288, Release 4.0 Linear, section 6.8.
    """
    if sweep.light is None or sweep.saturation is None:
        return None
    low, high = (share * sweep.saturation_signal_dn for share in _LINEARITY_RANGE)
    chosen = (sweep.signal_dn >= low) & (sweep.signal_dn <= high)
    if np.count_nonzero(chosen) < 3:
        return None
    light, signal = sweep.light[chosen], sweep.signal_dn[chosen]
    line = np.polyval(np.polyfit(light, signal, 1, w=1.0 / signal), light)
    deviation: FloatArray = signal / line - 1.0
    return deviation


# The standard's numbers by name, with its own symbol.
EMVA_SYMBOLS = {
    "gain_dn_per_e": "K",
    "responsivity_dn_per_photon": "R",
    "quantum_efficiency": "eta",
    "temporal_dark_noise_dn": "sigma_y.dark",
    "temporal_dark_noise_e": "sigma_d",
    "threshold_photons": "mu_p.min",
    "threshold_e": "mu_e.min",
    "saturation_photons": "mu_p.sat",
    "saturation_e": "mu_e.sat",
    "dynamic_range": "DR",
    "snr_max": "SNR_max",
    "linearity_error_min": "LE_min",
    "linearity_error_max": "LE_max",
    "dark_current_mean_e_per_s": "mu_I.mean",
    "dark_current_variance_e_per_s": "mu_I.var",
    "dsnu_e": "DSNU_1288",
    "dsnu_row_e": "DSNU_1288.row",
    "dsnu_column_e": "DSNU_1288.col",
    "dsnu_pixel_e": "DSNU_1288.pixel",
    "prnu": "PRNU_1288",
    "prnu_row": "PRNU_1288.row",
    "prnu_column": "PRNU_1288.col",
    "prnu_pixel": "PRNU_1288.pixel",
}
_OF_SATURATION = {"saturation_photons": 1.0, "saturation_e": 1.0, "dynamic_range": 1.0, "snr_max": 0.5}
# Numbers that become limits where the dark variance is replaced.
_CAPPED: dict[str, Literal["<", ">"]] = {
    "temporal_dark_noise_dn": "<",
    "temporal_dark_noise_e": "<",
    "threshold_photons": "<",
    "threshold_e": "<",
    "dynamic_range": ">",
}
_OF_DARKS = (
    "temporal_dark_noise_dn",
    "temporal_dark_noise_e",
    "threshold_e",
    "dark_current_mean_e_per_s",
    "dark_current_variance_e_per_s",
)


@dataclass(frozen=True, kw_only=True)
class EmvaFigure:
    """A number of the standard."""

    value: float  #: in the unit that its name ends in
    #: standard error (not part of the standard); None with too few levels
    std_error: float | None
    n: int  #: number of frames it was made from
    #: the number is a limit because the dark variance is below 0.24 DN^2
    bound: Literal["<", ">"] | None = None


def emva1288_figures(
    flats: Sequence[LevelStatistics], darks: Sequence[LevelStatistics], *, ceiling_dn: int
) -> dict[str, EmvaFigure | None]:
    """Return the numbers of EMVA 1288 Release 4.0 Linear, each under a name of `EMVA_SYMBOLS`.

    Numbers without data are None: in photons if photons are unknown, of saturation if the variance never falls, of a
    fixed pattern whose variance is not above 0.

    `temporal_dark_noise_dn` includes 1/12 DN^2 of rounding, `temporal_dark_noise_e` does not; the variance is at least
    0.24 DN^2. The pattern is that of the levels with the most frames, without a high-pass filter.

    Standard errors: leave one level out at a time (jackknife), for the flats and for the darks; with saturation,
    the step to the next level over the square root of 12; linearity errors, the wander of frame means. Fixed
    patterns: sampling of pixels, for rows, columns and pixels as if each were normal and alone.

    Differs from the standard: saturation that the sweep does not reach is not reported.

    EMVA Standard 1288, Release 4.0 Linear.
    """
    sweep = _emva_sweep(flats, darks, ceiling_dn=ceiling_dn)
    found: dict[str, EmvaFigure | None] = {**_temporal(sweep), **_linearity(sweep)}
    gain = found.get("gain_dn_per_e")
    if gain is not None:
        found |= _spatial(flats, darks, gain.value, middle_dn=0.5 * sweep.saturation_signal_dn)
    return {name: found.get(name) for name in EMVA_SYMBOLS}


def _temporal(sweep: _Sweep) -> dict[str, EmvaFigure]:
    values = _temporal_figures(sweep, flats=_all(sweep.signal_dn), darks=_all(sweep.exposure_s))
    in_range = sweep.signal_dn <= _GAIN_RANGE * sweep.saturation_signal_dn
    by_flats = [_temporal_figures(sweep, flats=rest, darks=_all(sweep.exposure_s)) for rest in _each_left_out(in_range)]
    by_darks = [
        _temporal_figures(sweep, flats=_all(sweep.signal_dn), darks=rest)
        for rest in _each_left_out(_all(sweep.exposure_s))
    ]
    n_flat = int(sweep.n_frames[in_range].sum())
    return {
        name: EmvaFigure(
            value=value,
            std_error=_error(name, value, sweep, by_flats, by_darks),
            n=sweep.n_dark_frames if name in _OF_DARKS else n_flat,
            bound=_CAPPED.get(name) if _is_capped(sweep) else None,
        )
        for name, value in values.items()
    }


def _all(values: FloatArray) -> NDArray[np.bool_]:
    return np.ones(len(values), dtype=bool)


def _each_left_out(chosen: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """Return masks that leave out one chosen level each; none if fewer than three are chosen."""
    indices = np.flatnonzero(chosen)
    if len(indices) < 3:
        return []
    return [np.arange(len(chosen)) != index for index in indices]


def _error(
    name: str,
    value: float,
    sweep: _Sweep,
    by_flats: list[dict[str, float]],
    by_darks: list[dict[str, float]],
) -> float | None:
    samples = [[rest[name] for rest in left_out if name in rest] for left_out in (by_flats, by_darks)]
    if min(map(len, samples)) < 3:
        return None
    variance = sum((len(s) - 1) * float(np.var(s)) for s in samples)
    variance += (_OF_SATURATION.get(name, 0.0) * value * _relative_step(sweep)) ** 2
    return float(np.sqrt(variance)) or None


def _relative_step(sweep: _Sweep) -> float:
    """Return the relative standard deviation of a saturation uniform up to the next level."""
    if sweep.saturation is None or sweep.saturation + 1 >= len(sweep.signal_dn):
        return 0.0
    here, above = sweep.signal_dn[sweep.saturation : sweep.saturation + 2]
    return float((above / here - 1.0) / np.sqrt(12.0))


def _linearity(sweep: _Sweep) -> dict[str, EmvaFigure]:
    deviation = _linearity_deviation(sweep)
    if deviation is None:
        return {}
    n, error = int(sweep.n_frames.sum()), sweep.wander or None
    return {
        "linearity_error_min": EmvaFigure(value=float(deviation.min()), std_error=error, n=n),
        "linearity_error_max": EmvaFigure(value=float(deviation.max()), std_error=error, n=n),
    }


def _spatial(
    flats: Sequence[LevelStatistics], darks: Sequence[LevelStatistics], gain: float, *, middle_dn: float
) -> dict[str, EmvaFigure | None]:
    dark = max(darks, key=lambda level: level.n_frames)
    flat = max(flats, key=lambda level: (level.n_frames, -abs(level.mean_dn - dark.mean_dn - middle_dn)))
    dark = min(
        (level for level in darks if level.n_frames == dark.n_frames),
        key=lambda level: abs((level.exposure_s or 0.0) - (flat.exposure_s or 0.0)),
    )
    signal_dn = flat.mean_dn - dark.mean_dn
    if signal_dn <= 0.0:
        return {}
    of_dark, of_flat = _parts(dark), _parts(flat)
    found: dict[str, EmvaFigure | None] = {}
    for part, (variance, error) in of_dark.items():
        found[f"dsnu{part}_e"] = _root(variance, error, scale=gain, n=dark.n_frames)
        found[f"prnu{part}"] = _root(
            of_flat[part][0] - variance,
            float(np.hypot(of_flat[part][1], error)),
            scale=signal_dn,
            n=flat.n_frames + dark.n_frames,
        )
    return found


def _parts(level: LevelStatistics) -> dict[str, tuple[float, float]]:
    """Return the spatial variances of a level by the ending of their name, with standard errors."""
    rows, columns = level.shape
    noise = level.temporal_variance_dn2 / level.n_frames
    of_rows, of_columns, of_pixels = level.pattern_dn2
    return {
        "": (level.spatial_variance_dn2, level.spatial_std_error_dn2),
        "_row": (of_rows, (abs(of_rows) + noise / columns) * float(np.sqrt(2.0 / rows))),
        "_column": (of_columns, (abs(of_columns) + noise / rows) * float(np.sqrt(2.0 / columns))),
        "_pixel": (of_pixels, (abs(of_pixels) + noise) * float(np.sqrt(2.0 / (rows * columns)))),
    }


def _root(variance: float, error: float, *, scale: float, n: int) -> EmvaFigure | None:
    if variance <= 0.0:
        return None
    value = float(np.sqrt(variance)) / scale
    return EmvaFigure(value=value, std_error=0.5 * value * error / variance, n=n)
