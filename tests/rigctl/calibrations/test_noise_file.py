"""The file of a noise calibration: written whole, read back as it was, refused when it is wrong."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibration.sensor.emva1288 import EMVA_SYMBOLS
from calibration.sensor.levels import level_statistics
from calibration.sensor.noise import NoiseCalibration, calibrate_noise
from rigctl.calibrations.made_for import MadeFor
from rigctl.calibrations.noise import QUANTITIES, read_noise_file
from rigctl.calibrations.noise_calibration import noise_content
from rigctl.calibrations.noise_frames import FrameSet, FrameSource
from rigctl.calibrations.record import write_content
from rigctl.errors import ConfigError, DataError
from tests.rigctl.noise_sessions import frames

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
        (spoilt(lambda c: c["covariance"]["names"].__setitem__(1, c["covariance"]["names"][0])), "hold one twice"),
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
    assert "holds for 365" in noise.doubts(old)[0]


def test_reading_a_calibration_does_not_import_an_optimizer():
    program = "import sys, rigctl.calibrations.noise; print('scipy.optimize' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
