"""A column is said once and stands wherever its table is written."""

import csv
import io
import json
import math
import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

from rigctl import cli
from rigctl.console import anonymous
from rigctl.report.comparison import relative_paths
from rigctl.report.document import Column, Picture, Report, Section, Shown, Table, Verbatim, text_columns
from rigctl.report.files import encoded, html
from rigctl.report.pdf import pdf
from tests.monkey.workspace import make_workspace


@dataclass(frozen=True, kw_only=True)
class Reading:
    name: str
    light: float
    error: float | None = None


READINGS = (Reading(name="road <1>", light=1.23456, error=0.01), Reading(name="paint", light=2.0))
COLUMNS = (
    Column(title="place", key="name", left=True),
    Column(title="light [DN]", key="light", text=lambda row: f"{row.light:.2f}", brief=lambda row: f"{row.light:.1f}"),
    Column(title="its error", key="error", text=lambda row: "–" if row.error is None else f"{row.error:.1g}"),
)
TWICE = Column(title="twice", key="twice", value=lambda row: 2.0 * row.light, text=lambda row: f"{2 * row.light:.3f}")


PIXEL = cv2.imencode(".png", np.zeros((1, 1, 3), np.uint8))[1].tobytes()


def report(*blocks, **judged):
    return Report(title="A title", source="Of a test.", sections=[Section(title="S", blocks=blocks)], **judged)


def page_rows(text):
    return [re.findall(r"<t[hd][^>]*>([^<]*)</t[hd]>", row) for row in re.findall(r"<tr[^>]*>(.*?)</tr>", text)]


def terminal_text(table, width=100):
    console = Console(file=io.StringIO(), width=width)
    console.print(table)
    return console.file.getvalue()


def test_a_column_more_stands_on_the_page_in_the_terminal_in_csv_and_in_json():
    table = Table(columns=(*COLUMNS, TWICE), rows=READINGS)
    assert page_rows(html(report(table)))[:2] == [
        ["place", "light [DN]", "its error", "twice"],
        ["road &lt;1&gt;", "1.23", "0.01", "2.469"],
    ]
    assert "twice" in terminal_text(table)
    assert next(csv.reader(io.StringIO(table.csv()))) == ["name", "light", "error", "twice"]
    assert table.json()[1] == {"name": "paint", "light": 2.0, "error": None, "twice": 4.0}


def test_people_read_text_and_programs_read_values():
    table = Table(columns=COLUMNS, rows=READINGS)
    assert table.csv() == "name,light,error\nroad <1>,1.23456,0.01\npaint,2.0,\n"
    assert table.texts(Shown.PAGE)[0] == ("road <1>", "1.23", "0.01")
    assert table.texts(Shown.TERMINAL)[0] == ("road <1>", "1.2", "0.01")


def test_a_column_stands_only_where_it_is_shown():
    columns = (
        *COLUMNS,
        Column(title="page", text=lambda _: "p", shown=Shown.PAGE),
        Column(title="terminal", text=lambda _: "t", shown=Shown.TERMINAL),
        Column(key="csv", value=lambda _: 1, shown=Shown.CSV),
    )
    table = Table(columns=columns, rows=READINGS)
    assert page_rows(html(report(table)))[0][-1] == "page"
    assert terminal_text(table).splitlines()[0].split()[-1] == "terminal"
    assert table.csv().splitlines()[0] == "name,light,error,csv"
    assert list(table.json()[0]) == ["name", "light", "error"]


def test_columns_without_a_key_are_for_people_alone():
    table = Table(columns=text_columns("what", "which"), rows=(("a", "b"),))
    assert table.csv() == "\n\n"
    assert table.json() == [{}]
    assert page_rows(html(report(table))) == [["what", "which"], ["a", "b"]]


def test_columns_serve_rows_that_hold_theirs():
    held = Table(columns=tuple(column.of(lambda pair: pair[1]) for column in COLUMNS), rows=((1, READINGS[0]),))
    plain = Table(columns=COLUMNS, rows=READINGS[:1])
    for where in (Shown.PAGE, Shown.TERMINAL):
        assert held.texts(where) == plain.texts(where)
    assert held.csv() == plain.csv()
    assert held.json() == plain.json()


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_json_holds_no_number_that_does_not_exist(number):
    assert Table(columns=COLUMNS, rows=(Reading(name="a", light=number),)).json()[0]["light"] is None


def test_csv_leaves_a_number_that_does_not_exist_empty():
    assert Table(columns=COLUMNS, rows=(Reading(name="a", light=math.nan),)).csv().endswith("\na,,\n")


def test_rows_to_be_seen_at_once_are_marked():
    table = Table(columns=COLUMNS, rows=READINGS, is_off=lambda row: row.name == "paint")
    assert html(report(table)).count('<tr class="off">') == 1


def test_headings_over_groups_span_their_columns():
    columns = (COLUMNS[0], Column(title="a", text=str, group="both"), Column(title="b", text=str, group="both"))
    text = html(report(Table(columns=columns, rows=READINGS)))
    assert '<th class="group" colspan="1"></th><th class="group" colspan="2">both</th>' in text
    assert pdf(report(Table(columns=columns, rows=READINGS))).startswith(b"%PDF")


@pytest.mark.parametrize(
    "block",
    [
        "a < b",
        ("a", "b"),
        Verbatim("[rig]\nx = 1"),
        Table(columns=COLUMNS, rows=READINGS),
        Table(columns=text_columns("", ""), rows=(("a", "b"),)),
        Table(columns=COLUMNS, rows=()),
        ((Picture(png=PIXEL), Picture(png=PIXEL, caption="S0"))),
    ],
)
def test_every_block_is_written_as_html_and_as_pdf(block, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1790000000")
    assert "A title" in html(report(block))
    assert pdf(report(block)) == pdf(report(block))


def test_only_a_report_that_judges_has_a_verdict():
    assert '<div class="verdict' not in html(report())
    judged = report(verdict="No.", good=False, reasons=(("Points to angle:", "look"),))
    assert '<div class="verdict disagrees">' in html(judged)
    assert pdf(judged).startswith(b"%PDF")


def test_the_name_of_a_file_says_how_a_report_is_written():
    assert encoded(report(), "noise.pdf").startswith(b"%PDF")
    assert encoded(report(), "noise.html").startswith(b"<!doctype html>")


def test_a_table_whose_numbers_would_break_is_turned():
    table = Table(columns=(*COLUMNS, TWICE), rows=READINGS)
    upright = terminal_text(table, width=40).splitlines()
    assert re.split(r"\s{2,}", upright[0].strip()) == ["place", "light [DN]", "its error", "twice"]
    turned = terminal_text(table, width=20).splitlines()
    assert [line.split()[-1] for line in turned if line.startswith("light [DN]")] == ["1.2", "2.0"]
    assert max(map(len, turned)) <= 20


def test_a_table_one_letter_too_wide_breaks_between_words_and_loses_nothing():
    columns = text_columns("region of pixels", "two words", left=(0,))
    text = terminal_text(Table(columns=columns, rows=(("the_widest_of_all", "12345"),)), width=27)
    assert [line.split() for line in text.splitlines()] == [
        ["two"],
        ["region", "of", "pixels", "words"],
        ["the_widest_of_all", "12345"],
    ]


def test_raw_json_stands_on_the_page_and_on_no_paper(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1790000000")
    words = Section(title="Words", blocks=("a",))
    raw = Section(title="Provenance in full", blocks=(Verbatim("{}"),), folded=True, printed=False)
    both, words_alone = (Report(title="A", source="", sections=sections) for sections in ([words, raw], [words]))
    assert pdf(both) == pdf(words_alone)
    assert "Provenance in full" in html(both)


def test_absolute_paths_are_relative_to_the_working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert relative_paths({"run": f"{tmp_path}/runs/a", "n": 2}) == {"run": "runs/a", "n": 2}


def test_an_anonymous_report_names_no_folder_serial_number_or_site():
    with anonymous([]):
        told = relative_paths({"path": "/home/ann/a.toml", "camera_serial": "11", "rig": {"site": {"x": 1}}})
    assert told == {"path": "a.toml", "camera_serial": "left out", "rig": {"site": "left out"}}


def test_a_comparison_can_be_anonymous(tmp_path, capsys):
    folder = make_workspace(tmp_path / "ann")
    words = [str(folder / "run"), "--scene", str(folder / "scene.toml"), "--out", str(tmp_path / "out")]
    assert cli.main(["compare", *words, "--json", "--anonymous"]) in (0, 5)
    provenance = json.loads(capsys.readouterr().out)["provenance"]
    assert str(tmp_path) not in json.dumps(provenance)
    assert provenance["run"]["path"] == "run"
    assert str(Path(tmp_path)) not in next((tmp_path / "out").glob("*.html")).read_text()
