"""Analyzers: fits of Malus' law, mounting axis, diattenuation and the measured data reduction matrix."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibration.results import CalibrationError

# Malus' law in closed form: intensity against the angle of a polarizer, by linear least squares

FloatArray = NDArray[np.float64]

_TERMS = 3
# Beyond this the angles do not separate the terms: equal modulo 180 deg, or all close together.
_WORST_CONDITION = 1e3
# Whole turns in equal steps have sqrt 2; half a turn has hundreds.
_APART_CONDITION = 3.0
# Harmonics of the residual of Malus' law [cycles per turn].
_HARMONIC_ORDERS = (1, 3, 4, 5, 6)
_ROUNDING = 1e-12
# Effects in addition to the law: least frames, terms of the drift, wander of a wedge over its size, usual size of a
# harmonic over the mean, probability that there is one, and the probability of the models that make the covariance.
_LEAST_MODELLED, _DRIFT_TERMS, _WEDGE_WANDER, _USUAL_HARMONIC, _P_HARMONIC, _KEPT = 16, 8, 0.25, 0.02, 0.3, 0.9
# Largest harmonic of real sheets and wire grids over the mean.
_LARGEST_HARMONIC = 0.03
# An amplitude of noise alone is larger than this many standard errors of its parts in 1 of 1000 cases.
SEEN_SIGMAS = 3.717


@dataclass(frozen=True, kw_only=True, eq=False)
class FourierFit:
    """Intensity = mean + cosine cos 2 angle + sine sin 2 angle, for one or many pixels."""

    terms: FloatArray  #: (3, ...): mean, cosine, sine; the other axes are those of the values
    unit_covariance: FloatArray  #: (3, 3): covariance of the errors of the terms for values of variance 1
    variance: FloatArray  #: (...): variance of a value, from the residuals
    dof: int  #: values less terms, at least 1

    @property
    def phase_rad(self) -> FloatArray:
        """Angle of largest intensity, -pi/2 to pi/2 [rad]."""
        phase: FloatArray = 0.5 * np.arctan2(self.terms[2], self.terms[1])
        return phase

    def at(self, angles_rad: FloatArray) -> FloatArray:
        """Return the law of one pixel at other angles."""
        law: FloatArray = _design(angles_rad, (2,)) @ self.terms
        return law

    @property
    def modulation(self) -> FloatArray:
        """Amplitude over mean."""
        ratio: FloatArray = np.hypot(self.terms[1], self.terms[2]) / self.terms[0]
        return ratio

    def phase_error_rad(self) -> FloatArray:
        """Return the standard error of `phase_rad` [rad]."""
        _, cosine, sine = self.terms
        square = cosine**2 + sine**2
        return self._error(np.array([np.zeros_like(cosine), -0.5 * sine / square, 0.5 * cosine / square]))

    def modulation_error(self) -> FloatArray:
        """Return the standard error of `modulation`."""
        mean, cosine, sine = self.terms
        amplitude = np.hypot(cosine, sine)
        return self._error(np.array([-amplitude / mean**2, cosine / amplitude / mean, sine / amplitude / mean]))

    def mean_error(self) -> FloatArray:
        """Return the standard error of the mean term."""
        error: FloatArray = np.sqrt(self.unit_covariance[0, 0] * self.variance)
        return error

    def _error(self, gradient: FloatArray) -> FloatArray:
        square = np.einsum("i...,ij,j...->...", gradient, self.unit_covariance, gradient)
        error: FloatArray = np.sqrt(square * self.variance)
        return error


@dataclass(frozen=True, kw_only=True)
class Harmonic:
    """Residual of a scan at one frequency."""

    #: cycles a turn: 1 and 3 are a wedge or a tilted element, 4 and 6 a detector that is not linear or the polarizer
    order: int
    amplitude: float  #: relative to the mean; the error is that of cosine and sine part each
    std_error: float

    @property
    def is_seen(self) -> bool:
        """True if noise alone would cause it in less than 1 of 1000 cases."""
        return self.amplitude > SEEN_SIGMAS * self.std_error


def fit_fourier(angles_rad: FloatArray, values: FloatArray) -> FourierFit:
    """Return the fit of Malus' law.

    Parameters
    ----------
    angles_rad : (K,) array
        Angles of the element that turns [rad]; four or more, three of them different modulo pi.
    values : (K, ...) array
        Intensities, dark taken off.

    Raises
    ------
    CalibrationError
        Angles do not determine the law, or there is no light.

    Notes
    -----
    Unweighted; all values of a pixel are taken to have one variance, which the residuals give.
    """
    if len(angles_rad) <= _TERMS:
        raise CalibrationError(f"a scan needs at least 4 angles to estimate its errors; there are {len(angles_rad)}")
    design = _design(angles_rad, (2,))
    condition = float(np.linalg.cond(design))
    if condition > _WORST_CONDITION:
        raise CalibrationError(
            f"the angles of the scan do not separate mean, cosine and sine (condition {condition:.3g}, allowed "
            f"{_WORST_CONDITION:.0g}): angles that differ by 180 deg are repeats; spread them over half a turn"
        )
    inverse = np.linalg.pinv(design)
    terms = np.tensordot(inverse, values, axes=1)
    if np.min(terms[0]) <= 0.0:
        raise CalibrationError("a scan has no light above its dark level: check dark frames and region")
    dof = len(angles_rad) - _TERMS
    residual = values - np.tensordot(design, terms, axes=1)
    return FourierFit(
        terms=terms,
        unit_covariance=inverse @ inverse.T,
        variance=np.sum(np.square(residual), axis=0) / dof,
        dof=dof,
    )


def fit_scan(angles_rad: FloatArray, values: FloatArray) -> tuple[FourierFit, tuple[Harmonic, ...]]:
    """Return Malus' law of one scan, with errors that include harmonics, wedge and drift, and the harmonics.

    Parameters
    ----------
    angles_rad : (K,) array
        Angles of the element that turns, in the order in which frames were taken [rad].
    values : (K,) array
        Intensities of one region, dark taken off.

    Raises
    ------
    CalibrationError
        As `fit_fourier`.

    Notes
    -----
    Harmonics of 1, 3, 4, 5 and 6 cycles a turn, a wedge whose effect wanders, and light that drifts as a random walk
    are random effects. Their presence and sizes are averaged over a grid, weighted by marginal likelihood; the
    covariance is that of the points with nine tenths of the probability. A harmonic that is present has a prior size of
    2 % of the mean, as in real sheets and wire grids.

    The law alone leaves harmonics in its residual, which makes errors of a whole turn ten times too large, and drift in
    its axis, which makes them three times too small. Scans of fewer than 16 frames are fitted with the law alone.

    Scans of less than a whole turn, or of fewer than 12 frames, do not determine harmonics, and none are returned. The
    covariance of the law alone then includes the effect of each harmonic that the residual does not exclude, up to 3 %
    of the mean.

    References
    ----------
    Patterson and Thompson, Biometrika 58, 545 (1971), doi:10.1093/biomet/58.3.545, for the likelihood; Hoeting et al.,
    Statistical Science 14, 382 (1999), for the mean over models.
    """
    law = fit_fourier(angles_rad, values)
    if not harmonics_are_told_apart(angles_rad):
        return _with_unknown_harmonics(law, angles_rad, values), ()
    if len(values) < _LEAST_MODELLED:
        return law, _harmonics(angles_rad, values, np.zeros((len(values), 0)))
    mean = float(law.terms[0])
    shape, time = law.at(angles_rad) / mean, (np.arange(len(values)) + 0.5) / len(values)
    # A random walk by its first cosines (Karhunen and Loeve).
    cycles = np.arange(1, _DRIFT_TERMS + 1)
    walk = np.sqrt(2.0) * np.cos(np.pi * cycles * time[:, None]) / cycles
    drift, turning = walk * shape[:, None], _design(angles_rad, (1,))[:, 1:] * shape[:, None]
    wedge = np.column_stack([turning, *(_WEDGE_WANDER * turning * walk[:, [k]] for k in (0, 1))])
    harmonics = _design(angles_rad, _HARMONIC_ORDERS)[:, 1:]
    noise = max(_noise(np.column_stack([_design(angles_rad, (2,)), harmonics, drift[:, :3]]), values), 1e-7 * mean)
    grid, log_prior = _effect_grid(float(np.clip(_USUAL_HARMONIC * mean / noise, 3.0, 1000.0)))
    repeats = [2] * len(_HARMONIC_ORDERS) + [wedge.shape[1], drift.shape[1]]
    design = np.column_stack([_design(angles_rad, (2,)), harmonics, wedge, drift])
    # The residual of the law is fitted: rounding of the whole intensity would be larger than the noise.
    rest = values - law.at(angles_rad)
    weight, terms, covariance = _averaged(design, rest, np.repeat(grid, repeats, axis=1), log_prior)
    best = grid[int(np.argmax(weight))]
    kept = _most_likely(weight)
    share = weight[kept] / weight[kept].sum()
    middle = share @ terms[kept]
    off = terms[kept] - middle
    total = np.einsum("m,mij->ij", share, covariance[kept]) + np.einsum("m,mi,mj->ij", share, off, off)
    terms_of_law = law.terms + middle
    fit = FourierFit(terms=terms_of_law, unit_covariance=total / noise**2, variance=np.array(noise**2), dof=law.dof)
    return fit, _harmonics(angles_rad, values, best[-1] * drift)


def _with_unknown_harmonics(law: FourierFit, angles_rad: FloatArray, values: FloatArray) -> FourierFit:
    """Return Malus' law with the error by harmonics of any phase that its residual does not exclude."""
    of_law = _design(angles_rad, (2,))
    residual = values - of_law @ law.terms
    covariance = law.unit_covariance * law.variance
    for order in _HARMONIC_ORDERS:
        wave = _design(angles_rad, (order,))[:, 1:]
        absorbed = np.linalg.pinv(of_law) @ wave
        # Cosine and sine part of a random phase have half of the squared amplitude each.
        left = 0.5 * float(np.sum(np.square(wave - of_law @ absorbed)))
        square = (_LARGEST_HARMONIC * float(law.terms[0])) ** 2
        if left > _ROUNDING:
            square = min(square, float(residual @ residual) / left)
        covariance = covariance + 0.5 * square * (absorbed @ absorbed.T)
    return replace(law, unit_covariance=covariance, variance=np.array(1.0))


def _effect_grid(harmonic_ratio: float) -> tuple[FloatArray, FloatArray]:
    """Return sizes of the effects over the noise, (m, 7): five harmonics, wedge, drift; and their log probability."""
    ratios = np.array([0.0, 1.0, 4.0, 16.0, 64.0, 256.0])
    of_ratio = np.log(np.where(ratios == 0.0, 0.5, 0.5 / (len(ratios) - 1)))
    axes = [np.array([0, 1])] * len(_HARMONIC_ORDERS) + [np.arange(len(ratios))] * 2
    index = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    there, sizes = index[:, :-2], index[:, -2:]
    log_prior = np.log(np.where(there, _P_HARMONIC, 1.0 - _P_HARMONIC)).sum(axis=1) + of_ratio[sizes].sum(axis=1)
    return np.column_stack([there * harmonic_ratio, ratios[sizes]]), log_prior


def _averaged(
    design: FloatArray, values: FloatArray, ratios: FloatArray, log_prior: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return probability (m,), terms of the law (m, 3) and their covariance (m, 3, 3) for each point of the grid.

    The noise is integrated out; columns beyond the law have normal priors in units of the noise.
    """
    scale = np.column_stack([np.ones((len(ratios), _TERMS)), ratios])
    information = scale[:, :, None] * (design.T @ design) * scale[:, None, :]
    random = np.arange(_TERMS, design.shape[1])
    information[:, random, random] += 1.0
    right, dof = scale * (design.T @ values), len(values) - _TERMS
    inverse = np.linalg.inv(information)
    solution = np.einsum("mij,mj->mi", inverse, right)
    # Ignore rounding of the difference.
    square = float(values @ values)
    residual = np.maximum(square - np.einsum("mi,mi->m", right, solution), 1e-14 * square + np.finfo(float).tiny)
    log_weight = log_prior - 0.5 * np.linalg.slogdet(information)[1] - 0.5 * dof * np.log(residual)
    weight = np.exp(log_weight - log_weight.max())
    covariance = inverse[:, :_TERMS, :_TERMS] * (residual / dof)[:, None, None]
    return weight / weight.sum(), solution[:, :_TERMS], covariance


def _most_likely(weight: FloatArray) -> NDArray[np.int64]:
    order = np.argsort(weight)[::-1]
    kept: NDArray[np.int64] = order[: int(np.searchsorted(np.cumsum(weight[order]), _KEPT)) + 1]
    return kept


def _noise(design: FloatArray, values: FloatArray) -> float:
    """Return the standard deviation about a linear model; with too few values, about Malus' law."""
    chosen = design if design.shape[1] + _TERMS < len(values) else design[:, :_TERMS]
    solution, _, rank, _ = np.linalg.lstsq(chosen, values, rcond=None)
    return float(np.linalg.norm(values - chosen @ solution) / np.sqrt(len(values) - rank))


def _harmonics(angles_rad: FloatArray, values: FloatArray, drift: FloatArray) -> tuple[Harmonic, ...]:
    """Return the harmonics in addition to Malus' law, all fitted together."""
    columns = np.column_stack([drift, _design(angles_rad, (2, *_HARMONIC_ORDERS))])
    # Drift has a normal prior; the law and the harmonics have none.
    inverse = np.linalg.inv(columns.T @ columns + np.diag(np.arange(columns.shape[1]) < drift.shape[1]))
    terms = inverse @ columns.T @ values
    freedom = len(values) - columns.shape[1] + drift.shape[1]
    variance = max(float(values @ (values - columns @ terms)), 0.0) / freedom
    mean, waves = terms[drift.shape[1]], drift.shape[1] + _TERMS + 2 * np.arange(len(_HARMONIC_ORDERS))
    return tuple(
        Harmonic(
            order=order,
            amplitude=float(np.hypot(terms[at], terms[at + 1]) / mean),
            std_error=float(np.sqrt(0.5 * variance * (inverse[at, at] + inverse[at + 1, at + 1])) / mean),
        )
        for order, at in zip(_HARMONIC_ORDERS, waves.tolist(), strict=True)
    )


def false_dolp(harmonic: Harmonic, angles_rad: FloatArray) -> float:
    """Return the largest DoLP that a harmonic of the throughput gives to unpolarized light.

    Light of degree p has its AoLP turned by half of this over p at most [rad].
    """
    reduction = np.linalg.pinv(_design(angles_rad, (2,)))
    parts = reduction @ _design(angles_rad, (harmonic.order,))[:, 1:]
    factor = float(np.linalg.norm(parts[1:], ord=2))
    return harmonic.amplitude * factor if factor > _ROUNDING else 0.0


def harmonics_are_told_apart(angles_rad: FloatArray) -> bool:
    """Return whether the angles of a scan separate the harmonics, which takes a whole turn."""
    design = _design(angles_rad, (2, *_HARMONIC_ORDERS))
    return len(angles_rad) > design.shape[1] and bool(np.linalg.cond(design) < _APART_CONDITION)


def _design(angles_rad: FloatArray, orders: tuple[int, ...]) -> FloatArray:
    columns = [np.ones_like(angles_rad)]
    for order in orders:
        columns += [np.cos(order * angles_rad), np.sin(order * angles_rad)]
    return np.column_stack(columns)


# Action of an analyzer on polarized light, from a generator that turns in front of it


_TWO_SIDED_95 = 1.959964


@dataclass(frozen=True, kw_only=True, eq=False)
class AnalyzerChannels:
    """Each analyzer angle by itself, for one region or for many pixels (the trailing axes)."""

    throughput: FloatArray  #: (N, ...): response to unpolarized light relative to the mean over the angles
    throughput_error: FloatArray
    diattenuation: FloatArray  #: (N, ...): (max - min) / (max + min) of its transmission; above 1 by its error only
    diattenuation_error: FloatArray
    axis_rad: FloatArray  #: (N, ...): transmission axis, -pi/2 to pi/2, in the generator's frame [rad]
    axis_error_rad: FloatArray
    scan: FourierFit  #: the fits themselves


@dataclass(frozen=True, kw_only=True)
class Extinction:
    """An extinction ratio, largest over smallest transmission."""

    ratio: float | None  #: None where the minimum is not above 0
    lower: float  #: 95 % interval; the upper end is None where there is no limit
    upper: float | None


def analyzer_channels(generator_rad: FloatArray, intensities: FloatArray, *, generator_dolp: float) -> AnalyzerChannels:
    """Return throughput, diattenuation and axis of each analyzer angle.

    Parameters
    ----------
    generator_rad : (K,) array
        Transmission axis of the generator, counter-clockwise as the camera sees the scene [rad].
    intensities : (K, N, ...) array
        Mean counts less dark, of each generator angle and each analyzer angle.
    generator_dolp : float
        Degree of linear polarization that the generator makes, 0 to 1.

    Raises
    ------
    CalibrationError
        Angles do not determine the fit, there is no light, or `generator_dolp` is not in (0, 1].

    References
    ----------
    Boulbry, Ramella-Roman and Germer, Appl. Opt. 46, 8533 (2007), doi:10.1364/AO.46.008533; each analyzer by
    itself, in closed form.
    """
    if not 0.0 < generator_dolp <= 1.0:
        raise CalibrationError(f"the generator's DoLP is {generator_dolp}; allowed is above 0, up to 1")
    scan = fit_fourier(generator_rad, intensities)
    mean = scan.terms[0].mean(axis=0)
    return AnalyzerChannels(
        throughput=scan.terms[0] / mean,
        throughput_error=scan.mean_error() / mean,
        diattenuation=scan.modulation / generator_dolp,
        diattenuation_error=scan.modulation_error() / generator_dolp,
        axis_rad=scan.phase_rad,
        axis_error_rad=scan.phase_error_rad(),
        scan=scan,
    )


def pooled_diattenuation(channels: AnalyzerChannels) -> tuple[FloatArray, FloatArray]:
    """Return the diattenuation that all analyzer angles share, and its standard error, scatter included.

    One polarizer that turns has one diattenuation; scatter beyond the errors is the light's and enlarges them.

    Definition; the mean weighted by inverse variances.
    """
    weights = channels.diattenuation_error**-2.0
    mean = (weights * channels.diattenuation).sum(axis=0) / weights.sum(axis=0)
    n = len(channels.diattenuation)
    chi2 = (weights * np.square(channels.diattenuation - mean)).sum(axis=0)
    scale = np.maximum(1.0, chi2 / max(1, n - 1))
    return mean, np.sqrt(scale / weights.sum(axis=0))


def extinction(diattenuation: float, std_error: float) -> Extinction:
    """Return the extinction ratio of a diattenuation.

    Parameters
    ----------
    diattenuation, std_error : float
        The error includes noise, the generator's DoLP and the dark level.

    Raises
    ------
    CalibrationError
        The diattenuation is below 0, or above 1, by more than its error.

    Notes
    -----
    Near 1 the ratio is steep, so its interval is computed from that of the diattenuation: asymmetric, and without an
    upper end if a perfect polarizer is possible.
    """
    low, high = diattenuation - _TWO_SIDED_95 * std_error, diattenuation + _TWO_SIDED_95 * std_error
    if high <= 0.0:
        raise CalibrationError(f"the diattenuation is {diattenuation:.4g} +- {std_error:.2g}; allowed is above 0")
    lower = _ratio(max(low, 0.0))
    if lower is None:
        raise CalibrationError(
            f"the diattenuation is {diattenuation:.6g} +- {std_error:.2g}, above 1: the light is better polarized than "
            f"stated, or the dark level is too high: check --dolp and dark frames"
        )
    return Extinction(ratio=_ratio(diattenuation), lower=lower, upper=_ratio(high))


def _ratio(diattenuation: float) -> float | None:
    return (1.0 + diattenuation) / (1.0 - diattenuation) if diattenuation < 1.0 else None


# Mounting of a polarizer in its stage: sense of rotation and axis offset

Sense = Literal[1, -1]

_SENSES: tuple[Sense, ...] = (1, -1)
# Difference of chi-squared that decides between the senses: 5 standard errors.
_DECIDED = 25.0


@dataclass(frozen=True, kw_only=True)
class AxisCandidate:
    """Offset for one sense of rotation."""

    sense: Sense  #: polarizer angle = sense * stage angle + offset
    offset_rad: float  #: in [0, pi), and its standard error, scatter included [rad]
    std_error_rad: float
    chi2: float  #: misfit of the angles in their errors


@dataclass(frozen=True, kw_only=True)
class AxisFit:
    """Both senses of rotation."""

    best: AxisCandidate  #: the better one first
    other: AxisCandidate
    is_decided: bool  #: the other is ruled out
    #: rms scatter of the directions about the better one, beyond their errors [rad]
    scatter_rad: float


def fit_axis(
    *,
    axis_rad: FloatArray,
    stage_rad: FloatArray,
    std_error_rad: FloatArray,
    common_error_rad: float = 0.0,
    expected_rad: float | None = None,
    expected_error_rad: float = 0.0,
) -> AxisFit:
    """Return sense and offset from stage angles at which the direction of the transmission axis is known.

    Parameters
    ----------
    axis_rad, stage_rad : (n,) arrays
        Direction of the transmission axis in the picture, and stage angle at which the polarizer has it [rad]. Of a
        scan against a fixed reference: the reference's direction, and the stage angle of largest intensity.
    std_error_rad : (n,) array
        Standard error of their difference, > 0 [rad].
    common_error_rad : float
        Error that all directions share, that of the reference [rad].
    expected_rad, expected_error_rad : float
        The approximate offset, for example from a mark on the mount, and its error [rad].

    Raises
    ------
    CalibrationError
        There is no pair.

    Notes
    -----
    offset = axis - sense * stage. A single pair fits either sense. A second direction (not at 90 deg to the first)
    decides, or an approximate offset, unless the reference is at 0 or 90 deg to the axis at stage angle zero: then both
    senses give the same offset.

    Scatter of the pairs beyond their errors enlarges the standard error.
    """
    if len(axis_rad) == 0:
        raise CalibrationError("no angle is known in both the picture and the stage")
    fits = [
        _candidate(sense, axis_rad, stage_rad, std_error_rad, common_error_rad, expected_rad, expected_error_rad)
        for sense in _SENSES
    ]
    best, other = sorted(fits, key=lambda fit: fit.chi2)
    scale = max(1.0, best.chi2 / max(1, len(axis_rad) - 1))
    left_rad = half_turn(axis_rad - best.sense * stage_rad - best.offset_rad)
    beyond = float(np.mean(np.square(left_rad) - np.square(std_error_rad)))
    return AxisFit(
        best=best,
        other=other,
        is_decided=other.chi2 - best.chi2 > _DECIDED * scale,
        scatter_rad=float(np.sqrt(max(beyond, 0.0))),
    )


def _candidate(
    sense: Sense,
    axis_rad: FloatArray,
    stage_rad: FloatArray,
    std_error_rad: FloatArray,
    common_error_rad: float,
    expected_rad: float | None,
    expected_error_rad: float,
) -> AxisCandidate:
    offsets, weights = axis_rad - sense * stage_rad, std_error_rad**-2.0
    # Directions are the same modulo pi: their mean is taken on the circle of the doubled angle, then refined.
    start = 0.5 * float(np.angle(weights @ np.exp(2j * offsets)))
    difference = half_turn(offsets - start)
    offset = start + float(weights @ difference / weights.sum())
    chi2 = float(weights @ half_turn(offsets - offset) ** 2)
    scale = max(1.0, chi2 / max(1, len(offsets) - 1))
    variance = scale / float(weights.sum()) + common_error_rad**2
    if expected_rad is not None:
        chi2 += float(half_turn(np.array(offset - expected_rad))) ** 2 / (variance + expected_error_rad**2)
    return AxisCandidate(sense=sense, offset_rad=offset % np.pi, std_error_rad=float(np.sqrt(variance)), chi2=chi2)


def half_turn(angle_rad: FloatArray) -> FloatArray:
    """Return the difference of two directions, in [-pi/2, pi/2) [rad]."""
    wrapped: FloatArray = (angle_rad + 0.5 * np.pi) % np.pi - 0.5 * np.pi
    return wrapped


# The data reduction matrix, measured with known states of polarization


_LINEAR = 3
_WORST_CONDITION_DATA_REDUCTION = 1e6


@dataclass(frozen=True, kw_only=True, eq=False)
class DataReduction:
    """A measured data reduction matrix W: Stokes parameters = W @ intensities."""

    #: (3, N): W, and the standard error of each of its elements; in the units of states over intensities
    matrix: FloatArray
    std_error: FloatArray
    #: (M,): of the intensities; those after the third are noise, or something that is not linear
    singular_values: FloatArray
    condition: float  #: first over third


def linear_states(axis_rad: FloatArray, *, dolp: float) -> FloatArray:
    """Return the Stokes parameters (3, K) of linear polarizers in unpolarized light of S0 = 1 behind them."""
    return np.array([np.ones_like(axis_rad), dolp * np.cos(2.0 * axis_rad), dolp * np.sin(2.0 * axis_rad)])


def measured_data_reduction(states: FloatArray, intensities: FloatArray) -> DataReduction:
    """Return W from the intensities of known states.

    Parameters
    ----------
    states : (3, K) array
        S0, S1, S2 of each state; four or more states.
    intensities : (N, K) array
        Intensity in each of N >= 3 analyzer channels, dark taken off.

    Raises
    ------
    CalibrationError
        Too few states or channels, or they do not span the linear Stokes parameters.

    Notes
    -----
    W = states @ pseudo-inverse of the intensities, of which the first three singular values are kept: linear light has
    three parameters; the others are noise. Standard errors to first order from the residuals
    of each channel.

    References
    ----------
    Boulbry, Ramella-Roman and Germer, Appl. Opt. 46, 8533 (2007), doi:10.1364/AO.46.008533.
    """
    n_channels, n_states = intensities.shape
    if n_channels < _LINEAR or n_states <= _LINEAR:
        raise CalibrationError(
            f"{n_channels} analyzer angles and {n_states} states are given; W needs at least 3 angles and 4 states"
        )
    left, singular, right = np.linalg.svd(intensities, full_matrices=False)
    if (
        singular[_LINEAR - 1] * _WORST_CONDITION_DATA_REDUCTION <= singular[0]
        or np.linalg.matrix_rank(states) < _LINEAR
    ):
        raise CalibrationError(
            f"the states or the analyzer angles do not span linear polarization (singular values "
            f"{singular[:_LINEAR]}): angles that differ by 180 deg are repeats; "
            f"take at least three different ones of each"
        )
    inverse = (right[:_LINEAR].T / singular[:_LINEAR]) @ left[:, :_LINEAR].T
    matrix = states @ inverse
    return DataReduction(
        matrix=matrix,
        std_error=_errors(matrix, states, intensities),
        singular_values=singular,
        condition=float(singular[0] / singular[_LINEAR - 1]),
    )


def _errors(matrix: FloatArray, states: FloatArray, intensities: FloatArray) -> FloatArray:
    """Return the first-order errors of a pseudo-inverse, from those of the matrix that it inverts."""
    analyzer = intensities @ np.linalg.pinv(states)
    residual = intensities - analyzer @ states
    variance = np.square(residual).sum(axis=1) / (states.shape[1] - _LINEAR)
    covariance = np.linalg.inv(states @ states.T)
    gram = np.linalg.inv(analyzer.T @ analyzer)
    beyond = np.eye(len(analyzer)) - analyzer @ matrix
    # dW / dA[j, m], as [row of W, column of W, j, m]
    slope = -np.einsum("aj,mb->abjm", matrix, matrix) + np.einsum("am,jb->abjm", gram, beyond)
    errors: FloatArray = np.sqrt(np.einsum("abjm,mn,abjn,j->ab", slope, covariance, slope, variance))
    return errors


def block_means(picture: NDArray[np.float64] | NDArray[np.uint16] | NDArray[np.bool_], side: int) -> FloatArray:
    """Return the means over square blocks of a picture."""
    rows, columns = (length // side for length in picture.shape)
    if side < 1 or rows == 0 or columns == 0:
        raise CalibrationError(
            f"blocks of {side} x {side} pixels do not fit into a picture of {picture.shape[1]} x {picture.shape[0]}"
        )
    whole = picture[: rows * side, : columns * side].astype(np.float64)
    means: FloatArray = whole.reshape(rows, side, columns, side).mean(axis=(1, 3))
    return means
