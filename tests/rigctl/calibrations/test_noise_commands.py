"""``rigctl calibrate noise`` and ``rigctl calibrate doubling`` from the command line to the files."""

import json
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from rigctl.calibrations.noise import QUANTITIES, read_noise_file
from rigctl.cli import main
from rigctl.console import EXIT_DATA, EXIT_USAGE
from rigctl.errors import ConfigError
from rigctl.runs.writer import RunWriter
from rigctl.session.numbers import noise_numbers
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


def test_json_is_the_file_the_table_names_quantities_and_a_plot_is_a_png(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, out, plot = write_noise_run(tmp_path / "run"), tmp_path / "noise.json", tmp_path / "curve.png"
    given = ["calibrate", "noise", "--run", str(run), "--out", str(out)]
    assert main([*given, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(out.read_text())
    assert main([*given, "--plot", str(plot), "--force"]) == 0
    shown = capsys.readouterr().out
    for text in ("gain", "read noise", "dark current", "black level", "saturation", "PRNU", "DSNU", "DN/e-"):
        assert text in shown
    assert "saturated_levels: " in shown
    assert plot.read_bytes().startswith(b"\x89PNG")


def write_flats(folder: Path, *, overscan: int = 0) -> Path:
    """Return a folder of PNG flats, with so many columns without light at the right."""
    folder.mkdir()
    strip = np.random.default_rng(2)
    for number, (kind, exposure_s, counts) in enumerate(frames()):
        if kind == "flat":
            dark = np.rint(strip.normal(BLACK_LEVEL_DN, 2.5, (counts.shape[0], overscan))).astype(np.uint16)
            cv2.imwrite(str(folder / f"flat_{exposure_s * 1e3:g}ms_{number:03}.png"), np.hstack([counts, dark]))
    return folder


@pytest.mark.parametrize(("columns", "options"), [(0, ["--black-level-dn", "60"]), (8, ["--overscan", "64,0,8,48"])])
def test_flats_without_darks_give_the_gain(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], columns: int, options: list[str]
) -> None:
    flats, out, page = write_flats(tmp_path / "flats", overscan=columns), tmp_path / "noise.json", tmp_path / "n.html"
    given = ["--folder", str(flats), "--bit-depth", "12", "--out", str(out), "--report", str(page), *options]
    assert main(["calibrate", "noise", *given]) == 0
    shown = capsys.readouterr().out
    found, content = read_noise_file(out), json.loads(out.read_text())
    assert abs(found.gain_dn_per_e.value - GAIN_DN_PER_E) < 4.0 * found.gain_dn_per_e.std_error
    assert abs(found.black_level_dn.value - BLACK_LEVEL_DN) < 2.0 * found.black_level_dn.std_error
    assert content["linearity"] is not None
    for name, title in (("read_noise_e", "read noise"), ("dark_current_e_per_s", "dark current by mean")):
        assert content[name] is None
        assert "no dark frames" in content["not_known"][name]
        assert re.search(rf"not determined: .*{title}", shown)
        assert re.search(rf"not determined: .*{title}", page.read_text())
    with pytest.raises(ConfigError, match=r"read_noise_e \(not determined"):
        noise_numbers(found)


def test_flats_of_a_run_that_records_its_black_level_need_no_option(tmp_path: Path) -> None:
    run, out = tmp_path / "run", tmp_path / "noise.json"
    with RunWriter.create(run, {"origin": "simulated"}) as writer:
        for sequence, (kind, exposure_s, counts) in enumerate(frames()):
            record = make_record(sequence, kind=kind, exposure_s=exposure_s, bit_depth=12, saturation_dn=4095.0)
            if kind == "flat":
                writer.write_frame(replace(record, black_level_dn=BLACK_LEVEL_DN), counts)
    assert main(["calibrate", "noise", "--run", str(run), "--out", str(out)]) == 0
    assert read_noise_file(out).black_level_dn.value == BLACK_LEVEL_DN


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "missing_levels"),
        (["--black-level-dn", "60", "--overscan", "60,0,4,48"], "give one of them"),
        (["--black-level-error-dn", "1"], "which is not given"),
        (["--overscan", "1,2"], "write x,y,width,height"),
        (["--overscan", "30,0,4,48"], "strip along a whole side"),
    ],
)
def test_what_cannot_be_the_black_level_of_flats(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], words: str
) -> None:
    given = ["--folder", str(write_flats(tmp_path / "flats")), "--bit-depth", "12", "--out", str(tmp_path / "n.json")]
    assert main(["calibrate", "noise", *given, *options]) in (EXIT_USAGE, EXIT_DATA)
    assert words in " ".join(capsys.readouterr().err.split())


def test_refused_frames_are_exit_4_named_and_no_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, out = write_noise_run(tmp_path / "run", frames(black_level_dn=2.0)), tmp_path / "noise.json"
    assert main(["calibrate", "noise", "--run", str(run), "--out", str(out), "--json"]) == EXIT_DATA
    shown = capsys.readouterr()
    assert not out.exists()
    assert "clipped_black" in shown.err
    content = json.loads(shown.out)
    assert [flag["name"] for flag in content["flags"] if flag["refuses"]] == ["clipped_black"]
    assert all(content[name] is None for name in QUANTITIES)


def test_frames_without_a_second_one_are_left_out(tmp_path: Path) -> None:
    run, out = write_noise_run(tmp_path / "run"), tmp_path / "noise.json"
    with RunWriter.append(run) as writer:
        facts = {"gain_db": 0.0, "camera_model": "synthetic", "camera_serial": "42"}
        record = make_record(writer.next_sequence, kind="dark", exposure_s=1.0, **facts)
        writer.write_frame(record, noisy_counts(shape=(48, 64)))
    assert main(["calibrate", "noise", "--run", str(run), "--out", str(out)]) == 0
    assert "single_frames" in {flag.name for flag in read_noise_file(out).flags}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([], "either --run RUN"),
        (["--run", "run", "--emva", "set.txt"], "either --run RUN"),
        (["--emva", "set.txt"], "begins with 'x'"),
        (["--run", "run", "--black-level-dn", "60"], "there are dark frames"),
        (["--run", "run", "--report", "gone/n.html"], "there is no folder"),
    ],
)
def test_options_that_do_not_fit_are_usage_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], given: list[str], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("set.txt").write_text("x\n")
    write_noise_run(Path("run"))
    assert main(["calibrate", "noise", *given, "--out", "noise.json"]) == EXIT_USAGE
    assert words in " ".join(capsys.readouterr().err.split())
    assert not Path("noise.json").exists()


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


def test_the_interval_that_doubles_the_dark_current(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = calibrations(tmp_path)
    capsys.readouterr()
    assert main(["calibrate", "doubling", *names, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["value_k"] == pytest.approx(8.0, rel=1e-6)
    assert found["n_temperatures"] == 3
    assert main(["calibrate", "doubling", *names]) == 0
    assert "doubles every 8.00" in capsys.readouterr().out
    assert main(["calibrate", "doubling", *names, "--temperature-c", "20"]) == EXIT_USAGE


def test_different_cameras_have_no_doubling(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "doubling", *calibrations(tmp_path, serials=("1", "2", "1"))]) == EXIT_DATA
    assert "different cameras" in capsys.readouterr().err


@pytest.mark.parametrize("make", [lambda folder: folder.parent / "secret.png", lambda _: Path("/etc/hostname")])
def test_a_descriptor_does_not_point_outside_of_its_folder(tmp_path, capsys, make):
    (tmp_path / "set").mkdir()
    cv2.imwrite(str(tmp_path / "secret.png"), np.zeros((4, 4), np.uint16))
    (tmp_path / "set" / "link.png").symlink_to(tmp_path / "secret.png")
    text = f"v 3.0\nn 12 4 4\nb 1000 10\ni {make(tmp_path / 'set')}\ni ../secret.png\ni link.png\nd 1000\ni none.png\n"
    (tmp_path / "set" / "data.txt").write_text(text)
    arguments = ["calibrate", "noise", "--emva", str(tmp_path / "set" / "data.txt"), "--out", str(tmp_path / "n.json")]
    assert main(arguments) == EXIT_USAGE
    assert capsys.readouterr().err.count("lies outside of the descriptor's folder") == 3
