"""RAW stacks of a still camera become runs: one colour, its black level, one gain, one exposure; or are refused."""

import numpy as np
import pytest

from rigctl.errors import ConfigError, DataError
from rigctl.imports.images import ImportRequest
from rigctl.runs.folder import read_run
from rigctl.verbs.import_images import imported
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


def request(folder, files, **changes):
    said = {
        "angles_deg": ANGLES_DEG,
        "plane": "green-2",
        "exposure_key": "EXPTIME",
        "black_level_key": "BLACK",
        "bit_depth": 12,
        **changes,
    }
    return ImportRequest(run=folder / "run", files=files, kind="scene", **said)


def test_one_colour_of_a_stack_becomes_a_run(tmp_path):
    files, pictures = stack(tmp_path)
    found = imported(request(tmp_path, files))
    assert [frame.polarizer_angle_deg for frame in found.frames] == list(ANGLES_DEG)
    run = read_run(tmp_path / "run")
    for record, counts in zip(run.frames, pictures, strict=True):
        assert (record.height, record.width) == (24, 32)
        assert record.black_level_dn == 258.0
        assert record.exposure_s == pytest.approx(1 / 125, rel=1e-7)
        np.testing.assert_array_equal(run.counts(record), counts[1::2, 0::2])


def test_another_gain_within_a_stack_is_refused(tmp_path):
    files, _ = stack(tmp_path, iso=200)
    with pytest.raises(DataError, match="ISO"):
        imported(request(tmp_path, files))


def test_another_exposure_is_not_the_same(tmp_path):
    files, _ = stack(tmp_path, exposure=(1, 60))
    with pytest.raises(DataError, match="exposed"):
        imported(request(tmp_path, files, exposure_key=None, same_exposure=True))


def test_another_exposure_is_fine_where_each_is_told(tmp_path):
    files, _ = stack(tmp_path, exposure=(1, 50))
    frames = imported(request(tmp_path, files)).frames
    assert [frame.exposure_s for frame in frames] == pytest.approx([1 / 125, 1 / 125, 1 / 50], rel=1e-7)


def test_an_exposure_that_is_not_told_has_to_be_said(tmp_path):
    files, _ = stack(tmp_path, exposure=None)
    with pytest.raises(ConfigError, match="EXPTIME"):
        imported(request(tmp_path, files))


def test_the_colour_has_to_be_said(tmp_path):
    files, _ = stack(tmp_path)
    with pytest.raises(ConfigError, match="--plane"):
        imported(request(tmp_path, files, plane=None))
