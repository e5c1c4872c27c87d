"""Fits of refractive index, roughness and diffuse reflectance to measured light.

Least squares of Stokes radiances in units of their uncertainty, unknown factors on counts eliminated. The result says
which parameters the observations cannot tell apart, and has confidence intervals to first order (`gauss_interval`) and
from the profile of chi-square (`profile_interval`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtrc

from model.numerics import ndtri
from model.surface.diffuse import Diffuse
from model.surface.facets import INDEX_MAX, SLOPE_RMS_MIN, Lobe, checked_azimuth, checked_zenith, reflectance_at
from model.surface.pbrdf import Surface, evaluate

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """Stokes radiance of one region in one geometry, and the light that fell on it.

    Parameters
    ----------
    theta_i_rad, phi_rad
        Zenith angles and relative azimuths of the sources (the sun, and points of the sky), shape (J,) [rad].
    theta_r_rad
        Zenith angle of the camera [rad].
    irradiance
        Stokes irradiance that each source gives on the surface, cosine included, in the source's own axes,
        shape (J, 3) [W m-2, or a unit of its own].
    stokes
        Measured Stokes radiance at the surface, shape (3,) [the same unit per sr]: path radiance taken off,
        transmittance divided out.
    covariance
        Of `stokes`, shape (3, 3), positive definite.
    scale
        Name of an unknown factor on `stokes`, such as that of counts; observations of one name share it and the fit
        finds it. None: `stokes` and `irradiance` have the same unit.

    Raises
    ------
    ValueError
        If shapes do not fit, a value is not finite or an angle outside its range, or the covariance is not
        positive definite.
    """

    theta_i_rad: ArrayLike
    phi_rad: ArrayLike
    theta_r_rad: float
    irradiance: ArrayLike
    stokes: ArrayLike
    covariance: ArrayLike
    scale: str | None = None

    def __post_init__(self) -> None:
        checked_zenith("theta_r_rad", self.theta_r_rad)
        theta, phi = checked_zenith("theta_i_rad", self.theta_i_rad), checked_azimuth("phi_rad", self.phi_rad)
        if theta.ndim != 1 or theta.size == 0 or phi.shape != theta.shape:
            raise ValueError(
                f"theta_i_rad has shape {theta.shape}, phi_rad {phi.shape}; allowed is (J,) for both, J > 0"
            )
        _require_finite("irradiance", self.irradiance, (theta.size, 3))
        _require_finite("stokes", self.stokes, (3,))
        _require_finite("covariance", self.covariance, (3, 3))
        _whitening_matrix(self.covariance)


def sunlit(
    *,
    theta_i_rad: float,
    theta_r_rad: float,
    phi_rad: float,
    irradiance: float,
    stokes: ArrayLike,
    covariance: ArrayLike,
    scale: str | None = None,
) -> Observation:
    """Return the observation of a region in unpolarised sunlight alone.

    Parameters
    ----------
    theta_i_rad, theta_r_rad, phi_rad
        As in `model.surface.pbrdf.mueller` [rad].
    irradiance
        Of the sun on the surface, cosine included.
    stokes, covariance, scale
        As in `Observation`.

    Returns
    -------
    Observation
        With one source.

    Raises
    ------
    ValueError
        As `Observation`.
    """
    return Observation(
        theta_i_rad=[theta_i_rad],
        phi_rad=[phi_rad],
        theta_r_rad=theta_r_rad,
        irradiance=[[irradiance, 0.0, 0.0]],
        stokes=stokes,
        covariance=covariance,
        scale=scale,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Information:
    """First-order uncertainty of parameters."""

    standard_uncertainty: FloatArray
    correlation: FloatArray
    singular_values: FloatArray
    words: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class FitProblem:
    """Observations laid out for one evaluation, and what may vary."""

    start: Surface
    names: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray
    theta_i_rad: FloatArray
    theta_r_rad: FloatArray
    phi_rad: FloatArray
    irradiance: FloatArray
    first_source: NDArray[np.intp]
    stokes: FloatArray
    whitening: FloatArray
    sharing: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceFit:
    """Parameters of a surface as the observations give them.

    Parameters
    ----------
    surface
        The best surface.
    names
        Parameters that were fitted.
    values
        Shape (P,).
    information
        First-order (Gauss-Newton) uncertainties, correlations, and what cannot be told apart.
    chi_square
        Sum of squared residuals in units of their uncertainty.
    degrees_of_freedom
        Number of residuals less that of parameters and of unknown factors.
    p_value
        Probability of a chi-square at least as large, were model and covariances right; 1 without freedom.
    findings
        What to know before using the values, in words: at a bound, not determined, a bad fit.
    problem
        What was fitted, for `profile_interval`.
    internal
        The solution as `problem` counts it.
    """

    surface: Surface
    names: tuple[str, ...]
    values: FloatArray
    information: Information
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    findings: tuple[str, ...]
    problem: FitProblem
    internal: FloatArray


def fit_surface(
    observations: Sequence[Observation],
    *,
    start: Surface,
    free: Sequence[str] = ("n", "slope_rms", "dhr"),
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> SurfaceFit:
    """Return the parameters of a surface that fit measured Stokes radiances best.

    Parameters
    ----------
    observations
        Regions in one or several geometries.
    start
        Where to begin; parameters that are not free keep its values, and so do shadowing and diffuse kind.
    free
        Any of "n", "k", "slope_rms", "dhr", "specular_weight".
    bounds
        Where to look, by name, instead of `_PARAMETERS`' own. None for "dhr".

    Returns
    -------
    SurfaceFit
        With uncertainties and findings.

    Raises
    ------
    ValueError
        If the input is not possible, the search does not end, or the best parameters form no possible surface (a
        DHR that is held fixed, below what the fitted lobe reflects).

    Notes
    -----
    Weighted least squares, hence maximum likelihood for Gaussian noise of known covariance. The best minimum near
    the start is found; a start far off may lead to another. What the covariances leave out (illumination,
    model) the uncertainties leave out too; `p_value` tells when that matters.

    References
    ----------
    Definition; trust-region reflective least squares, Branch, Coleman and Li (1999),
    doi:10.1137/S1064827595289108.
    """
    problem = _fit_problem(observations, start=start, free=free, bounds=bounds or {})
    internal = _solved(
        problem,
        _initial_values(problem),
        function=lambda values: residuals(problem, values),
        jacobian=lambda values: _difference_jacobian(problem, values, residuals),
    )
    left = residuals(problem, internal)
    information_ = _information(problem, internal)
    chi_square, freedom = float(left @ left), left.size - len(problem.names) - len(problem.sharing)
    p_value = float(chdtrc(freedom, chi_square)) if freedom > 0 else 1.0
    return SurfaceFit(
        surface=_surface_of_values(problem, internal),
        names=problem.names,
        values=_physical_values(problem, internal),
        information=information_,
        chi_square=chi_square,
        degrees_of_freedom=freedom,
        p_value=p_value,
        findings=(*information_.words, *_bound_words(problem, internal), *_misfit_words(p_value, freedom)),
        problem=problem,
        internal=internal,
    )


def gauss_interval(fit: SurfaceFit, name: str, *, level: float = 0.95) -> tuple[float, float]:
    """Return the first-order confidence interval of a parameter.

    Parameters
    ----------
    name
        A fitted parameter.
    level
        Probability with which such intervals hold the truth, between 0 and 1.

    Returns
    -------
    tuple of float
        Value plus and minus the normal quantile times the standard uncertainty; infinite where not determined.
        May reach beyond the bounds.

    Raises
    ------
    ValueError
        If the name was not fitted or the level is not between 0 and 1.
    """
    index, quantile = _parameter_index(fit, name), _normal_quantile(level)
    reach = quantile * float(fit.information.standard_uncertainty[index])
    return float(fit.values[index]) - reach, float(fit.values[index]) + reach


def profile_interval(fit: SurfaceFit, name: str, *, level: float = 0.95) -> tuple[float, float]:
    """Return the profile-likelihood confidence interval of a parameter.

    Parameters
    ----------
    name
        A fitted parameter.
    level
        Probability with which such intervals hold the truth, between 0 and 1.

    Returns
    -------
    tuple of float
        Where chi-square, minimised over the other parameters, rises by the squared normal quantile. An end that
        lies beyond the bounds is the bound.

    Raises
    ------
    ValueError
        If the name was not fitted, the level is not between 0 and 1, or a search does not end.

    Notes
    -----
    Asymmetric where the model bends, and good near a bound, where the first-order interval is not; it takes some
    ten fits.

    References
    ----------
    Venzon and Moolgavkar (1988), doi:10.2307/2347496.
    """
    index, quantile = _parameter_index(fit, name), _normal_quantile(level)
    return (
        _profile_end(fit, index, quantile, direction=-1.0),
        _profile_end(fit, index, quantile, direction=1.0),
    )


def residuals(problem: FitProblem, values: FloatArray) -> FloatArray:
    """Return measured less modelled Stokes radiances in units of their uncertainty.

    Parameters
    ----------
    values
        Parameters as the problem counts them, shape (P,).

    Returns
    -------
    ndarray
        Shape (3 K,); independent and of variance 1 at the true parameters. An unknown factor has the value that fits
        best with these parameters, so that each costs one degree of freedom.

    References
    ----------
    [MK14] eq. (2) for sources without extent; definition. Factors: variable projection, Golub and Pereyra (1973),
    doi:10.1137/0710036.
    """
    lobe, weight, diffuse = _parts(problem, values)
    matrix = evaluate(
        problem.theta_i_rad,
        problem.theta_r_rad,
        problem.phi_rad,
        lobe=lobe,
        specular_weight=weight,
        diffuse=diffuse,
    )
    radiance = np.einsum("tij,tj->ti", matrix, problem.irradiance)
    modelled = np.add.reduceat(radiance, problem.first_source, axis=0)
    expected = np.einsum("kij,kj->ki", problem.whitening, modelled)
    measured = np.einsum("kij,kj->ki", problem.whitening, problem.stokes)
    return np.asarray(measured - _factors(problem, measured, expected)[:, None] * expected).ravel()


def _require_finite(name: str, value: ArrayLike, shape: tuple[int, ...]) -> None:
    array = np.asarray(value, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}; allowed is {shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name} has {np.sum(~np.isfinite(array))} values that are not finite")


def _whitening_matrix(covariance: ArrayLike) -> FloatArray:
    """Return W with W C W' = 1."""
    matrix = np.asarray(covariance, dtype=np.float64)
    if np.max(np.abs(matrix - matrix.T)) > 1e-12 * np.max(np.abs(matrix)):
        raise ValueError("covariance is not symmetric")
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(matrix)))
    except np.linalg.LinAlgError as error:
        raise ValueError(
            f"covariance is not positive definite (eigenvalues {np.linalg.eigvalsh(matrix)}); each of S0, S1, S2 "
            "needs an uncertainty of its own"
        ) from error


def _fit_problem(
    observations: Sequence[Observation],
    *,
    start: Surface,
    free: Sequence[str],
    bounds: Mapping[str, tuple[float, float]],
) -> FitProblem:
    """Return the problem of these observations."""
    names = _checked_names(free, start=start, bounds=bounds)
    if not observations:
        raise ValueError("observations is empty; allowed is one or more")
    if "specular_weight" in names and start.dhr is None and all(o.scale is not None for o in observations):
        raise ValueError(
            "specular_weight is a factor on all light of a surface without dhr, and the scale of all observations is "
            "unknown: give the start a dhr, or one observation in the unit of its irradiance"
        )
    limits = np.array([_checked_bounds(name, bounds) for name in names])
    sources = [np.size(observation.theta_i_rad) for observation in observations]
    return FitProblem(
        start=start,
        names=names,
        lower=limits[:, 0],
        upper=limits[:, 1],
        theta_i_rad=np.concatenate([np.asarray(o.theta_i_rad, dtype=np.float64) for o in observations]),
        theta_r_rad=np.repeat([o.theta_r_rad for o in observations], sources),
        phi_rad=np.concatenate([np.asarray(o.phi_rad, dtype=np.float64) for o in observations]),
        irradiance=np.concatenate([np.asarray(o.irradiance, dtype=np.float64) for o in observations]),
        first_source=np.concatenate([[0], np.cumsum(sources[:-1], dtype=np.intp)]).astype(np.intp),
        stokes=np.array([o.stokes for o in observations], dtype=np.float64),
        whitening=np.array([_whitening_matrix(o.covariance) for o in observations]),
        sharing=_sharing([o.scale for o in observations]),
    )


@dataclass(frozen=True, kw_only=True)
class _Parameter:
    """Limits and scale of one parameter of a surface."""

    lowest: float
    highest: float
    bounds: tuple[float, float]
    step: float


_PARAMETERS: Mapping[str, _Parameter] = {
    "n": _Parameter(lowest=1e-3, highest=INDEX_MAX, bounds=(1.0, 3.0), step=1e-4),
    "k": _Parameter(lowest=0.0, highest=INDEX_MAX, bounds=(0.0, 10.0), step=1e-4),
    "slope_rms": _Parameter(lowest=SLOPE_RMS_MIN, highest=10.0, bounds=(0.005, 1.0), step=2e-5),
    "dhr": _Parameter(lowest=0.0, highest=1.0, bounds=(0.0, 1.0), step=1e-5),
    "specular_weight": _Parameter(lowest=0.0, highest=1.0, bounds=(0.0, 1.0), step=1e-4),
}


def _checked_names(
    free: Sequence[str], *, start: Surface, bounds: Mapping[str, tuple[float, float]]
) -> tuple[str, ...]:
    """Return the names of the parameters to fit in the order of `_PARAMETERS`."""
    unknown = sorted({*free, *bounds} - set(_PARAMETERS))
    if unknown or not free:
        raise ValueError(f"free = {tuple(free)}, bounds for {tuple(bounds)}; allowed are {', '.join(_PARAMETERS)}")
    if "dhr" in free and start.dhr is None:
        raise ValueError("dhr is to be fitted, but the start has none; give the start a dhr")
    if "dhr" in bounds:
        raise ValueError("dhr takes no bounds: it lies between what the specular lobe alone reflects and 1")
    return tuple(name for name in _PARAMETERS if name in free)


def _checked_bounds(name: str, bounds: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
    """Return where to look for a parameter."""
    parameter = _PARAMETERS[name]
    low, high = bounds.get(name, parameter.bounds)
    if not parameter.lowest <= low < high <= parameter.highest or high - low < 4.0 * parameter.step:
        raise ValueError(
            f"bounds of {name} = ({low}, {high}); allowed is low < high within "
            f"{parameter.lowest:g} to {parameter.highest:g}"
        )
    return low, high


def _sharing(scales: Sequence[str | None]) -> NDArray[np.bool_]:
    names = dict.fromkeys(scale for scale in scales if scale is not None)
    return np.array([[scale == name for scale in scales] for name in names], dtype=np.bool_).reshape(-1, len(scales))


_TOLERANCE = 1e-8
_EVALUATIONS = 200
_BAD_FIT = 1e-3


def _solved(
    problem: FitProblem,
    start: FloatArray,
    *,
    function: Callable[[FloatArray], FloatArray],
    jacobian: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Return the values within the problem's bounds that minimise the sum of squares of a function.

    Branch, Coleman and Li (1999), doi:10.1137/S1064827595289108.
    """
    margin = 1e-9 * (problem.upper - problem.lower)
    from scipy.optimize import least_squares

    solution = least_squares(
        function,
        np.clip(start, problem.lower + margin, problem.upper - margin),
        jac=jacobian,
        bounds=(problem.lower, problem.upper),
        x_scale=[_PARAMETERS[name].step for name in problem.names],
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
        gtol=_TOLERANCE,
        max_nfev=_EVALUATIONS,
    )
    if solution.status <= 0:
        raise ValueError(
            f"the search did not end within {_EVALUATIONS} evaluations; begin nearer, or free fewer parameters"
        )
    return np.asarray(solution.x)


def _initial_values(problem: FitProblem) -> FloatArray:
    """Return the start's parameters as the problem counts them."""
    start = problem.start
    values = {name: getattr(start, name) for name in problem.names}
    if "dhr" in values and start.diffuse_term is not None:
        values["dhr"] = start.diffuse_term.excess
    return np.clip([float(values[name]) for name in problem.names], problem.lower, problem.upper)


def _parts(problem: FitProblem, values: FloatArray) -> tuple[Lobe, float, Diffuse | None]:
    """Lobe, its weight, and the diffuse term, which on the way may be one that no surface has."""
    start = problem.start
    chosen = {name: getattr(start, name) for name in _PARAMETERS if name != "dhr"}
    chosen.update({name: float(value) for name, value in zip(problem.names, values, strict=True)})
    weight = chosen["specular_weight"]
    lobe = Lobe(n=chosen["n"], k=chosen["k"], slope_rms=chosen["slope_rms"], shadowing=start.shadowing)
    if start.dhr is None:
        return lobe, weight, None
    if "dhr" not in chosen:
        chosen["dhr"] = start.dhr - weight * reflectance_at(lobe, start.dhr_angle_rad)
    term = Diffuse(
        kind=start.diffuse,
        lobe=lobe,
        specular_weight=weight,
        excess=chosen["dhr"],
        dhr_angle_rad=start.dhr_angle_rad,
        single=start.single,
    )
    return lobe, weight, term


def _factors(problem: FitProblem, measured: FloatArray, expected: FloatArray) -> FloatArray:
    """Return the factor on each observation's expectation, shape (K,): 1, or the best one where it is unknown."""
    factors = np.ones(len(expected))
    for members in problem.sharing:
        power = float(np.sum(expected[members] ** 2))
        if power > 0.0:
            factors[members] = np.sum(measured[members] * expected[members]) / power
    return factors


def _difference_jacobian(
    problem: FitProblem, values: FloatArray, function: Callable[[FitProblem, FloatArray], FloatArray]
) -> FloatArray:
    """Return derivatives of a function of the parameters by central differences, one-sided at a bound."""
    columns = []
    for index, name in enumerate(problem.names):
        step = np.zeros_like(values)
        step[index] = _PARAMETERS[name].step
        high = np.minimum(values + step, problem.upper)
        low = np.maximum(values - step, problem.lower)
        columns.append((function(problem, high) - function(problem, low)) / (high[index] - low[index]))
    return np.stack(columns, axis=-1)


def _information(problem: FitProblem, internal: FloatArray) -> Information:
    """Uncertainties of the physical parameters: chain rule through the excess that stands for the DHR."""
    inner = _difference_jacobian(problem, internal, residuals)
    physical = _difference_jacobian(problem, internal, _physical_values)
    return information(inner @ np.linalg.inv(physical), names=problem.names, ranges=problem.upper - problem.lower)


def _physical_values(problem: FitProblem, values: FloatArray) -> FloatArray:
    """Return the parameters as a user knows them, the DHR with the lobe's share in it."""
    physical = values.copy()
    if "dhr" in problem.names:
        lobe, weight, _ = _parts(problem, values)
        share = weight * reflectance_at(lobe, problem.start.dhr_angle_rad)
        physical[problem.names.index("dhr")] += share
    return physical


# Below this of the largest singular value a direction is nothing but rounding and difference quotients.
_RANK = 1e-7

# Shares of a vague combination that are worth a word, and of one that is not determined at all.
_NOTABLE = 0.2
_LOST = 1e-3


def information(jacobian: FloatArray, *, names: Sequence[str], ranges: FloatArray) -> Information:
    """Return what whitened derivatives say about the parameters.

    Definition: inverse of J' J by singular values.
    """
    parameters = len(names)
    padded = np.vstack([jacobian * ranges, np.zeros((parameters, parameters))])
    _, singular, directions = np.linalg.svd(padded, full_matrices=False)
    held = singular > _RANK * max(float(singular[0]), np.finfo(float).tiny)
    lost = np.any(np.abs(directions[~held]) > _LOST, axis=0)
    root = directions[held] / singular[held, None]
    covariance = root.T @ root
    scaled = np.sqrt(np.diag(covariance))
    divisor = np.where(lost | (scaled == 0.0), np.inf, scaled)
    correlation = covariance / np.outer(divisor, divisor)
    np.fill_diagonal(correlation, 1.0)
    return Information(
        standard_uncertainty=np.where(lost, np.inf, scaled * ranges),
        correlation=correlation,
        singular_values=singular,
        words=(*_vague_words(singular, directions, held, names), *_correlation_words(correlation, names)),
    )


# A combination known no better than this share of its range is not known.
_VAGUE = 0.25


def _vague_words(
    singular: FloatArray, directions: FloatArray, held: NDArray[np.bool_], names: Sequence[str]
) -> list[str]:
    words = []
    for value, direction, hold in zip(singular, directions, held, strict=True):
        if value * _VAGUE >= 1.0:
            continue
        least = _NOTABLE if hold else _LOST
        parts = [name for name, share in zip(names, direction, strict=True) if abs(share) > least]
        subject = parts[0] if len(parts) == 1 else "a combination of " + " and ".join(parts)
        known = f"only to {100.0 / value:.0f} % of its range" if hold else "not at all"
        words.append(
            f"the observations determine {subject} {known}: hold {' or '.join(parts)} fixed, or add geometries "
            "(the lobe's flank, another angle of incidence, a direction away from the glint)"
        )
    return words


# Two parameters above this correlation are told apart badly.
_STRONG_CORRELATION = 0.95


def _correlation_words(correlation: FloatArray, names: Sequence[str]) -> list[str]:
    return [
        f"{names[i]} and {names[j]} are told apart badly (correlation {correlation[i, j]:+.3f}): their errors "
        "compensate, only a combination of the two is known well"
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(correlation[i, j]) > _STRONG_CORRELATION
    ]


def _surface_of_values(problem: FitProblem, values: FloatArray) -> Surface:
    """Return the surface of these parameters."""
    physical = _physical_values(problem, values)
    chosen = {name: getattr(problem.start, name) for name in _PARAMETERS}
    chosen.update({name: float(value) for name, value in zip(problem.names, physical, strict=True)})
    return replace(problem.start, **chosen)


def _bound_words(problem: FitProblem, internal: FloatArray) -> list[str]:
    words = []
    for index, name in enumerate(problem.names):
        near = 1e-6 * (problem.upper[index] - problem.lower[index])
        for side, bound in (("lower", problem.lower[index]), ("upper", problem.upper[index])):
            if abs(internal[index] - bound) > near:
                continue
            which = "the excess of dhr over the specular lobe" if name == "dhr" else name
            words.append(
                f"{which} ends at its {side} bound {bound:g}: first-order uncertainties do not hold there, use the "
                "profile interval"
            )
    return words


def _misfit_words(p_value: float, freedom: int) -> list[str]:
    if freedom <= 0:
        return ["as many parameters as measured numbers: the fit cannot be checked against the data"]
    if p_value < _BAD_FIT:
        blame = "uncertainties are too small, or something is missing (skylight, another diffuse term, shadowing)"
        return [f"the model misses the data (p = {p_value:.1g}): {blame}"]
    return []


def _parameter_index(fit: SurfaceFit, name: str) -> int:
    if name not in fit.names:
        raise ValueError(f"{name!r} was not fitted; allowed are {', '.join(fit.names)}")
    return fit.names.index(name)


def _normal_quantile(level: float) -> float:
    """Return the quantile of the standard normal distribution to which a two-sided interval reaches: 1.96 for 0.95."""
    if not 0.0 < level < 1.0:
        raise ValueError(f"level = {level}; allowed is between 0 and 1")
    return float(ndtri(0.5 + 0.5 * level))


def _profile_end(fit: SurfaceFit, index: int, quantile: float, *, direction: float) -> float:
    """Walk outwards until the profile has risen enough, then close in on the place."""
    best = float(fit.values[index])
    limit = float((fit.problem.lower if direction < 0.0 else fit.problem.upper)[index])
    spread = float(fit.information.standard_uncertainty[index])
    room = abs(limit - best)
    step = min(quantile * spread, room)
    if step == 0.0:
        return limit

    def shortfall(distance: float) -> float:
        # The root of the rise is nearly linear in the distance, so few steps find where it is met.
        risen = max(_profile_rise(fit, index, best + direction * distance, spread), 0.0)
        return float(np.sqrt(risen)) - quantile

    outer = step
    while shortfall(outer) < 0.0:
        if outer >= room:
            return limit
        outer = min(2.0 * outer, room)
    from scipy.optimize import brentq

    return best + direction * float(brentq(shortfall, 0.0, outer, xtol=2e-3 * outer, rtol=1e-6))


# The parameter is held by a spring this many times stiffer than the data.
_STIFFNESS = 1e4


def _profile_rise(fit: SurfaceFit, index: int, target: float, spread: float) -> float:
    """Return how much chi-square rises when one physical parameter is held at a value and the others adapt."""
    problem = fit.problem
    scale = min(spread, float(problem.upper[index] - problem.lower[index]))
    stiffness = _STIFFNESS / scale

    def held(values: FloatArray) -> FloatArray:
        pull = stiffness * (_physical_values(problem, values)[index] - target)
        return np.append(residuals(problem, values), pull)

    def slope(values: FloatArray) -> FloatArray:
        row = _difference_jacobian(problem, values, _physical_values)[index]
        return np.vstack([_difference_jacobian(problem, values, residuals), stiffness * row])

    adapted = _solved(problem, fit.internal, function=held, jacobian=slope)
    left = residuals(problem, adapted)
    return float(left @ left) - fit.chi_square
