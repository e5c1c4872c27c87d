"""Time and error of the atmosphere solver over its settings; sasktran2 beside it where that is installed.

Run: OPENBLAS_NUM_THREADS=1 python -m benchmarks.sky_solver [--limit]

Beside it the solver's limit (with --limit that alone): seconds of the processor, those of its matrix products, and what
as many operations take in one large product, in double and in single precision.
"""

import argparse
import importlib.util
from collections import Counter
from math import cos, radians
from time import perf_counter, process_time

import numpy as np

from model.atmosphere import solver as successive_orders
from model.atmosphere.air import AtmosphereState, column
from model.atmosphere.layers import AerosolKind
from model.atmosphere.sasktran2_engine import Sasktran2Solution, sasktran2_solution
from model.atmosphere.sky import FIDELITY_LEVELS, Fidelity
from model.atmosphere.solver import Layer, Solution, solve

SZA_DEG = 50.0
STATE = AtmosphereState(visibility_m=23e3)
ZENITH_RAD, PHI_RAD = (
    grid.ravel() for grid in np.meshgrid(np.radians(np.arange(0, 81, 10)), np.radians(np.arange(0, 181, 10)))
)
# Beside the sun the aureole of spheres is not what one asks these settings for.
AWAY = np.cos(ZENITH_RAD) * cos(radians(SZA_DEG)) + np.sin(ZENITH_RAD) * np.sin(radians(SZA_DEG)) * np.cos(
    PHI_RAD
) < cos(radians(10.0))


def sky(solution: Solution | Sasktran2Solution) -> np.ndarray:
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
    error = np.max((np.abs(light - reference) / reference[:, :1])[AWAY], axis=0)
    print(
        f"{name:34} {seconds:7.3f} s + {seconds_sky:6.3f} s, {solution.orders:3d} orders, "
        f"error I {error[0]:.1e} Q {error[1]:.1e} U {error[2]:.1e}, estimated {solution.error_estimate:.1e}"
    )


def own_solver() -> None:
    one = column(STATE, wavelength_m=550e-9)
    print(f"rural 23 km, 550 nm, optical depth {one.depth:.3f}, sun at {SZA_DEG} deg, 171 directions of the sky")
    for kind in AerosolKind:
        fine = one.layers(fine=True, aerosol=kind)
        nodes = 32 if kind is AerosolKind.SPHERES else 20
        reference = timed(fine, aerosol=kind, nodes=nodes, element_depth=0.02, tolerance=1e-8)[3]
        for tier in (Fidelity.FAST, Fidelity.STANDARD):
            settings = FIDELITY_LEVELS[tier].settings
            report(
                f"{tier}, {kind}",
                one.layers(fine=settings.fine_layers, aerosol=kind, matrix_tolerance=settings.matrix_tolerance),
                reference,
                aerosol=kind,
                nodes=settings.nodes,
                element_depth=settings.element_depth,
                tolerance=settings.tolerance,
            )
        for nodes in (4, 6, 8, 12, 16):
            report(f"78 layers, {nodes} nodes, {kind}", fine, reference, aerosol=kind, nodes=nodes)


def sasktran2_sky() -> None:
    """The same sky by sasktran2, 16 streams."""
    one = column(STATE, wavelength_m=550e-9)
    far = AWAY & (np.radians(12) < ZENITH_RAD)  # nearer the zenith its source is interpolated badly, up to 1.6 %
    for kind in AerosolKind:
        layers = one.layers(fine=True, aerosol=kind)
        solve_s, sky_s, _, ours = timed(layers, aerosol=kind)
        start = perf_counter()
        theirs = sky(sasktran2_solution(layers, mu0=cos(radians(SZA_DEG)), albedo=0.1, aerosol=kind))
        seconds = perf_counter() - start
        error = np.abs(theirs - ours) / ours[:, :1]
        print(
            f"sasktran2, {kind}: {seconds:.3f} s, {seconds / (solve_s + sky_s):.0f} times ours on the same 78 layers, "
            f"difference beyond 12 deg {np.max(error[far], axis=0)}"
        )


def products_of(layers: tuple[Layer, ...], **settings) -> Counter[tuple[int, ...]]:
    """Count the matrix products of a solution, by their shapes: matrices, rows, inner, columns."""
    found: Counter[tuple[int, ...]] = Counter()
    project, scattered_source = successive_orders.project, successive_orders.scattered_source

    def projected(scattering, radiance):
        modes, inner, columns = scattering.projector.shape
        found[modes, radiance.shape[0], inner, columns] += 1
        return project(scattering, radiance)

    def scattered(scattering, moments, grid):
        modes, inner, columns = scattering.basis.shape
        found[modes, 3 * scattering.coefficients.shape[0], inner, columns] += 1
        return scattered_source(scattering, moments, grid)

    successive_orders.project, successive_orders.scattered_source = projected, scattered
    try:
        solve(layers, mu0=cos(radians(SZA_DEG)), albedo=0.1, **settings)
    finally:
        successive_orders.project, successive_orders.scattered_source = project, scattered_source
    return found


def seconds_of(work, *, rounds: int = 5) -> float:
    """Least processor time of some calls [s]."""
    taken = []
    for _ in range(rounds):
        start = process_time()
        work()
        taken.append(process_time() - start)
    return min(taken)


def product_s(shapes: Counter[tuple[int, ...]], kind: type) -> float:
    """Time of the products alone, their factors being there [s]."""
    total = 0.0
    for (matrices, rows, inner, columns), times in shapes.items():
        left, right = np.ones((matrices, rows, inner), kind), np.ones((matrices, inner, columns), kind)
        total += times * seconds_of(lambda left=left, right=right: left @ right)
    return total


def limit() -> None:
    """The solver beside its matrix products, and these beside one large one."""
    one, side = column(STATE, wavelength_m=550e-9), 768
    rates = {}
    for kind in (np.float64, np.float32):
        square = np.ones((side, side), kind)
        rates[kind] = 2.0 * side**3 / seconds_of(lambda square=square: square @ square)
    print(f"one large product: {rates[np.float64]:.2g} operations/s, single precision {rates[np.float32]:.2g}")
    for tier, nodes in ((Fidelity.FAST, 8), (Fidelity.STANDARD, 16)):
        settings = FIDELITY_LEVELS[tier].settings
        for kind in (AerosolKind.DEPOLARIZING, AerosolKind.POLARIZING):
            layers = one.layers(fine=settings.fine_layers, aerosol=kind, matrix_tolerance=settings.matrix_tolerance)
            how = {"aerosol": kind, "nodes": nodes, "element_depth": settings.element_depth}
            how["tolerance"] = settings.tolerance
            shapes = products_of(layers, **how)
            work = sum(2.0 * np.prod(shape) * times for shape, times in shapes.items())
            whole = seconds_of(
                lambda layers=layers, how=how: solve(layers, mu0=cos(radians(SZA_DEG)), albedo=0.1, **how)
            )
            double, single = (product_s(shapes, one_kind) for one_kind in (np.float64, np.float32))
            print(
                f"{nodes} streams, {kind}: {1e3 * whole:.1f} ms; its products {1e3 * double:.1f} ms, in single "
                f"precision {1e3 * single:.1f}; {work:.2g} operations, {1e3 * work / rates[np.float64]:.2f} ms of one "
                f"large product",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--limit", action="store_true")
    if parser.parse_args().limit:
        limit()
        return
    own_solver()
    limit()
    if importlib.util.find_spec("sasktran2") is None:
        print("sasktran2 is not installed: pip install sasktran2 to see it beside")
    else:
        sasktran2_sky()


if __name__ == "__main__":
    main()
