"""RAW stacks of a still camera become runs: one colour, its black level, one gain, one exposure; or are refused."""

import numpy as np
import pytest

from rigctl.errors import ConfigError, DataError
from rigctl.runs.folder import read_run
from rigctl.verbs.import_images import import_images
from tests.drivers.cameras.dng import write_dng

ANGLES_DEG = (0.0, 60.0, -60.0)


def stack(folder, **of_the_last):
    """Write three files; those of the last one may differ."""
    generator = np.random.default_rng(8)
    paths, pictures = [], []
    for index in range(3):
        counts = generator.integers(200, 4096, (48, 64), dtype=np.uint16)
        path = folder / f"{index}.dng"
        write_dng(path, counts, black=(256, 257, 258, 259), **(of_the_last if index == 2 else {}))
        paths.append(path)
        pictures.append(counts)
    return tuple(paths), pictures


def imported(folder, files, **changes):
    said = {
        "angles": ANGLES_DEG,
        "plane": "green-2",
        "exposure_key": "EXPTIME",
        "black_level_key": "BLACK",
        "bit_depth": 12,
        **changes,
    }
    return import_images(folder / "run", files, kind="scene", **said)


def test_one_colour_of_a_stack_becomes_a_run(tmp_path):
    files, pictures = stack(tmp_path)
    found = imported(tmp_path, files)
    assert [frame.polarizer_angle_deg for frame in found.frames] == list(ANGLES_DEG)
    run = read_run(tmp_path / "run")
    for record, counts in zip(run.frames, pictures, strict=True):
        assert (record.height, record.width) == (24, 32)
        assert record.black_level_dn == 258.0
        assert record.exposure_s == pytest.approx(1 / 125, rel=1e-7)
        np.testing.assert_array_equal(run.counts(record), counts[1::2, 0::2])


def test_another_exposure_is_fine_where_each_is_told(tmp_path):
    files, _ = stack(tmp_path, exposure=(1, 50))
    frames = imported(tmp_path, files).frames
    assert [frame.exposure_s for frame in frames] == pytest.approx([1 / 125, 1 / 125, 1 / 50], rel=1e-7)


@pytest.mark.parametrize(
    ("of_the_last", "changes", "error", "said"),
    [
        ({"iso": 200}, {}, DataError, "ISO"),
        ({"exposure": (1, 60)}, {"exposure_key": None, "same_exposure": True}, DataError, "exposed"),
        ({"exposure": None}, {}, ConfigError, "EXPTIME"),
        ({}, {"plane": None}, ConfigError, "--plane"),
    ],
)
def test_a_stack_that_was_not_taken_alike_or_says_too_little_is_refused(tmp_path, of_the_last, changes, error, said):
    files, _ = stack(tmp_path, **of_the_last)
    with pytest.raises(error, match=said):
        imported(tmp_path, files, **changes)
