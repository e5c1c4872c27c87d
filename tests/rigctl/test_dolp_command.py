import json

from rigctl import cli


def test_fig5_sets_first_order_exact_law_and_draws_side_by_side(tmp_path, capsys):
    assert cli.main(["dolp", "fig5", "--draws", "2000", "--json", "--out", str(tmp_path / "out")]) == 0
    content = json.loads(capsys.readouterr().out)
    assert len(content["snr"]) == len(content["mean"]) == 21
    assert content["mean"][0] is None
    # At 40 dB 5000 electrons: 2000 draws know the mean to some 3e-4.
    assert abs(content["mean"][-1] - content["drawn_mean"][-1]) < 5 * content["drawn_mean_error"][-1]
    assert (tmp_path / "out" / "fig5.png").read_bytes().startswith(b"\x89PNG")


def test_estimators_are_shown_with_bias_and_rms_error(tmp_path, capsys):
    assert cli.main(["dolp", "estimators", "--json", "--out", str(tmp_path / "out")]) == 0
    content = json.loads(capsys.readouterr().out)
    # Unpolarised light: the naive estimate is biased by sqrt(pi / 2), its rms error is sqrt 2 (Rice with no signal).
    assert abs(content["naive"]["bias"][0] - 1.2533141373155) < 1e-9
    assert abs(content["naive"]["rms"][0] - 1.4142135623731) < 1e-9
    assert (tmp_path / "out" / "estimators.png").exists()


def test_tables_are_printed_without_json(capsys):
    assert cli.main(["dolp", "fig5", "--draws", "100"]) == 0
    assert "SNR [dB]" in capsys.readouterr().out
    assert cli.main(["dolp", "estimators"]) == 0
    assert "true SNR" in capsys.readouterr().out
