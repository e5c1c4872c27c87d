"""Maps of polarization: against double precision, at the edges, and what is refused."""

import importlib.util

import numpy as np
import pytest

from model.moments import Moments
from model.processing import dolp, maps
from model.processing.maps import Engine, polarization_maps
from model.processing.reconstruction import Design, aolp_moments_rad, design

DOUBLE = np.float64
# What single precision may lose: of S0 for Stokes parameters, absolute for DoLP, over DoLP for AoLP [rad].
SINGLE = 1e-6

needs_numba = pytest.mark.skipif(
    importlib.util.find_spec("numba") is None, reason="numba is not installed: pip install 'rigctl[fast]'"
)
engines = pytest.mark.parametrize("engine", ["numpy", pytest.param("fast", marks=needs_numba)])


def frames_of(stokes: np.ndarray, plan: Design) -> np.ndarray:
    return np.einsum("nk,khw->nhw", plan.system, stokes)


def scene(shape: tuple[int, int], seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    s0 = generator.uniform(200.0, 30000.0, shape)
    degree, angle = generator.uniform(0.0, 1.0, shape), generator.uniform(0.0, np.pi, shape)
    return np.stack([s0, s0 * degree * np.cos(2.0 * angle), s0 * degree * np.sin(2.0 * angle)])


def reference(frames: np.ndarray, plan: Design) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    stokes = np.einsum("kn,nhw->khw", plan.inverse, frames.astype(DOUBLE))
    return stokes, np.hypot(stokes[1], stokes[2]) / stokes[0], 0.5 * np.arctan2(stokes[2], stokes[1]) % np.pi


def assert_within_single(found, frames: np.ndarray, plan: Design) -> None:
    stokes, degree, angle = reference(frames, plan)
    assert np.all(np.abs(found.stokes - stokes) <= SINGLE * stokes[0])
    assert np.all(np.abs(found.dolp - degree) <= SINGLE)
    off = np.abs(found.aolp_rad - angle)
    assert np.all(np.minimum(off, np.pi - off) * degree <= SINGLE)
    assert found.valid.all()


@engines
@pytest.mark.parametrize(
    "angles_deg", [(0, 60, 120), (0, 45, 90, 135), tuple(range(0, 180, 20)), tuple(range(0, 360, 45))]
)
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_maps_keep_to_single_precision_whatever_the_angles(engine: Engine, angles_deg, dtype):
    plan = design(np.deg2rad(angles_deg), 500.0)
    # 41 x 613 pixels: neither a row nor a block comes out even.
    frames = np.round(frames_of(scene((41, 613), seed=1), plan)).astype(dtype)
    assert_within_single(polarization_maps(frames, plan, engine=engine), frames, plan)


@engines
def test_a_faint_picture_on_a_high_black_level_keeps_its_digits(engine: Engine):
    plan = design(np.deg2rad([0, 45, 90, 135]))
    dark = np.array([60000.3, 60000.7, 59999.2, 60000.5])
    frames = (60002 + np.round(frames_of(scene((20, 30), seed=2), plan) / 3000)).astype(np.uint16)
    found = polarization_maps(frames, plan, dark_dn=dark, engine=engine)
    assert_within_single(found, frames - dark[:, None, None], plan)


@engines
def test_dark_levels_may_be_one_number_one_a_frame_or_pictures(engine: Engine):
    plan = design(np.deg2rad([0, 45, 90, 135]))
    frames = np.round(frames_of(scene((20, 30), seed=3), plan) + 64.0).astype(np.uint16)
    plain = polarization_maps(frames, plan, dark_dn=64.25, engine=engine)
    for dark in (np.full(4, 64.25), np.full(frames.shape, 64.25), np.full(frames.shape, 64.25, dtype=np.float32)):
        again = polarization_maps(frames, plan, dark_dn=dark, engine=engine)
        np.testing.assert_allclose(again.stokes, plain.stokes, atol=SINGLE * plain.stokes[0].min())


@engines
def test_what_has_no_light_or_no_value_is_marked_and_nothing_else_is(engine: Engine):
    plan = design(np.deg2rad([0, 45, 90, 135]))
    frames = np.full((4, 2, 3), 100.0, dtype=np.float32)
    frames[2, 0, 0], frames[1, 0, 1], frames[:, 0, 2], frames[:, 1, 0] = np.nan, np.inf, 10.0, 5.0
    found = polarization_maps(frames, plan, dark_dn=10.0, deviations=1.0, engine=engine)
    expected = np.array([[False, False, False], [False, True, True]])
    assert np.array_equal(found.valid, expected)
    for plane in (found.dolp, found.aolp_rad, found.dolp_std, found.aolp_std_rad):
        assert np.array_equal(np.isnan(plane), ~expected)


@engines
def test_unpolarized_light_has_angle_0_and_no_known_direction(engine: Engine):
    plan = design(np.deg2rad([0, 90, 0, 90, 45, 135]))
    found = polarization_maps(np.full((6, 1, 1), 100, dtype=np.uint16), plan, deviations=2.0, engine=engine)
    stokes = found.stokes[:, 0, 0]
    assert abs(found.dolp[0, 0]) < SINGLE
    assert 0.0 <= found.aolp_rad[0, 0] < np.pi
    assert stokes[0] == pytest.approx(200.0, rel=SINGLE)


@engines
def test_threads_fill_the_same_maps(engine: Engine, monkeypatch: pytest.MonkeyPatch):
    plan = design(np.deg2rad([0, 45, 90, 135]))
    frames = np.random.default_rng(3).integers(100, 4000, (4, 61, 67), dtype=np.uint16)
    alone = polarization_maps(frames, plan, dark_dn=64.3, engine=engine)
    monkeypatch.setattr(maps, "_PIXELS_A_THREAD", 1000)
    monkeypatch.setattr("os.cpu_count", lambda: 3)
    together = polarization_maps(frames, plan, dark_dn=64.3, engine=engine)
    for name in ("stokes", "dolp", "aolp_rad", "valid"):
        np.testing.assert_array_equal(getattr(together, name), getattr(alone, name))


def test_memory_is_taken_again_once_no_view_of_it_is_left():
    plan = design(np.deg2rad([0, 45, 90, 135]))
    frames = np.random.default_rng(5).integers(100, 4000, (4, 40, 50), dtype=np.uint16)
    first = polarization_maps(frames, plan)
    address, row = first.stokes.ctypes.data, first.aolp_rad[3:4, ::2]
    expected = row.copy()
    del first
    second = polarization_maps(frames[::-1], plan)
    assert np.array_equal(row, expected)
    assert second.stokes.ctypes.data != address
    del row
    assert polarization_maps(frames, plan).stokes.ctypes.data == address


@engines
def test_an_angle_just_below_zero_does_not_round_to_pi(engine: Engine):
    plan = design(np.deg2rad([0, 45, 90, 135]))
    frames = np.array([1000.0, 500.0 - 3e-5, 0.0, 500.0 + 3e-5], dtype=np.float32).reshape(4, 1, 1)
    found = polarization_maps(frames, plan, engine=engine)
    assert found.aolp_rad[0, 0] < np.pi


@engines
@pytest.mark.parametrize("by_pixel", [False, True])
def test_deviations_are_those_of_first_order(engine: Engine, by_pixel):
    plan = design(np.deg2rad([0, 45, 90, 135]), 300.0)
    frames = frames_of(scene((6, 7), seed=4), plan).astype(np.float32)
    sigma = np.array([3.0, 5.0, 2.0, 4.0])
    given = np.broadcast_to(sigma[:, None, None], frames.shape) if by_pixel else sigma
    found = polarization_maps(frames, plan, deviations=given, engine=engine)
    cov = plan.inverse @ np.diag(sigma**2) @ plan.inverse.T
    stokes = np.moveaxis(reference(frames, plan)[0], 0, -1)
    expected = np.sqrt(dolp.first_order(stokes, np.broadcast_to(cov, (*stokes.shape, 3))).variance)
    # First order in the picture's own Stokes parameters: their rounding enters relative to the deviation.
    np.testing.assert_allclose(found.dolp_std, expected, rtol=1e-4)
    for row, column in ((0, 0), (3, 4), (5, 6)):
        angle = aolp_moments_rad(Moments(mean=stokes[row, column], cov=cov))
        assert found.aolp_std_rad[row, column] == pytest.approx(np.sqrt(angle.cov).item(), rel=1e-4)


def test_a_frame_too_few_another_type_and_a_negative_deviation_are_refused():
    plan = design(np.deg2rad([0, 45, 90, 135]))
    frames = np.ones((4, 2, 2), dtype=np.uint16)
    with pytest.raises(ValueError, match=r"frames has shape \(3, 2, 2\); allowed is \(4, H, W\)"):
        polarization_maps(frames[:3], plan)
    with pytest.raises(ValueError, match="frames has type int64; allowed are uint16 and float32"):
        polarization_maps(frames.astype(np.int64), plan)
    with pytest.raises(ValueError, match=r"dark_dn has shape \(3,\)"):
        polarization_maps(frames, plan, dark_dn=[1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="deviations holds -1; allowed is 0 and above"):
        polarization_maps(frames, plan, deviations=[-1.0, 1.0, 1.0, 1.0])
