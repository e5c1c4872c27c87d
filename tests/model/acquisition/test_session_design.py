from dataclasses import replace

import numpy as np
import pytest

from model.acquisition import PATTERNS, Disturbances, Session, cycle_light, dolp_budget
from model.moments import Moments
from model.sensor import electrons_per_radiance
from tests.model.sensors import sensor

ANGLES = tuple(np.radians([0.0, 90.0, 45.0, 135.0]))
LIGHT = np.array([30.0, 6.0, -3.0])
GRAY = np.array([30.0, 0.0, 0.0])
STILL = Disturbances()
DRIFT_PER_S = 1e-4


def light(stokes=LIGHT, angles=ANGLES, **changes):
    return cycle_light(Moments(mean=stokes, cov=np.zeros((3, 3))), sensor=sensor(**changes), angles_rad=angles)


def session(**changes):
    return Session(**({"angles_rad": ANGLES, "exposure_s": 30e-6, "overhead_s": 0.5} | changes))


def stokes_of(counts, angles=ANGLES):
    """Least squares, written out."""
    rows = 0.5 * np.stack([np.ones(len(angles)), np.cos(2 * np.array(angles)), np.sin(2 * np.array(angles))], axis=1)
    return np.linalg.lstsq(rows, np.moveaxis(counts, -1, 0).reshape(len(angles), -1), rcond=None)[0].T


def drawn_dolp(stokes, *, cycles, draws, seed, device):
    """DoLP of pixels whose frames were drawn: photons, read noise, rounding; the mean of all cycles."""
    rng = np.random.default_rng(seed)
    rows = 0.5 * np.stack([np.ones(4), np.cos(2 * np.array(ANGLES)), np.sin(2 * np.array(ANGLES))], axis=1)
    mean_e = electrons_per_radiance(device) * rows @ stokes
    noise = device.noise
    electrons = rng.poisson(mean_e, (draws, cycles, 4)) + rng.normal(0.0, noise.read_noise_e, (draws, cycles, 4))
    counts = np.round(noise.gain_dn_per_e * electrons + noise.black_level_dn) - noise.black_level_dn
    s0, s1, s2 = stokes_of(counts.mean(axis=1)).T
    return np.hypot(s1, s2) / s0


@pytest.mark.parametrize(("stokes", "cycles"), [(LIGHT, 1), (LIGHT, 6), (GRAY, 4)])
def test_sigma_is_that_of_drawn_frames(stokes, cycles):
    draws = 20_000
    found = drawn_dolp(stokes, cycles=cycles, draws=draws, seed=3, device=sensor())
    budget = dolp_budget(light(stokes), session(cycles=cycles), STILL)
    # A standard deviation of n draws has the relative error 1 / sqrt(2 n) for normal values; five of them.
    assert np.std(found) == pytest.approx(budget.sigma, rel=5.0 / np.sqrt(2.0 * draws))


def test_pixels_that_are_averaged_count_like_cycles():
    together = dolp_budget(light(), session(cycles=3), STILL, pixels=4)
    assert together.sigma == pytest.approx(dolp_budget(light(), session(cycles=12), STILL).sigma)


@pytest.mark.parametrize(
    ("order_deg", "share"), [((0, 45, 90, 135), 0.4714), ((0, 90, 45, 135), 0.2357), ((0, 45, 135, 90), 0.5270)]
)
def test_false_polarization_of_an_order_by_drift(order_deg, share):
    angles = tuple(np.radians(order_deg))
    frames = session(angles_rad=angles)
    change = 3.0 * frames.frame_s * DRIFT_PER_S  # from the first frame to the last
    budget = dolp_budget(light(GRAY, angles), frames, Disturbances(drift_per_s=DRIFT_PER_S))
    assert budget.drift_error == pytest.approx(share * change, rel=2e-4)  # four digits of the closed form


def frames_of(taken):
    """Number of the angle of every frame, written out."""
    order = {"cycles": [0, 1, 2, 3] * taken.cycles, "grouped": np.repeat(range(4), taken.cycles).tolist()}
    back_and_forth = [k for cycle in range(taken.cycles) for k in ([0, 1, 2, 3], [3, 2, 1, 0])[cycle % 2]]
    return np.array((order | {"palindrome": back_and_forth})[taken.pattern])


def mean_counts(taken, intensities):
    order = frames_of(taken)
    return np.array([np.mean(intensities[order == k]) for k in range(4)])


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("cycles", [1, 3, 4])
@pytest.mark.parametrize("stokes", [LIGHT, GRAY])
def test_drift_error_is_that_of_frames_written_out(pattern, cycles, stokes):
    taken = session(cycles=cycles, pattern=pattern)
    order = frames_of(taken)
    rows = 0.5 * np.stack([np.ones(4), np.cos(2 * np.array(ANGLES)), np.sin(2 * np.array(ANGLES))], axis=1)
    time_s = taken.frame_s * (np.arange(order.size) - 0.5 * (order.size - 1))
    measured = stokes_of(mean_counts(taken, (rows @ stokes)[order] * (1.0 + DRIFT_PER_S * time_s)))[0]
    expected = np.hypot(*(measured[1:] / measured[0] - stokes[1:] / stokes[0]))
    budget = dolp_budget(light(stokes), taken, Disturbances(drift_per_s=DRIFT_PER_S))
    # To first order in the change of the light over the session, which is 8e-4 at most.
    assert budget.drift_error == pytest.approx(expected, rel=1e-3, abs=1e-12)


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("cycles", [1, 4])
def test_settling_error_is_that_of_frames_written_out(pattern, cycles):
    taken = session(cycles=cycles, pattern=pattern, settle_s=0.06)
    order = frames_of(taken)
    aimed = np.array(ANGLES)[order]
    stands = aimed - np.diff(aimed, prepend=aimed[0]) * np.exp(-6.0)
    rows = 0.5 * np.stack([np.ones(order.size), np.cos(2 * stands), np.sin(2 * stands)], axis=1)
    measured = stokes_of(mean_counts(taken, rows @ LIGHT))[0]
    expected = np.hypot(*(measured[1:] / measured[0] - LIGHT[1:] / LIGHT[0]))
    budget = dolp_budget(light(), taken, Disturbances(settling_time_s=0.01))
    # To first order in what is left of a turn of 90 deg, 4e-3 rad.
    assert budget.settling_error == pytest.approx(expected, rel=2e-2)


def test_noise_and_systematic_errors_add_up_as_stated():
    budget = dolp_budget(
        light(),
        session(settle_s=0.02),
        Disturbances(drift_per_s=DRIFT_PER_S, settling_time_s=0.01),
    )
    systematic = budget.drift_error + budget.settling_error
    assert min(budget.drift_error, budget.settling_error) > 0.0
    assert budget.total == pytest.approx(np.sqrt(budget.sigma**2 + systematic**2))


def test_light_too_weak_has_no_sigma():
    faint = light(0.003 * LIGHT)
    assert np.isnan(dolp_budget(faint, session(), STILL).sigma)


def test_times_of_a_session():
    taken = session(cycles=5, exposure_s=0.2, settle_s=0.3, overhead_s=0.5)
    assert (taken.frames, taken.frame_s) == (20, pytest.approx(1.0))
    assert taken.duration_s == pytest.approx(20.0)


@pytest.mark.parametrize("change", [{"cycles": 0}, {"exposure_s": 0.0}, {"settle_s": -1.0}, {"overhead_s": np.nan}])
def test_impossible_sessions_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        session(**change)


@pytest.mark.parametrize("change", [{"drift_per_s": np.inf}, {"settling_time_s": -1.0}])
def test_impossible_disturbances_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        replace(STILL, **change)


def test_light_of_other_angles_is_refused():
    with pytest.raises(ValueError, match="light of 3 angles"):
        dolp_budget(light(angles=tuple(np.radians([0.0, 60.0, 120.0]))), session(), STILL)
