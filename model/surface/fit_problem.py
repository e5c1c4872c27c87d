"""The least-squares problem of a surface's parameters: measured Stokes radiances against the model's."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.surface.diffuse import Diffuse, reflectance_at
from model.surface.fit_observation import Observation, whitening_matrix
from model.surface.fit_parameters import PARAMETERS, checked_bounds, checked_names
from model.surface.lobe import Lobe
from model.surface.pbrdf import Surface, evaluate

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class FitProblem:
    """Observations laid out for one evaluation, and what may vary.

    Parameters
    ----------
    start
        The surface to begin with; it keeps the values that are not free.
    names
        Free parameters, in the order of `PARAMETERS`. Within the problem "dhr" stands for its excess over the lobe,
        DHR - B E(theta_m), whose one limit is zero: the lobe's own share moves with the other parameters.
    lower, upper
        Bounds of the free parameters, shape (P,).
    theta_i_rad, theta_r_rad, phi_rad
        Of all sources of all observations, shape (T,) [rad].
    irradiance
        Shape (T, 3).
    first_source
        Where each observation's sources begin, shape (K,).
    stokes
        Measured, shape (K, 3).
    whitening
        Of each observation's covariance, shape (K, 3, 3).
    sharing
        Which observations share each unknown factor on `stokes`, shape (U, K); U may be 0.
    """

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


def fit_problem(
    observations: Sequence[Observation],
    *,
    start: Surface,
    free: Sequence[str],
    bounds: Mapping[str, tuple[float, float]],
) -> FitProblem:
    """Return the problem of these observations.

    Parameters
    ----------
    observations
        At least one.
    start
        The surface to begin with.
    free
        Names of the parameters to fit, of `PARAMETERS`.
    bounds
        Where to look, by name; for the others the parameter's own. The DHR takes none but 0 to 1.

    Returns
    -------
    FitProblem
        The problem.

    Raises
    ------
    ValueError
        If there is nothing to fit, a name is not known, bounds are not possible, or the specular weight is nothing but
        an unknown scale.
    """
    names = checked_names(free, start=start, bounds=bounds)
    if not observations:
        raise ValueError("observations is empty; allowed is one or more")
    if "specular_weight" in names and start.dhr is None and all(o.scale is not None for o in observations):
        raise ValueError(
            "specular_weight is a factor on all light of a surface without dhr, and the scale of all observations is "
            "unknown: give the start a dhr, or one observation in the unit of its irradiance"
        )
    limits = np.array([checked_bounds(name, bounds) for name in names])
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
        whitening=np.array([whitening_matrix(o.covariance) for o in observations]),
        sharing=_sharing([o.scale for o in observations]),
    )


def initial_values(problem: FitProblem) -> FloatArray:
    """Return the start's parameters as the problem counts them.

    Parameters
    ----------
    problem
        Its start, the names of what is fitted, and their bounds.

    Returns
    -------
    ndarray
        Shape (P,); a value outside the bounds is moved to the nearer one.
    """
    start = problem.start
    values = {name: getattr(start, name) for name in problem.names}
    if "dhr" in values and start.diffuse_term is not None:
        values["dhr"] = start.diffuse_term.excess
    return np.clip([float(values[name]) for name in problem.names], problem.lower, problem.upper)


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


def physical_values(problem: FitProblem, values: FloatArray) -> FloatArray:
    """Return the parameters as a user knows them, the DHR with the lobe's share in it.

    Parameters
    ----------
    values
        Parameters as the problem counts them, shape (P,).

    Returns
    -------
    ndarray
        Shape (P,).
    """
    physical = values.copy()
    if "dhr" in problem.names:
        lobe, weight, _ = _parts(problem, values)
        share = weight * reflectance_at(lobe, problem.start.dhr_angle_rad)
        physical[problem.names.index("dhr")] += share
    return physical


def difference_jacobian(
    problem: FitProblem, values: FloatArray, function: Callable[[FitProblem, FloatArray], FloatArray]
) -> FloatArray:
    """Return derivatives of a function of the parameters by central differences, one-sided at a bound.

    Parameters
    ----------
    values
        Where, shape (P,), within the bounds.
    function
        Of problem and values; returns shape (M,).

    Returns
    -------
    ndarray
        Shape (M, P).
    """
    columns = []
    for index, name in enumerate(problem.names):
        step = np.zeros_like(values)
        step[index] = PARAMETERS[name].step
        high = np.minimum(values + step, problem.upper)
        low = np.maximum(values - step, problem.lower)
        columns.append((function(problem, high) - function(problem, low)) / (high[index] - low[index]))
    return np.stack(columns, axis=-1)


def surface_of_values(problem: FitProblem, values: FloatArray) -> Surface:
    """Return the surface of these parameters.

    Parameters
    ----------
    values
        Parameters as the problem counts them, shape (P,).

    Returns
    -------
    Surface
        What is not free as in the start.

    Raises
    ------
    ValueError
        If a DHR that is held fixed is below what the lobe of these parameters reflects.
    """
    physical = physical_values(problem, values)
    chosen = {name: getattr(problem.start, name) for name in PARAMETERS}
    chosen.update({name: float(value) for name, value in zip(problem.names, physical, strict=True)})
    return Surface(
        **chosen,
        dhr_angle_rad=problem.start.dhr_angle_rad,
        shadowing=problem.start.shadowing,
        diffuse=problem.start.diffuse,
    )


def _factors(problem: FitProblem, measured: FloatArray, expected: FloatArray) -> FloatArray:
    """Return the factor on each observation's expectation, shape (K,): 1, or the best one where it is unknown."""
    factors = np.ones(len(expected))
    for members in problem.sharing:
        power = float(np.sum(expected[members] ** 2))
        if power > 0.0:
            factors[members] = np.sum(measured[members] * expected[members]) / power
    return factors


def _sharing(scales: Sequence[str | None]) -> NDArray[np.bool_]:
    names = dict.fromkeys(scale for scale in scales if scale is not None)
    return np.array([[scale == name for scale in scales] for name in names], dtype=np.bool_).reshape(-1, len(scales))


def _parts(problem: FitProblem, values: FloatArray) -> tuple[Lobe, float, Diffuse | None]:
    """Lobe, its weight, and the diffuse term, which on the way may be one that no surface has."""
    start = problem.start
    chosen = {name: getattr(start, name) for name in PARAMETERS if name != "dhr"}
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
    )
    return lobe, weight, term
