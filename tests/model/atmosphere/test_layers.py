import numpy as np
import pytest

from model.atmosphere.layers import Layer, merge_alike


def test_alike_neighbours_are_joined():
    thin, other = Layer(0.1, 0.05, 0.9, 0.6, 1.0), Layer(0.2, 0.0, 0.0, 0.0, 1.0)
    merged = merge_alike([thin, thin, other, thin])
    assert [layer.depth for layer in merged] == pytest.approx([0.3, 0.2, 0.15])
    assert merged[0].tau_aerosol == pytest.approx(0.1)


def test_layers_of_no_depth_are_left_out():
    assert merge_alike([Layer(0.0, 0.0, 0.5, 0.5, 0.5)]) == []


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ((-0.1, 0.0, 0.0, 0.0, 0.0), "tau_rayleigh"),
        ((0.0, np.inf, 0.0, 0.0, 0.0), "tau_aerosol"),
        ((0.0, 0.1, 1.1, 0.0, 0.0), "ssa_aerosol"),
        ((0.0, 0.1, 0.9, 1.0, 0.0), "g_aerosol"),
        ((0.0, 0.1, 0.9, 0.5, np.nan), "delta"),
    ],
)
def test_impossible_layers_are_refused(values, named):
    with pytest.raises(ValueError, match=named):
        Layer(*values)
