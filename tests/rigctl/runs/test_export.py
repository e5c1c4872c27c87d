"""Exports hold what the run holds, bit for bit."""

import csv
import json
from dataclasses import fields, replace

import cv2
import h5py
import numpy as np
import pytest
import tifffile
import xarray as xr
import zarr
from astropy.io import fits

from rigctl.cli import main
from rigctl.runs.folder import read_run
from rigctl.runs.records import FrameRecord
from rigctl.runs.writer import RunWriter
from rigctl.verbs.stokes import stokes
from tests.rigctl.made_runs import at, make_run
from tests.rigctl.run_samples import FULL_RECORD, make_record, noisy_counts, write_run


def _with_every_field(path):
    """Return a run in which one frame knows everything, one as little as a frame can, and one has every extreme."""
    extremes = np.array([[0, 1, 4095, 32767, 32768, 65534, 65535]] * 5, dtype=np.uint16)
    with RunWriter.create(path, {"origin": "simulated", "rig": {"name": "Böhm's", "offset_deg": 0.1 + 0.2}}) as writer:
        writer.write_frame(replace(FULL_RECORD, sequence=0), noisy_counts(0))
        writer.write_frame(make_record(1, start_monotonic_ns=2**53 + 1), noisy_counts(1))
        writer.write_frame(replace(FULL_RECORD, sequence=2, polarizer_angle_deg=-0.0, remarks=()), extremes)
    return path


def _export(tmp_path, to, name):
    run = _with_every_field(tmp_path / "run")
    assert main(["export", str(run), "--to", to, "--out", str(tmp_path / name)]) == 0
    return read_run(run), tmp_path / name


def _record(values):
    return FrameRecord(**values | {"remarks": tuple(values["remarks"])})


def test_hdf5_holds_every_frame_and_its_record(tmp_path):
    run, out = _export(tmp_path, "hdf5", "run.h5")
    with h5py.File(out) as file:
        assert file["counts"].dtype == np.uint16
        for place, record in enumerate(run.frames):
            np.testing.assert_array_equal(file["counts"][place], run.counts(record))
            assert _record(json.loads(file["records"][place])) == record
        assert json.loads(file.attrs["session"]) == run.session_json
        assert file.attrs["created_by"] == run.created_by


def test_hdf5_has_a_column_a_field_with_its_unit(tmp_path):
    run, out = _export(tmp_path, "hdf5", "run.h5")
    with h5py.File(out) as file:
        frames = file["frames"]
        assert set(frames) == {field.name for field in fields(FrameRecord)}
        assert frames["polarizer_angle_deg"].attrs["unit"] == "deg"
        assert frames["egain_e_per_dn"].attrs["unit"] == "e-/DN"
        assert frames["kind"].attrs["unit"] == ""
        np.testing.assert_array_equal(frames["polarizer_angle_deg"][:], [run.frames[0].polarizer_angle_deg, np.nan, 0])
        assert frames["sequence"].dtype == np.int64
        assert frames["camera_serial"].asstr()[:].tolist() == ["Böhm's № 1", "", "Böhm's № 1"]
        assert frames["remarks"].asstr()[0] == "\n".join(run.frames[0].remarks)


def test_zarr_holds_every_frame_and_its_record(tmp_path):
    run, out = _export(tmp_path, "zarr", "run.zarr")
    group = zarr.open_group(str(out), mode="r")
    assert group["counts"].attrs["_ARRAY_DIMENSIONS"] == ["frame", "y", "x"]
    for place, record in enumerate(run.frames):
        np.testing.assert_array_equal(group["counts"][place], run.counts(record))
        assert _record({name: column[place] for name, column in group.attrs["frames"].items()}) == record
    assert group.attrs["session"] == run.session_json


def test_xarray_opens_a_zarr_lazily_with_coordinates(tmp_path):
    run, out = _export(tmp_path, "zarr", "run.zarr")
    store = xr.open_zarr(out)
    assert store.counts.dims == ("frame", "y", "x")
    assert store.counts.dtype == np.uint16
    assert store.counts.encoding["chunks"][0] == 1
    assert {"kind", "polarizer_angle_deg", "exposure_s"} <= set(store.counts.coords)
    assert store.kind.values.tolist() == [record.kind for record in run.frames]
    known = [np.nan if record.polarizer_angle_deg is None else record.polarizer_angle_deg for record in run.frames]
    np.testing.assert_array_equal(store.polarizer_angle_deg, known)
    assert store.exposure_s.attrs["units"] == "s"
    scenes = store.counts.where((store.kind == "scene").compute(), drop=True)
    assert scenes.sizes["frame"] == sum(record.kind == "scene" for record in run.frames)
    starts = [record.start_utc for record in run.frames]
    if None not in starts:
        assert [f"{text}Z" for text in np.datetime_as_string(store.time.values, unit="ns")] == starts


def test_tiff_holds_every_frame_and_its_record(tmp_path):
    run, out = _export(tmp_path, "tiff", "run-tiff")
    for record in run.frames:
        name = record.file.replace("frames/", "").replace(".fits", ".tif")
        with tifffile.TiffFile(out / name) as file:
            np.testing.assert_array_equal(file.asarray(), run.counts(record))
            assert _record(json.loads(file.pages[0].description)) == record
        # Another reader, which shares no code with the writer.
        np.testing.assert_array_equal(cv2.imread(str(out / name), cv2.IMREAD_UNCHANGED), run.counts(record))
    assert json.loads((out / "session.json").read_text()) == run.session_json


def test_fits_holds_every_frame_and_its_record(tmp_path):
    run, out = _export(tmp_path, "fits", "run.fits")
    with fits.open(out) as file:
        file.verify("exception")
        for place, record in enumerate(run.frames):
            np.testing.assert_array_equal(file[0].data[place], run.counts(record))
            assert _record(json.loads(file["FRAMES"].data["record"][place])) == record
        angles = file["FRAMES"].data["polarizer_angle_deg"]
        np.testing.assert_array_equal(angles, [run.frames[0].polarizer_angle_deg, np.nan, 0])
        assert file["FRAMES"].columns["exposure_s"].unit == "s"


def test_csv_holds_each_region_in_each_cycle(tmp_path):
    generator = np.random.default_rng(5)
    frames = [
        (at(angle, cycle=cycle, exposure_s=0.01), generator.poisson(400 + 80 * np.cos(np.radians(2 * angle)), (20, 24)))
        for cycle in range(2)
        for angle in (0.0, 45.0, 90.0, 135.0)
    ]
    make_run(tmp_path / "run", frames)
    regions = tmp_path / "regions.toml"
    regions.write_text('[[regions]]\nname = "panel"\nrectangle = { x = 2, y = 2, width = 16, height = 14 }\n')
    words = ["export", str(tmp_path / "run"), "--out", str(tmp_path / "run.csv")]
    assert main([*words, "--to", "csv"]) == 2
    assert main([*words, "--to", "fits", "--regions", str(regions)]) == 2
    assert main([*words, "--to", "csv", "--regions", str(regions)]) == 0
    rows = list(csv.DictReader((tmp_path / "run.csv").read_text().splitlines()))
    degrees = [row for row in rows if row["quantity"] == "dolp"]
    assert [(row["cycle"], row["region"]) for row in degrees] == [("0", "panel"), ("1", "panel")]
    assert all(abs(float(row["value"]) - 0.2) < 5.0 * float(row["std_error"]) for row in degrees)
    assert degrees[0]["value"] != degrees[1]["value"]


@pytest.mark.parametrize("to", ["fits", "hdf5", "zarr", "csv"])
def test_every_format_of_stokes_has_the_same_planes(tmp_path, to):
    generator = np.random.default_rng(5)
    frames = [
        (at(angle, cycle=cycle, exposure_s=0.01), generator.poisson(400 + 80 * np.cos(np.radians(2 * angle)), (6, 7)))
        for cycle in range(2)
        for angle in (0.0, 45.0, 90.0, 135.0)
    ]
    planes = stokes(make_run(tmp_path / "run", frames).path).planes
    out = tmp_path / f"stokes.{to}"
    assert main(["export", str(tmp_path / "run"), "--of", "stokes", "--to", to, "--out", str(out)]) == 0
    if to == "fits":
        with fits.open(out) as units:
            found = dict(zip(("s0", "s1", "s2"), units["SCI"].data, strict=True)) | {"dq": units["DQ"].data}
    elif to == "hdf5":
        with h5py.File(out) as file:
            found = {name: one[:] for name, one in file["entry/stokes"].items()}
            polarizer = file["entry/instrument/polarizer"]
            assert polarizer.attrs["NX_class"] == "NXoptical_polarizer"
            assert polarizer["polarizer_angle"][:].tolist() == [0.0, 45.0, 90.0, 135.0]
    elif to == "zarr":
        found = {name: one.values for name, one in xr.open_zarr(out).items()}
    else:
        table = np.genfromtxt(out, delimiter=",", names=True)
        assert table["x"][:8].tolist() == [0, 1, 2, 3, 4, 5, 6, 0]
        found = {name: table[name].reshape(6, 7) for name in planes}
    if to != "fits":
        assert set(found) == set(planes)
    for name, values in found.items():
        np.testing.assert_allclose(values, planes[name].values, rtol=1e-5, atol=1e-9)
    assert main(["export", str(tmp_path / "run"), "--of", "stokes", "--to", "tiff", "--out", f"{out}2"]) == 2


@pytest.mark.parametrize("to", ["fits", "hdf5", "zarr"])
def test_frames_of_two_sizes_do_not_go_into_one_array(tmp_path, to, capsys):
    with RunWriter.create(tmp_path / "run", {}) as writer:
        writer.write_frame(make_record(0), noisy_counts(0))
        writer.write_frame(make_record(1), noisy_counts(1, (4, 4)))
    assert main(["export", str(tmp_path / "run"), "--to", to, "--out", str(tmp_path / "out")]) == 4
    assert "frames of 2 sizes" in " ".join(capsys.readouterr().err.split())
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_a_damaged_frame_is_not_exported(tmp_path):
    run = write_run(tmp_path / "run")
    frame = next((run / "frames").glob("*.fits"))
    frame.write_bytes(frame.read_bytes()[:-1] + b"x")
    assert main(["export", str(run), "--to", "hdf5", "--out", str(tmp_path / "run.h5")]) == 4
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run"]
