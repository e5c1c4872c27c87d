"""Several runs of one rig compared with one scene."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import benchmarks.trials.uncertain_panels as panels
from rigctl.cli import main
from rigctl.comparison.series import ComparedSeries, require_one_instrument
from rigctl.console import EXIT_DATA
from rigctl.errors import ConfigError, DataError
from rigctl.report.pdf import pdf
from rigctl.report.series import series_json, series_report
from rigctl.runs.folder import read_run
from rigctl.runs.records import PolarizerAsTaken, RigAsTaken
from rigctl.verbs.compare import SeriesResult, compare


def afternoon(folder: Path, *, runs: int = 3, **strange: object) -> list[Path]:
    """Return runs an hour apart under a sinking sun; the last differs from the others by what is given."""
    (folder / "scene.toml").write_text(panels.scene_text())
    truth = panels.drawn_truth(np.random.default_rng(2))
    paths = [folder / f"run-{k}" for k in range(runs)]
    for k, path in enumerate(paths):

        def facts(sequence: int, k: int = k) -> dict[str, object]:
            return {
                "start_utc": f"2026-06-21T{12 + k:02d}:00:{sequence:02d}.000000Z",
                "sun_azimuth_deg": 180.0 + 15.0 * k,
                "sun_elevation_deg": 60.0 - 8.0 * k,
                "camera_serial": "7",
            } | (strange if k == runs - 1 else {})

        # The polarization of the black panel grows by 3 % an hour, which the scene file does not say.
        changed = truth | {"regions.black.stokes_radiance.1": truth["regions.black.stokes_radiance.1"] * (1 + 0.03 * k)}
        panels.take_run(path, changed, np.random.default_rng([9, k]), facts=facts)
    return paths


@pytest.fixture(scope="module")
def series(tmp_path_factory: pytest.TempPathFactory) -> ComparedSeries:
    folder = tmp_path_factory.mktemp("afternoon")
    paths = afternoon(folder)
    found = compare(*paths, scene=folder / "scene.toml", alpha=1e-3)
    assert isinstance(found, SeriesResult)
    return found.series


def test_every_run_has_its_sun_and_time(series: ComparedSeries) -> None:
    content = series_json(series)
    assert [run["sun_zenith_deg"] for run in content["runs"]] == [30.0, 38.0, 46.0]
    assert content["runs"][1]["first_frame_utc"].startswith("2026-06-21T13:00")


def test_a_residual_that_grows_is_found_as_drift(series: ComparedSeries) -> None:
    drifts = {(d.region, d.quantity): d for d in series.drifts}
    assert drifts["black", "s1n"].z > 5.0
    assert abs(drifts["white", "dolp"].z) < 5.0


def test_alpha_is_shared_by_the_runs(series: ComparedSeries) -> None:
    assert series.comparisons[0].alpha == pytest.approx(1e-3 / 3)


@pytest.mark.slow
def test_the_report_of_many_runs_says_what_drifts_and_is_the_same_twice(
    series: ComparedSeries, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1274807220")  # the PDF says when it was made
    report = series_report(series)
    assert any(word == "Drifts:" and "s1n of black" in text for word, text in report.reasons)
    assert pdf(report) == pdf(report)


@pytest.mark.parametrize(
    ("strange", "named"),
    [({"camera_serial": "8"}, "camera"), ({"gain_db": 6.0}, "gain"), ({"stage_serial": "1"}, "stage")],
)
def test_a_run_that_does_not_belong_is_refused(tmp_path: Path, strange: dict[str, object], named: str) -> None:
    paths = afternoon(tmp_path, runs=2, **strange)
    with pytest.raises(DataError, match=f"run-1: {named}"):
        require_one_instrument([read_run(path) for path in paths])


def test_a_run_of_another_axis_is_refused(series: ComparedSeries) -> None:
    run = series.comparisons[0].measurement.run
    polarizer = PolarizerAsTaken(extinction_ratio=500.0, offset_deg=3.0)
    other = replace(run, path=Path("other"), session=replace(run.session, rig=RigAsTaken(polarizer=polarizer)))
    with pytest.raises(DataError, match="polarizer offset"):
        require_one_instrument([run, other])


@pytest.mark.slow
def test_the_command_takes_several_runs_and_refuses_a_stranger(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = [str(path) for path in afternoon(tmp_path, runs=2)]
    words = ["--scene", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out")]
    assert main(["compare", *paths, *words]) == 0
    assert (tmp_path / "out" / "run-1" / "report.pdf").read_bytes().startswith(b"%PDF")
    with (tmp_path / "out" / "series.csv").open(newline="") as file:
        assert {row["run"] for row in csv.DictReader(file)} == {"run-0", "run-1"}
    assert len(json.loads((tmp_path / "out" / "series.json").read_text())["runs"]) == 2
    (tmp_path / "strange").mkdir()
    stranger = afternoon(tmp_path / "strange", runs=1, camera_serial="8")
    stranger[0].rename(tmp_path / "strange" / "other")
    assert main(["compare", *paths, str(tmp_path / "strange" / "other"), *words, "--force"]) == EXIT_DATA
    assert "do not belong" in capsys.readouterr().err


def test_runs_of_one_name_are_refused(series: ComparedSeries) -> None:
    path = series.comparisons[0].measurement.run.path
    with pytest.raises(ConfigError, match="different names"):
        compare(path, path, path.parent / "scene.toml")
