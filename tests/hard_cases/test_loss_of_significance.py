"""What the page on loss of significance says."""

import re

import pytest

from tests.hard_cases import loss_of_significance as shown

_NUMBER = re.compile(r"(?<=\| )[\d.e+-]+(?= )")
# Columns whose digits every library must find; those of the naive formulas are rounding alone.
_SAME_EVERYWHERE = ("ours", "first order", "reference")


@pytest.mark.parametrize("snr", [1e6, 1e8, 1e9])
def test_the_deviation_of_dolp_keeps_its_digits_where_a_difference_of_squares_loses_them(snr):
    # First order leaves 1/snr^2; the difference of squares rounds at 1e-17 over a variance of 2/snr^2.
    assert shown.our_std(snr) == pytest.approx(shown.first_order_std(snr), rel=max(100.0 / snr**2, 1e-13))
    # Both squares are multiples of 2^-61, whatever rounds them; the true variance of these three lies a quarter of that
    # or more from the nearest multiple.
    assert abs(shown.naive_std(snr) / shown.our_std(snr) - 1.0) > 1e-20 * snr**2


def test_a_miss_has_digits_where_one_minus_detection_has_none():
    for _, naive, ours, truth in shown.misses():
        assert naive == 0.0
        assert ours == pytest.approx(truth, rel=1e-12)


def test_close_angles_lose_half_as_many_digits_as_by_the_normal_equations():
    condition, naive, ours = shown.stokes_errors(0.1)
    assert ours is not None
    assert ours < 1e-15 * condition
    assert naive > 100.0 * ours


def test_angles_too_close_are_refused():
    assert shown.stokes_errors(0.001)[2] is None


def _same_everywhere(lines):
    """Return the numbers of all tables that do not depend on how the last digit of a sum is rounded."""
    values, header = [], []
    for line in lines:
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("|"):
            header = []
        elif not header:
            header = cells
        elif not line.startswith("|---"):
            values += [float(cell) for name, cell in zip(header, cells, strict=True) if name in _SAME_EVERYWHERE]
    return values


def test_the_page_says_what_the_code_finds():
    found = "\n".join(shown.lines()).splitlines()
    page = shown.PAGE.read_text(encoding="utf-8").splitlines()
    assert [_NUMBER.sub("#", line) for line in page] == [_NUMBER.sub("#", line) for line in found]
    written = _same_everywhere(page)
    assert len(written) == 16
    # Ten digits are written of the first table.
    assert _same_everywhere(found) == pytest.approx(written, rel=1e-9)
