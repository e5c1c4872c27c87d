"""Reading EMVA 1288 descriptors: what stands in them, and every problem of a bad one at once."""

from pathlib import Path

import pytest

from rigctl.calibrations.noise_frames import read_emva_descriptor
from rigctl.errors import ConfigError

GOOD = r"""# a comment
v 3.0
n 12 640 480

b 40000.0 120.0
i images\b_1.png
i images/b_2.png
d 40000.0
i d_1.png
i d 2.png
"""


def write(folder: Path, text: str) -> Path:
    (folder / "images").mkdir()
    for name in ("images/b_1.png", "images/b_2.png", "d_1.png", "d 2.png"):
        (folder / name).touch()
    path = folder / "EMVA1288_Data.txt"
    path.write_text(text, encoding="utf-8")
    return path


def problems(folder: Path, text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        read_emva_descriptor(write(folder, text))
    return str(caught.value)


def test_a_descriptor_lists_its_images_by_level(tmp_path: Path) -> None:
    bits, shape, images = read_emva_descriptor(write(tmp_path, GOOD))
    assert (bits, shape) == (12, (480, 640))
    # Backslashes, slashes and blanks in the names of files; exposures in nanoseconds.
    names = [one.path.relative_to(tmp_path).as_posix() for one in images]
    assert names == ["images/b_1.png", "images/b_2.png", "d_1.png", "d 2.png"]
    assert [(one.kind, one.photons, one.level) for one in images[1:3]] == [("flat", 120.0, "5"), ("dark", None, "8")]
    assert {one.exposure_s for one in images} == {40e-6}


def test_lines_may_end_as_in_windows(tmp_path: Path) -> None:
    assert len(read_emva_descriptor(write(tmp_path, GOOD.replace("\n", "\r\n")))[2]) == 4


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("v 3.0", "w 3.0", "line 2: 'w 3.0' begins with 'w'; allowed are v, n, b, d, i and #"),
        ("n 12 640 480\n", "", "there is no line `n BITS WIDTH HEIGHT`"),
        ("n 12 640 480", "n 12 640", "line 3: '12 640' has to be 3 numbers"),
        ("n 12 640 480", "n 17 640 480", "line 3: n 17 640 480 is not 1 to 16 bits"),
        ("n 12 640 480", "n 12 640 480.5", "all whole numbers"),
        ("n 12 640 480", "n 12 640 480\nn 12 640 480", "line 4: n stands a second time"),
        ("b 40000.0 120.0", "b 40000.0", "line 5: '40000.0' has to be 2 numbers"),
        ("d 40000.0", "d -1", "line 8: '-1' has to be 1 numbers, none below 0"),
        ("d 40000.0", "d inf", "line 8: 'inf' has to be 1 numbers"),
        ("d 40000.0", "d 4 ms", "line 8: '4 ms' has to be 1 numbers"),
        ("i d 2.png", "i d_3.png", "line 10: image 'd_3.png': there is no such file"),
        ("i d 2.png", r"i images\b_1.png", "is listed a second time (first in line 6)"),
        ("d 40000.0", "d 40000.0\nd 50000.0", "line 8: no image follows"),
        ("b 40000.0 120.0\n", "", "line 5: image 'images\\\\b_1.png' stands before any b or d line"),
        ("d 40000.0\n", "", "there is no dark group"),
    ],
)
def test_a_problem_is_named_with_its_line(tmp_path: Path, old: str, new: str, problem: str) -> None:
    assert problem in problems(tmp_path, GOOD.replace(old, new))


def test_all_problems_are_named_at_once(tmp_path: Path) -> None:
    text = problems(tmp_path, "n 12 640\nx\nb 1\ni gone.png\n")
    assert "5 problems" in text
    for line in ("line 1:", "line 2:", "line 3:", "line 4:", "dark group"):
        assert line in text


def test_a_descriptor_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        read_emva_descriptor(tmp_path / "gone.txt")
