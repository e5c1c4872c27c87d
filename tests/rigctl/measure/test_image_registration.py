"""Frames that walk while the polarizer turns, moved back by a registration: a scene that is known at every point."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import TypeAdapter

from rigctl.calibrations.registration import ImageRegistration, register_run
from rigctl.errors import DataError
from rigctl.files.regions import Rectangle, Region
from rigctl.measure.frames import RunCalibrations
from rigctl.measure.measure import Measurement, measure, temporal_noise, temporal_variance
from rigctl.runs.folder import Run
from tests.rigctl.made_runs import at, make_run
from tests.rigctl.noise_records import noise_parameters

FloatArray = NDArray[np.float64]

SIZE = (180, 200)
STAGE_DEG = (0.0, 45.0, 90.0, 135.0)
RADIUS = 0.6
GAIN, READ_NOISE_E, BLACK_DN, DOLP, AOLP_DEG = 0.25, 8.0, 64.0, 0.2, 30.0
REGION = Region(name="a", rectangle=Rectangle(x=10, y=10, width=170, height=150))
NOISE = noise_parameters(
    {
        "gain_dn_per_e": {"value": GAIN, "std_error": 1e-5, "n": 10},
        "read_noise_e": {"value": READ_NOISE_E, "std_error": 1e-3, "n": 10},
        "dark_current_e_per_s": None,
        "black_level_dn": {"value": BLACK_DN, "std_error": 0.0, "n": 10},
        "covariance": None,
    }
)


def shift(stage_deg: float) -> FloatArray:
    """Walk of the picture against that at stage angle 0 (x, y)."""
    walk = RADIUS * (np.exp(1j * np.radians(stage_deg + 20.0)) - np.exp(1j * np.radians(20.0)))
    return np.array([walk.real, walk.imag])


def electrons(moved: FloatArray) -> FloatArray:
    """S0 of a sum of waves, at points that are given: no interpolation is needed to move it."""
    draws = np.random.default_rng(7)
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float64)
    level = np.full(SIZE, 6000.0)
    for period in (12.0, 17.0, 25.0, 40.0, 60.0):
        for _ in range(3):
            direction, phase = draws.uniform(0.0, np.pi), draws.uniform(0.0, 2.0 * np.pi)
            along = (x - moved[0]) * np.cos(direction) + (y - moved[1]) * np.sin(direction)
            level += 350.0 * np.cos(2.0 * np.pi * along / period + phase)
    return level


def walking_run(path: Path, *, cycles: int = 6, bad: bool = False) -> Run:
    draws = np.random.default_rng(2)
    frames = []
    for cycle in range(cycles):
        for stage_deg in STAGE_DEG:
            malus = 0.5 * (1.0 + DOLP * np.cos(2.0 * np.radians(stage_deg - AOLP_DEG)))
            light = draws.poisson(electrons(shift(stage_deg)) * malus) + READ_NOISE_E * draws.standard_normal(SIZE)
            counts = np.rint(GAIN * light + BLACK_DN)
            if bad and stage_deg == 45.0:
                counts[50, 60] = 4095.0
            facts = at(stage_deg, stage_angle_deg=stage_deg, cycle=cycle, exposure_s=0.01, black_level_dn=BLACK_DN)
            frames.append((facts, counts))
    return make_run(path, frames)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return walking_run(tmp_path_factory.mktemp("walking") / "run")


@pytest.fixture(scope="module")
def registration(run: Run) -> ImageRegistration:
    return TypeAdapter(ImageRegistration).validate_python(register_run(run)[0])


@pytest.fixture(scope="module")
def moved(run: Run, registration: ImageRegistration) -> Measurement:
    return measure(run, regions=[REGION], calibrations=RunCalibrations(noise=NOISE, registration=registration))


def dolp(measurement: Measurement) -> FloatArray:
    s0, s1, s2 = np.einsum("kn,nij->kij", measurement.plan.inverse, measurement.channels)[:, 10:160, 10:180]
    return np.asarray(np.hypot(s1, s2) / s0)


def test_the_walk_is_known_to_a_fiftieth_of_a_pixel(registration: ImageRegistration) -> None:
    assert registration.wander is not None
    assert np.hypot(*registration.wander.turning_pixels) == pytest.approx(RADIUS, abs=0.02)
    for stage_deg in STAGE_DEG:
        np.testing.assert_allclose(registration.shift_pixels(stage_deg, against_deg=0.0), shift(stage_deg), atol=0.03)


def test_false_polarization_at_edges_goes_away(run: Run, moved: Measurement) -> None:
    before, after = (
        np.std(dolp(one)) for one in (measure(run, regions=[REGION], calibrations=RunCalibrations(noise=NOISE)), moved)
    )
    # Noise alone: sqrt(2) / sqrt(6000 * 6 cycles) is 0.0075 or less where pixels were mixed.
    assert before > 0.015
    assert after < 0.009


def test_temporal_noise_is_predicted_with_what_moving_does_to_it(moved: Measurement) -> None:
    factor = moved.noise_factor
    assert factor[0] == 1.0
    assert np.all(factor[1:] < 0.9)
    region = moved.regions["a"]
    predicted = np.sqrt(temporal_variance(moved, region, temporal_noise(NOISE).values))
    # 25 500 pixels, 5 degrees of freedom each: 0.2 % and, since neighbours are alike, at most twice that.
    for name, deviation in zip(moved.grid.channel_names, predicted, strict=True):
        assert region.quantities[name]["std_temporal"].value == pytest.approx(deviation, rel=5.0 * 0.004)


def test_the_margin_that_not_every_frame_shows_is_missing(moved: Measurement) -> None:
    assert moved.shifts is not None
    # The walk is 1.2 * sin(67.5 deg) at most.
    assert moved.shifts.margin_pixels == 2
    assert moved.frames.missing[:2].all()
    assert moved.frames.missing[:, -2:].all()
    assert not moved.frames.missing[2:-2, 2:-2].any()


def test_pixels_that_take_part_of_a_saturated_one_are_saturated(
    tmp_path: Path, registration: ImageRegistration
) -> None:
    found = measure(
        walking_run(tmp_path / "run", cycles=1, bad=True),
        regions=[],
        calibrations=RunCalibrations(noise=NOISE, registration=registration),
    )
    # One bad pixel is part of four when it is moved by parts of a pixel both ways.
    assert found.frames.saturated.sum() == 4
    y, x = np.argwhere(found.frames.saturated).mean(axis=0)
    assert (x, y) == pytest.approx((60.0, 50.0) - shift(45.0), abs=0.51)


def test_shifts_without_a_circle_are_looked_up_by_angle() -> None:
    content = {
        "schema_version": 1,
        "kind": "registration",
        "made_for": {},
        "wander": {"turning_pixels": [0.5, 0.0], "sense": 1, "residual_pixels": 0.3},
        "angles": [
            {"angle_deg": 0.0, "shift_pixels": [0.0, 0.0]},
            {"angle_deg": 359.5, "shift_pixels": [0.8, 0.1]},
        ],
    }
    found = TypeAdapter(ImageRegistration).validate_python(content)
    assert found.shift_pixels(-0.7, against_deg=0.1) == pytest.approx([0.8, 0.1])
    with pytest.raises(DataError, match="no shift for 45"):
        found.shift_pixels(45.0, against_deg=0.0)


def test_a_shift_that_shows_is_a_finding(run: Run, registration: ImageRegistration) -> None:
    finding = register_run(run)[0]["finding"] or ""
    assert finding.startswith("shifted_frames: the picture at 45.0 deg lies 0.4")
    # Every picture that is shifted is named.
    assert "at 90.0 deg lies 0.8" in finding
    assert "at 135.0 deg lies 1.1" in finding
    first = [record for record in run.frames if record.stage_angle_deg == 0.0][:2]
    still = make_run(
        run.path.parent / "still",
        [(at(45.0 * k, cycle=0, stage_angle_deg=45.0 * k), run.counts(record)) for k, record in enumerate(first)],
    )
    assert register_run(still)[0]["finding"] is None
