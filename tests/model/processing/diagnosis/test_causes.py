import numpy as np

from model.processing.fault_fit import Cause, known_causes
from model.processing.reconstruction import design

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
