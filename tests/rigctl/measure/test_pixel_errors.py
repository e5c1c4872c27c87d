"""Errors of single pixels, held against independent frames by plain numpy, and the file that has them."""

from dataclasses import replace

import numpy as np
import pytest
from astropy.io import fits
from astropy.nddata import CCDData
from astropy.wcs import WCS

from rigctl.base.numbers import covariance_rows
from rigctl.measure.measure import measure
from rigctl.measure.pixel_errors import Doubt, pixel_errors
from rigctl.report.stokes_file import stokes_fits
from rigctl.runs.records import PolarizerAsTaken, RigAsTaken
from rigctl.verbs.stokes import stokes
from tests.rigctl.made_runs import at, make_run
from tests.rigctl.noise_records import noise_parameters

ANGLES_DEG, SHAPE = np.array([0.0, 45.0, 90.0, 135.0]), (30, 32)
GAIN, READ_NOISE_E, BLACK_DN = 0.5, 8.0, 50.0
# A gradient of S0 from 300 to 3000 electrons, of DoLP from 0 to 0.6.
S0_E = np.broadcast_to(np.linspace(300.0, 3000.0, SHAPE[1]), SHAPE)
DOLP = np.broadcast_to(np.linspace(0.0, 0.6, SHAPE[0])[:, None], SHAPE)
AOLP_RAD = 0.4
TRUE_DN = GAIN * np.array([S0_E, S0_E * DOLP * np.cos(2 * AOLP_RAD), S0_E * DOLP * np.sin(2 * AOLP_RAD)])
SESSIONS = 12


def frame(rng, angle_deg):
    light_e = 0.5 * S0_E * (1.0 + DOLP * np.cos(2.0 * (np.radians(angle_deg) - AOLP_RAD)))
    counts = GAIN * (rng.poisson(light_e) + rng.normal(0.0, READ_NOISE_E, SHAPE)) + BLACK_DN
    return np.clip(np.rint(counts), 0, 4095)


def session(path, seed, *, cycles, angles=ANGLES_DEG, change=lambda counts, cycle: counts):
    rng = np.random.default_rng(seed)
    frames = [
        (at(angle, cycle=cycle, black_level_dn=BLACK_DN, exposure_s=0.01), change(frame(rng, angle), cycle))
        for cycle in range(cycles)
        for angle in angles
    ]
    return make_run(path, frames)


def noise_calibration():
    known = {"gain_dn_per_e": GAIN, "read_noise_e": READ_NOISE_E, "black_level_dn": BLACK_DN}
    return noise_parameters({name: {"value": value, "std_error": 0.0, "n": 1} for name, value in known.items()})


@pytest.mark.parametrize(
    ("cycles", "calibrated", "source", "tolerance"),
    [
        # Of the noise that is known: sampling of the chi-square alone, 3 in each of 11520 pixels.
        (1, True, "the noise calibration", 0.0),
        (3, True, "the noise calibration", 0.0),
        # Of the noise that each session shows itself: 3 % of a variance by 3840 squares.
        (3, False, "the scatter over 3 cycles", 0.03),
        # A line over the mean of the angles does not know which of them is bright.
        (1, False, "how well the angles agree", 0.06),
    ],
)
def test_chi_square_of_every_pixel_over_repeated_sessions_is_1(tmp_path, cycles, calibrated, source, tolerance):
    total = []
    for seed in range(SESSIONS):
        measured = measure(session(tmp_path / str(seed), seed, cycles=cycles), regions=[])
        errors = pixel_errors(measured, noise_calibration() if calibrated else None)
        assert errors.source == source
        apart = (measured.images.stokes - TRUE_DN).reshape(3, -1).T
        cov = errors.cov.reshape(3, 3, -1).transpose(2, 0, 1).astype(np.float64)
        total.append(np.einsum("pi,pij,pj->p", apart, np.linalg.inv(cov), apart))
    chi_squares = np.array(total)
    sampling = np.sqrt(2.0 * 3.0 / chi_squares.size) / 3.0
    assert chi_squares.mean() / 3.0 == pytest.approx(1.0, abs=4.0 * sampling + tolerance)
    # Dark and bright pixels by themselves: the error follows the light.
    by_column = chi_squares.reshape(SESSIONS, *SHAPE).mean(axis=(0, 1)) / 3.0
    assert np.abs(by_column - 1.0).max() < 5.0 * np.sqrt(2.0 / 3.0 / (SESSIONS * SHAPE[0])) + 5.0 * tolerance


def test_errors_of_dolp_and_aolp_are_the_scatter_over_sessions(tmp_path):
    found = [measure(session(tmp_path / str(k), k, cycles=2), regions=[]) for k in range(SESSIONS)]
    errors = pixel_errors(found[0], noise_calibration())
    # To first order where DoLP is many errors: rows of DoLP above 0.3, columns of much light.
    part = np.s_[16:, 12:]
    dolp = np.std([one.images.dolp for one in found], axis=0, ddof=1)[part]
    aolp = np.std([one.images.aolp_deg for one in found], axis=0, ddof=1)[part]
    freedom = (SESSIONS - 1) * dolp.size
    for scatter, error in ((dolp, errors.dolp[part]), (aolp, errors.aolp_deg[part])):
        assert np.mean(np.square(scatter / error)) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / freedom) + 0.03)


def test_one_cycle_of_three_angles_shows_no_noise(tmp_path):
    measured = measure(session(tmp_path / "run", 1, cycles=1, angles=(0.0, 60.0, 120.0)), regions=[])
    errors = pixel_errors(measured, None)
    assert errors.source.startswith("not determined")
    assert np.isnan(errors.cov).all()
    assert np.isnan(errors.dolp).all()


def test_doubts_of_pixels_are_bits(tmp_path):
    def change(counts, cycle):
        counts[2, 3] = 4095
        counts[4, 5] = 0
        if cycle == 1:
            counts[6, 7] += 2000
        return counts

    errors = pixel_errors(measure(session(tmp_path / "run", 1, cycles=3, change=change), regions=[]), None)
    doubted = {tuple(place): int(errors.doubts[tuple(place)]) for place in np.argwhere(errors.doubts)}
    assert doubted == {(2, 3): Doubt.SATURATED, (4, 5): Doubt.AT_ZERO, (6, 7): Doubt.HIT}


def test_stokes_fits_opens_in_astropy_with_its_errors(tmp_path):
    run = session(tmp_path / "run", 1, cycles=2)
    found = stokes(run.path, out=tmp_path / "out")
    path = tmp_path / "out" / "stokes.fits"
    data = CCDData.read(path, hdu_uncertainty="ERR")
    np.testing.assert_allclose(data.data, found.measurement.images.stokes)
    variances = np.array([found.errors.cov[k, k] for k in range(3)])
    np.testing.assert_allclose(np.square(data.uncertainty.array), variances, rtol=1e-5)
    assert str(data.unit) == "DN"
    with fits.open(path, checksum=True) as units:
        units.verify("exception")
        names = ["SCI", "ERR", "COV", "DQ", "DOLP", "DOLP_ERR", "AOLP", "AOLP_ERR", "CALERR"]
        assert [unit.name for unit in units] == names
        errors = {name: units[name].header["ERRTYPE"] for name in ("ERR", "COV", "CALERR")}
        assert errors == {"ERR": "noise", "COV": "noise", "CALERR": "calibration"}
        np.testing.assert_allclose(units["COV"].data[0], found.errors.cov[0, 1])
        np.testing.assert_allclose(units["DOLP"].data, found.dolp)
        np.testing.assert_array_equal(units["DQ"].data, found.errors.doubts)
        header = units["SCI"].header
    assert list(WCS(header).wcs.ctype) == ["X", "Y", "STOKES"]
    # SAOImage DS9 refuses an axis that has a type and no scale.
    assert all(f"{key}{axis}" in header for key in ("CRPIX", "CRVAL", "CDELT") for axis in (1, 2, 3))
    assert (header["POLCCONV"], header["POLCANGL"], header["NCYCLES"]) == ("(+X,-Y,+Z)", 0.0, 2)
    assert header["POLANGS"] == "0.0000, 45.0000, 90.0000, 135.0000"


def test_the_mean_of_reads_has_the_noise_of_a_mean(tmp_path):
    measured = measure(session(tmp_path / "run", 1, cycles=1), regions=[])
    one = pixel_errors(measured, noise_calibration())
    records = tuple(tuple(replace(record, reads=9, real_counts=True) for record in c) for c in measured.grid.records)
    measured.frames.grid = replace(measured.grid, records=records)
    nine = pixel_errors(measured, noise_calibration())
    np.testing.assert_allclose(one.cov, 9.0 * nine.cov, rtol=1e-5, atol=1e-9)


def test_what_all_pixels_share_stands_by_itself_and_is_that_of_the_regions(tmp_path):
    """Dark frames whose mean is known to some tenths of a count: of S0, twice as much as of an angle."""
    made = session(tmp_path / "run", 1, cycles=2)
    measured = measure(made, regions=[])
    measured.frames.dark_level = replace(measured.frames.dark_level, std_error_dn=0.25)
    found = pixel_errors(measured, noise_calibration())
    np.testing.assert_allclose(found.calibration[0], 0.5, rtol=1e-6)
    np.testing.assert_allclose(found.calibration[1:], 0.0, atol=1e-6)
    # At exact angles S1 and S2 have no frame in common.
    assert not found.cov[1, 2].any()
    assert found.cov[0, 1].any()


def test_the_error_of_the_axis_turns_s1_into_s2(tmp_path):
    made = session(tmp_path / "run", 1, cycles=2)
    rig = RigAsTaken(polarizer=PolarizerAsTaken(offset_std_deg=0.5))
    measured = measure(replace(made, session=replace(made.session, rig=rig)), regions=[])
    found, (_, s1, s2) = pixel_errors(measured, noise_calibration()), measured.images.stokes
    turned = 2.0 * np.radians(0.5) * np.abs([0.0 * s1, s2, s1])
    np.testing.assert_allclose(found.calibration, turned, rtol=1e-5, atol=1e-9)
    header = fits.Header.fromstring(stokes_fits(measured, found, {}).decode("latin-1"))
    assert header["AXISERR"] == 0.5


def test_a_covariance_that_cancels_to_rounding_is_written_as_0():
    assert covariance_rows(np.array([[4.0, -1e-16], [-1e-16, 1.0]])) == [[4.0, 0.0], [0.0, 1.0]]
    assert str(covariance_rows(np.array([[4.0, -1e-16], [-1e-16, 1.0]]))[0][1]) == "0.0"
    assert covariance_rows(np.array([[1.0, 0.5], [0.5, 1.0]])) == [[1.0, 0.5], [0.5, 1.0]]
