import csv
import json
import re

import numpy as np
import pytest

from rigctl.report.comparison import _LOOKS, write_comparison
from rigctl.rig.roof import perturbed
from rigctl.session.take import take_session
from rigctl.verbs.compare import compare
from tests.rigctl.example_files import small_rig, small_session


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compared")
    take_session(small_rig(folder), small_session(cycles=3), folder / "run", files={})
    found = compare(folder / "run", folder / "scene.toml", out=folder / "out").comparison
    return folder / "out", found


def test_the_report_is_one_file_that_needs_no_other(compared):
    html = (compared[0] / "report.html").read_text()
    assert re.findall(r'(?:src|href)="(?!data:)', html) == []
    assert html.count("data:image/png;base64,") == 6


def test_the_report_says_what_is_simulated_assumed_and_not_tested(compared):
    html = (compared[0] / "report.html").read_text()
    assert "The frames are simulated" in html
    assert "assumed, not calibrated: noise.gain_dn_per_e = 0.24" in html
    assert "What this does not test" in html


@pytest.mark.parametrize(
    "section",
    [
        "In short",
        "Trends",
        "Uncertainty budget",
        "Effects taken and skipped",
        "The run by itself",
        "Where it comes from",
    ],
)
def test_the_report_has_its_sections(compared, section):
    assert f"<h2>{section}</h2>" in (compared[0] / "report.html").read_text()


def test_the_report_names_what_of_it_depends_on_the_machine(compared):
    provenance = json.loads((compared[0] / "comparison.json").read_text())["provenance"]
    assert set(provenance["machine"]) >= {"numpy", "matplotlib", "python", "processor"}
    assert provenance["settings"] == {"alpha": 1e-3, "scale": "absolute"}


def test_trends_stand_after_the_pictures(compared):
    html = (compared[0] / "report.html").read_text()
    assert html.index("<h2>Pictures</h2>") < html.index("<h2>Trends</h2>") < html.index("Provenance in full")


def test_every_row_stands_in_the_csv_once(compared):
    with (compared[0] / "comparison.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(compared[1].rows)
    assert float(rows[0]["predicted"]) == compared[1].rows[0].predicted


def test_every_cause_of_the_budget_has_a_look_of_its_own():
    assert len(set(_LOOKS.values())) >= len(_LOOKS) - 1


def test_the_report_prints_the_rule_of_its_decision(compared):
    html = (compared[0] / "report.html").read_text()
    assert "Holm" in html
    assert "alpha = 0.001" in html


def test_json_has_the_documented_shape(compared):
    content = json.loads((compared[0] / "comparison.json").read_text())
    assert content["agrees"] is True
    assert content["alpha"] == 1e-3
    assert content["disagreements"] == []
    row = content["regions"]["left"]["dolp"]["mean"]
    assert set(row) >= {"predicted", "measured", "std_error", "std_error_inputs", "z", "agrees"}
    numbers = [s for q in content["regions"].values() for s in q.values() if isinstance(s, dict)]
    assert len(content["rows"]) == sum(len(statistics) for statistics in numbers)
    assert {region["verdict"] for region in content["regions"].values()} <= {"agrees", "agrees_with_reservations"}
    assert row.keys() >= {"smallest_difference_90"}


def test_prediction_and_measurement_have_the_same_names(compared):
    predicted = json.loads((compared[0] / "prediction.json").read_text())["regions"]
    measured = json.loads((compared[0] / "measurement.json").read_text())["regions"]
    assert {name: set(quantities) for name, quantities in predicted.items()} == {
        name: set(quantities) for name, quantities in measured.items()
    }


def test_the_run_and_every_file_stand_in_the_provenance_with_their_hashes(compared):
    provenance = json.loads((compared[0] / "comparison.json").read_text())["provenance"]
    assert set(provenance["files"]) == {"scene", "manifest"}
    assert all(re.fullmatch("[0-9a-f]{64}", file["sha256"]) for file in provenance["files"].values())


def test_the_same_comparison_gives_the_same_report(compared, tmp_path):
    write_comparison(compared[1], tmp_path)
    for name in ("report.html", "report.pdf", "comparison.json", "comparison.csv"):
        assert (tmp_path / name).read_bytes() == (compared[0] / name).read_bytes()


def test_a_disagreement_heads_the_report_with_where_it_points(tmp_path):
    rig = perturbed(small_rig(tmp_path), "gain")
    take_session(rig, small_session(), tmp_path / "run", files={})
    compare(tmp_path / "run", tmp_path / "scene.toml", out=tmp_path / "out")
    html = (tmp_path / "out" / "report.html").read_text()
    head = html[: html.index("Pictures")]
    assert "Model and measurement disagree" in head
    assert "<strong>Points to scale:</strong>" in head
    assert "DISAGREES" in head


def test_no_number_in_the_json_is_nan(compared):
    for file in compared[0].glob("*.json"):
        assert not re.search(r"\bNaN\b|Infinity", file.read_text())


def test_histogram_law_has_the_area_of_its_pixels(compared):
    """What is drawn over the histogram is the density of the same numbers: mean of DoLP by it equals the prediction."""
    from model.processing import dolp

    prediction = compared[1].predictions["left"]
    law = prediction.quantities["dolp_pixels"]
    x = np.linspace(law["mean"] - 8 * law["std"], law["mean"] + 8 * law["std"], 2001)
    density = dolp.pdf(x, prediction.stokes_dn.mean, prediction.stokes_dn.cov)
    # Trapezoid over 8 deviations either side with a step of s / 125: below 1e-9 for a smooth density.
    assert np.trapezoid(density, x) == pytest.approx(1.0, abs=1e-6)
    assert np.trapezoid(x * density, x) == pytest.approx(law["mean"], rel=1e-6)
