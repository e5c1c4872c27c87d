"""Cases of a study, and Sobol's indices against functions whose indices are known in closed form."""

import tomllib

import numpy as np
import pytest

from benchmarks.trials.pointing import POINTED, pointing_predictor
from rigctl.errors import ConfigError
from rigctl.files.scene_file import SceneFile
from rigctl.files.study_file import CasesSection
from rigctl.prediction.predict import ScenePredictor
from rigctl.study import cases_of, sobol_of, unit_draws
from tests.rigctl.example_files import SMALL_SCENE
from tests.rigctl.study.study_files import EFFICIENCY, EXPOSURE


@pytest.fixture
def scene(tmp_path):
    return ScenePredictor(SceneFile.model_validate(tomllib.loads(SMALL_SCENE)), None).scene


def section(**content):
    return CasesSection.model_validate(content)


def columns(cases):
    return np.array([[value for _, value in case.values] for case in cases])


def test_a_grid_has_every_combination_the_last_fastest(scene):
    parameters = {EXPOSURE: {"start": 0.01, "stop": 0.03, "n": 3}, EFFICIENCY: {"values": [0.3, 0.5]}}
    cases = cases_of(section(kind="grid", parameters=parameters), [scene, scene])
    assert [case.number for case in cases] == list(range(12))
    assert [case.scene for case in cases] == [0] * 6 + [1] * 6
    np.testing.assert_allclose(columns(cases)[:4], [[0.01, 0.3], [0.01, 0.5], [0.02, 0.3], [0.02, 0.5]])


@pytest.mark.parametrize(
    ("one", "other", "words"),
    [
        ({"start": 0.01, "stop": 0.05, "n": 1_000_000_000}, {"values": [0.3]}, "less than or equal to 1000000"),
        (
            {"start": 0.01, "stop": 0.05, "n": 10_000},
            {"start": 0.1, "stop": 0.5, "n": 10_000},
            "are 100000000 cases of each scene, allowed are 1000000 in all",
        ),
    ],
    ids=["axis", "product"],
)
def test_a_grid_of_more_cases_than_memory_holds_is_refused_by_its_numbers(one, other, words):
    with pytest.raises(ValueError, match=words):
        section(kind="grid", parameters={EXPOSURE: one, EFFICIENCY: other})


def test_lists_stand_side_by_side(scene):
    parameters = {EXPOSURE: {"values": [0.01, 0.02]}, EFFICIENCY: {"values": [0.3, 0.5]}}
    np.testing.assert_array_equal(
        columns(cases_of(section(kind="list", parameters=parameters), [scene])), [[0.01, 0.3], [0.02, 0.5]]
    )


@pytest.mark.parametrize("kind", ["latin", "random", "sobol"])
def test_draws_follow_their_laws(scene, kind):
    parameters = {EXPOSURE: {"range": [0.01, 0.03]}, EFFICIENCY: {"std": 0.02}}
    drawn = columns(cases_of(section(kind=kind, n=512, seed=3, parameters=parameters), [scene]))
    # Five standard errors of mean and deviation of 512 independent draws; the others are spread more evenly.
    assert drawn[:, 0].mean() == pytest.approx(0.02, abs=5 * 0.02 / np.sqrt(12 * 512))
    assert drawn[:, 1].mean() == pytest.approx(0.45, abs=5 * 0.02 / np.sqrt(512))
    assert drawn[:, 1].std() == pytest.approx(0.02, rel=5 / np.sqrt(2 * 512))
    again = columns(cases_of(section(kind=kind, n=512, seed=3, parameters=parameters), [scene]))
    np.testing.assert_array_equal(drawn, again)


def test_a_normal_law_is_cut_at_the_limits_of_its_number(scene):
    parameters = {EFFICIENCY: {"std": 1.0}}
    drawn = columns(cases_of(section(kind="random", n=2000, parameters=parameters), [scene]))
    assert drawn.min() >= 0.0
    assert drawn.max() <= 1.0
    # Within its limits the law is nearly even: were draws outside set to the limits, many would be alike.
    assert np.unique(drawn).size == 2000


def test_blocks_of_sobol_share_columns():
    cube = unit_draws("sobol", 3, 8, 1).reshape(5, 8, 3)
    for k in range(3):
        np.testing.assert_array_equal(cube[2 + k][:, k], cube[1][:, k])
        others = [j for j in range(3) if j != k]
        np.testing.assert_array_equal(cube[2 + k][:, others], cube[0][:, others])


def test_all_problems_are_told_at_once(scene):
    parameters = {EFFICIENCY: {"values": [0.5, 1.5]}, "sun.zenith_deg": {"values": [10]}, "no.such": {"values": [1]}}
    with pytest.raises(ConfigError) as problem:
        cases_of(section(kind="grid", parameters=parameters), [scene])
    for word in (f"{EFFICIENCY} = 1.5", "sun.zenith_deg", "no.such"):
        assert word in str(problem.value)


def test_a_stated_deviation_has_to_be_there(scene):
    with pytest.raises(ConfigError, match="the scene states none"):
        cases_of(section(kind="random", n=4, parameters={EFFICIENCY: {"std": "stated"}}), [scene])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"kind": "grid", "parameters": {EXPOSURE: {"std": 0.1}}}, "needs values"),
        ({"kind": "grid", "n": 4, "parameters": {EXPOSURE: {"values": [1]}}}, "takes no n"),
        ({"kind": "random", "parameters": {EXPOSURE: {"std": 0.1}}}, "needs n"),
        ({"kind": "sobol", "n": 100, "parameters": {EXPOSURE: {"std": 0.1}}}, "power of two"),
        ({"kind": "sobol", "n": 64, "parameters": {EXPOSURE: {"values": [1]}}}, "needs a law"),
        (
            {"kind": "list", "parameters": {EXPOSURE: {"values": [1]}, EFFICIENCY: {"values": [0.1, 0.2]}}},
            "equal numbers",
        ),
        ({"kind": "grid", "parameters": {EXPOSURE: {"values": [1], "std": 1}}}, "needs one of"),
        ({"kind": "grid", "parameters": {EXPOSURE: {"start": 1, "stop": 2}}}, "start, stop and n together"),
        ({"kind": "random", "n": 3, "parameters": {EXPOSURE: {"range": [2, 1]}}}, "below the second"),
    ],
)
def test_what_a_study_file_cannot_mean_is_refused(content, words):
    with pytest.raises(ValueError, match=words):
        CasesSection.model_validate(content)


@pytest.mark.parametrize("kind", ["random", "latin"])
def test_stated_errors_are_drawn_as_they_go_together(tmp_path, kind):
    scene = pointing_predictor(tmp_path, -0.9).scene
    varied = {key: {"std": "stated"} for key in POINTED}
    found = columns(cases_of(section(kind=kind, n=400, seed=1, parameters=varied), [scene]))
    correlation = np.corrcoef(found.T)
    # Of 400 draws: 0.05 where there is none, 0.01 where it is 0.9.
    assert correlation[0, 1] == pytest.approx(-0.9, abs=0.05)
    assert correlation[0, 2] == pytest.approx(0.0, abs=0.2)
    assert np.std(found[:, 0]) == pytest.approx(2.0, rel=0.15)


NUMBER = ("scene", "region", "dolp_mean")
KEYS = ("a", "b", "c")


def test_sobol_of_ishigami():
    # f = sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1, each even over (-pi, pi) (Saltelli et al. 2010).
    x = np.pi * (2.0 * unit_draws("sobol", 3, 1024, 7) - 1.0)
    found = sobol_of(NUMBER, np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0]), KEYS)
    for row, first, total in zip(found, (0.3139, 0.4424, 0.0), (0.5576, 0.4424, 0.2437), strict=True):
        # The bootstrap's 95 % limits are 1.96 standard errors wide to each side: five of them.
        assert row.first == pytest.approx(first, abs=5 / 1.96 * (row.first_high - row.first_low) / 2)
        assert row.total == pytest.approx(total, abs=5 / 1.96 * (row.total_high - row.total_low) / 2)
        assert row.first_high - row.first_low < 0.3
        assert row.reason == ""


def test_an_input_that_changes_nothing_has_indices_of_0():
    u = unit_draws("sobol", 3, 64, 1)
    found = sobol_of(NUMBER, u[:, 0] + 2.0 * u[:, 1], KEYS)
    assert (found[2].first, found[2].total, found[2].total_high) == (0.0, 0.0, 0.0)
    # Variances 1/12 and 4/12; limits as in the test above.
    for row, share in zip(found, (0.2, 0.8), strict=False):
        assert row.total == pytest.approx(share, abs=5 / 1.96 * (row.total_high - row.total_low) / 2)


@pytest.mark.parametrize(("spoil", "reason"), [(np.nan, "1 of 40 cases"), (None, "no input changes it")])
def test_where_there_is_none_the_reason_stands(spoil, reason):
    values = np.ones(8 * 5)
    if spoil is not None:
        values[3] = spoil
    rows = sobol_of(NUMBER, values, KEYS)
    assert all(reason in row.reason and np.isnan(row.total) for row in rows)
