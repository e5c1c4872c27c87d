"""Exports hold what the run holds, bit for bit."""

import json

import numpy as np
import pytest

from rigctl.cli import main
from rigctl.runs.run_folder import read_run
from tests.rigctl.run_samples import write_run


def _export(tmp_path, to, name):
    run = write_run(tmp_path / "run")
    assert main(["export", str(run), "--to", to, "--out", str(tmp_path / name)]) == 0
    return read_run(run), tmp_path / name


def test_hdf5_holds_every_frame_and_its_record(tmp_path):
    h5py = pytest.importorskip("h5py", reason="pip install h5py")
    run, out = _export(tmp_path, "hdf5", "run.h5")
    with h5py.File(out) as file:
        for place, record in enumerate(run.frames):
            np.testing.assert_array_equal(file["counts"][place], run.counts(record))
            assert file["frames/polarizer_angle_deg"][place] == record.polarizer_angle_deg
            assert file["frames/checksum"][place].decode() == record.checksum
        assert np.isnan(file["frames/exposure_s"][0])
        assert json.loads(file.attrs["session"]) == run.session


def test_zarr_holds_every_frame_and_its_record(tmp_path):
    zarr = pytest.importorskip("zarr", reason="pip install zarr")
    run, out = _export(tmp_path, "zarr", "run.zarr")
    group = zarr.open_group(str(out), mode="r")
    for place, record in enumerate(run.frames):
        np.testing.assert_array_equal(group["counts"][place], run.counts(record))
        assert group.attrs["frames"]["polarizer_angle_deg"][place] == record.polarizer_angle_deg


def test_tiff_holds_every_frame_and_its_record(tmp_path):
    tifffile = pytest.importorskip("tifffile", reason="pip install tifffile")
    run, out = _export(tmp_path, "tiff", "run-tiff")
    for record in run.frames:
        with tifffile.TiffFile(out / record.file.replace("frames/", "").replace(".fits", ".tif")) as file:
            np.testing.assert_array_equal(file.asarray(), run.counts(record))
            assert json.loads(file.pages[0].description)["checksum"] == record.checksum


def test_what_is_there_is_not_written_over(tmp_path, capsys):
    run = write_run(tmp_path / "run")
    (tmp_path / "mine.h5").write_text("precious")
    assert main(["export", str(run), "--to", "hdf5", "--out", str(tmp_path / "mine.h5")]) == 2
    assert "is there already" in capsys.readouterr().err
    assert (tmp_path / "mine.h5").read_text() == "precious"


def test_a_damaged_frame_is_not_exported(tmp_path):
    pytest.importorskip("h5py", reason="pip install h5py")
    run = write_run(tmp_path / "run")
    frame = next((run / "frames").glob("*.fits"))
    frame.write_bytes(frame.read_bytes()[:-1] + b"x")
    assert main(["export", str(run), "--to", "hdf5", "--out", str(tmp_path / "run.h5")]) == 4
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run"]
