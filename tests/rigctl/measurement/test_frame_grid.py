import numpy as np
import pytest

from rigctl.errors import DataError
from rigctl.measure.frames import arrange
from tests.rigctl.made_runs import at, make_run

PICTURE = np.arange(6).reshape(2, 3)


def test_angles_are_sorted_and_named_by_what_was_asked_for(tmp_path):
    grid = arrange(make_run(tmp_path / "run", [(at(a), PICTURE) for a in (0, 90, 45, 135)]))
    assert grid.channel_names == ("dn_0", "dn_45", "dn_90", "dn_135")
    assert grid.polarizer_angles_rad == pytest.approx(np.deg2rad([0, 45, 90, 135]))


def test_minus_60_is_120(tmp_path):
    assert arrange(make_run(tmp_path / "run", [(at(a), PICTURE) for a in (0, 60, -60)])).channel_names == (
        "dn_0", "dn_60", "dn_120",
    )  # fmt: skip


def test_a_readback_on_the_other_side_of_zero_is_averaged_as_an_axis(tmp_path):
    readbacks = [0.004, 179.998]
    frames = [
        (at(a, cycle=c, polarizer_angle_deg=readbacks[c] if a == 0 else float(a)), PICTURE)
        for c in (0, 1)
        for a in (0, 60, 120)
    ]
    angle_deg = np.rad2deg(arrange(make_run(tmp_path / "run", frames)).polarizer_angles_rad[0])
    assert angle_deg == pytest.approx(0.001, abs=1e-9)


def test_an_incomplete_cycle_is_left_out_and_said(tmp_path):
    frames = [(at(a, cycle=c), PICTURE) for c in (0, 1) for a in (0, 60, 120)][:-1]
    grid = arrange(make_run(tmp_path / "run", frames))
    assert grid.cycles == 1
    assert grid.left_out == ("cycle 1: incomplete, 2 of 3",)


def test_without_cycles_the_nth_frame_at_an_angle_is_of_cycle_n(tmp_path):
    grid = arrange(make_run(tmp_path / "run", [(at(a), PICTURE) for a in (0, 0, 60, 60, 120, 120)]))
    assert [[record.sequence for record in cycle] for cycle in grid.records] == [[0, 2, 4], [1, 3, 5]]


def test_an_angle_repeated_in_a_cycle_is_a_channel_of_its_own(tmp_path):
    grid = arrange(make_run(tmp_path / "run", [(at(a, cycle=0), PICTURE) for a in (0, 60, 120, 180)]))
    assert grid.channel_names == ("dn_0", "dn_0_2", "dn_60", "dn_120")


def test_exposures_that_differ_make_it_counts_a_second(tmp_path):
    frames = [(at(a, exposure_s=t), PICTURE) for a, t in ((0, 1.0), (60, 2.0), (120, 4.0))]
    grid = arrange(make_run(tmp_path / "run", frames))
    assert grid.unit == "DN/s"
    assert grid.to_unit == pytest.approx([1.0, 0.5, 0.25])


def test_an_angle_that_is_not_known_is_refused(tmp_path):
    run = make_run(tmp_path / "run", [(at(0), PICTURE), (at(60, polarizer_angle_deg=None), PICTURE)])
    with pytest.raises(DataError, match="angle of 1 frames is not known"):
        arrange(run)


def test_sizes_that_differ_are_refused(tmp_path):
    run = make_run(tmp_path / "run", [(at(0), PICTURE), (at(60), PICTURE), (at(120), PICTURE.T)])
    with pytest.raises(DataError, match="differ in size"):
        arrange(run)


def test_a_run_of_darks_only_is_refused(tmp_path):
    with pytest.raises(DataError, match="no scene frames"):
        arrange(make_run(tmp_path / "run", [({"kind": "dark"}, PICTURE)]))
