"""``rigctl calibrate noise`` and ``rigctl calibrate doubling`` from the command line to the files."""

import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from astropy.io import fits
from numpy.typing import NDArray

from calibration.results import Flag, RefusedFramesError
from calibration.sensor.emva1288 import EMVA_SYMBOLS
from calibration.sensor.levels import level_statistics
from calibration.sensor.noise import NoiseCalibration, calibrate_noise
from rigctl.calibrations.kinds import MadeFor
from rigctl.calibrations.noise import QUANTITIES, read_noise_file
from rigctl.calibrations.noise_calibration import calibrate_frames, noise_content
from rigctl.calibrations.noise_frames import (
    FrameSet,
    FrameSource,
    Loader,
    emva_frames,
    folder_frames,
    read_emva_descriptor,
    record_flags,
    run_frames,
    table_frames,
)
from rigctl.calibrations.record import write_content
from rigctl.cli import main
from rigctl.console import EXIT_DATA, EXIT_USAGE
from rigctl.errors import ConfigError, DataError
from rigctl.runs.writer import RunWriter
from rigctl.session.numbers import noise_numbers
from tests.rigctl.noise_sessions import (
    BLACK_LEVEL_DN,
    GAIN_DN_PER_E,
    SHAPE,
    SIGNALS_E,
    frames,
    write_emva_set,
    write_noise_run,
)
from tests.rigctl.run_samples import make_record, noisy_counts, write_run


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
    """Return a folder of FITS flats, with so many columns without light at the right, which the header names."""
    folder.mkdir()
    strip = np.random.default_rng(2)
    for number, (kind, exposure_s, counts) in enumerate(frames()):
        if kind == "flat":
            dark = np.rint(strip.normal(BLACK_LEVEL_DN, 2.5, (counts.shape[0], overscan))).astype(np.uint16)
            unit = fits.PrimaryHDU(np.hstack([counts, dark]))
            if overscan:
                unit.header["BIASSEC"], unit.header["DATASEC"] = f"[65:{64 + overscan},1:48]", "[1:64,1:48]"
            unit.writeto(folder / f"flat_{exposure_s * 1e3:g}ms_{number:03}.fits")
    return folder


@pytest.mark.parametrize(
    ("columns", "options"), [(0, ["--black-level-dn", "60"]), (8, ["--overscan", "64,0,8,48"]), (8, [])]
)
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


FRAMES = FrameSet(
    groups=(),
    bit_depth=12,
    made_for=MadeFor(camera_model="synthetic", camera_serial="42", gain_db=0.0, bit_depth=12),
    source=FrameSource(kind="run", path="runs/noise", sha256="0" * 64, frames_sha256="1" * 64),
)


@cache
def calibration() -> NoiseCalibration:
    groups: dict[tuple[Any, float], list[Any]] = {}
    for kind, exposure_s, counts in frames():
        groups.setdefault((kind, exposure_s), []).append(counts)
    levels = [level_statistics(group, kind=kind, exposure_s=time_s) for (kind, time_s), group in groups.items()]
    return calibrate_noise(levels, bit_depth=12)


def content() -> dict[str, Any]:
    return noise_content(calibration(), FRAMES, created_ns=1_700_000_000_000_000_000)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "noise.json"
    write_content(path, content())
    found = read_noise_file(path)
    for name in QUANTITIES:
        assert asdict(found.known[name]) == content()[name]
    assert [asdict(flag) for flag in found.flags] == content()["flags"]
    assert found.made_for == FRAMES.made_for
    assert set(content()["emva1288"]) == set(EMVA_SYMBOLS)
    assert (content()["source"]["sha256"], content()["created_utc"]) == ("0" * 64, "2023-11-14T22:13:20.000000000Z")


def test_the_covariance_is_kept_to_the_last_digit(tmp_path: Path) -> None:
    path = tmp_path / "noise.json"
    write_content(path, content())
    found, joint = read_noise_file(path), calibration().covariance
    np.testing.assert_array_equal(found.covariance_of(joint.names), joint.matrix)
    backwards = tuple(reversed(joint.names))
    np.testing.assert_array_equal(found.covariance_of(backwards), joint.matrix[::-1, ::-1])


def test_errors_that_do_not_go_together_stand_on_the_diagonal(tmp_path: Path) -> None:
    path = tmp_path / "noise.json"
    path.write_bytes(spoilt(lambda c: c.update(covariance=None, prnu=None)))
    found = read_noise_file(path)
    error = found.gain_dn_per_e.std_error
    np.testing.assert_array_equal(found.covariance_of(("prnu", "gain_dn_per_e")), np.diag([0.0, error**2]))


def test_the_sensor_has_nothing_below_zero(tmp_path: Path) -> None:
    path = tmp_path / "noise.json"
    path.write_bytes(spoilt(lambda c: c["dark_current_e_per_s"].update(value=-3.0)))
    found = read_noise_file(path)
    assert found.below_zero == {"dark_current_e_per_s": -3.0}
    assert found.sensor_noise().dark_current_e_per_s == 0.0
    assert found.sensor_noise().read_noise_e == content()["read_noise_e"]["value"]


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be written"):
        write_content(tmp_path / "gone" / "noise.json", content())


def spoilt(change: Callable[[dict[str, Any]], object]) -> bytes:
    made = content()
    change(made)
    return json.dumps(made).encode()


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (b"{", "no JSON file"),
        (spoilt(lambda c: c.pop("gain_dn_per_e")), "gain_dn_per_e: is missing"),
        (spoilt(lambda c: c.update(gain_dn_per_e=None)), "gain_dn_per_e"),
        (spoilt(lambda c: c["gain_dn_per_e"].update(value=0.0)), "gain_dn_per_e.value"),
        (spoilt(lambda c: c["read_noise_e"].update(std_error=-1.0)), "read_noise_e.std_error"),
        (spoilt(lambda c: c.update(schema_version=3)), "schema_version"),
        (spoilt(lambda c: c["made_for"].update(bit_depth="many")), "made_for.bit_depth"),
        (spoilt(lambda c: c["covariance"]["names"].append("prnu")), "7 rows and columns"),
        (spoilt(lambda c: c["covariance"]["names"].__setitem__(0, "gain")), "names"),
        (spoilt(lambda c: c["covariance"]["matrix"][0].__setitem__(1, 1.0)), "not symmetric"),
        (spoilt(lambda c: c["covariance"]["matrix"][0].__setitem__(0, -1.0)), "negative eigenvalue"),
        (spoilt(lambda c: c["covariance"]["names"].__setitem__(1, c["covariance"]["names"][0])), "are not distinct"),
        (spoilt(lambda c: c["covariance"]["matrix"][0].__setitem__(0, 1e300)), "covariance.matrix.0.0"),
        (spoilt(lambda c: c["prnu"].update(value=1e40)), "prnu.value"),
        (spoilt(lambda c: c["read_noise_e"].update(value=1e300)), "read_noise_e.value"),
        (spoilt(lambda c: c["black_level_dn"].update(std_error=1e300)), "black_level_dn.std_error"),
        (spoilt(lambda c: c["made_for"].update(taken_utc="x")), "made_for.taken_utc: is 'x', must be a time"),
        (spoilt(lambda c: c["made_for"].update(binning=0)), "made_for.binning"),
        (spoilt(lambda c: c["made_for"].update(valid_days=-1)), "made_for.valid_days"),
        (spoilt(lambda c: c.update(created_utc="x")), "created_utc"),
        (spoilt(lambda c: c["performance"].update(dark_current_variance_e_per_s=1.0)), "performance.dark_current"),
    ],
)
def test_a_wrong_file_is_refused_with_its_problem(tmp_path: Path, data: bytes, problem: str) -> None:
    path = tmp_path / "noise.json"
    path.write_bytes(data)
    with pytest.raises(DataError, match="(?s)" + problem):
        read_noise_file(path)


def test_a_file_may_be_without_quantities_but_has_to_be_there(tmp_path: Path) -> None:
    path = tmp_path / "noise.json"
    with pytest.raises(DataError, match="cannot be read"):
        read_noise_file(path)
    path.write_bytes(spoilt(lambda c: c.update(saturation_e=None, dsnu_e=None, covariance=None)))
    assert read_noise_file(path).dsnu_e is None


def test_it_is_too_old_after_a_year(tmp_path: Path) -> None:
    write_content(tmp_path / "noise.json", content())
    noise = read_noise_file(tmp_path / "noise.json")
    young, old = (MadeFor(taken_utc=f"{day}T00:00:00.000000000Z") for day in ("2024-11-13", "2024-11-15"))
    assert noise.doubts(young) == ()
    assert "valid for 365" in noise.doubts(old)[0]


def test_reading_a_calibration_does_not_import_an_optimizer():
    program = "import sys, rigctl.calibrations.noise; print('scipy.optimize' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_a_run_is_grouped_by_kind_and_exposure_in_the_order_of_its_frames(tmp_path: Path) -> None:
    found = run_frames(write_noise_run(tmp_path / "run"))
    sizes = {(group.kind, group.exposure_s): len(group.loaders) for group in found.groups}
    assert sizes == {
        (kind, light_e / 1e6): 8 if light_e == 6000.0 else 2 for kind in ("dark", "flat") for light_e in SIGNALS_E
    }
    expected = [counts for kind, exposure_s, counts in frames() if (kind, exposure_s) == ("dark", 0.0006)]
    for load, counts in zip(found.groups[0].loaders, expected, strict=True):
        np.testing.assert_array_equal(load(), counts)
    assert (found.made_for.camera_serial, found.made_for.gain_db, found.bit_depth) == ("42", 0.0, 12)


def test_exposures_that_differ_in_the_last_digits_are_one(tmp_path: Path) -> None:
    with RunWriter.create(tmp_path / "run", {"origin": "simulated"}) as writer:
        for i in range(3):
            writer.write_frame(make_record(i, kind="dark", exposure_s=0.01 * (1.0 + 1e-9 * i)), noisy_counts(i))
    assert [len(group.loaders) for group in run_frames(tmp_path / "run").groups] == [3]


def test_flats_at_another_polarizer_angle_are_another_level(tmp_path: Path) -> None:
    with RunWriter.create(tmp_path / "run", {"origin": "simulated"}) as writer:
        for i in range(4):
            record = make_record(i, kind="flat", exposure_s=0.01, polarizer_angle_target_deg=45.0 * (i % 2))
            writer.write_frame(record, noisy_counts(i))
    assert [len(group.loaders) for group in run_frames(tmp_path / "run").groups] == [2, 2]


def test_a_run_of_scene_frames_only_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no dark and no flat frames"):
        run_frames(write_run(tmp_path / "run"))


def test_frames_of_mixed_gain_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"gain_db: 0\.0, 6\.0"):
        run_frames(write_noise_run(tmp_path / "run", gain_db=(0.0, 6.0)))


def counted(found: FrameSet) -> tuple[FrameSet, list[int]]:
    """Return the frames with loaders that note when they are asked."""
    loads: list[int] = []

    def load(loader: Loader, number: int) -> NDArray[np.uint16]:
        loads.append(number)
        return loader()

    groups, number = [], 0
    for group in found.groups:
        loaders = tuple(partial(load, loader, number + place) for place, loader in enumerate(group.loaders))
        number += len(loaders)
        groups.append(replace(group, loaders=loaders))
    return replace(found, groups=tuple(groups)), loads


def test_each_frame_is_read_once_and_the_first_again_for_its_size(tmp_path: Path) -> None:
    found, loads = counted(run_frames(write_noise_run(tmp_path / "run")))
    calibrate_frames(found)
    assert sorted(loads) == [0, *range(sum(len(group.loaders) for group in found.groups))]


def test_without_a_longest_stack_two_levels_are_read_again(tmp_path: Path) -> None:
    found, loads = counted(run_frames(write_noise_run(tmp_path / "run")))
    pairs = replace(found, groups=tuple(replace(group, loaders=group.loaders[:2]) for group in found.groups))
    assert calibrate_frames(pairs).pattern is not None
    assert len(loads) == 1 + 2 * len(pairs.groups) + 4


@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        (lambda folder: None, r"frame_0\.png: has \(48, 64\) .* says \(480, 640\)"),
        (lambda folder: (folder / "frame_0.png").write_text("no picture"), r"frame_0\.png: is not a FITS, PNG"),
    ],
)
def test_a_file_that_is_not_the_stated_image_is_refused(
    tmp_path: Path, spoil: Callable[[Path], object], problem: str
) -> None:
    descriptor = write_emva_set(tmp_path)
    descriptor.write_text(descriptor.read_text().replace(f"n 12 {SHAPE[1]} {SHAPE[0]}", "n 12 640 480"))
    spoil(tmp_path)
    with pytest.raises(DataError, match=problem):
        emva_frames(descriptor).groups[0].loaders[0]()


def test_another_pixel_is_another_hash_of_the_frames(tmp_path: Path) -> None:
    descriptor = write_emva_set(tmp_path)
    before = emva_frames(descriptor).source
    (tmp_path / "frame_0.png").write_bytes((tmp_path / "frame_1.png").read_bytes())
    after = emva_frames(descriptor).source
    assert before.sha256 == after.sha256
    assert before.frames_sha256 != after.frames_sha256


@pytest.mark.parametrize(
    ("exposure_s", "spacing_s", "spread_c", "names"),
    [
        (0.1, 0.12, 0.0, []),
        # 10 ms that were read as 10 s.
        (10.0, 0.05, 0.0, ["wrong_time_unit"]),
        (0.1, 0.12, 1.0, []),
        (0.1, 0.12, 6.0, ["temperature_drift"]),
    ],
)
def test_flags_of_how_frames_were_taken(exposure_s: float, spacing_s: float, spread_c: float, names: list[str]) -> None:
    records = [
        make_record(
            number,
            kind="dark",
            exposure_s=exposure_s,
            start_monotonic_ns=round(1e9 * spacing_s * number),
            camera_temperature_c=30.0 + 0.5 * spread_c * number,
        )
        for number in range(3)
    ]
    flags = record_flags(records)
    assert [flag.name for flag in flags] == names
    assert [flag.refuses for flag in flags] == [name == "wrong_time_unit" for name in names]


GOOD = r"""# a comment
v 3.0
n 12 640 480

b 40000.0 120.0
i images\b_1.png
i images/b_2.png
d 40000.0
i d_1.png
i d 2.png
"""


def write_descriptor(folder: Path, text: str) -> Path:
    (folder / "images").mkdir()
    for name in ("images/b_1.png", "images/b_2.png", "d_1.png", "d 2.png"):
        (folder / name).touch()
    path = folder / "EMVA1288_Data.txt"
    path.write_text(text, encoding="utf-8")
    return path


def problems(folder: Path, text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        read_emva_descriptor(write_descriptor(folder, text))
    return str(caught.value)


def test_a_descriptor_lists_its_images_by_level(tmp_path: Path) -> None:
    bits, shape, images = read_emva_descriptor(write_descriptor(tmp_path, GOOD))
    assert (bits, shape) == (12, (480, 640))
    # Backslashes, slashes and blanks in the names of files; exposures in nanoseconds.
    names = [one.path.relative_to(tmp_path).as_posix() for one in images]
    assert names == ["images/b_1.png", "images/b_2.png", "d_1.png", "d 2.png"]
    assert [(one.kind, one.photons, one.level) for one in images[1:3]] == [("flat", 120.0, "5"), ("dark", None, "8")]
    assert {one.exposure_s for one in images} == {40e-6}


def test_lines_may_end_as_in_windows(tmp_path: Path) -> None:
    assert len(read_emva_descriptor(write_descriptor(tmp_path, GOOD.replace("\n", "\r\n")))[2]) == 4


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("v 3.0", "w 3.0", "line 2: 'w 3.0' begins with 'w'; allowed are v, n, b, d, i and #"),
        ("n 12 640 480\n", "", "a line `n BITS WIDTH HEIGHT` is missing"),
        ("n 12 640 480", "n 12 640", "line 3: '12 640' must be 3 numbers"),
        ("n 12 640 480", "n 17 640 480", "line 3: n 17 640 480 must be three whole numbers: 1 to 16 bits"),
        ("n 12 640 480", "n 12 640 480.5", "must be three whole numbers"),
        ("n 12 640 480", "n 12 640 480\nn 12 640 480", "line 4: n occurs a second time"),
        ("b 40000.0 120.0", "b 40000.0", "line 5: '40000.0' must be 2 numbers"),
        ("d 40000.0", "d -1", "line 8: '-1' must be 1 numbers, none below 0"),
        ("d 40000.0", "d inf", "line 8: 'inf' must be 1 numbers"),
        ("d 40000.0", "d 4 ms", "line 8: '4 ms' must be 1 numbers"),
        ("i d 2.png", "i d_3.png", "line 10: image 'd_3.png': there is no such file"),
        ("i d 2.png", r"i images\b_1.png", "is listed a second time (first in line 6)"),
        ("d 40000.0", "d 40000.0\nd 50000.0", "line 8: no image follows"),
        ("b 40000.0 120.0\n", "", "line 5: image 'images\\\\b_1.png' stands before any b or d line"),
        ("d 40000.0\n", "", "there is no dark group"),
    ],
)
def test_a_problem_is_named_with_its_line(tmp_path: Path, old: str, new: str, problem: str) -> None:
    assert problem in problems(tmp_path, GOOD.replace(old, new))


def test_all_problems_are_named_at_once(tmp_path: Path) -> None:
    text = problems(tmp_path, "n 12 640\nx\nb 1\ni gone.png\n")
    assert "5 problems" in text
    for line in ("line 1:", "line 2:", "line 3:", "line 4:", "dark group"):
        assert line in text


def test_a_descriptor_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        read_emva_descriptor(tmp_path / "gone.txt")


def write_png(path: Path, counts: object = None) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((4, 5), 7, np.uint16) if counts is None else np.asarray(counts))


def session_in_folder(folder: Path) -> Path:
    for number, (kind, exposure_s, counts) in enumerate(frames()):
        write_png(folder / f"{kind}_{exposure_s * 1e6:g}us_{number:03}.png", counts)
    return folder


def session_in_table(folder: Path) -> Path:
    session_in_folder(folder)
    rows = [
        f"{path.name},{path.stem.split('_')[0]},{float(path.stem.split('_')[1].removesuffix('us')) / 1e3}"
        for path in sorted(folder.glob("*.png"))
    ]
    (folder / "table.csv").write_text("\n".join(["file,kind,exposure_ms", *rows]) + "\n")
    return folder / "table.csv"


@pytest.mark.parametrize(("option", "write"), [("--folder", session_in_folder), ("--table", session_in_table)])
def test_gives_what_a_run_of_the_same_frames_gives(tmp_path: Path, option: str, write: Callable[[Path], Path]) -> None:
    run, source = write_noise_run(tmp_path / "run"), write(tmp_path / "images")
    arguments = [option, str(source), "--bit-depth", "12", "--out", str(tmp_path / "images.json")]
    assert main(["calibrate", "noise", *arguments]) == 0
    assert main(["calibrate", "noise", "--run", str(run), "--out", str(tmp_path / "run.json")]) == 0
    by_images, by_run = read_noise_file(tmp_path / "images.json"), read_noise_file(tmp_path / "run.json")
    for name in QUANTITIES:
        # The same frames in the same order; exposures are products of decimal fractions.
        assert by_images.known[name].value == pytest.approx(by_run.known[name].value, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "kind", "exposure_s"),
    [
        ("dark_10ms_1.png", "dark", 0.01),
        ("flats/0.5s/1.png", "flat", 0.5),
        ("bias/250us-01.tif", "dark", 250e-6),
        ("Light 2p5ms.png", "flat", 2.5e-3),
        ("bright_1S_x.png", "flat", 1.0),
        ("dark_frames2.png", "dark", None),
        ("flat_exp000000522us_3.png", "flat", 522e-6),
        ("dark/exposure=2p5ms.png", "dark", 2.5e-3),
        ("flat-exp000522.png", "flat", None),
    ],
)
def test_kind_and_exposure_of_a_name(tmp_path: Path, name: str, kind: str, exposure_s: float | None) -> None:
    write_png(tmp_path / name)
    (group,) = folder_frames(tmp_path, bit_depth=12).groups
    assert group.kind == kind
    assert group.exposure_s == (None if exposure_s is None else pytest.approx(exposure_s))


@pytest.mark.parametrize("name", ["flat_exp000522.png", "flat_exp_522.png", "flat_texp=522.png"])
def test_a_number_without_a_unit_has_the_one_that_is_stated(tmp_path: Path, name: str) -> None:
    write_png(tmp_path / name)
    (group,) = folder_frames(tmp_path, bit_depth=12, exposure_unit="us").groups
    assert group.exposure_s == pytest.approx(522e-6)


def test_many_images_of_which_the_same_is_to_be_said_take_few_lines(tmp_path: Path) -> None:
    for number in range(84):
        write_png(tmp_path / f"raw_{number:02}.png")
    with pytest.raises(ConfigError) as caught:
        folder_frames(tmp_path, bit_depth=12)
    assert len(str(caught.value).splitlines()) == 5
    assert "and 81 more files" in str(caught.value)


def test_exposures_that_are_not_recognised_are_told_as_such(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for number, (kind, exposure_s, counts) in enumerate(frames()):
        write_png(tmp_path / f"{kind}_{exposure_s * 1e6:g}_{number:03}.png", counts)
    arguments = ["--folder", str(tmp_path), "--bit-depth", "12", "--out", str(tmp_path / "noise.json")]
    assert main(["calibrate", "noise", *arguments]) == EXIT_DATA
    error = " ".join(capsys.readouterr().err.split())
    assert "no exposure was recognised" in error
    assert "--table" in error
    assert "keep automatic exposure" not in error


def test_kind_and_exposure_of_a_header(tmp_path: Path) -> None:
    header = fits.Header({"IMAGETYP": "Flat Field", "EXPTIME": 0.02})
    fits.PrimaryHDU(np.full((4, 5), 7, np.uint16), header).writeto(tmp_path / "a.fits")
    (group,) = folder_frames(tmp_path, bit_depth=12).groups
    assert (group.kind, group.exposure_s) == ("flat", 0.02)


def test_flats_of_one_exposure_in_two_folders_are_two_levels(tmp_path: Path) -> None:
    for lamp in ("lamp1", "lamp2"):
        for number in range(2):
            write_png(tmp_path / "flat" / lamp / f"10ms_{number}.png")
            write_png(tmp_path / "dark" / lamp / f"10ms_{number}.png")
    sizes = {(group.kind, len(group.loaders)) for group in folder_frames(tmp_path, bit_depth=12).groups}
    assert sizes == {("flat", 2), ("dark", 4)}


def test_folders_and_images_that_are_no_frames_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such folder"):
        folder_frames(tmp_path / "nowhere", bit_depth=12)
    with pytest.raises(ConfigError, match="has no PNG"):
        folder_frames(tmp_path, bit_depth=12)
    write_png(tmp_path / "one.png")
    write_png(tmp_path / "dark_flat.png")
    with pytest.raises(ConfigError, match=r"dark_flat\.png: is it dark or flat\?(.|\n)*one\.png: is it"):
        folder_frames(tmp_path, bit_depth=12)


def test_files_that_lost_their_noise_are_refused_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_png(tmp_path / "flat_10ms.jpg", np.zeros((4, 4), np.uint8))
    with pytest.raises(RefusedFramesError, match="lossy_compression"):
        folder_frames(tmp_path, bit_depth=8)
    arguments = ["--folder", str(tmp_path), "--bit-depth", "8", "--out", str(tmp_path / "n.json"), "--json"]
    assert main(["calibrate", "noise", *arguments]) == EXIT_DATA
    shown = capsys.readouterr()
    assert "lossy_compression" in shown.err
    assert [flag["name"] for flag in json.loads(shown.out)["flags"]] == ["lossy_compression"]


def test_images_want_a_bit_depth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_png(tmp_path / "dark_10ms.png")
    arguments = ["calibrate", "noise", "--folder", str(tmp_path), "--out", str(tmp_path / "n.json")]
    assert main(arguments) == EXIT_USAGE
    assert "--bit-depth" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "problems"),
    [
        (
            "file,kind,exposure_ms\na.png,grey,1\nb.png,dark,1\na.png,flat,long\n",
            r"line 2: kind is 'grey'(.|\n)*line 3: there is no file(.|\n)*line 4: exp",
        ),
        ("file,sort\na.png,dark\n", r"'kind' is missing(.|\n)*'sort' is not one of"),
    ],
)
def test_every_problem_of_a_table_is_named(tmp_path: Path, text: str, problems: str) -> None:
    write_png(tmp_path / "a.png")
    (tmp_path / "table.csv").write_text(text)
    with pytest.raises(ConfigError, match=problems):
        table_frames(tmp_path / "table.csv", bit_depth=12)


def test_exposures_of_a_table_in_another_unit(tmp_path: Path) -> None:
    write_png(tmp_path / "one.png")
    table = tmp_path / "frames.csv"
    table.write_text("file,kind,exposure_ms\none.png,flat,522\n")
    (group,) = table_frames(table, bit_depth=12, exposure_unit="us").groups
    assert group.exposure_s == pytest.approx(522e-6)


def test_a_table_gives_photons_and_levels(tmp_path: Path) -> None:
    for name in ("a.png", "b.png", "c.png"):
        write_png(tmp_path / name)
    table = tmp_path / "table.csv"
    table.write_text("file,kind,exposure_ms,photons,level\na.png,flat,10,500,1\nb.png,flat,10,900,2\nc.png,dark,10,,\n")
    found = table_frames(table, bit_depth=12).groups
    assert [(group.kind, group.photons) for group in found] == [("flat", 500.0), ("flat", 900.0), ("dark", None)]
    np.testing.assert_array_equal(found[0].loaders[0](), np.full((4, 5), 7))


GAIN, READ_E, BLACK_DN = 0.5, 6.0, 400.0
# The dark current doubles every 6 K [e-/s].
DARK_E_PER_S = {-10.0: 200.0, -5.0: 200.0 * 2.0 ** (5.0 / 6.0)}


def write_set(folder: Path, *, flats_c: float | None, darks_c: dict[float, int], key: str = "CCD-TEMP") -> Path:
    """FITS files as camera programs name them, drawn by NumPy alone; temperatures scatter by a tenth of a degree."""
    draws = np.random.default_rng(8)

    def write(kind: str, number: int, exposure_s: float, electrons: float, temperature_c: float | None) -> None:
        counts = BLACK_DN + GAIN * (draws.poisson(electrons, (64, 80)) + READ_E * draws.standard_normal((64, 80)))
        header = fits.Header({"IMAGETYP": kind, "EXPTIME": exposure_s})
        if temperature_c is not None:
            header[key] = temperature_c + 0.1 * draws.standard_normal()
        name = f"{kind}_{exposure_s:g}_{temperature_c}_{number}.fits"
        fits.PrimaryHDU(np.rint(counts).astype(np.uint16), header).writeto(folder / name)

    for place in range(1, 11):
        for number in range(2):
            write("flat", number, 0.2 * place, 8000.0 * place, flats_c)
            for temperature_c, count in darks_c.items():
                if number < count:
                    write("dark", number, 2.0 * place, DARK_E_PER_S[temperature_c] * 2.0 * place, temperature_c)
    return folder


def named(found: Any) -> dict[str, Flag]:
    return {flag.name: flag for flag in found.flags}


@pytest.mark.parametrize("used_c", [-10.0, -5.0])
def test_the_darks_of_the_flats_temperature_are_used_and_the_others_named(tmp_path: Path, used_c: float) -> None:
    frames = folder_frames(write_set(tmp_path, flats_c=used_c, darks_c={-10.0: 2, -5.0: 2}), bit_depth=16)
    found = calibrate_frames(frames)
    message = named(found)["dark_temperatures"].message
    assert "-10.0 C (20 frames) and -5.0 C (20 frames)" in message
    assert f"those at {used_c:.1f} C are used, nearest to the flats" in message
    assert not {"light_in_darks", "black_clamp", "wrong_dark", "dark_current_changed"} & set(named(found))
    current = found.dark_current_e_per_s
    assert current is not None
    assert abs(current.value - DARK_E_PER_S[used_c]) < 4.0 * current.std_error
    # The doubling of the dark current takes it from the file.
    assert frames.made_for.temperature_c == pytest.approx(used_c, abs=0.1)


@pytest.mark.parametrize("key", ["DET-TEMP", "CCDTEMP"])
def test_without_the_temperature_of_flats_the_darks_of_which_there_are_most_are_used(tmp_path: Path, key: str) -> None:
    frames = folder_frames(write_set(tmp_path, flats_c=None, darks_c={-10.0: 1, -5.0: 2}, key=key), bit_depth=16)
    (flag,) = frames.flags
    assert "those at -5.0 C are used, the most" in flag.message


def test_darks_of_one_temperature_are_all_used(tmp_path: Path) -> None:
    frames = folder_frames(write_set(tmp_path, flats_c=-5.0, darks_c={-10.0: 2}), bit_depth=16)
    assert frames.flags == ()
    assert sum(len(group.loaders) for group in frames.groups if group.kind == "dark") == 20


def test_a_header_in_kelvins_is_one_in_degrees(tmp_path: Path) -> None:
    for number in range(2):
        header = fits.Header({"IMAGETYP": "dark", "EXPTIME": 1.0, "CCD-TEMP": 163.15})
        fits.PrimaryHDU(np.full((4, 5), 7, np.uint16), header).writeto(tmp_path / f"{number}.fits")
    assert folder_frames(tmp_path, bit_depth=12).made_for.temperature_c == pytest.approx(-110.0)


def test_darks_of_a_run_are_grouped_by_its_records(tmp_path: Path) -> None:
    with RunWriter.create(tmp_path / "run", {"origin": "simulated"}) as writer:
        for number, (kind, warmth) in enumerate([("flat", 20.0), ("dark", 20.5), ("dark", 20.7), ("dark", 31.0)]):
            record = make_record(number, kind=kind, exposure_s=0.01, camera_temperature_c=warmth)
            writer.write_frame(record, noisy_counts(number))
    found = run_frames(tmp_path / "run")
    assert "20.6 C (2 frames) and 31.0 C (1 frames)" in named(found)["dark_temperatures"].message
    assert [len(group.loaders) for group in found.groups] == [1, 2]
