"""Dark frames of several temperatures in one set: grouped by their headers or records, and the difference named."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from astropy.io import fits

from calibration.results import Flag
from rigctl.calibrations.noise_calibration import calibrate_frames
from rigctl.calibrations.noise_frames import folder_frames, run_frames
from rigctl.runs.writer import RunWriter
from tests.rigctl.run_samples import make_record, noisy_counts

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
            for temperature_c, frames in darks_c.items():
                if number < frames:
                    write("dark", number, 2.0 * place, DARK_E_PER_S[temperature_c] * 2.0 * place, temperature_c)
    return folder


def named(found: Any) -> dict[str, Flag]:
    return {flag.name: flag for flag in found.flags}


@pytest.mark.parametrize("used_c", [-10.0, -5.0])
def test_the_darks_of_the_flats_temperature_are_used_and_the_others_named(tmp_path: Path, used_c: float) -> None:
    frames = folder_frames(write_set(tmp_path, flats_c=used_c, darks_c={-10.0: 2, -5.0: 2}), bit_depth=16)
    found = calibrate_frames(frames).noise
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
