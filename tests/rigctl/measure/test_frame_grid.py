"""Which frame of a run is which angle of which cycle."""

import numpy as np
import pytest

from rigctl.errors import DataError
from rigctl.measure.frames import arrange
from tests.rigctl.made_runs import at, make_run

PICTURE = np.arange(6).reshape(2, 3)


def grid_of(folder, *facts):
    return arrange(make_run(folder / "run", [(one, PICTURE) for one in facts]))


@pytest.mark.parametrize(
    ("asked", "names"),
    [
        ([at(a) for a in (0, 90, 45, 135)], ("dn_0", "dn_45", "dn_90", "dn_135")),
        ([at(a) for a in (0, 60, -60)], ("dn_0", "dn_60", "dn_120")),
        ([at(a, cycle=0) for a in (0, 60, 120, 180)], ("dn_0", "dn_0_2", "dn_60", "dn_120")),
    ],
)
def test_angles_are_sorted_and_named_by_what_was_asked_for(tmp_path, asked, names):
    grid = grid_of(tmp_path, *asked)
    assert grid.channel_names == names
    assert grid.polarizer_angles_rad == pytest.approx(np.deg2rad([float(name.split("_")[1]) for name in names]))


def test_a_readback_on_the_other_side_of_zero_is_averaged_as_an_axis(tmp_path):
    readbacks = [0.004, 179.998]
    asked = [
        at(a, cycle=c, polarizer_angle_deg=readbacks[c] if a == 0 else float(a)) for c in (0, 1) for a in (0, 60, 120)
    ]
    assert np.rad2deg(grid_of(tmp_path, *asked).polarizer_angles_rad[0]) == pytest.approx(0.001, abs=1e-9)


def test_an_incomplete_cycle_is_left_out_and_said(tmp_path):
    grid = grid_of(tmp_path, *[at(a, cycle=c) for c in (0, 1) for a in (0, 60, 120)][:-1])
    assert (grid.cycles, grid.left_out) == (1, ("cycle 1: incomplete, 2 of 3",))


def test_without_cycles_the_nth_frame_at_an_angle_is_of_cycle_n(tmp_path):
    grid = grid_of(tmp_path, *[at(a) for a in (0, 0, 60, 60, 120, 120)])
    assert [[record.sequence for record in cycle] for cycle in grid.records] == [[0, 2, 4], [1, 3, 5]]


def test_exposures_that_differ_make_it_counts_a_second(tmp_path):
    grid = grid_of(tmp_path, *[at(a, exposure_s=t) for a, t in ((0, 1.0), (60, 2.0), (120, 4.0))])
    assert grid.unit == "DN/s"
    assert grid.to_unit == pytest.approx([1.0, 0.5, 0.25])


@pytest.mark.parametrize(
    ("frames", "said"),
    [
        ([(at(0), PICTURE), (at(60, polarizer_angle_deg=None), PICTURE)], "angle of 1 frames is not known"),
        ([(at(0), PICTURE), (at(60), PICTURE), (at(120), PICTURE.T)], "differ in size"),
        ([({"kind": "dark"}, PICTURE)], "no scene frames"),
    ],
)
def test_frames_that_give_no_grid_are_refused(tmp_path, frames, said):
    with pytest.raises(DataError, match=said):
        arrange(make_run(tmp_path / "run", frames))
