"""Estimators of the true DoLP, from the command line."""

import json

from rigctl import cli


def test_estimators_are_shown_with_bias_and_rms_error(tmp_path, capsys):
    assert cli.main(["paper", "--estimators", "--json", "--out", str(tmp_path / "out")]) == 0
    content = json.loads(capsys.readouterr().out)
    # Unpolarised light: the naive estimate is biased by sqrt(pi / 2), its rms error is sqrt 2 (Rice with no signal).
    assert abs(content["naive"]["bias"][0] - 1.2533141373155) < 1e-9
    assert abs(content["naive"]["rms"][0] - 1.4142135623731) < 1e-9
    assert (tmp_path / "out" / "estimators.png").exists()


def test_the_table_begins_with_the_best_estimator(capsys):
    assert cli.main(["paper", "--estimators"]) == 0
    assert capsys.readouterr().out.startswith("at a true SNR of 2 ")
