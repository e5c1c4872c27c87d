"""The fault matrix of stages, with few seeds, and some cells of cameras; `benchmarks.trials.fault_matrix` runs all."""

import pytest

from benchmarks.trials.camera_faults import CAMERA_FAULTS, run_camera_cell
from benchmarks.trials.fault_matrix import FAMILIES, FAULTS, OPERATIONS, Fault, run_cell
from tests.sim_devices.cameras.gige_port import gige_port

CELLS = [(family, fault) for family in FAMILIES for fault in FAULTS if family in fault.keys]


@pytest.mark.parametrize(("family", "fault"), CELLS, ids=[f"{family}-{fault.name}" for family, fault in CELLS])
def test_ends_in_the_right_angle_or_the_right_error_in_time(family: str, fault: Fault) -> None:
    for operation in OPERATIONS:
        for seed in range(2 if fault.is_random else 1):
            outcome = run_cell(family, fault, operation, seed=seed)
            assert outcome is None or outcome.is_right, (operation, seed, outcome)


def test_a_wrong_angle_would_be_seen() -> None:
    """A stage that goes to 0 instead and is believed: the tolerance of the driver is the whole circle's."""
    fault = Fault(name="moves are not corrected", keys={"ellx": "landing=5&seed=3"})
    outcome = run_cell("ellx", fault, "move", seed=0)
    assert outcome is not None
    assert not outcome.is_right  # LimitError, which this fault does not allow


# A silent camera's pictures, with their deadline: tests/drivers/cameras/test_gige_faults.py.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("its power goes and comes back here", "set"),
        ("1 % of packets lost, sent again", "take"),
        ("5 % of packets lost, not sent again", "open"),
    ],
)
def test_a_camera_gives_the_right_picture_or_the_right_error_in_time(name: str, call: str) -> None:
    (fault,) = (fault for fault in CAMERA_FAULTS if fault.name == name)
    with gige_port():
        outcome = run_camera_cell(fault, call)
    assert outcome is not None
    assert outcome.is_right, outcome
