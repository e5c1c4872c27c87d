"""Orders against drift, brackets, darks among the scene frames, rounds."""

import pytest

from rigctl.errors import ConfigError
from rigctl.files.session_file import load_session
from rigctl.session.plan import false_dolp, grouping_cost, plan_steps, step_times_ns
from tests.rigctl.session.made_rig import NS


def _session(tmp_path, take, more=""):
    path = tmp_path / "session.toml"
    path.write_text(f'name = "test"\n{more}\n[[take]]\nkind = "scene"\nexposure_ms = 1\n{take}\n')
    return load_session(path)


def _angles(steps):
    return [step.polarizer_angle_deg for step in steps]


def test_a_palindrome_goes_back_every_second_cycle(tmp_path):
    steps = plan_steps(_session(tmp_path, 'order = "palindrome"\ncycles = 3'))
    assert _angles(steps) == [0, 90, 45, 135, 135, 45, 90, 0, 0, 90, 45, 135]
    assert [step.cycle for step in steps] == [0] * 4 + [1] * 4 + [2] * 4


def test_a_linear_drift_cancels_over_a_palindrome(tmp_path):
    steps = plan_steps(_session(tmp_path, 'order = "palindrome"\ncycles = 2'))
    mean_place = {angle: sum(s.sequence for s in steps if s.polarizer_angle_deg == angle) / 2 for angle in (0, 90)}
    assert mean_place[0] == mean_place[90]


def test_a_closing_repeat_ends_a_cycle_where_it_began(tmp_path):
    steps = plan_steps(_session(tmp_path, "closing_repeat = true\ncycles = 2"))
    assert _angles(steps) == [0, 90, 45, 135, 0] * 2
    assert [step.sequence for step in steps if step.ends_cycle] == [4, 9]


def test_grouped_takes_all_frames_of_an_angle_first(tmp_path):
    steps = plan_steps(_session(tmp_path, 'order = "grouped"\ncycles = 2\nangles_deg = [0, 60, 120]'))
    assert [(s.polarizer_angle_deg, s.cycle) for s in steps] == [(0, 0), (0, 1), (60, 0), (60, 1), (120, 0), (120, 1)]


def test_grouping_says_what_drift_costs_it(tmp_path):
    grouped = _session(tmp_path, 'order = "grouped"\ncycles = 8')
    assert grouping_cost(_session(tmp_path, "cycles = 8")) is None
    cost, instead = (false_dolp(plan_steps(session)) for session in (grouped, _session(tmp_path, "cycles = 8")))
    # Eight frames of an angle take eight times as long as one, and the angles are so much further apart; the moves
    # of the stage are fewer.
    assert cost > instead
    assert f"a false DoLP of {cost:.2g}; in cycles it were {instead:.2g}" in grouping_cost(grouped)


def test_a_bracket_takes_each_exposure_at_each_angle(tmp_path):
    steps = plan_steps(_session(tmp_path, "bracket = [1, 4]\nangles_deg = [0, 60, 120]"))
    assert [(s.polarizer_angle_deg, s.exposure_s) for s in steps] == [
        (0, 0.001), (0, 0.004), (60, 0.001), (60, 0.004), (120, 0.001), (120, 0.004),
    ]  # fmt: skip


def test_darks_come_before_after_and_every_so_many_cycles_at_the_exposures_of_the_scene(tmp_path):
    steps = plan_steps(
        _session(tmp_path, "cycles = 4\nangles_deg = [0, 60, 120]", "[darks]\nframes = 1\nevery_cycles = 2")
    )
    kinds = "".join(step.kind[0] for step in steps)
    assert kinds == "d" + "s" * 6 + "d" + "s" * 6 + "d"
    assert {step.exposure_s for step in steps} == {0.001}


def test_every_second_round_can_have_the_darks(tmp_path):
    session = _session(
        tmp_path, "angles_deg = [0, 60, 120]", "darks = { every_cycles = 1, frames = 2, every_rounds = 2 }"
    )
    steps = plan_steps(session, (0, 1, 2))
    assert [sum(step.kind == "dark" for step in steps if step.round == number) for number in range(3)] == [4, 0, 4]


def test_rounds_count_their_cycles_on(tmp_path):
    steps = plan_steps(_session(tmp_path, "cycles = 2\nangles_deg = [0, 60, 120]"), (100 * NS, 200 * NS))
    assert [step.cycle for step in steps if step.polarizer_angle_deg == 0] == [0, 1, 2, 3]
    assert [step.due_ns for step in steps] == [100 * NS] * 6 + [200 * NS] * 6
    assert [step.sequence for step in steps] == list(range(12))


def test_a_take_of_every_second_round_is_left_out_of_the_others(tmp_path):
    text = 'every_rounds = 2\nangles_deg = [0]\n[[take]]\nkind = "scene"\nexposure_ms = 2\nangles_deg = [90]'
    steps = plan_steps(_session(tmp_path, text), (1, 2, 3))
    assert [(s.round, s.polarizer_angle_deg) for s in steps] == [(0, 0), (0, 90), (1, 90), (2, 0), (2, 90)]


def test_a_round_is_not_planned_before_it_is_due(tmp_path):
    steps = plan_steps(_session(tmp_path, "angles_deg = [0]"), (1000 * NS, 2000 * NS))
    times = step_times_ns(steps, start_ns=0)
    assert times[0] >= 1000 * NS
    assert times[1] >= 2000 * NS


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ('order = "grouped"\nclosing_repeat = true', "no cycles"),
        ('[[take]]\nkind = "dark"\nexposure_ms = "auto"', r"\[darks\]"),
        ("bracket = [0]", "bracket"),
    ],
)
def test_what_makes_no_sense_is_refused(tmp_path, text, match):
    with pytest.raises(ConfigError, match=match):
        _session(tmp_path, text)
