"""Sets of frames as others have them: sums, means, folders, header words; written by other programs, and by numpy."""

import json
from pathlib import Path

import h5py
import numpy as np
import PIL.Image
import pytest
import tifffile
from astropy.io import fits

from rigctl.cli import main
from rigctl.imports import headers
from rigctl.measure.measure import measure
from rigctl.measure.pixel_errors import pixel_errors
from rigctl.runs.folder import read_run
from rigctl.verbs.import_images import import_images
from rigctl.verbs.look import look
from rigctl.verbs.stokes import stokes
from tests.rigctl.noise_records import noise_parameters
from tests.rigctl.run_samples import noisy_counts

ANGLES_DEG, READS, BLACK_DN = (0, 45, 90, 135), 15, 60
DOLP, AOLP_DEG, GAIN, READ_NOISE_E = 0.3, 25.0, 0.5, 4.0


def single_reads(rng, angle_deg, shape=(24, 24)):
    """Return counts of reads, by plain numpy."""
    light_e = 1500.0 * (1.0 + DOLP * np.cos(2.0 * np.radians(angle_deg - AOLP_DEG)))
    electrons = rng.poisson(light_e, (READS, *shape)) + rng.normal(0.0, READ_NOISE_E, (READS, *shape))
    return np.rint(GAIN * electrons + BLACK_DN)


def write(path, counts, **header):
    unit = fits.PrimaryHDU(counts)
    unit.header.update({"EXPTIME": 0.01, "IMAGETYP": "Light Frame", "DET-TEMP": 263.15, **header})
    unit.writeto(path)
    return path


@pytest.fixture(scope="module")
def sets(tmp_path_factory):
    """Return the same reads as they are, as sums, as means, and as means rounded to whole counts, as runs."""
    folder, rng = tmp_path_factory.mktemp("sets"), np.random.default_rng(5)
    for name in ("single", "sum", "mean", "rounded"):
        (folder / name).mkdir()
    for angle in ANGLES_DEG:
        reads, polar = single_reads(rng, angle), {"POLAR": f"{angle} Deg"}
        for number, counts in enumerate(reads):
            write(folder / "single" / f"{angle}_{number:02}.fits", counts.astype(np.uint16), **polar)
        write(folder / "sum" / f"{angle}.fits", reads.sum(axis=0).astype(np.int32), COADDS=READS, **polar)
        write(folder / "mean" / f"{angle}.fits", reads.mean(axis=0).astype(np.float32), NCOMBINE=READS, **polar)
        write(folder / "rounded" / f"{angle}.fits", np.rint(reads.mean(axis=0)).astype(np.int16), **polar)
    runs = {}
    for name, more in {"single": {}, "sum": {}, "mean": {}, "rounded": {"averaged": READS}}.items():
        black_dn = BLACK_DN * (READS if name == "sum" else 1)
        runs[name] = folder / f"run-{name}"
        import_images(runs[name], [folder / name], bit_depth=12, black_level_dn=black_dn, **more)
    return runs


@pytest.mark.parametrize("name", ["sum", "mean", "rounded"])
def test_sums_and_means_give_the_dolp_of_their_reads(sets, name):
    one, all_reads = stokes(sets[name]), stokes(sets["single"])
    # Single precision, and rounding of a mean to whole counts: half a count of some 750.
    tolerance = 0.5 / 750.0 * 2.0 if name == "rounded" else 1e-5
    np.testing.assert_allclose(one.dolp, all_reads.dolp, atol=tolerance)
    np.testing.assert_allclose(one.s0, all_reads.s0, rtol=tolerance)
    first = read_run(sets[name]).frames[0]
    assert (first.reads, first.real_counts) == (READS, None if name == "rounded" else True)
    assert (first.exposure_s, first.saturation_dn) == (0.01, 4095.0)
    assert first.camera_temperature_c == pytest.approx(-10.0)


def test_the_errors_of_pixels_hold_the_truth_whether_reads_are_single_summed_or_averaged(sets):
    known = {"gain_dn_per_e": GAIN, "read_noise_e": READ_NOISE_E, "black_level_dn": BLACK_DN}
    noise = noise_parameters({name: {"value": value, "std_error": 0.0, "n": 1} for name, value in known.items()})
    twice = 2.0 * np.radians(AOLP_DEG)
    truth_dn = GAIN * 3000.0 * np.array([1.0, DOLP * np.cos(twice), DOLP * np.sin(twice)])
    errors = {}
    for name, run in sets.items():
        measured = measure(read_run(run), regions=[])
        found = pixel_errors(measured, noise)
        apart = measured.images.stokes.reshape(3, -1).T - truth_dn
        cov = found.cov.reshape(3, 3, -1).transpose(2, 0, 1).astype(np.float64)
        chi_square = np.einsum("pi,pij,pj->p", apart, np.linalg.inv(cov), apart)
        # Three degrees of freedom in each of 576 pixels.
        assert chi_square.mean() / 3.0 == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / (3.0 * 576.0)))
        errors[name] = found.dolp.mean()
    assert errors["sum"] == pytest.approx(errors["single"], rel=0.01)
    assert errors["mean"] == pytest.approx(errors["single"], rel=0.01)


def test_the_noise_of_a_mean_is_that_of_its_reads(sets):
    """Against the scatter of the pixels, which here is noise alone."""
    for name in ("sum", "rounded"):
        run = read_run(sets[name])
        measurement = measure(run, regions=[])
        grid = measurement.grid
        signal_e = np.array([run.counts(record).mean() - BLACK_DN for record in grid.records[0]]) / GAIN
        of_read = GAIN**2 * (signal_e + READ_NOISE_E**2) + 1.0 / 12.0
        expected = of_read * measurement.noise_factor + grid.rounding_dn2
        found = np.array([run.counts(record).var(ddof=1) for record in grid.records[0]])
        # A variance of 576 pixels is known to 6 %; four of them together to 3 %.
        assert np.mean(found / expected) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / (4.0 * 576.0)))


def test_counts_below_0_are_kept(tmp_path):
    rng = np.random.default_rng(1)
    taken = [rng.normal(0.4, 3.0, (8, 9)).astype(np.float32) for _ in ANGLES_DEG]
    for angle, counts in zip(ANGLES_DEG, taken, strict=True):
        tifffile.imwrite(tmp_path / f"pol{angle}deg.tif", counts)
    words = ["--bit-depth", "14", "--black-level-dn", "0", "--same-exposure"]
    assert main(["import", str(tmp_path / "run"), *map(str, sorted(tmp_path.glob("*.tif"))), *words]) == 0
    run = read_run(tmp_path / "run")
    by_angle = {record.polarizer_angle_deg: run.counts(record) for record in run.frames}
    for angle, counts in zip(ANGLES_DEG, taken, strict=True):
        np.testing.assert_array_equal(by_angle[angle], counts)


def test_counts_that_all_need_more_than_16_bits_are_kept(tmp_path):
    rng = np.random.default_rng(1)
    (tmp_path / "set").mkdir()
    for angle in ANGLES_DEG:
        counts = rng.integers(100_000, 200_000, (24, 24), dtype=np.uint32)
        write(tmp_path / "set" / f"{angle}.fits", counts, POLAR=float(angle))
    found = import_images(tmp_path / "run", [tmp_path / "set"], bit_depth=18, black_level_dn=1000)
    assert found.frames[0].saturation_dn == 2**18 - 1
    last = next(frame for frame in found.frames if frame.polarizer_angle_deg == ANGLES_DEG[-1])
    np.testing.assert_array_equal(read_run(tmp_path / "run").counts(last)[::-1], counts)
    assert np.isfinite(stokes(tmp_path / "run").s0).all()


def test_a_folder_of_all_kinds_is_one_run(tmp_path):
    words = {"zero": "Bias Frame", "d": "DARK", "f": "flat field", "p0": "Object", "p60": "Object", "p120": "Object"}
    (tmp_path / "night").mkdir()
    for number, (name, word) in enumerate(words.items()):
        write(
            tmp_path / "night" / f"{name}.fits",
            noisy_counts(number),
            IMAGETYP=word,
            EXPTIME=0.0 if number == 0 else 1.5,
        )
    assert main(["import", str(tmp_path / "run"), str(tmp_path / "night"), "--bit-depth", "12"]) == 0
    frames = read_run(tmp_path / "run").frames
    assert sorted((record.kind, record.polarizer_angle_deg) for record in frames if record.kind == "scene") == [
        ("scene", 0.0),
        ("scene", 60.0),
        ("scene", 120.0),
    ]
    assert sorted(record.exposure_s for record in frames if record.kind == "dark") == [0.0, 1.5]


@pytest.mark.parametrize(
    ("header", "name", "kind"),
    [
        ({"IMAGETYP": "zero"}, "a.fits", "dark"),
        ({"FRAME": "Bias"}, "a.fits", "dark"),
        ({"OBSTYPE": "OBJECT"}, "dark.fits", "scene"),
        ({"IMAGETYP": "Light Frame"}, "a.fits", "scene"),
        ({"IMAGETYP": "Flats"}, "a.fits", "flat"),
        ({}, "biassu0s0017.fits", "dark"),
        ({}, "Dark_001.fits", "dark"),
        ({}, "flat-3.tif", "flat"),
        ({}, "zero_deg.png", None),
        ({}, "darkness.png", None),
        ({}, "dark_flat.png", None),
        ({"IMAGETYP": "?"}, "panel.png", None),
    ],
)
def test_kinds_by_headers_and_names(header, name, kind):
    assert headers.kind_of(header, name) == kind


@pytest.mark.parametrize(
    ("header", "found"),
    [
        ({"CCD-TEMP": -20.0}, -20.0),
        ({"DET-TEMP": 250.0}, -23.15),
        ({"SET-TEMP": -5.0, "CCDTEMP": -4.9}, -4.9),
        ({}, None),
    ],
)
def test_temperatures_by_headers(header, found):
    assert headers.temperature_c(header) == (None if found is None else pytest.approx(found))


def test_camera_filter_place_and_times_of_a_header_are_those_of_the_result(tmp_path):
    (tmp_path / "set").mkdir()
    for number, angle in enumerate(ANGLES_DEG):
        facts = {"INSTRUME": "PolCam", "FILTER": "V", "SITELAT": 43.1, "SITELONG": -77.6, "SITEELEV": 160}
        times = {"DATE-OBS": f"2026-05-04T10:00:0{number}.250", "EXPTIME": 0.5}
        write(tmp_path / "set" / f"{angle}.fits", noisy_counts(number), POLAR=float(angle), **facts, **times)
    import_images(tmp_path / "run", [tmp_path / "set"], bit_depth=12, black_level_dn=1)
    stokes(tmp_path / "run", out=tmp_path / "out")
    header = fits.getheader(tmp_path / "out" / "stokes.fits")
    assert {key: header[key] for key in facts} == facts
    found = [header[key] for key in ("DATE-BEG", "DATE-AVG", "DATE-END")]
    assert found == [f"2026-05-04T10:00:0{second}" for second in ("0.250", "2.000", "3.750")]


@pytest.mark.parametrize(
    ("header", "reads", "is_sum"),
    [
        ({"COADDS": 45}, 45, True),
        ({"NCOMBINE": 3}, 3, False),
        ({"COADDS": 1}, 1, False),
        ({"COADDS": "many"}, 1, False),
    ],
)
def test_reads_by_headers(header, reads, is_sum):
    assert headers.reads_of(header)[:2] == (reads, is_sum)


@pytest.mark.parametrize("key", ["POLANG", "POLAR", "POLARREF"])
def test_angles_by_headers(key):
    assert headers.angles_of([(Path("a"), {key: one}) for one in ("0", 60.0, "-60 Deg")])[0] == (0.0, 60.0, -60.0)


def test_angles_by_the_names_of_files_of_arrays(tmp_path):
    for angle in ANGLES_DEG:
        with h5py.File(tmp_path / f"p_{angle}.h5", "w") as file:
            file["entry/data"] = noisy_counts(angle)
    files = [f"{tmp_path}/p_{angle}.h5:/entry/data" for angle in ANGLES_DEG]
    import_images(tmp_path / "run", files, same_exposure=True, bit_depth=12, black_level_dn=1)
    assert [record.polarizer_angle_deg for record in read_run(tmp_path / "run").frames] == list(ANGLES_DEG)


def test_angles_by_a_table(tmp_path):
    files = [write(tmp_path / f"{name}.fits", noisy_counts(k), POLAR=7.0) for k, name in enumerate("abc")]
    (tmp_path / "angles.csv").write_text("file,angle_deg\nc.fits,120\nb.fits,60\na.fits,0\n")
    import_images(tmp_path / "run", files, angles=[str(tmp_path / "angles.csv")], bit_depth=12, black_level_dn=1)
    assert [record.polarizer_angle_deg for record in read_run(tmp_path / "run").frames] == [0.0, 60.0, 120.0]


def test_stacks_are_frames_with_an_angle_for_each_file_or_picture(tmp_path, capsys):
    cubes = [
        write(tmp_path / f"{name}.fits", np.stack([noisy_counts(k), noisy_counts(k + 9)]))
        for k, name in enumerate("abc")
    ]
    tifffile.imwrite(tmp_path / "scan.tif", np.stack([noisy_counts(k) for k in range(3)]), photometric="minisblack")
    (tmp_path / "angles.csv").write_text("file,angle_deg\nscan.tif[2],120\nscan.tif[0],0\nscan.tif[1],60\n")
    known = {"bit_depth": 12, "black_level_dn": 1, "same_exposure": True}
    found = import_images(tmp_path / "bursts", cubes, angles=[0, 60, 120], bit_depth=12, black_level_dn=1)
    assert "a.fits and 2 other files hold 6 pictures, each a frame" in found.remarks
    assert [record.polarizer_angle_deg for record in found.frames] == [0.0, 0.0, 60.0, 60.0, 120.0, 120.0]
    assert [record.cycle for record in found.frames] == [0, 1] * 3
    assert found.frames[1].source_file.endswith("a.fits[1]")
    for name, angles in (("list", [0, 60, 120]), ("table", [str(tmp_path / "angles.csv")])):
        scan = import_images(tmp_path / name, [tmp_path / "scan.tif"], angles=angles, **known)
        assert [record.polarizer_angle_deg for record in scan.frames] == [0.0, 60.0, 120.0]
        np.testing.assert_array_equal(read_run(tmp_path / name).counts(scan.frames[2]), noisy_counts(2))
    maps = look([tmp_path / "scan.tif"], angles=[0, 60, 120], out=tmp_path / "look.png")
    assert list(maps.angles_deg.values()) == [0.0, 60.0, 120.0]
    words = ["import", str(tmp_path / "run"), *map(str, cubes), "--angles", "0,60", "--bit-depth", "12"]
    assert main([*words, "--black-level-dn", "1"]) == 2
    assert "2 angles for 3 files of 6 pictures" in capsys.readouterr().err


def test_jpeg_is_shown_with_a_caution_and_not_imported(tmp_path, capsys):
    (tmp_path / "set").mkdir()
    for angle in ANGLES_DEG:
        PIL.Image.fromarray((noisy_counts(angle) >> 4).astype(np.uint8)).save(tmp_path / "set" / f"p{angle}.jpg")
    assert main(["look", str(tmp_path / "set"), "--out", str(tmp_path / "look.png")]) == 0
    assert "4 of 4 images are JPEG" in capsys.readouterr().err
    words = ["--same-exposure", "--black-level-dn", "0"]
    assert main(["import", str(tmp_path / "run"), str(tmp_path / "set"), *words]) == 4
    assert "p45.jpg and 1 more: is compressed with loss" in capsys.readouterr().err


def test_all_that_is_missing_is_asked_for_in_one_message(tmp_path, capsys):
    for number in range(3):
        write(
            tmp_path / f"{number}.fits", noisy_counts(number).astype(np.int32) * 40, OFFSET=9, RETANG=22.5, EXPTIME="?"
        )
    words = ["import", str(tmp_path / "run"), *map(str, sorted(tmp_path.glob("*.fits")))]
    assert main(words) == 2
    said = " ".join(capsys.readouterr().err.split())
    for text in (
        "--exposure-s",
        "--black-level-dn",
        "the headers have OFFSET",
        "--bit-depth",
        "--coadds N",
        "--angles",
    ):
        assert text in said
    assert "a half-wave plate turns the axis by twice its angle" in said
    assert main([*words, "--coadds", "2", "--averaged", "2"]) == 2
    assert "--coadds, --averaged: give one" in capsys.readouterr().err


def test_the_second_command_gives_a_calibrated_result(tmp_path, capsys):
    rng = np.random.default_rng(3)
    for angle in ANGLES_DEG:
        tifffile.imwrite(tmp_path / f"panel_{angle}.tif", single_reads(rng, angle)[0].astype(np.uint16))
    files = [str(tmp_path / f"panel_{angle}.tif") for angle in ANGLES_DEG]
    words = ["--black-level-dn", str(BLACK_DN), "--same-exposure", "--bit-depth", "12", "--json"]
    assert main(["import", str(tmp_path / "run"), *files, *words, "--stokes", str(tmp_path / "out")]) == 0
    assert json.loads(capsys.readouterr().out)["stokes"]["sound"]
    with fits.open(tmp_path / "out" / "stokes.fits") as file:
        # 576 pixels, each known to about 0.03.
        assert np.nanmean(file["DOLP"].data) == pytest.approx(DOLP, abs=0.01)


def test_pixels_that_are_no_numbers_are_missing(tmp_path):
    rng = np.random.default_rng(4)
    for name, more in (("whole", 0.0), ("means", 0.25)):
        (tmp_path / name).mkdir()
        for angle in ANGLES_DEG:
            counts = (single_reads(rng, angle)[0] + more).astype(np.float32)
            counts[2:4, 5] = np.nan, np.inf
            write(tmp_path / name / f"{angle}.fits", counts, POLAR=float(angle))
        run = tmp_path / f"run-{name}"
        found = import_images(run, [tmp_path / name], bit_depth=12, black_level_dn=BLACK_DN)
        assert "8 pixels are NaN or infinite, and are taken as missing" in " ".join(found.remarks)
        maps = look([tmp_path / name], out=tmp_path / "look.png").maps
        assert np.argwhere(maps.unusable).tolist() == [[20, 5], [21, 5]]
        result = stokes(run, out=tmp_path / f"out-{name}")
        assert np.nanmedian(result.dolp) == pytest.approx(DOLP, abs=0.05)
        with fits.open(tmp_path / f"out-{name}" / "stokes.fits") as file:
            # FITS without ROWORDER has its bottom row first.
            assert np.argwhere(file["DQ"].data[::-1] & 4).tolist() == [[2, 5], [3, 5]]
            assert np.isnan(file["DOLP"].data[::-1][2:4, 5]).all()


def test_the_overscan_gives_the_black_level_and_is_cut_off(tmp_path):
    rng = np.random.default_rng(6)
    for angle in ANGLES_DEG:
        counts = np.full((26, 32), BLACK_DN + 3, dtype=np.uint16)
        counts[1:25, 4:28] = single_reads(rng, angle)[0] + 3
        keys = {"BIASSEC": "[29:32,1:26]", "TRIMSEC": "[5:28,2:25]", "DATASEC": "[1:28,1:26]"}
        write(tmp_path / f"{angle}.fits", counts, POLAR=float(angle), **keys)
    found = import_images(tmp_path / "run", sorted(tmp_path.glob("*.fits")), bit_depth=12)
    assert "pictures are cut to TRIMSEC" in " ".join(found.remarks)
    frames = read_run(tmp_path / "run").frames
    assert {(one.width, one.height, one.black_level_dn) for one in frames} == {(24, 24, BLACK_DN + 3.0)}
    assert np.median(stokes(tmp_path / "run").dolp) == pytest.approx(DOLP, abs=0.05)
    assert {one.black_level_dn for one in _with_level(tmp_path, 40)} == {40.0}


def _with_level(folder, level_dn):
    files = sorted(folder.glob("*.fits"))
    import_images(folder / "stated", files, bit_depth=12, black_level_dn=level_dn)
    return read_run(folder / "stated").frames


def test_a_section_beyond_the_picture_is_named(tmp_path, capsys):
    files = [write(tmp_path / f"{k}.fits", noisy_counts(k), POLAR=60.0 * k, TRIMSEC="[1:9999,1:9]") for k in range(3)]
    assert main(["import", str(tmp_path / "run"), *map(str, files), "--bit-depth", "12", "--black-level-dn", "1"]) == 2
    assert "TRIMSEC = [1:9999,1:9] does not lie within the picture" in " ".join(capsys.readouterr().err.split())


def test_a_half_wave_plate_turns_the_axis_by_twice_its_angle():
    found, how = headers.angles_of([(Path("a"), {"RETANG": one}) for one in (0.0, 22.5, 45, "67.5")])
    assert found == (0.0, 45.0, 90.0, 135.0)
    assert "half-wave plate" in how
