"""The rows of a comparison, for programs and for people."""

from dataclasses import asdict, fields

import pytest

from rigctl.comparison.rows import Row
from rigctl.report.comparison import mixed_row_table, row_table
from rigctl.report.data_files import csv_rows, json_rows
from rigctl.report.table import Shown

ROW = Row(
    region="road",
    quantity="dolp",
    statistic="mean",
    predicted=0.123456,
    measured=0.2,
    std_error=0.0012,
    std_error_inputs=0.0005,
    z_measurement=63.8,
    z=58.9,
    agrees=False,
    smallest_difference_90=0.004,
)
UNTESTED = Row(region="road", quantity="s0", statistic="mean", predicted=10.0, measured=11.0)


@pytest.mark.parametrize("row", [ROW, UNTESTED])
def test_programs_read_every_field_of_a_row_in_its_order(row):
    (content,) = json_rows(row_table([row]))
    assert list(content.items()) == list(asdict(row).items())
    assert csv_rows(row_table([row])).decode().splitlines()[0].split(",") == [field.name for field in fields(Row)]


def test_people_read_numbers_to_the_digits_of_their_error():
    (texts,) = row_table([ROW]).texts(Shown.PAGE)
    assert texts == ("dolp", "mean", "0.1235", "0.2000", "0.0012", "0.0005", "+63.80", "+58.90", "DISAGREES", "0.004")


def test_the_terminal_says_the_region_and_one_score():
    (texts,) = row_table([ROW]).texts(Shown.TERMINAL)
    assert texts == ("road", "dolp", "mean", "0.123456", "0.2", "+58.9")


def test_rows_of_several_regions_say_theirs_on_a_page():
    assert mixed_row_table([ROW]).texts()[0][0] == "road: dolp"


def test_a_number_that_was_not_tested_has_neither_error_nor_score():
    (texts,) = row_table([UNTESTED]).texts(Shown.PAGE)
    assert texts[4:] == ("–", "–", "–", "–", "no test", "–")
