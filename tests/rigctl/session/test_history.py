"""Cycles of a run computed from its frames, what sensors explain of its light, and the state of its session."""

import numpy as np
import pytest

from rigctl.report.run import cycle_figure, drift_line
from rigctl.runs.folder import read_run
from rigctl.runs.records import MonitorTrace, RunEvent, SessionNoise
from rigctl.session.history import CycleHistory, CycleLook, cycle_history, light_lines, region_means_of
from rigctl.session.status import Estimate, RegionPolarization, read_status, session_state
from tests.rigctl.session.made_rig import MadeWorld, take_watched

_NOISE = SessionNoise(gain_dn_per_e=0.5, read_noise_e=1.0, dark_current_e_per_s=0.0, black_level_dn=100.0)


def _history(tmp_path, *, faults=None, noise=None, **take):
    take_watched(MadeWorld(camera_faults=faults), tmp_path, take=take, noise=noise)
    run = read_run(tmp_path / "run")
    return cycle_history(run, region_means_of(run))


def test_the_last_cycle_of_the_history_equals_the_live_numbers(tmp_path):
    history = _history(tmp_path, cycles=3, noise=_NOISE)
    last, live = history.looks[-1], read_status(tmp_path / "run").numbers
    assert last.cycle == live.cycle["cycle"] == 2
    assert last.regions["picture"].dolp.value == pytest.approx(live.regions["picture"].dolp.value)
    assert last.regions["picture"].dolp.sigma == pytest.approx(live.regions["picture"].dolp.sigma)
    assert last.sum_rule.value == pytest.approx(live.sum_rule.value)
    # One is by UTC and one by the monotonic clock, which are the same here; UTC is kept to the microsecond.
    assert last.drift.per_min == pytest.approx(live.drift.per_min, rel=1e-4)
    assert cycle_figure(history).startswith(b"\x89PNG")


@pytest.mark.parametrize("order", ["cycles", "palindrome", "grouped"])
def test_every_order_has_its_cycles(tmp_path, order):
    history = _history(tmp_path, cycles=3, order=order)
    assert [look.cycle for look in history.looks] == [0, 1, 2]
    # Light of DoLP 0.3 and S0 = 1000 DN; a black level of 100 DN that nobody has told adds 200: 0.3 * 1000 / 1200.
    # Noise of 1 DN in 192 pixels makes sqrt(2) * 0.072 / 1200 of it, 1e-4.
    assert [look.regions["picture"].dolp.value for look in history.looks] == pytest.approx([0.25] * 3, abs=5e-4)


def test_a_jump_of_the_light_is_reported(tmp_path):
    brighter = dict.fromkeys((8, 9, 10, 11), lambda counts: (counts * 1.1).astype(np.uint16))
    history = _history(tmp_path, cycles=3, faults=brighter)
    changes = [look.drift.change for look in history.looks[1:]]
    # 10 % of the mean of both; the cut to whole counts takes half a count of 350, 0.14 %.
    assert changes == pytest.approx([0.0, 0.1 / 1.05], abs=0.003)
    assert "9.4 % at most" in drift_line(history) or "9.5 % at most" in drift_line(history)


def _look(time_s, light):
    region = RegionPolarization(dolp=Estimate(value=0.1, sigma=None), aolp_deg=1.0, light_dn_per_s=light)
    return CycleLook(round=None, cycle=0, time_s=time_s, sum_rule=None, regions={"picture": region}, drift=None)


def test_light_is_divided_by_a_sensor_that_follows_it():
    history = CycleHistory(reference="picture", looks=(_look(0.0, 100.0), _look(60.0, 80.0), _look(120.0, 99.0)))
    facts = {"monitor": "sun", "device": "s", "unit": "W m-2", "follows_light": True}
    trace = MonitorTrace(
        **facts, times_s=(0.0, 60.0, 120.0), values=(500.0, 400.0, 500.0), missing=1, problems=("busy",)
    )
    (line,) = light_lines(history, [trace])
    assert line.startswith(
        "Light of picture changed by -1.0 % over the run and by 20 % at most, sun by 0 %; divided by it"
    )
    assert line.endswith("-1.0 % is left, 1.0 % at most")
    assert trace.line == "sun (s): 400 to 500 W m-2, mean 466.667, +0 an hour; 1 of 4 readings missing (busy)"


@pytest.mark.parametrize(
    ("events", "is_open", "state"),
    [
        ([], False, "interrupted"),
        (["homed"], False, "interrupted"),
        (["homed", "finished"], False, "finished"),
        (["homed", "finished", "camera tally"], False, "finished"),
        (["homed", "stopped", "camera tally"], False, "stopped"),
        (["homed", "stopped", "resumed", "homed", "interlock"], False, "interrupted"),
        (["homed"], True, "running"),
        (["homed", "hold", "interlock"], True, "holding"),
        (["homed", "hold", "continue"], True, "running"),
        (["homed", "hold", "devices opened again", "camera tally"], True, "running"),
        (["homed", "waiting"], True, "waiting"),
        (["homed", "waiting", "round"], True, "running"),
    ],
)
def test_the_state_of_a_session_follows_from_its_events_and_its_process(events, is_open, state):
    assert session_state(42 if is_open else None, [RunEvent(event=name) for name in events]) == state
