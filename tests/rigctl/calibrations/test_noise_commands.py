"""``rigctl calibrate noise`` and ``rigctl calibrate doubling`` from the command line to the files."""

import json
from pathlib import Path

import pytest

from rigctl.calibrations.noise import QUANTITIES, read_noise_file
from rigctl.cli import main
from rigctl.console.failures import EXIT_DATA, EXIT_USAGE
from rigctl.runs.writer import RunWriter
from tests.rigctl.noise_sessions import (
    BLACK_LEVEL_DN,
    GAIN_DN_PER_E,
    READ_NOISE_E,
    frames,
    write_emva_set,
    write_noise_run,
)
from tests.rigctl.run_samples import make_record, noisy_counts


def test_a_run_gives_the_sensor_that_made_it(tmp_path: Path) -> None:
    run, out = write_noise_run(tmp_path / "run"), tmp_path / "noise.json"
    assert main(["calibrate", "noise", "--run", str(run), "--out", str(out)]) == 0
    found = read_noise_file(out).known
    truth = {"gain_dn_per_e": GAIN_DN_PER_E, "read_noise_e": READ_NOISE_E, "black_level_dn": BLACK_LEVEL_DN}
    for name, value in truth.items():
        assert abs(found[name].value - value) < 5.0 * found[name].std_error


def test_a_run_and_an_emva_set_of_the_same_frames_give_the_same(tmp_path: Path) -> None:
    run, descriptor = write_noise_run(tmp_path / "run"), write_emva_set(tmp_path)
    main(["calibrate", "noise", "--run", str(run), "--out", str(tmp_path / "run.json")])
    main(["calibrate", "noise", "--emva", str(descriptor), "--out", str(tmp_path / "emva.json")])
    by_run, by_emva = read_noise_file(tmp_path / "run.json"), read_noise_file(tmp_path / "emva.json")
    for name in QUANTITIES:
        # The exposure is a product with 1e-9 in one of them; sums are taken in the same order.
        assert by_emva.known[name].value == pytest.approx(by_run.known[name].value, rel=1e-9)


def test_json_on_standard_output_is_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, out = write_noise_run(tmp_path / "run"), tmp_path / "noise.json"
    assert main(["calibrate", "noise", "--run", str(run), "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(out.read_text())


def test_the_table_names_quantities_and_flags(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = write_noise_run(tmp_path / "run")
    main(["calibrate", "noise", "--run", str(run), "--out", str(tmp_path / "noise.json")])
    shown = capsys.readouterr().out
    for text in ("gain", "read noise", "dark current", "black level", "saturation", "PRNU", "DSNU", "DN/e-"):
        assert text in shown
    assert "saturated_levels: " in shown


def test_a_plot_is_a_png_file(tmp_path: Path) -> None:
    run, plot = write_noise_run(tmp_path / "run"), tmp_path / "curve.png"
    main(["calibrate", "noise", "--run", str(run), "--out", str(tmp_path / "noise.json"), "--plot", str(plot)])
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_refused_frames_are_exit_4_and_no_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, out = write_noise_run(tmp_path / "run", frames(black_level_dn=2.0)), tmp_path / "noise.json"
    assert main(["calibrate", "noise", "--run", str(run), "--out", str(out)]) == EXIT_DATA
    assert not out.exists()
    assert "clipped_black" in capsys.readouterr().err


def test_refused_frames_are_named_in_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = write_noise_run(tmp_path / "run", frames(black_level_dn=2.0))
    assert main(["calibrate", "noise", "--run", str(run), "--out", str(tmp_path / "n.json"), "--json"]) == EXIT_DATA
    shown = json.loads(capsys.readouterr().out)
    assert [flag["name"] for flag in shown["flags"] if flag["refuses"]] == ["clipped_black"]
    assert all(shown[name] is None for name in QUANTITIES)


def test_frames_without_a_second_one_are_left_out(tmp_path: Path) -> None:
    run, out = write_noise_run(tmp_path / "run"), tmp_path / "noise.json"
    with RunWriter.append(run) as writer:
        facts = {"gain_db": 0.0, "camera_model": "synthetic", "camera_serial": "42"}
        record = make_record(writer.next_sequence, kind="dark", exposure_s=1.0, **facts)
        writer.write_frame(record, noisy_counts(shape=(48, 64)))
    assert main(["calibrate", "noise", "--run", str(run), "--out", str(out)]) == 0
    assert "single_frames" in {flag.name for flag in read_noise_file(out).flags}


@pytest.mark.parametrize("sources", [[], ["--run", "run", "--emva", "set.txt"]])
def test_exactly_one_source_is_wanted(tmp_path: Path, sources: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "noise", *sources, "--out", str(tmp_path / "noise.json")]) == EXIT_USAGE
    assert "either --run RUN" in capsys.readouterr().err


def test_a_folder_that_is_not_there_is_said_before_the_work(tmp_path: Path) -> None:
    run = write_noise_run(tmp_path / "run")
    assert main(["calibrate", "noise", "--run", str(run), "--out", str(tmp_path / "gone" / "n.json")]) == EXIT_USAGE


def test_a_bad_descriptor_is_a_usage_error(tmp_path: Path) -> None:
    descriptor = tmp_path / "set.txt"
    descriptor.write_text("x\n")
    arguments = ["calibrate", "noise", "--emva", str(descriptor), "--out", str(tmp_path / "noise.json")]
    assert main(arguments) == EXIT_USAGE
    assert not (tmp_path / "noise.json").exists()


def calibrations(folder: Path, *, serials: tuple[str, ...] = ("1", "1", "1")) -> list[str]:
    """Files of a dark current that doubles every 8 K."""
    assert (
        main(["calibrate", "noise", "--run", str(write_noise_run(folder / "run")), "--out", str(folder / "n.json")])
        == 0
    )
    content = json.loads((folder / "n.json").read_text())
    names = []
    for place, serial in enumerate(serials):
        current = {"value": 100.0 * 2.0**place, "std_error": 1.0, "n": 10}
        made_for = content["made_for"] | {"temperature_c": 20.0 + 8.0 * place, "camera_serial": serial}
        changed = content | {"dark_current_e_per_s": current, "made_for": made_for}
        names.append(str(folder / f"noise_{place}.json"))
        Path(names[-1]).write_text(json.dumps(changed))
    return names


def test_finds_the_interval(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = calibrations(tmp_path)
    capsys.readouterr()
    assert main(["calibrate", "doubling", *names, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["value_k"] == pytest.approx(8.0, rel=1e-6)
    assert found["n_temperatures"] == 3


def test_says_it_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "doubling", *calibrations(tmp_path)]) == 0
    assert "doubles every 8.00" in capsys.readouterr().out


def test_different_cameras_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "doubling", *calibrations(tmp_path, serials=("1", "2", "1"))]) == EXIT_DATA
    assert "different cameras" in capsys.readouterr().err


def test_temperatures_have_to_match_the_files(tmp_path: Path) -> None:
    assert main(["calibrate", "doubling", *calibrations(tmp_path), "--temperature-c", "20"]) == EXIT_USAGE
