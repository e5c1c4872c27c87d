"""A comparison as its report, its CSV and its JSON."""

import csv
import json
import re
from dataclasses import asdict, fields, replace

import numpy as np
import pytest

from rigctl.comparison.rows import Row
from rigctl.report.comparison import (
    comparison_files,
    comparison_report,
    light_section,
    mixed_row_table,
    row_table,
    summary_table,
)
from rigctl.report.document import Picture, Shown, Table
from rigctl.report.files import html, write_folder
from rigctl.rig.roof import perturbed
from rigctl.session.take import take_session
from rigctl.verbs.compare import compare, compare_run
from tests.rigctl.example_files import small_rig, small_session


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compared")
    take_session(small_rig(folder), small_session(cycles=3), folder / "run", files={})
    found = compare(folder / "run", folder / "scene.toml", out=folder / "out").comparison
    return folder / "out", found


def test_the_report_is_one_file_that_answers_first(compared):
    page = (compared[0] / "report.html").read_text()
    assert re.findall(r'(?:src|href)="(?!data:)', page) == []
    first = [
        f"<h1>Measurement versus model: {compared[0].parent.name}/run</h1>",
        "Model and measurement agree: ",
        "Means of the regions ± standard errors",
        'alt="Map of S0"',
        'alt="Map of DoLP"',
        'alt="Map of AoLP"',
        "<h2>Basis of the verdict</h2>",
        "s rule at alpha = 0.001",
        "<h2>Trends</h2>",
        "<h2>Uncertainty budget</h2>",
        "<h2>Effects taken and skipped</h2>",
        "<h2>The run by itself</h2>",
        "<h2>Not tested here</h2>",
        "assumed, not calibrated: noise.gain_dn_per_e = 0.24",
        "<h2>Source of the frames</h2>",
        "Provenance in full",
    ]
    places = [page.index(text) for text in first]
    assert places == sorted(places)
    assert "The frames are simulated" in page
    assert page.count("data:image/png;base64,") == 8


def test_every_measured_number_of_the_summary_has_its_error_and_no_prediction_of_exact_inputs(compared):
    rows = summary_table(compared[1]).texts()
    assert [row[0] for row in rows] == ["left", "", "", "", "right", "", "", ""]
    assert [row[1] for row in rows[:4]] == ["S0 [DN]", "DoLP", "AoLP [deg]", "DoLP SNR"]
    assert all("\N{NO-BREAK SPACE}± " in row[2] for row in rows)
    assert not any("±" in row[3] for row in rows)


def test_a_comparison_is_told_to_programs_whole_and_with_its_provenance(compared):
    out, found = compared
    content = json.loads((out / "comparison.json").read_text())
    assert (content["agrees"], content["alpha"], content["disagreements"]) == (True, 1e-3, [])
    assert set(content["regions"]["left"]["dolp"]["mean"]) >= {
        "predicted", "measured", "std_error", "std_error_inputs", "z", "agrees", "smallest_difference_90",
    }  # fmt: skip
    numbers = [s for q in content["regions"].values() for s in q.values() if isinstance(s, dict)]
    assert len(content["rows"]) == sum(len(statistics) for statistics in numbers)
    assert {region["verdict"] for region in content["regions"].values()} <= {"agrees", "agrees_with_reservations"}
    provenance = content["provenance"]
    assert set(provenance["files"]) == {"scene", "manifest"}
    assert all(re.fullmatch("[0-9a-f]{64}", file["sha256"]) for file in provenance["files"].values())
    assert set(provenance["machine"]) >= {"numpy", "matplotlib", "python", "processor"}
    assert provenance["settings"] == {"alpha": 1e-3, "scale": "absolute"}
    with (out / "comparison.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(found.rows)
    assert float(rows[0]["predicted"]) == found.rows[0].predicted
    predicted, measured = (
        json.loads((out / f"{side}.json").read_text())["regions"] for side in ("prediction", "measurement")
    )
    assert {name: set(quantities) for name, quantities in predicted.items()} == {
        name: set(quantities) for name, quantities in measured.items()
    }
    for file in out.glob("*.json"):
        assert not re.search(r"\bNaN\b|Infinity", file.read_text())


@pytest.mark.slow
def test_the_same_comparison_gives_the_same_files_on_the_same_day(compared, tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1790000000")
    for name in ("a", "b"):
        write_folder(tmp_path / name, comparison_files(compared[1]))
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes()
    assert b"D:20260921" in (tmp_path / "a" / "report.pdf").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("perturbation", "words", "size"),
    [
        ("gain", r"light or counts off by ([−\d.]+) ± ([\d.]+) %", 5.0),
        ("angle-offset", r"polarizer axis off by ([−\d.]+) ± ([\d.]+) deg", -2.0),
    ],
)
def test_a_disagreement_says_the_size_of_its_likeliest_cause_once_and_first(tmp_path, perturbation, words, size):
    take_session(perturbed(small_rig(tmp_path), perturbation), small_session(), tmp_path / "run", files={})
    report = comparison_report(compare_run(tmp_path / "run", scene=tmp_path / "scene.toml"))
    found = re.search(words, report.verdict)
    value, std = (float(text.replace("−", "-")) for text in found.groups())
    assert abs(value - size) < 5.0 * std
    assert html(report).count(found.group()) == 1
    assert "Disagreements" in [section.title for section in report.sections]


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
WITH_ERRORS = ("0.12346\N{NO-BREAK SPACE}± 0.00050", "0.2000\N{NO-BREAK SPACE}± 0.0012")
UNTESTED = Row(region="road", quantity="s0", statistic="mean", predicted=10.0, measured=11.0)


@pytest.mark.parametrize("row", [ROW, UNTESTED])
def test_programs_read_every_field_of_a_row_in_its_order(row):
    # Degrees of freedom are in the score already.
    shown = [field.name for field in fields(Row) if field.name != "freedom"]
    (content,) = row_table([row]).json()
    assert list(content.items()) == [(name, asdict(row)[name]) for name in shown]
    assert row_table([row]).csv().splitlines()[0].split(",") == shown


def test_people_read_numbers_to_the_digits_of_their_error():
    (texts,) = row_table([ROW]).texts(Shown.PAGE)
    assert texts == ("dolp", "mean", *WITH_ERRORS, ">10", "DISAGREES", "0.004")
    (texts,) = row_table([ROW]).texts(Shown.TERMINAL)
    assert texts == ("road", "dolp", "mean", "0.1235", "0.2000", ">10")
    assert mixed_row_table([ROW]).texts()[0][0] == "road: dolp"
    (texts,) = row_table([UNTESTED]).texts(Shown.PAGE)
    assert texts[2:] == ("10", "11", "–", "no test", "–")
    (texts,) = row_table([replace(ROW, std_error_inputs=0.0, z=-0.01)]).texts(Shown.PAGE)
    assert texts[2:5] == ("0.1235", WITH_ERRORS[1], "+0.0")


def test_an_angle_that_may_be_any_is_undefined_to_people_and_a_number_to_programs():
    row = replace(ROW, quantity="aolp_deg", predicted=12.0, measured=54.0, std_error=81.0)
    assert row_table([row]).texts()[0][2:4] == ("12.00000\N{NO-BREAK SPACE}± 0.00050", "undefined")
    assert row_table([row]).json()[0]["measured"] == 54.0


class MadeLight:
    """Light of three known parts."""

    def __init__(self, sun, sky, path):
        reflected = np.add(sun, sky)
        self._parts = {
            "reflected_sun": np.array(sun),
            "reflected_sky": np.array(sky),
            "path": np.array(path),
            "reflected": reflected,
            "total": reflected + path,
        }

    def mean(self, part):
        return self._parts[part]


def test_every_part_of_the_light_of_every_region_has_its_row_and_share():
    lights = {
        "paint": MadeLight([6.0, 3.0, 0.0], [3.0, -1.0, 0.0], [1.0, 0.0, 0.0]),
        "road": MadeLight([20.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    }
    blocks = light_section(lights).blocks
    (table,) = (block for block in blocks if isinstance(block, Table))
    rows = {(row[0], row[1]): row for row in table.texts()}
    assert len(rows) == 10
    assert rows["paint", "reflected sun"][-1] == "60.0%"
    assert rows["paint", "path"][-1] == "10.0%"
    assert rows["road", "total at the aperture"][-1] == "100.0%"
    assert rows["road", "path"][5:7] == ("-", "-")  # no light has no angle
    assert [block.png[:4] for block in blocks if isinstance(block, Picture)] == [b"\x89PNG"]
