"""Frames for a calibration, out of run folders and EMVA 1288 data sets."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.calibrations.noise_calibration import calibrate_frames
from rigctl.calibrations.noise_frames import FrameSet, Loader, emva_frames, run_frames
from rigctl.errors import DataError
from rigctl.runs.writer import RunWriter
from tests.rigctl.noise_sessions import SHAPE, SIGNALS_E, frames, write_emva_set, write_noise_run
from tests.rigctl.run_samples import make_record, noisy_counts, write_run


def test_a_run_is_grouped_by_kind_and_exposure(tmp_path: Path) -> None:
    found = run_frames(write_noise_run(tmp_path / "run"))
    sizes = {(group.kind, group.exposure_s): len(group.loaders) for group in found.groups}
    assert sizes == {
        (kind, light_e / 1e6): 8 if light_e == 6000.0 else 2 for kind in ("dark", "flat") for light_e in SIGNALS_E
    }


def test_frames_of_a_group_come_in_the_order_in_which_they_were_taken(tmp_path: Path) -> None:
    group = run_frames(write_noise_run(tmp_path / "run")).groups[0]
    expected = [counts for kind, exposure_s, counts in frames() if (kind, exposure_s) == ("dark", 0.0006)]
    for load, counts in zip(group.loaders, expected, strict=True):
        np.testing.assert_array_equal(load(), counts)


def test_the_camera_of_a_run_is_kept(tmp_path: Path) -> None:
    found = run_frames(write_noise_run(tmp_path / "run"))
    assert (found.made_for.camera_serial, found.made_for.gain_db, found.bit_depth) == ("42", 0.0, 12)


def test_exposures_that_differ_in_the_last_digits_are_one(tmp_path: Path) -> None:
    with RunWriter.create(tmp_path / "run", {"origin": "simulated"}) as writer:
        for i in range(3):
            writer.write_frame(make_record(i, kind="dark", exposure_s=0.01 * (1.0 + 1e-9 * i)), noisy_counts(i))
    assert [len(group.loaders) for group in run_frames(tmp_path / "run").groups] == [3]


def test_flats_at_another_polarizer_angle_are_another_level(tmp_path: Path) -> None:
    with RunWriter.create(tmp_path / "run", {"origin": "simulated"}) as writer:
        for i in range(4):
            record = make_record(i, kind="flat", exposure_s=0.01, polarizer_angle_target_deg=45.0 * (i % 2))
            writer.write_frame(record, noisy_counts(i))
    assert [len(group.loaders) for group in run_frames(tmp_path / "run").groups] == [2, 2]


def test_a_run_of_scene_frames_only_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no dark and no flat frames"):
        run_frames(write_run(tmp_path / "run"))


def test_frames_of_mixed_gain_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"gain_db: 0\.0, 6\.0"):
        run_frames(write_noise_run(tmp_path / "run", gain_db=(0.0, 6.0)))


def counted(found: FrameSet) -> tuple[FrameSet, list[int]]:
    """Return the frames with loaders that note when they are asked."""
    loads: list[int] = []

    def load(loader: Loader, number: int) -> NDArray[np.uint16]:
        loads.append(number)
        return loader()

    groups, number = [], 0
    for group in found.groups:
        loaders = tuple(partial(load, loader, number + place) for place, loader in enumerate(group.loaders))
        number += len(loaders)
        groups.append(replace(group, loaders=loaders))
    return replace(found, groups=tuple(groups)), loads


def test_each_frame_is_read_once(tmp_path: Path) -> None:
    found, loads = counted(run_frames(write_noise_run(tmp_path / "run")))
    calibrate_frames(found)
    assert sorted(loads) == list(range(sum(len(group.loaders) for group in found.groups)))


def test_without_a_longest_stack_two_levels_are_read_again(tmp_path: Path) -> None:
    found, loads = counted(run_frames(write_noise_run(tmp_path / "run")))
    pairs = replace(found, groups=tuple(replace(group, loaders=group.loaders[:2]) for group in found.groups))
    assert calibrate_frames(pairs).pattern is not None
    assert len(loads) == 2 * len(pairs.groups) + 4


def test_an_emva_set_holds_sixteen_bits(tmp_path: Path) -> None:
    found = emva_frames(write_emva_set(tmp_path))
    expected = [counts for kind, exposure_s, counts in frames() if (kind, exposure_s) == ("flat", 0.006)]
    group = next(g for g in found.groups if g.kind == "flat" and len(g.loaders) == 8)
    for load, counts in zip(group.loaders, expected, strict=True):
        np.testing.assert_array_equal(load(), counts)


def test_an_image_of_another_size_than_the_descriptor_says_is_refused(tmp_path: Path) -> None:
    descriptor = write_emva_set(tmp_path)
    descriptor.write_text(descriptor.read_text().replace(f"n 12 {SHAPE[1]} {SHAPE[0]}", "n 12 640 480"))
    with pytest.raises(DataError, match=r"frame_0\.png: has \(48, 64\) .* says \(480, 640\)"):
        emva_frames(descriptor).groups[0].loaders[0]()


def test_a_file_that_is_no_image_is_refused(tmp_path: Path) -> None:
    descriptor = write_emva_set(tmp_path)
    (tmp_path / "frame_0.png").write_text("no picture")
    with pytest.raises(DataError, match=r"frame_0\.png: is no FITS, PNG"):
        emva_frames(descriptor).groups[0].loaders[0]()


def test_another_pixel_is_another_hash_of_the_frames(tmp_path: Path) -> None:
    descriptor = write_emva_set(tmp_path)
    before = emva_frames(descriptor).source
    (tmp_path / "frame_0.png").write_bytes((tmp_path / "frame_1.png").read_bytes())
    after = emva_frames(descriptor).source
    assert before.sha256 == after.sha256
    assert before.frames_sha256 != after.frames_sha256
