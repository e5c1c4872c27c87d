"""Devices at work for a page, without a page."""

import time
from collections.abc import Callable

from rigctl.web.rig import REST, LiveLook, LiveRig, Task

CAMERA = "sim:gc780"


def until(rig: LiveRig, is_so: Callable[[LiveLook], bool]) -> LiveLook:
    deadline_s = time.monotonic() + 60.0
    while not is_so(look := rig.look()):
        assert time.monotonic() < deadline_s, look
        time.sleep(0.02)
    return look


def test_a_camera_alone_is_focused_by_and_has_no_polarization() -> None:
    rig = LiveRig(CAMERA)
    rig.begin(Task(kind="preview", exposure_ms=0.03))
    look = until(rig, lambda look: look.sharpness > 0.0)
    assert (look.width, look.height) == (782, 582)
    assert rig.newest_counts().shape == (582, 782)
    one, same = rig.picture("view"), rig.picture("view")
    assert one.jpeg.startswith(b"\xff\xd8")
    assert sum(one.histogram) == sum(same.histogram) == 782 * 582
    rig.begin(Task(kind="polarimetry", exposure_ms=0.03))
    assert "needs a stage" in until(rig, lambda look: bool(look.problem)).problem
    assert rig.look().task == "rest"


def test_the_exposure_follows_the_light_unless_it_is_given() -> None:
    rig = LiveRig(CAMERA)
    rig.begin(Task(kind="preview"))
    # The exposure begins with 10 ms, which saturates all pixels: no such picture is shown.
    assert rig.newer_look(0, timeout_s=60.0).brightest < 1.0
    look = until(rig, lambda look: 0.4 <= look.brightest <= 0.9)
    assert look.is_automatic
    assert look.exposure_ms < 0.1
    rig.begin(REST)


def test_a_camera_that_cannot_be_opened_is_a_problem_in_words() -> None:
    rig = LiveRig("gige:nowhere.invalid")
    rig.begin(Task(kind="preview"))
    assert until(rig, lambda look: bool(look.problem)).task == "rest"
    rig.begin(REST)
    assert rig.picture("view") is None
