"""The result of EMVA 1288 to its letter, to set beside data sheets; `calibration.sensor.noise` has the better one."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibration.sensor.emva_fits import GAIN_RANGE, is_capped, linearity_deviation, temporal_figures
from calibration.sensor.emva_sweep import EmvaSweep, emva_sweep
from calibration.sensor.frame_statistics import LevelStatistics

FloatArray = NDArray[np.float64]

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
# What the cap of the dark variance makes of the numbers that hold it.
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
    """A number of the standard.

    Attributes
    ----------
    value : float
        In the unit that its name ends in.
    std_error : float or None
        Standard error, which the standard itself does not ask for; None where there are too few levels for it.
    n : int
        Number of frames it was made from.
    bound : {"<", ">"} or None
        The number is a limit: the dark variance is below 0.24 DN^2, where the standard caps it.
    """

    value: float
    std_error: float | None
    n: int
    bound: Literal["<", ">"] | None = None


def emva1288_figures(
    flats: Sequence[LevelStatistics], darks: Sequence[LevelStatistics], *, ceiling_dn: int
) -> dict[str, EmvaFigure | None]:
    """Return the numbers of EMVA 1288 Release 4.0 Linear, each under a name of `EMVA_SYMBOLS`.

    Parameters
    ----------
    flats, darks : sequences of LevelStatistics
        At least one of each, of one camera at one gain.
    ceiling_dn : int
        Sample of a saturated pixel [DN].

    Notes
    -----
    A number that the levels do not give is None: those in photons where photons are not known, those of
    saturation where the variance never falls, a fixed pattern whose variance is not above 0.

    1/12 DN^2 of rounding is in `temporal_dark_noise_dn`, and taken off in `temporal_dark_noise_e`; the variance is
    capped at 0.24 DN^2 from below. The pattern is that of the levels with the most frames, no high-pass filter.

    Standard errors: leave one level out at a time (jackknife), for the flats and for the darks; with saturation,
    the step to the next level over the square root of 12; linearity errors, the wander of frame means. Fixed
    patterns: sampling of pixels, for rows, columns and pixels as if each were normal and alone.

    Differs from the standard: saturation that the sweep does not reach is not reported.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear.
    """
    sweep = emva_sweep(flats, darks, ceiling_dn=ceiling_dn)
    found: dict[str, EmvaFigure | None] = {**_temporal(sweep), **_linearity(sweep)}
    gain = found.get("gain_dn_per_e")
    if gain is not None:
        found |= _spatial(flats, darks, gain.value, middle_dn=0.5 * sweep.saturation_signal_dn)
    return {name: found.get(name) for name in EMVA_SYMBOLS}


def _temporal(sweep: EmvaSweep) -> dict[str, EmvaFigure]:
    values = temporal_figures(sweep, flats=_all(sweep.signal_dn), darks=_all(sweep.exposure_s))
    in_range = sweep.signal_dn <= GAIN_RANGE * sweep.saturation_signal_dn
    by_flats = [temporal_figures(sweep, flats=rest, darks=_all(sweep.exposure_s)) for rest in _each_left_out(in_range)]
    by_darks = [
        temporal_figures(sweep, flats=_all(sweep.signal_dn), darks=rest)
        for rest in _each_left_out(_all(sweep.exposure_s))
    ]
    n_flat = int(sweep.n_frames[in_range].sum())
    return {
        name: EmvaFigure(
            value=value,
            std_error=_error(name, value, sweep, by_flats, by_darks),
            n=sweep.n_dark_frames if name in _OF_DARKS else n_flat,
            bound=_CAPPED.get(name) if is_capped(sweep) else None,
        )
        for name, value in values.items()
    }


def _all(values: FloatArray) -> NDArray[np.bool_]:
    return np.ones(len(values), dtype=bool)


def _each_left_out(chosen: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """Return one mask for each chosen level, that leaves it out; none if there are fewer than three."""
    indices = np.flatnonzero(chosen)
    if len(indices) < 3:
        return []
    return [np.arange(len(chosen)) != index for index in indices]


def _error(
    name: str,
    value: float,
    sweep: EmvaSweep,
    by_flats: list[dict[str, float]],
    by_darks: list[dict[str, float]],
) -> float | None:
    samples = [[rest[name] for rest in left_out if name in rest] for left_out in (by_flats, by_darks)]
    if min(map(len, samples)) < 3:
        return None
    variance = sum((len(s) - 1) * float(np.var(s)) for s in samples)
    variance += (_OF_SATURATION.get(name, 0.0) * value * _relative_step(sweep)) ** 2
    return float(np.sqrt(variance)) or None


def _relative_step(sweep: EmvaSweep) -> float:
    """Return the standard deviation of a saturation evenly likely up to the next level, relative to it."""
    if sweep.saturation is None or sweep.saturation + 1 >= len(sweep.signal_dn):
        return 0.0
    here, above = sweep.signal_dn[sweep.saturation : sweep.saturation + 2]
    return float((above / here - 1.0) / np.sqrt(12.0))


def _linearity(sweep: EmvaSweep) -> dict[str, EmvaFigure]:
    deviation = linearity_deviation(sweep)
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
    parts = level.pattern
    return {
        "": (level.spatial_variance_dn2, level.spatial_std_error_dn2),
        "_row": (parts.row_dn2, (abs(parts.row_dn2) + noise / columns) * float(np.sqrt(2.0 / rows))),
        "_column": (parts.column_dn2, (abs(parts.column_dn2) + noise / rows) * float(np.sqrt(2.0 / columns))),
        "_pixel": (parts.pixel_dn2, (abs(parts.pixel_dn2) + noise) * float(np.sqrt(2.0 / (rows * columns)))),
    }


def _root(variance: float, error: float, *, scale: float, n: int) -> EmvaFigure | None:
    if variance <= 0.0:
        return None
    value = float(np.sqrt(variance)) / scale
    return EmvaFigure(value=value, std_error=0.5 * value * error / variance, n=n)
