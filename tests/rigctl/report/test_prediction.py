"""Numbers of a prediction as people read them."""

from rigctl.report.prediction import quantity_tables


def test_what_is_left_of_rounding_is_zero_and_a_small_mean_is_not():
    regions = {"panel": {"s2": {"mean": 8.3e-13, "std": 29.0}, "dolp": {"mean": 8.3e-7, "std": 0.01}}}
    (table,) = quantity_tables(regions)
    mean = next(column for column in table.columns if column.title == "mean")
    assert [mean.text(row) for row in table.rows] == ["0", "8.3e-07"]
