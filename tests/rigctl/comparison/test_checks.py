"""Broken sets of frames are refused or flagged by name; disagreements point to their cause."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.cli import main
from rigctl.comparison.checks import (
    ADVICE,
    Cause,
    Check,
    diagnose,
    nothing_tested,
    refusals,
    region_verdicts,
    run_checks,
    verdict_of,
)
from rigctl.comparison.rows import Row
from rigctl.console import EXIT_DATA
from rigctl.files.regions import Region
from rigctl.measure.diagnose import measure_run
from tests.rigctl.made_runs import at, make_run

ANGLES = (0.0, 45.0, 90.0, 135.0)
Picture = NDArray[np.float64]
REGION = "[[regions]]\nname = 'all'\nrectangle = { x = 10, y = 10, width = 180, height = 180 }\n"


def scene() -> list[Picture]:
    """Return four frames of a picture with edges, whose light is polarized in many ways."""
    draws = np.random.default_rng(8)
    light = np.full((200, 200), 1000.0)
    for _ in range(40):
        x, y, side = draws.integers(0, 170), draws.integers(0, 170), draws.integers(15, 50)
        light[y : y + side, x : x + side] = draws.uniform(400.0, 2000.0)
    light = cv2.GaussianBlur(light, (0, 0), 0.8)
    down, right = np.mgrid[0:200, 0:200] / 200.0
    frames = []
    for angle in ANGLES:
        seen = 0.5 * light * (1.0 + 0.25 * down * np.cos(2.0 * (np.radians(angle) - 1.5 * np.pi * right)))
        frames.append(seen + draws.normal(0.0, 3.0, seen.shape))
    return frames


def checked(folder: Path, frames: list[Picture], **facts: object) -> dict[str, Check]:
    run = make_run(folder / "run", [(at(angle, **facts), np.rint(f)) for angle, f in zip(ANGLES, frames, strict=True)])
    region = Region.model_validate({"name": "all", "rectangle": {"x": 10, "y": 10, "width": 180, "height": 180}})
    return {check.name: check for check in run_checks(measure_run(run, [region]))}


def pairs_off(frames: list[Picture]) -> list[Picture]:
    return [frame * (1.16 if k in (0, 2) else 1.0) for k, frame in enumerate(frames)]


def shifted(frames: list[Picture]) -> list[Picture]:
    motion = np.array([[1.0, 0.0, 0.8], [0.0, 1.0, 0.0]])
    return [frames[0], cv2.warpAffine(frames[1], motion, frames[1].shape[::-1]), *frames[2:]]


def compressed(frames: list[Picture]) -> list[Picture]:
    return [frame * (1.0 - 0.08 * frame / 750.0) for frame in frames]


def test_a_region_that_is_cut_off_at_zero_is_flagged_and_refused_where_no_law_describes_it(tmp_path: Path) -> None:
    draws = np.random.default_rng(1)
    dark = [np.rint(np.maximum(draws.normal(4.0, 3.0, (200, 200)), 0.0)) for _ in range(4)]
    assert checked(tmp_path / "even", dark)["clipped at zero of all"].verdict == "flagged"
    halves = np.where(np.arange(200) < 100, 0.0, 30.0)
    uneven = [np.rint(np.maximum(draws.normal(4.0 + halves, 3.0, (200, 200)), 0.0)) for _ in range(4)]
    assert checked(tmp_path / "uneven", uneven)["clipped at zero of all"].verdict == "refused"


def test_a_sound_set_passes(tmp_path: Path) -> None:
    found = checked(tmp_path, scene())
    assert {name: check.verdict for name, check in found.items() if check.verdict != "not testable"} == {
        "pair sums of all": "sound",
        "linear response": "sound",
        "registration": "sound",
    }


def test_pair_sums_16_percent_apart_are_refused(tmp_path: Path) -> None:
    found = checked(tmp_path, pairs_off(scene()))
    assert found["pair sums of all"].verdict == "refused"
    (refusal,) = refusals(tuple(found.values()))
    assert re.match(r"pair sums of all: .* differ by 14\.[78]", refusal)


@pytest.mark.parametrize(("broken", "named"), [(shifted, "registration"), (compressed, "linear response")])
def test_broken_sets_are_flagged_by_name(
    tmp_path: Path, broken: Callable[[list[Picture]], list[Picture]], named: str
) -> None:
    found = checked(tmp_path, broken(scene()))
    assert found[named].verdict == "flagged"
    assert [name for name, check in found.items() if check.verdict == "refused"] == []


def test_the_size_of_a_shift_is_said(tmp_path: Path) -> None:
    assert "45 deg lies 0.8" in checked(tmp_path, shifted(scene()))["registration"].text


def test_compare_refuses_with_the_exit_code_of_unfit_data(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames = pairs_off(scene())
    make_run(tmp_path / "run", [(at(angle), np.rint(f)) for angle, f in zip(ANGLES, frames, strict=True)])
    (tmp_path / "regions.toml").write_text(REGION)
    words = ["compare", str(tmp_path / "run"), "--regions", str(tmp_path / "regions.toml"), "--out", str(tmp_path)]
    assert main(words) == EXIT_DATA
    assert "pair sums of all" in capsys.readouterr().err


def test_drift_needs_three_cycles(tmp_path: Path) -> None:
    assert checked(tmp_path, scene())["drift of the light"].verdict == "not testable"


def test_light_that_fades_is_flagged(tmp_path: Path) -> None:
    frames = scene()
    taken = [
        (at(angle, cycle=cycle), np.rint(frame * (1.0 - 0.01 * (cycle + k / 4.0))))
        for cycle in range(4)
        for k, (angle, frame) in enumerate(zip(ANGLES, frames, strict=True))
    ]
    region = Region.model_validate({"name": "all", "rectangle": {"x": 10, "y": 10, "width": 180, "height": 180}})
    measured = measure_run(make_run(tmp_path / "run", taken), [region])
    found = {check.name: check for check in run_checks(measured)}
    assert found["drift of the light"].verdict == "flagged"
    assert "-1.0" in found["drift of the light"].text


def test_pairs_that_are_a_little_off_are_flagged_as_soon_as_it_is_known(tmp_path: Path) -> None:
    frames = [frame * (1.015 if k in (0, 2) else 1.0) for k, frame in enumerate(scene())]
    found = checked(tmp_path, frames)["pair sums of all"]
    # 1.5 % is less than 1 % and five errors taken together, and above each of them.
    error_percent = float(found.text.split("+- ")[1].split("%")[0])
    assert 5.0 * error_percent < 1.5
    assert found.verdict == "flagged"


def test_frames_cut_off_below_the_stated_saturation_are_flagged(tmp_path: Path) -> None:
    cut = [np.minimum(frame, np.quantile(frame, 0.8)) for frame in scene()]
    found = checked(tmp_path, cut)
    assert found["largest count"].verdict == "flagged"
    assert "20.0% of the frame at 45 deg" in found["largest count"].text
    assert "largest count" not in checked(tmp_path / "sound", scene())
    # A count that marks a border of missing pixels is not a count.
    bordered = [np.pad(frame[8:-8, 8:-8], 8, constant_values=4094.0) for frame in scene()]
    assert "largest count" not in checked(tmp_path / "bordered", bordered, missing_dn=4094.0)


def row(quantity: str, agrees: bool | None, statistic: str = "mean", values: tuple[float, float] = (1.0, 1.0)) -> Row:
    predicted, measured = values
    return Row(
        region="a",
        quantity=quantity,
        statistic=statistic,
        predicted=predicted,
        measured=measured,
        std_error=0.01,
        z=9.0,
        agrees=agrees,
    )


def angles(*pairs: tuple[float, float]) -> list[Row]:
    return [row("aolp_deg", False, values=pair) for pair in pairs]


@pytest.mark.parametrize(
    ("rows", "causes"),
    [
        ([row("s0", True), row("dolp", True)], ()),
        ([row("s0", False), row("dn_0", False), row("s1", False), row("dolp", True)], ("scale",)),
        ([row("dolp", False), row("s0", False), row("s1n", False)], ("polarization",)),
        ([*angles((10, 12.0), (95, 97.1), (179, 1.0)), row("dolp", True)], ("axis-offset",)),
        ([*angles((10, 53.4), (95, 148.4), (168, 75.5)), row("dolp", True)], ("axis-sense",)),
        ([*angles((10, 12), (95, 97)), row("s0", False), row("dolp", True)], ("axis-offset", "scale")),
        ([row("dn_0", False, "std_temporal"), row("dn_0", True), row("s0", True)], ("noise",)),
    ],
)
def test_disagreements_point_to_their_cause(rows: list[Row], causes: tuple[Cause, ...]) -> None:
    assert diagnose(rows) == causes
    assert all(ADVICE[cause] for cause in causes)


def test_a_comparison_in_which_nothing_was_tested_cannot_be_judged() -> None:
    untested = [row("s0", None), row("dolp", None)]
    assert verdict_of(untested, nothing_tested(untested, ["why"]), {}) == "cannot_be_judged"
    other = replace(row("s0", True), region="b")
    assert verdict_of([*untested, other], (), {}) == "agrees_with_reservations"
    assert region_verdicts([*untested, other], (), {})["a"].reason == "none of its numbers was tested"
