"""Diagnosis of runs of the generator of world-like frames, which shares no formula with it."""

from dataclasses import replace

import numpy as np
import pytest

from model.processing.diagnosis import Diagnosis, Term, consequence, diagnose, region_residual
from model.processing.fault_fit import (
    Cause,
    known_causes,
    parameter_count,
    place,
    rounding_offsets,
)
from model.processing.reconstruction import design
from tests.worldlike import Faults, World, expose, other_world, random_world

CLEAN_SEEDS = range(24)
FOUND_SEEDS = range(3)


def _diagnosed(world: World, faults: Faults, seed: int) -> Diagnosis:
    frames = expose(world, faults, np.random.default_rng(seed))
    angles_rad = np.radians(world.angles_deg)
    usable = np.all((frames > 0) & (frames < world.full_scale_dn), axis=0)
    counts = frames.astype(np.float64) - world.black_dn
    times = range(len(frames))
    return diagnose(design(angles_rad), counts, usable, angles_rad=angles_rad, times=times, step=1.0)


def _world(seed: int) -> World:
    return random_world(np.random.default_rng(seed), full_scale_dn=4095, black_dn=100.0)


def _named(found: Diagnosis) -> list[tuple[str, int | None]]:
    return [(term.name, term.frame) for term in found.terms if term.is_named]


def _term(found: Diagnosis, name: str, frame: int | None) -> Term:
    return next(term for term in found.terms if (term.name, term.frame) == (name, frame))


def test_runs_without_a_fault_show_none() -> None:
    worlds = [(other_world if seed % 2 else random_world)(np.random.default_rng(seed)) for seed in CLEAN_SEEDS]
    found = [_diagnosed(world, Faults(), seed) for seed, world in zip(CLEAN_SEEDS, worlds, strict=True)]
    assert sum(one.first is not None for one in found) <= 1


@pytest.mark.parametrize("seed", FOUND_SEEDS)
@pytest.mark.parametrize(
    ("faults", "name", "frame", "size"),
    [
        (Faults(throughput={1: 0.03}), "throughput", 1, 0.03),
        (Faults(angle_deg={2: 2.5}), "angle", 2, np.radians(2.5)),
        (Faults(shift_pixels={3: (1.2, -0.7)}), "shift", 3, np.hypot(1.2, 0.7)),
        (Faults(throughput={0: 0.02, 2: 0.02}), "throughput of pairs", None, 0.02 / 1.01),
        (Faults(drift=0.01), "drift", None, 0.03 / 1.015),
    ],
)
def test_a_single_fault_is_named_first_with_its_size(
    faults: Faults, name: str, frame: int | None, size: float, seed: int
) -> None:
    found = _diagnosed(_world(seed), faults, seed)
    assert found.first is not None
    alike = {(found.first.name, found.first.frame), *found.first.confused_with}
    assert (name, frame) in alike
    term = _term(found, name, frame)
    assert term.value is not None
    assert term.std_error is not None
    # A common factor of the light cannot be seen: sizes are known to their own size relatively.
    assert abs(term.value - size) < 4.5 * term.std_error + size**2


@pytest.mark.parametrize("tone", [0.8, 0.9, 1.25])
@pytest.mark.parametrize("seed", FOUND_SEEDS)
def test_a_tone_curve_is_named_as_a_response(tone: float, seed: int) -> None:
    found = _diagnosed(replace(_world(seed), black_dn=0.0), Faults(tone=tone), seed)
    assert found.first is not None
    assert found.first.name.startswith("response")
    assert _term(found, "response power law", None).value == pytest.approx(tone - 1.0, abs=0.03)


def test_a_wrong_dark_level_cannot_be_told_from_that_of_other_frames() -> None:
    found = _diagnosed(_world(1), Faults(dark_dn={1: 20.0}), 1)
    assert found.first is not None
    assert found.first.name == "dark level"
    assert {frame for _, frame in (("", found.first.frame), *found.first.confused_with)} == {0, 1, 2, 3}
    value = _term(found, "dark level", 1).value
    assert value == pytest.approx(20.0, abs=1.5)


@pytest.mark.parametrize("seed", FOUND_SEEDS)
def test_two_faults_are_both_named(seed: int) -> None:
    found = _diagnosed(_world(seed), Faults(throughput={0: 0.03}, shift_pixels={1: (0.5, 0.5)}), seed)
    assert {("throughput", 0), ("shift", 1)} <= set(_named(found))


def test_two_faults_that_two_others_do_as_well_are_named_or_among_the_stated_confusions() -> None:
    # Light of 0 against all, and S1 as a turn of 45: two throughputs of 0 and 90 do the same to the residual.
    found = _diagnosed(_world(2), Faults(throughput={0: 0.03}, angle_deg={1: 2.5}), 2)
    named = [term for term in found.terms if term.is_named]
    said = {which for term in named for which in ((term.name, term.frame), *term.confused_with)}
    assert {("throughput", 0), ("angle", 1), ("throughput", 2), ("angle", 3)} <= said


def test_a_turn_is_named_before_two_throughputs_that_would_do_the_same() -> None:
    found = _diagnosed(_world(0), Faults(angle_deg={3: 1.5}), 0)
    assert found.first is not None
    assert found.first.name == "angle"
    assert {("angle", 1), ("angle", 3)} <= {(found.first.name, found.first.frame), *found.first.confused_with}


def test_planes_of_a_mosaic_are_found_to_lie_half_a_pixel_apart_and_are_no_fault() -> None:
    corners = {0: (0.25, 0.25), 1: (0.25, -0.25), 2: (-0.25, -0.25), 3: (-0.25, 0.25)}
    world = replace(_world(3), texture=0.3)
    found = _diagnosed(world, Faults(shift_pixels=corners, throughput={0: 0.03, 2: 0.03}), 3)
    assert found.first is not None
    assert found.first.name == "throughput of pairs"
    planes = _term(found, "planes of a mosaic", None)
    assert planes.is_named
    assert planes.value == pytest.approx(0.5, abs=4.0 * (planes.std_error or 0.0))


def _diagnosed_pictures(pictures: np.ndarray, usable: np.ndarray | None = None) -> Diagnosis:
    angles_rad = np.arange(len(pictures)) * np.pi / len(pictures)
    good = np.ones(pictures.shape[1:]) if usable is None else usable
    return diagnose(design(angles_rad), pictures, good, angles_rad=angles_rad, times=range(len(pictures)))


def test_light_without_polarization_cannot_tell_a_response() -> None:
    found = _diagnosed_pictures(np.random.default_rng(7).poisson(1000.0, (4, 128, 128)).astype(np.float64))
    term = _term(found, "response curvature", None)
    assert not term.is_testable
    assert term.value is None
    assert term.reason


def test_three_angles_fit_any_frames() -> None:
    found = _diagnosed_pictures(np.full((3, 64, 64), 9.0))
    assert found.terms == ()
    assert "three angles" in found.reason


@pytest.mark.parametrize("usable_pixels", [0, 1, 40])
def test_a_picture_with_hardly_a_usable_pixel_is_not_testable(usable_pixels: int) -> None:
    found = _diagnosed_pictures(np.full((4, 64, 64), 9.0), np.arange(64 * 64).reshape(64, 64) < usable_pixels)
    assert found.reason
    assert found.first is None


@pytest.mark.parametrize("angles", [4, 6, 12])
def test_even_pictures_without_noise_show_nothing_and_end(angles: int) -> None:
    assert _diagnosed_pictures(np.full((angles, 64, 64), 77.0)).first is None


def test_edges_that_resampling_made_at_the_rim_do_not_hide_a_shift() -> None:
    found = _diagnosed(replace(_world(4), resampled_deg=2.2), Faults(shift_pixels={3: (0.4, -0.3)}), 4)
    assert found.first is not None
    assert (found.first.name, found.first.frame) == ("shift", 3)
    assert found.first.value == pytest.approx(0.5, abs=4.0 * (found.first.std_error or 0.0))


@pytest.mark.parametrize("seed", range(900, 904))
def test_small_pictures_of_many_angles_have_their_fault_named_or_the_confusion_said(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = other_world(rng, height=64, width=64)
    found = _diagnosed(world, Faults(throughput={1: 0.04}), seed)
    assert found.first is not None
    assert ("throughput", 1) in {(found.first.name, found.first.frame), *found.first.confused_with}


_TWELVE_DEG = (7.0, 12.0, 31.0, 48.0, 60.0, 77.0, 93.0, 110.0, 121.0, 139.0, 150.0, 168.0)
# Light that is hardly polarized, of small pictures: neither a response nor other sets of two do the same.
_HARDLY_POLARIZED = World(
    angles_deg=_TWELVE_DEG, height=64, width=96, scene="grain", texture_pixels=3.0, polarized=0.01
)


@pytest.mark.parametrize(
    ("faults", "names"),
    [
        (Faults(drift=0.003, dark_dn={9: 40.0}), {("drift", None), ("dark level", 9)}),
        # Neighbours that are off to either side hide each other.
        (Faults(dark_dn={0: 40.0, 1: -40.0}), {("dark level", 0), ("dark level", 1)}),
        (Faults(throughput={3: 0.02}, shift_pixels={8: (0.5, 0.5)}), {("throughput", 3), ("shift", 8)}),
    ],
)
def test_faults_that_nothing_else_does_are_named_and_no_confusion_is_said(
    faults: Faults, names: set[tuple[str, int | None]]
) -> None:
    found = _diagnosed(_HARDLY_POLARIZED, faults, 5)
    assert set(_named(found)) == names
    assert not [term.confused_with for term in found.terms if term.is_named and term.confused_with]


def test_shifts_that_pictures_hardly_tell_apart_do_not_hide_themselves() -> None:
    world = World(angles_deg=tuple(22.5 * k for k in range(8)), height=96, width=96, scene="stars", polarized=0.05)
    found = _diagnosed(world, Faults(shift_pixels={5: (-0.4, -0.3), 4: (0.35, -0.3)}), 6)
    assert set(_named(found)) == {("shift", 4), ("shift", 5)}


@pytest.mark.parametrize("texture_pixels", [1.6, 2.9])
def test_rounding_of_flat_parts_without_noise_is_no_fault(texture_pixels: float) -> None:
    # Each of the few levels of such a picture has a rounding error of its own, the same all over it.
    world = World(
        height=64,
        width=96,
        scene="checker",
        texture=0.2,
        texture_pixels=texture_pixels,
        blur_pixels=0.3,
        full_scale_dn=255,
        electrons=1e9,
        read_noise_dn=0.0,
        polarized=0.05,
        is_evenly_polarized=True,
    )
    assert not [_named(found) for seed in range(4) if (found := _diagnosed(world, Faults(), seed)).first]


def test_a_response_too_far_off_a_line_leaves_nothing_known_narrowly() -> None:
    found = _diagnosed(replace(_world(1), black_dn=0.0), Faults(tone=0.12, throughput={0: 0.06, 2: 0.06}), 1)
    assert found.first is not None
    assert found.first.name.startswith("response")
    for term in found.terms:
        if term.is_named:
            assert term.value is not None
            assert term.std_error is not None
            assert term.std_error >= 0.5 * abs(term.value), term.name


def test_a_response_far_off_a_line_is_said_before_what_was_measured_with_it() -> None:
    found = _diagnosed(replace(_world(1), black_dn=0.0), Faults(tone=0.8, throughput={0: 0.06, 2: 0.06}), 1)
    assert {name for name, _ in _named(found)} >= {"throughput of pairs"}
    assert found.first is not None
    assert found.first.name.startswith("response")


PLAN = design(np.radians([0.0, 45.0, 90.0, 135.0]))
STOKES = np.array([200.0, 40.0, -30.0])


def _parameters(kind: str, frame: int, size: float) -> np.ndarray:
    found = np.zeros(parameter_count(4))
    found[place(kind, frame, 4)] = size
    return found


@pytest.mark.parametrize(
    ("kind", "size", "counts"),
    [
        ("throughput", 0.03, PLAN.system @ STOKES * np.array([1.03, 1.0, 1.0, 1.0])),
        ("response curvature", -0.05, PLAN.system @ STOKES - 0.05 * (PLAN.system @ STOKES) ** 2 / 100.0),
    ],
)
def test_a_fault_taken_out_gives_the_light_back(kind: str, size: float, counts: np.ndarray) -> None:
    shift, _ = consequence(PLAN.system, counts, _parameters(kind, 0, size), light=100.0)
    wrong = PLAN.inverse @ counts
    assert shift == pytest.approx(np.hypot(*wrong[1:]) / wrong[0] - 0.25, abs=1e-12)


def test_a_turned_angle_moves_the_polarization_by_what_it_says() -> None:
    turned = design(np.radians([0.0, 47.0, 90.0, 135.0]))
    counts = turned.system @ STOKES
    shift, turn_rad = consequence(PLAN.system, counts, _parameters("angle", 1, np.radians(2.0)), light=100.0)
    wrong = PLAN.inverse @ counts
    assert shift == pytest.approx(np.hypot(*wrong[1:]) / wrong[0] - 0.25, abs=1e-12)
    assert turn_rad == pytest.approx(
        0.5 * (np.arctan2(wrong[2], wrong[1]) - np.arctan2(STOKES[2], STOKES[1])), abs=1e-12
    )


def test_a_shift_moves_the_polarization_of_a_slope_and_of_nothing_even() -> None:
    counts, moved = PLAN.system @ STOKES, _parameters("shift x", 2, 0.5)
    slopes = np.column_stack([np.full(4, 3.0), np.full(4, 7.0)])
    # A picture that walks to the right brings what was half a pixel to the left: less, where it rises to the right.
    counts_walked = counts - np.array([0.0, 0.0, 1.5, 0.0])
    wrong = PLAN.inverse @ counts_walked
    shift, _ = consequence(PLAN.system, counts_walked, moved, light=100.0, slopes=slopes)
    assert shift == pytest.approx(np.hypot(*wrong[1:]) / wrong[0] - 0.25, abs=1e-12)
    assert consequence(PLAN.system, counts, moved, light=100.0)[0] == pytest.approx(0.0, abs=1e-15)


def test_light_without_polarization_has_no_angle_to_move() -> None:
    found = consequence(PLAN.system, np.full(4, 100.0), _parameters("dark level", 0, 0.0), light=100.0)
    assert found == (pytest.approx(0.0, abs=1e-15), None)


def test_texture_that_cancels_in_the_residual_makes_no_error() -> None:
    draws = np.random.default_rng(4)
    texture = draws.uniform(0.5, 1.5, (64, 64))
    pictures = (PLAN.system @ STOKES)[:, None, None] * texture
    found = region_residual(PLAN, pictures, np.ones((64, 64), dtype=bool))
    assert np.max(np.abs(found.cov)) < 1e-20


def test_error_of_a_residual_is_that_of_its_noise() -> None:
    draws = np.random.default_rng(6)
    pictures = 100.0 + draws.normal(0.0, 2.0, (4, 96, 96))
    found = region_residual(PLAN, pictures, np.ones((96, 96), dtype=bool))
    # The widest of several estimates from a few dozen blocks: up to about half more than the truth.
    assert 1.0 <= np.trace(found.cov) / (4.0 / 96**2) < 2.0


@pytest.mark.parametrize(
    ("kind", "size"),
    [("response curvature", -0.54), ("response power law", -3.4), ("throughput", -1.4), ("angle", 20.0)],
)
def test_a_fault_too_large_to_be_undone_moves_the_polarization_by_an_unknown_amount(kind: str, size: float) -> None:
    counts = PLAN.system @ STOKES
    assert consequence(PLAN.system, counts, _parameters(kind, 0, size), light=100.0) == (None, None)


FOUR = np.radians([0.0, 45.0, 90.0, 135.0])


def _names(angles_deg: list[float]) -> list[tuple[str, int | None]]:
    causes = known_causes(np.radians(angles_deg), range(len(angles_deg)), light=100.0)
    return [(cause.name, cause.frame) for cause in causes]


def _left_over(cause: Cause) -> np.ndarray:
    """Return what a cause leaves in the residual, for light of three kinds, at four angles."""
    plan = design(FOUR)
    turned = np.column_stack([np.zeros(4), -2.0 * plan.system[:, 2], 2.0 * plan.system[:, 1]])
    effect = cause.directions[:4, 0, None] * plan.system + cause.directions[4:8, 0, None] * turned
    return np.asarray(plan.null_basis.T @ effect).ravel()


def test_two_orthogonal_pairs_are_held_against_one_another_once() -> None:
    assert _names([0, 45, 90, 135]).count(("throughput of pairs", None)) == 1


def test_whole_turns_show_a_wedge_and_a_wobble_and_half_turns_do_not() -> None:
    assert ("wobble", None) in _names(list(range(0, 360, 45)))
    assert ("wobble", None) not in _names([0, 45, 90, 135])


def test_frames_of_the_same_time_show_no_drift() -> None:
    causes = known_causes(FOUR, [1.0, 1.0, 1.0, 1.0], light=100.0)
    assert not any(cause.name == "drift" for cause in causes)


def test_the_two_of_a_pair_against_one_another_are_a_turn_of_either_of_the_other_two() -> None:
    causes = {(cause.name, cause.frame): cause for cause in known_causes(FOUR, range(4), light=100.0)}
    left = [_left_over(causes[which]) for which in (("throughput within a pair", 0), ("angle", 1), ("angle", 3))]
    unit = [one / np.linalg.norm(one) for one in left]
    assert abs(abs(unit[0] @ unit[1]) - 1.0) < 1e-12
    assert abs(unit[1] @ unit[2] + 1.0) < 1e-12


def test_rounding_moves_a_level_by_a_step_over_the_root_of_twelve_and_noise_makes_it_harmless() -> None:
    whole = np.ones((64, 64), dtype=bool)
    np.testing.assert_allclose(rounding_offsets(np.full((4, 64, 64), 7.0), whole, step=2.0), 2.0 / 12.0**0.5, rtol=0.02)
    noisy = np.rint(np.random.default_rng(5).normal(50.0, 1.0, (4, 64, 64)))
    assert np.all(rounding_offsets(noisy, whole, step=1.0) < 1e-3)
