import numpy as np
import pytest

from model.atmosphere.aerosols import chebyshev_wavelengths_m, lagrange_basis


def test_chebyshev_wavelengths_of_the_visible():
    nodes = chebyshev_wavelengths_m(shortest_m=400e-9, longest_m=700e-9, count=4)
    np.testing.assert_allclose(nodes * 1e9, [411.4, 492.6, 607.4, 688.6], atol=0.05)


def test_basis_reproduces_a_cubic_in_inverse_wavelength():
    nodes = chebyshev_wavelengths_m(shortest_m=400e-9, longest_m=700e-9, count=4)
    target = np.linspace(400e-9, 700e-9, 50)

    def cubic(wavelength_m):
        x = 1e-6 / wavelength_m
        return 1.0 - 2.0 * x + 0.3 * x**2 + 0.1 * x**3

    read = cubic(nodes) @ lagrange_basis(nodes_m=nodes, wavelength_m=target)
    np.testing.assert_allclose(read, cubic(target), rtol=1e-12)


@pytest.mark.parametrize(("shortest", "longest", "count"), [(7e-7, 4e-7, 3), (4e-7, 7e-7, 0)])
def test_empty_bands_are_refused(shortest, longest, count):
    with pytest.raises(ValueError, match=r"count|shortest"):
        chebyshev_wavelengths_m(shortest_m=shortest, longest_m=longest, count=count)
