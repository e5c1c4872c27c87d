"""Time and estimated error of scattering matrices of spheres over the tolerance, and what they cost a sky.

Run: python -m benchmarks.mie_speed
"""

from collections.abc import Callable
from time import process_time

import numpy as np

from model.atmosphere.aerosols import AerosolType, preset_aerosol
from model.atmosphere.air import AtmosphereState, column
from model.atmosphere.layers import AerosolKind
from model.atmosphere.mie import aerosol_scattering, efficiencies, sphere_coefficients
from model.atmosphere.sky import FIDELITY_LEVELS, Fidelity
from model.atmosphere.solver import solve


def seconds(action: Callable[[int], object]) -> float:
    """Least processor time of three runs, which are told their number."""
    times = []
    for run in range(3):
        start = process_time()
        action(run)
        times.append(process_time() - start)
    return min(times)


def single_spheres() -> None:
    for largest in (1.0, 10.0, 100.0, 1000.0):
        sizes = np.linspace(largest / 100.0, largest, 100)

        def evaluate(_: int, sizes: np.ndarray = sizes) -> object:
            a, b = sphere_coefficients(size_parameter=sizes, n=1.53, k=0.0066)
            return efficiencies(size_parameter=sizes, a=a, b=b)

        print(f"100 spheres up to x = {largest:6g}: {1e3 * seconds(evaluate):8.2f} ms")


def matrices() -> None:
    for kind in AerosolType:
        aerosol = preset_aerosol(kind, relative_humidity=0.5)
        for tolerance in (3e-3, 1e-3, 3e-4):
            # A wavelength of its own for each run: results are remembered.
            took = seconds(
                lambda run, a=aerosol, t=tolerance: aerosol_scattering(
                    a, wavelength_m=550e-9 + run * 1e-13, tolerance=t
                )
            )
            found = aerosol_scattering(aerosol, wavelength_m=550e-9, tolerance=tolerance)
            print(
                f"{kind:14} tolerance {tolerance:.0e}: {took:6.2f} s, {len(found.matrix.coefficients):4d} degrees, "
                f"ssa {found.ssa:.4f}, g {found.matrix.g:.4f}, estimated {found.matrix.error_estimate:.1e}"
            )


def skies() -> None:
    one = column(AtmosphereState(visibility_m=23e3), wavelength_m=550e-9)
    for tier in (Fidelity.FAST, Fidelity.STANDARD):
        settings = FIDELITY_LEVELS[tier].settings
        times = {}
        for kind in AerosolKind:
            layers = one.layers(fine=settings.fine_layers, aerosol=kind, matrix_tolerance=settings.matrix_tolerance)
            times[kind] = seconds(
                lambda _, layers=layers, kind=kind, s=settings: solve(
                    layers,
                    mu0=0.64,
                    albedo=0.1,
                    aerosol=kind,
                    nodes=s.nodes,
                    element_depth=s.element_depth,
                    tolerance=s.tolerance,
                )
            )
        ratio = times[AerosolKind.SPHERES] / times[AerosolKind.DEPOLARIZING]
        listed = ", ".join(f"{kind} {time:.3f} s" for kind, time in times.items())
        print(f"{tier}: {listed}; spheres {ratio:.1f} times depolarizing")


if __name__ == "__main__":
    single_spheres()
    matrices()
    skies()
