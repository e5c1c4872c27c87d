"""Indices against functions whose indices are known in closed form."""

import numpy as np
import pytest

from rigctl.study import sobol_of, unit_draws

NUMBER = ("scene", "region", "dolp_mean")
KEYS = ("a", "b", "c")


def test_sobol_of_ishigami():
    # f = sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1, each even over (-pi, pi) (Saltelli et al. 2010).
    x = np.pi * (2.0 * unit_draws("sobol", 3, 1024, 7) - 1.0)
    found = sobol_of(NUMBER, np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0]), KEYS)
    for row, first, total in zip(found, (0.3139, 0.4424, 0.0), (0.5576, 0.4424, 0.2437), strict=True):
        # The bootstrap's 95 % limits are 1.96 standard errors wide to each side: five of them.
        assert row.first == pytest.approx(first, abs=5 / 1.96 * (row.first_high - row.first_low) / 2)
        assert row.total == pytest.approx(total, abs=5 / 1.96 * (row.total_high - row.total_low) / 2)
        assert row.first_high - row.first_low < 0.3
        assert row.reason == ""


def test_an_input_that_changes_nothing_has_indices_of_0():
    u = unit_draws("sobol", 3, 64, 1)
    found = sobol_of(NUMBER, u[:, 0] + 2.0 * u[:, 1], KEYS)
    assert (found[2].first, found[2].total, found[2].total_high) == (0.0, 0.0, 0.0)
    # Variances 1/12 and 4/12; limits as in the test above.
    for row, share in zip(found, (0.2, 0.8), strict=False):
        assert row.total == pytest.approx(share, abs=5 / 1.96 * (row.total_high - row.total_low) / 2)


@pytest.mark.parametrize(("spoil", "reason"), [(np.nan, "1 of 40 cases"), (None, "no input changes it")])
def test_where_there_is_none_the_reason_stands(spoil, reason):
    values = np.ones(8 * 5)
    if spoil is not None:
        values[3] = spoil
    rows = sobol_of(NUMBER, values, KEYS)
    assert all(reason in row.reason and np.isnan(row.total) for row in rows)
