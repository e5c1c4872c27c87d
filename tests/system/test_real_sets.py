"""Frames that nobody here made, through import, stokes and compare: what is said is what their sources say of them."""

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.special import chdtri

from model.processing.fault_fit import SHARED as RESPONSES
from rigctl.comparison.compare import Comparison, compare_with_itself
from rigctl.files.regions import Rectangle, Region
from rigctl.measure.diagnose import MeasuredRun, measure_run
from rigctl.runs.folder import read_run
from rigctl.verbs.compare import compare_run
from rigctl.verbs.import_images import ImportedRun, import_images

REAL_DATA = os.environ.get("RIGCTL_REAL_DATA")
pytestmark = pytest.mark.skipif(REAL_DATA is None, reason="set RIGCTL_REAL_DATA to the folder of real frames")
FOLDER = Path(REAL_DATA or "")
TURN_DEG = tuple(float(angle) for angle in range(0, 360, 45))
STATES = sorted(path.relative_to(FOLDER / "mueller_psa").as_posix() for path in FOLDER.glob("mueller_psa/*nm_g*/a*"))
# Of the table of the set; 192 x 192 pixels around it are imported.
MIDDLE = Region(name="middle", rectangle=Rectangle(x=56, y=56, width=80, height=80))
CROP = (slice(144, 336), slice(224, 416))


def imported_mosaic(
    folder: Path, name: str, *, x: int = 0, y: int = 0, side: tuple[int, int] | None = None
) -> ImportedRun:
    """Import a part of a mosaic (all of it without sides); the run is called `run`."""
    file = FOLDER / f"imx250_{name}" / f"{name}_IMX250MZR.png"
    if side is not None:
        raw = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)[y : y + side[0], x : x + side[1]]
        file = folder / f"{name}.png"
        cv2.imwrite(str(file), raw)
    return import_images(
        folder / "run",
        [file],
        kind="scene",
        mosaic=(90.0, 45.0, 135.0, 0.0),
        black_level_dn=0.0,
        same_exposure=True,
    )


def imported_state(folder: Path, state: str) -> MeasuredRun:
    """Import the middle of one state of light, measured over the region of its table."""
    files = []
    for angle in TURN_DEG:
        picture = cv2.imread(str(FOLDER / "mueller_psa" / state / f"p{angle:03.0f}.png"), cv2.IMREAD_UNCHANGED)
        files.append(folder / f"p{angle:03.0f}.png")
        cv2.imwrite(str(files[-1]), picture[CROP])
    import_images(folder / "run", files, kind="scene", angles=TURN_DEG, black_level_dn=0.0, same_exposure=True)
    return measure_run(read_run(folder / "run"), [MIDDLE])


@pytest.fixture(scope="module")
def states(tmp_path_factory: pytest.TempPathFactory) -> dict[str, MeasuredRun]:
    """Return the twelve states of light, measured."""
    return {state: imported_state(tmp_path_factory.mktemp("state"), state) for state in STATES}


@pytest.fixture(scope="module")
def table() -> dict[str, Any]:
    """Return what plain numpy and the published calibration say of the states."""
    found: dict[str, Any] = json.loads((FOLDER / "mueller_psa" / "reference.json").read_text())["scenes"]
    return found


def compared(folder: Path, regions: Iterable[Region], *correct: str) -> Comparison:
    """Return the run of a folder beside its own moments."""
    text = "".join(
        f'[[regions]]\nname = "{region.name}"\nrectangle = {{ x = {region.rectangle.x}, y = {region.rectangle.y}, '
        f"width = {region.rectangle.width}, height = {region.rectangle.height} }}\n"
        for region in regions
        if region.rectangle is not None
    )
    (folder / "regions.toml").write_text(text)
    return compare_run(folder / "run", regions=folder / "regions.toml", correct=correct)


def quarters(side: int) -> list[Region]:
    """Return four regions of a square picture."""
    return [
        Region(
            name=f"q{x}{y}", rectangle=Rectangle(x=x * side // 8, y=y * side // 8, width=side // 4, height=side // 4)
        )
        for x in (1, 5)
        for y in (1, 5)
    ]


def pair_sums(found: Comparison) -> list[float]:
    """Return by how much the pair sums of each region differ [%]."""
    return [float(check.size.split("%")[0]) for check in found.checks if check.kind == "pair sums"]


def wrapped_deg(angle_deg: float) -> float:
    """Return a difference of axes, from -90 to 90 degrees."""
    return (angle_deg + 90.0) % 180.0 - 90.0


def test_no_state_of_a_linear_camera_is_called_non_linear(states: dict[str, MeasuredRun]) -> None:
    # Whole pictures of all states: tests/model/processing/diagnosis.
    for state in STATES[::4]:
        found = states[state].diagnosis
        assert not {term.name for term in found.named} & set(RESPONSES), state
        for term in found.terms:
            if term.name in RESPONSES and term.value is not None and term.std_error is not None:
                assert abs(term.value) < 4.0 * term.std_error, (state, term)


def test_errors_cover_what_half_turns_differ_by(states: dict[str, MeasuredRun], table: dict[str, Any]) -> None:
    scores = []
    for state, run in states.items():
        numbers = run.measurement.regions["middle"].quantities
        first, last = (np.array(table[state][key]) for key in ("S_of_first_four", "S_of_last_four"))
        degrees = [np.hypot(s[1], s[2]) / s[0] for s in (first, last)]
        angles_deg = [np.degrees(0.5 * np.arctan2(s[2], s[1])) for s in (first, last)]
        # The mean of two half turns is off by half of what they differ by.
        scores.append(0.5 * (degrees[0] - degrees[1]) / numbers["dolp"]["mean"].std_error)
        scores.append(0.5 * wrapped_deg(angles_deg[0] - angles_deg[1]) / numbers["aolp_deg"]["mean"].std_error)
    # Sum of squares of 24 scores: between the quantiles of one in two hundred either way.
    assert chdtri(len(scores), 0.995) < np.sum(np.square(scores)) < chdtri(len(scores), 0.005)
    assert np.mean(np.abs(scores) < 2.0) >= 0.9


def test_polarization_agrees_with_the_published_calibration(
    states: dict[str, MeasuredRun], table: dict[str, Any]
) -> None:
    off, turned_deg = [], []
    for state, run in states.items():
        numbers, said = run.measurement.regions["middle"].quantities, table[state]
        assert numbers["dolp"]["mean"].value == pytest.approx(said["DoLP_of_mean"], abs=1e-9)
        if state.startswith("630nm"):
            off.append(numbers["dolp"]["mean"].value - said["published_model_DoLP"])
            turned_deg.append(wrapped_deg(numbers["aolp_deg"]["mean"].value - said["published_model_AoLP_deg"]))
    # The source's own agreement over 16 states is 0.010 and 0.58 deg; of 8 of them, with the error of such a scatter.
    assert np.sqrt(np.mean(np.square(off))) < 0.010 * (1.0 + 2.0 / np.sqrt(16.0))
    assert np.sqrt(np.mean(np.square(turned_deg))) < 0.58 * (1.0 + 2.0 / np.sqrt(16.0))
    assert abs(np.mean(turned_deg)) < 2.0 * 0.58 / np.sqrt(8.0)


def test_rounding_is_no_disagreement_and_points_to_no_calibration(states: dict[str, MeasuredRun]) -> None:
    for state, run in states.items():
        # 8 bits, noise of 0.2 to 0.45 DN; nobody gave a noise calibration.
        found = compare_with_itself(run, alpha=1e-3)
        assert found.verdict != "disagrees", state
        assert not found.points_to, state


@pytest.mark.parametrize(("name", "x", "y"), [("fruits", 400, 400), ("carps", 800, 800)])
def test_two_per_cent_between_pairs_are_throughput_and_applied(tmp_path: Path, name: str, x: int, y: int) -> None:
    imported_mosaic(tmp_path, name, x=x, y=y, side=(800, 800))
    found = compared(tmp_path, quarters(400))
    diagnosis = found.run.diagnosis
    assert diagnosis is not None
    assert diagnosis.first is not None
    assert diagnosis.first.name == "throughput of pairs"
    assert diagnosis.first.value is not None
    ratio = (1.0 + diagnosis.first.value / 2.0) / (1.0 - diagnosis.first.value / 2.0)
    assert ratio == pytest.approx(0.980, abs=0.002)
    assert not {term.name for term in diagnosis.named} & set(RESPONSES)
    assert found.verdict != "agrees"
    corrected = compared(tmp_path, quarters(400), "throughput")
    assert max(pair_sums(corrected)) <= 0.4
    assert any("frames were divided by" in remark for remark in corrected.remarks)


# Centre of each disc in the crop of the planes, and its angle of polarization by the source [deg].
DISCS = {"0": (190, 146, 83.4), "45": (500, 148, 43.8), "90": (776, 148, 175.4), "135": (1056, 152, 135.6)}


def test_a_tone_mapped_picture_has_its_response_named_first_and_every_disc_reported(tmp_path: Path) -> None:
    imported_mosaic(tmp_path, "polarizer", y=800, side=(608, 2448))
    discs = [
        Region(name=name, rectangle=Rectangle(x=x - 55, y=y - 55, width=110, height=110))
        for name, (x, y, _) in DISCS.items()
    ]
    street = Region(name="street", rectangle=Rectangle(x=400, y=20, width=120, height=25))
    found = compared(tmp_path, [*discs, street])
    diagnosis = found.run.diagnosis
    assert diagnosis is not None
    assert diagnosis.first is not None
    assert diagnosis.first.name in RESPONSES
    assert found.verdict == "cannot_be_judged"
    assert found.agrees is None
    assert set(found.regions) == {*DISCS, "street"}
    for name, (_, _, aolp_deg) in DISCS.items():
        numbers = found.run.measurement.regions[name].quantities
        assert abs(wrapped_deg(numbers["aolp_deg"]["mean"].value - aolp_deg)) < 0.5
        # By the source 0.43 to 0.52 instead of near 1, over another part of each disc.
        assert 0.35 < numbers["dolp"]["mean"].value < 0.6
        assert found.regions[name].verdict == "cannot_be_judged"
        assert "response" in found.regions[name].reason
    # Of weakly polarised light alone nothing says "agree" either.
    assert compared(tmp_path, [street]).agrees is None


def test_a_sky_that_is_clipped_up_to_the_edge_is_neither_a_border_nor_missing(tmp_path: Path) -> None:
    told = imported_mosaic(tmp_path, "polarizer")
    assert any("saturated pixels, where nothing is measured: 13.1" in remark for remark in told.remarks)
    assert not any("border" in remark for remark in told.remarks)
    assert all(record.missing_dn is None for record in told.frames)


def test_nothing_false_is_said_of_a_real_triplet(tmp_path: Path) -> None:
    files = tuple(FOLDER / "lasco_c2_triplet" / f"lasco_{angle}.fts" for angle in ("0", "+60", "-60"))
    told = import_images(
        tmp_path / "run",
        files,
        kind="scene",
        angles=(0.0, 60.0, -60.0),
        exposure_key="EXPTIME",
        black_level_key="OFFSET",
        bit_depth=16,
    )
    assert any("65532" in remark and "saturated" in remark for remark in told.remarks)
    assert any(remark.startswith("3.1% of the pixels are 0") and "missing" in remark for remark in told.remarks)
    east = Region(name="east", rectangle=Rectangle(x=40, y=200, width=80, height=80))
    faint = Region(name="faint", rectangle=Rectangle(x=42, y=42, width=84, height=84))
    found = compared(tmp_path, [east, faint])
    checks = {check.name: check for check in found.checks}
    assert checks["pair sums"].verdict == "not testable"
    assert checks["linear response"].verdict == "not testable"
    assert checks["registration"].verdict == "sound"
    diagnosis = found.run.diagnosis
    assert diagnosis is not None
    assert not diagnosis.terms
    assert "three angles" in diagnosis.reason
    assert found.verdict in ("agrees", "agrees_with_reservations")
    assert all(region.verdict != "disagrees" for region in found.regions.values())
