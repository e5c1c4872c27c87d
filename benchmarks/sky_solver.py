"""Time and error of the atmosphere solver over its settings; sasktran2 beside it where that is installed.

Run: python -m benchmarks.sky_solver
"""

import importlib.util
from math import cos, radians
from time import perf_counter

import numpy as np

from model.atmosphere.phase import AerosolKind
from model.atmosphere.profile import AtmosphereState, column
from model.atmosphere.solver import Layer, Solution, solve
from model.atmosphere.tiers import TIERS, Tier

SZA_DEG = 50.0
STATE = AtmosphereState(visibility_m=23e3)
ZENITH_RAD, PHI_RAD = (
    grid.ravel() for grid in np.meshgrid(np.radians(np.arange(0, 81, 10)), np.radians(np.arange(0, 181, 10)))
)


def sky(solution: Solution) -> np.ndarray:
    return solution.stokes(solution.depth, np.cos(ZENITH_RAD), PHI_RAD, looking="up")


def timed(layers: tuple[Layer, ...], **settings) -> tuple[float, float, Solution, np.ndarray]:
    """Best of three: seconds of the solution, seconds of 171 directions."""
    best = (np.inf, np.inf)
    for _ in range(3):
        start = perf_counter()
        solution = solve(layers, mu0=cos(radians(SZA_DEG)), albedo=0.1, **settings)
        middle = perf_counter()
        light = sky(solution)
        best = min(best, (middle - start, perf_counter() - middle))
    return *best, solution, light


def report(name: str, layers: tuple[Layer, ...], reference: np.ndarray, **settings) -> None:
    seconds, seconds_sky, solution, light = timed(layers, **settings)
    error = np.max(np.abs(light - reference) / reference[:, :1], axis=0)
    print(
        f"{name:34} {seconds:7.3f} s + {seconds_sky:6.3f} s, {solution.orders:3d} orders, "
        f"error I {error[0]:.1e} Q {error[1]:.1e} U {error[2]:.1e}, estimated {solution.error_estimate:.1e}"
    )


def own_solver() -> None:
    one = column(STATE, wavelength_m=550e-9)
    fine = one.layers(fine=True)
    print(f"rural 23 km, 550 nm, optical depth {one.depth:.3f}, sun at {SZA_DEG} deg, 171 directions of the sky")
    for kind in AerosolKind:
        reference = timed(fine, aerosol=kind, nodes=20, element_depth=0.01, tolerance=1e-8)[3]
        for tier in (Tier.FAST, Tier.STANDARD):
            settings = TIERS[tier].settings
            report(
                f"{tier}, {kind}",
                one.layers(fine=settings.fine_layers),
                reference,
                aerosol=kind,
                nodes=settings.nodes,
                element_depth=settings.element_depth,
                tolerance=settings.tolerance,
            )
        for nodes in (4, 6, 8, 12, 16):
            report(f"78 layers, {nodes} nodes, {kind}", fine, reference, aerosol=kind, nodes=nodes)


def sasktran2_sky() -> None:
    """The same sky by sasktran2, 16 streams, spherical with a flat Earth (it cannot look up otherwise)."""
    import sasktran2 as sk

    one = column(STATE, wavelength_m=550e-9)
    z_m = np.concatenate([np.arange(0, 10e3, 250.0), np.arange(10e3, 30e3, 1e3), np.arange(30e3, 100e3, 5e3)])
    step_m = 1.0
    rayleigh, aerosol = extinctions(one, z_m, step_m)
    config = sk.Config()
    config.num_stokes, config.num_streams, config.num_singlescatter_moments = 3, 16, 64
    config.multiple_scatter_source = sk.MultipleScatterSource.DiscreteOrdinates
    config.single_scatter_source = sk.SingleScatterSource.Exact
    mu0 = cos(radians(SZA_DEG))
    geometry = sk.Geometry1D(mu0, 0.0, 1e9, z_m, sk.InterpolationMethod.LinearInterpolation, sk.GeometryType.Spherical)
    views = sk.ViewingGeometry()
    for zenith, phi in zip(ZENITH_RAD, PHI_RAD, strict=True):
        views.add_ray(sk.SolarAnglesObserverLocation(mu0, phi, min(np.cos(zenith), 1 - 1e-9), 0.0))
    air = sk.Atmosphere(geometry, config, calculate_derivatives=False, numwavel=1)
    ssa = np.where(z_m < 2e3, one.lower.ssa, one.upper.ssa)
    g = np.where(z_m < 2e3, one.lower.g, one.upper.g)
    scattering = rayleigh + ssa * aerosol
    share = rayleigh / scattering
    air.storage.total_extinction[:, 0] = rayleigh + aerosol
    air.storage.ssa[:, 0] = scattering / (rayleigh + aerosol)
    degree = np.arange(64)[:, np.newaxis]
    molecules = np.zeros((64, 1))
    molecules[0], molecules[2] = 1.0, one.delta / 2
    air.leg_coeff.a1[:, :, 0] = share * molecules + (1 - share) * (2 * degree + 1) * g**degree
    air.leg_coeff.a2[2, :, 0] = 3 * share * one.delta
    air.leg_coeff.b1[2, :, 0] = np.sqrt(6) / 2 * share * one.delta
    air.surface.albedo[:] = 0.1
    start = perf_counter()
    radiance = sk.Engine(config, geometry, views).calculate_radiance(air)["radiance"].to_numpy()[0]
    seconds = perf_counter() - start
    ours = timed(one.layers(fine=True))[3]
    error = np.abs(radiance * [1, -1, 1] - ours) / ours[:, :1]
    far = np.radians(12) < ZENITH_RAD  # nearer the zenith its source is interpolated badly, up to 1.6 %
    print(f"sasktran2, 16 streams {seconds:.3f} s, difference beyond 12 deg {np.max(error[far], axis=0)}")


def extinctions(one, z_m: np.ndarray, step_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Extinction of molecules and of aerosol at heights [m-1], by differences."""
    from model.atmosphere.molecules import pressure_ratio

    low, high = np.maximum(z_m - step_m, 0.0), z_m + step_m
    rayleigh = one.tau_rayleigh * (pressure_ratio(low) - pressure_ratio(high)) / (high - low)
    total = (one.tau_above(low) - one.tau_above(high)) / (high - low)
    return rayleigh, np.maximum(total - rayleigh, 0.0)


if __name__ == "__main__":
    own_solver()
    if importlib.util.find_spec("sasktran2") is None:
        print("sasktran2 is not installed: pip install sasktran2 to see it beside")
    else:
        sasktran2_sky()
