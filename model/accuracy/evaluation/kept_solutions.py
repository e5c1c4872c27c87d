"""Solutions of the atmosphere that one evaluation leaves for the next."""

from collections import OrderedDict
from collections.abc import Hashable
from typing import Unpack

from model.atmosphere.lighting.diffuse_light import DiffuseLight
from model.atmosphere.lighting.solve_column import HowToSolve, LightSolver
from model.atmosphere.transfer.layers import Layer

# Of one wavelength, with many streams and layers ten megabytes.
_KEPT = 48


class KeptSolutions:
    """Calls a solver, and keeps the last solutions."""

    def __init__(self, solver: LightSolver) -> None:
        """Set the solver."""
        self._solver = solver
        self._kept: OrderedDict[Hashable, tuple[tuple[Layer, ...], DiffuseLight]] = OrderedDict()

    def __call__(self, layers: tuple[Layer, ...], **how: Unpack[HowToSolve]) -> DiffuseLight:
        """Return the solution of one wavelength; arguments as `model.atmosphere.solver.solve`."""
        key = (tuple(map(_facts, layers)), *sorted(how.items()))
        if key not in self._kept:
            solution = self._solver(layers, **how)
            # The layers stay with it: a scattering matrix is known by its identity.
            self._kept[key] = (layers, solution)
            if len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key][1]


def _facts(layer: Layer) -> Hashable:
    matrix = None if layer.matrix is None else id(layer.matrix)
    scattering = (layer.ssa_aerosol, layer.g_aerosol, layer.delta, layer.forward_share)
    return (layer.tau_rayleigh, layer.tau_aerosol, *scattering, matrix)
