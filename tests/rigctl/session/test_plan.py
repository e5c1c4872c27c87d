"""Steps in their order, rounds in time, what they need. The sun of these tests is astropy's, not the program's."""

from datetime import UTC, datetime
from itertools import pairwise

import numpy as np
import pytest
from astropy import units
from astropy.coordinates import AltAz, EarthLocation, get_sun
from astropy.time import Time
from astropy.utils import iers

from rigctl.base.numbers import unix_ns
from rigctl.errors import ConfigError
from rigctl.files.place import SiteSection
from rigctl.files.rig_file import load_rig
from rigctl.files.session_file import SessionFile, load_session
from rigctl.runs.folder import read_run
from rigctl.session.control import ask
from rigctl.session.plan import (
    SunTrack,
    estimate,
    false_dolp,
    grouping_cost,
    plan_steps,
    round_times_ns,
    step_times_ns,
)
from rigctl.session.take import resume_session, take_session
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.session.made_rig import NS, RIG_FILE, MadeWorld, events_of

SITE = SiteSection(latitude_deg=43.16, longitude_deg=-77.61, elevation_m=150)
RIG_AT_SITE = RIG_FILE.model_copy(update={"site": SITE})
MORNING_NS = unix_ns(datetime(2026, 5, 4, 11, 0, tzinfo=UTC))
H = 3600 * NS
# The program's algorithm states 0.0003 deg; UT1 - UTC, which it takes as 0, is at most 0.9 s = 0.004 deg; chords
# between exact positions take 0.0002 deg.
_SUN_TOLERANCE_DEG = 0.006
# The sun sinks or rises by 0.002 to 0.004 deg a second here, and its azimuth goes faster.
_CROSSING_TOLERANCE_S = 5.0


def _sun_deg(times_ns):
    """Return azimuth and elevation by astropy."""
    with iers.conf.set_temp("auto_download", False), iers.conf.set_temp("auto_max_age", None):
        where = EarthLocation(
            lat=SITE.latitude_deg * units.deg, lon=SITE.longitude_deg * units.deg, height=150 * units.m
        )
        time = Time(np.asarray(times_ns) / NS, format="unix")
        found = get_sun(time).transform_to(AltAz(obstime=time, location=where))
        return found.az.deg, found.alt.deg


def scheduled(schedule, **more):
    take = [{"kind": "scene", "exposure_ms": 10}]
    locks = {"disk_free_mb": 0, "queue": "off"}
    return SessionFile.model_validate({"name": "day", "take": take, "schedule": schedule, "interlocks": locks} | more)


def _times(schedule, **limits):
    return round_times_ns(scheduled(schedule), SITE, **({"now_ns": MORNING_NS} | limits))


def test_the_sun_is_where_astropy_has_it():
    times = [MORNING_NS + k * 17 * 60 * NS + 12_345_678_901 for k in range(80)]
    azimuth_deg, elevation_deg = _sun_deg(times)
    found = [SunTrack(SITE).at(time) for time in times]
    assert np.max(np.abs([s.elevation_deg for s in found] - elevation_deg)) < _SUN_TOLERANCE_DEG
    # Near the zenith an azimuth means little: compare it on the sky.
    on_sky = np.abs([s.azimuth_deg for s in found] - azimuth_deg) * np.cos(np.radians(elevation_deg))
    assert np.max(on_sky) < _SUN_TOLERANCE_DEG


def test_every_so_many_minutes_from_now_on():
    times = tuple(MORNING_NS + k * 600 * NS for k in range(6))
    assert _times({"every_min": 10, "duration_h": 1}) == times
    assert _times({"every_min": 10}, until_ns=MORNING_NS + H) == times


def test_given_times_are_put_in_order_and_those_outside_are_left_out():
    given = ["2026-05-04T15:00:00Z", "2026-05-04T14:00:00+01:00", "2026-05-03T10:00:00Z"]
    assert _times({"times": given}) == (MORNING_NS + 2 * H, MORNING_NS + 4 * H)


def test_the_solar_zenith_passes_43_deg_twice_a_day():
    times = _times({"zenith_passes_deg": [43]})
    assert len(times) == 2
    _, elevation_deg = _sun_deg(times)
    before, after = (_sun_deg(np.array(times) + s * int(_CROSSING_TOLERANCE_S * NS))[1] for s in (-1, 1))
    assert np.all(np.abs(elevation_deg - 47.0) < _SUN_TOLERANCE_DEG + 0.004 * 0.1)
    assert np.all((before - 47.0) * (after - 47.0) < 0)


def test_while_the_solar_zenith_is_below_60():
    times = _times({"every_min": 5, "while_zenith_below_deg": 60, "duration_h": 24})
    every = MORNING_NS + np.arange(288) * 300 * NS
    _, elevation_deg = _sun_deg(every)
    assert times == tuple(int(time) for time in every[elevation_deg > 30.0])


def test_a_schedule_without_a_round_or_a_site_is_refused():
    with pytest.raises(ConfigError, match="rigctl plan"):
        _times({"zenith_passes_deg": [5]})
    with pytest.raises(ConfigError, match=r"\[site\]"):
        round_times_ns(scheduled({"zenith_passes_deg": [43]}), None, now_ns=MORNING_NS)


def _run(tmp_path, schedule, world, **more):
    session = scheduled(schedule, **more)
    return take_session(RIG_AT_SITE, session, tmp_path / "run", files={}, clock=world.time.clock, opener=world.open)


def test_eight_hours_of_a_moving_sun(tmp_path):
    world = MadeWorld(start_ns=MORNING_NS)
    schedule = {"every_min": 10, "duration_h": 8, "while_zenith_below_deg": 60, "zenith_passes_deg": [43]}
    assert _run(tmp_path, schedule, world).is_finished
    frames = read_run(tmp_path / "run").frames
    starts_ns = [unix_ns(datetime.fromisoformat(record.start_utc)) for record in frames]
    azimuth_deg, elevation_deg = _sun_deg(starts_ns)
    assert np.max(np.abs([r.sun_elevation_deg for r in frames] - elevation_deg)) < _SUN_TOLERANCE_DEG
    on_sky = np.abs([r.sun_azimuth_deg for r in frames] - azimuth_deg) * np.cos(np.radians(elevation_deg))
    assert np.max(on_sky) < _SUN_TOLERANCE_DEG
    # The rounds are those that astropy's sun allows, and each pass of 43 deg that falls into the time.
    every_ns = MORNING_NS + np.arange(48) * 600 * NS
    allowed = int(np.count_nonzero(_sun_deg(every_ns)[1] > 30.0))
    passes = np.count_nonzero(np.diff(np.sign(_sun_deg(MORNING_NS + np.arange(481) * 60 * NS)[1] - 47.0)))
    assert len(frames) == 4 * (allowed + passes)
    # A round begins when it is due, once the stage has turned; homing and waking take a second at most.
    firsts = [start for start, record in zip(starts_ns, frames, strict=True) if record.polarizer_angle_target_deg == 0]
    late_s = [(first - due) / NS for first, due in zip(sorted(firsts), sorted(_due_ns(tmp_path)), strict=True)]
    assert min(late_s) >= 0
    assert max(late_s) < 1.0
    assert (frames[-1].site_latitude_deg, frames[-1].site_elevation_m, frames[-1].filter_name) == (43.16, 150.0, "V")
    assert {record.round for record in frames} == set(range(allowed + passes))


def _due_ns(tmp_path):
    events = events_of(tmp_path / "run")
    return [unix_ns(datetime.fromisoformat(e["facts"]["due_utc"])) for e in events if e["event"] == "round"]


def test_a_round_whose_time_has_passed_is_left_out_with_an_event(tmp_path):
    world = MadeWorld(start_ns=MORNING_NS)
    schedule = {"every_min": 10, "duration_h": 1, "start": "2026-05-04T10:45:00Z"}
    _run(tmp_path, schedule, world)
    missed = [e["facts"]["round"] for e in events_of(tmp_path / "run") if e["event"] == "round missed"]
    # 10:45 is 15 minutes ago and 10:55 just the five that are allowed.
    assert missed == [0]
    assert {record.round for record in read_run(tmp_path / "run").frames} == {1, 2, 3, 4, 5}


def test_a_clock_set_back_does_not_stall_the_schedule(tmp_path):
    world = MadeWorld(start_ns=MORNING_NS)

    def set_back():
        if world.time.monotonic_ns > 5 * NS + 25 * 60 * NS:
            world.time.set_ns -= H
            world.time.wakes.clear()

    world.time.wakes.append(set_back)
    _run(tmp_path, {"every_min": 10, "duration_h": 1}, world)
    assert world.time.monotonic_ns < 5 * NS + H
    assert len(read_run(tmp_path / "run").frames) == 24


def test_a_stop_while_waiting_is_answered_and_resume_continues(tmp_path):
    world = MadeWorld(start_ns=MORNING_NS)

    def stop():
        if world.time.monotonic_ns > 5 * NS + 15 * 60 * NS:
            ask(tmp_path / "run", "stop")
            world.time.wakes.clear()

    world.time.wakes.append(stop)
    outcome = _run(tmp_path, {"every_min": 10, "duration_h": 1}, world)
    assert not outcome.is_finished
    assert outcome.frames == 8
    # Power comes back after half an hour: rounds 2 to 3 have gone by, 4 is to come.
    world.time.sleep(20 * 60)
    outcome = resume_session(tmp_path / "run", clock=world.time.clock, opener=world.open)
    assert outcome.is_finished
    assert {record.round for record in read_run(tmp_path / "run").frames} == {0, 1, 4, 5}


def test_at_and_until(tmp_path):
    world = MadeWorld(start_ns=MORNING_NS)
    session = SessionFile.model_validate(
        {
            "name": "x",
            "take": [{"kind": "scene", "exposure_ms": 10_000, "cycles": 50}],
            "interlocks": {"disk_free_mb": 0, "exposure": "off"},
        }
    )
    outcome = take_session(
        RIG_AT_SITE, session, tmp_path / "run", files={}, clock=world.time.clock, opener=world.open,
        at_ns=MORNING_NS + H, until_ns=MORNING_NS + H + 60 * NS,
    )  # fmt: skip
    assert outcome.is_finished
    starts = [unix_ns(datetime.fromisoformat(record.start_utc)) for record in read_run(tmp_path / "run").frames]
    assert min(starts) >= MORNING_NS + H
    assert max(starts) < MORNING_NS + H + 61 * NS
    assert len(starts) == 6


def _session(tmp_path, take, more="", *, kind="scene", exposure="1"):
    path = tmp_path / "session.toml"
    path.write_text(f'name = "test"\n{more}\n[[take]]\nkind = "{kind}"\nexposure_ms = {exposure}\n{take}\n')
    return load_session(path)


@pytest.mark.parametrize(
    ("take", "angles", "cycles"),
    [
        # The order that halves what a drift looks like.
        ("", [0, 90, 45, 135], [0] * 4),
        ("angles_deg = [0, 60, 120]\ncycles = 2", [0, 60, 120] * 2, [0] * 3 + [1] * 3),
        (
            'order = "palindrome"\ncycles = 3',
            [0, 90, 45, 135, 135, 45, 90, 0, 0, 90, 45, 135],
            [0] * 4 + [1] * 4 + [2] * 4,
        ),
        ("closing_repeat = true\ncycles = 2", [0, 90, 45, 135, 0] * 2, [0] * 5 + [1] * 5),
        ('order = "grouped"\ncycles = 2\nangles_deg = [0, 60, 120]', [0, 0, 60, 60, 120, 120], [0, 1] * 3),
    ],
    ids=["usual", "cycles", "palindrome", "closing repeat", "grouped"],
)
def test_orders_of_angles(tmp_path, take, angles, cycles):
    steps = plan_steps(_session(tmp_path, take))
    assert [step.polarizer_angle_deg for step in steps] == angles
    assert [step.cycle for step in steps] == cycles
    assert [step.sequence for step in steps] == list(range(len(angles)))
    ends = [last.sequence for last, later in pairwise(steps) if later.cycle != last.cycle]
    wanted = [] if "grouped" in take else [*ends, len(steps) - 1]
    assert [step.sequence for step in steps if step.ends_cycle] == wanted


def test_grouping_states_its_false_dolp_by_drift(tmp_path):
    grouped = _session(tmp_path, 'order = "grouped"\ncycles = 8')
    assert grouping_cost(_session(tmp_path, "cycles = 8")) is None
    cost, instead = (false_dolp(plan_steps(session)) for session in (grouped, _session(tmp_path, "cycles = 8")))
    # Eight frames of an angle take eight times as long as one, and the angles are so much further apart; the moves
    # of the stage are fewer.
    assert cost > instead
    assert f"a false DoLP of {cost:.2g}; in cycles it would be {instead:.2g}" in grouping_cost(grouped)


def test_a_bracket_takes_each_exposure_at_each_angle(tmp_path):
    steps = plan_steps(_session(tmp_path, "bracket = [1, 4]\nangles_deg = [0, 60]"))
    assert [(s.polarizer_angle_deg, s.exposure_s) for s in steps] == [(0, 0.001), (0, 0.004), (60, 0.001), (60, 0.004)]


def test_darks_come_before_after_and_every_so_many_cycles_at_the_exposures_of_the_scene(tmp_path):
    darks = "[darks]\nframes = 1\nevery_cycles = 2"
    steps = plan_steps(_session(tmp_path, "cycles = 4\nangles_deg = [0, 60, 120]", darks))
    assert "".join(step.kind[0] for step in steps) == "d" + "s" * 6 + "d" + "s" * 6 + "d"
    assert {step.exposure_s for step in steps} == {0.001}


def test_every_second_round_can_have_the_darks_or_a_take(tmp_path):
    darks = "darks = { every_cycles = 1, frames = 2, every_rounds = 2 }"
    steps = plan_steps(_session(tmp_path, "angles_deg = [0, 60, 120]", darks), (0, 1, 2))
    assert [sum(step.kind == "dark" for step in steps if step.round == number) for number in range(3)] == [4, 0, 4]
    text = 'every_rounds = 2\nangles_deg = [0]\n[[take]]\nkind = "scene"\nexposure_ms = 2\nangles_deg = [90]'
    steps = plan_steps(_session(tmp_path, text), (1, 2, 3))
    assert [(s.round, s.polarizer_angle_deg) for s in steps] == [(0, 0), (0, 90), (1, 90), (2, 0), (2, 90)]


def test_rounds_count_their_cycles_on_and_none_is_planned_before_it_is_due(tmp_path):
    steps = plan_steps(_session(tmp_path, "cycles = 2\nangles_deg = [0, 60, 120]"), (100 * NS, 200 * NS))
    assert [step.cycle for step in steps if step.polarizer_angle_deg == 0] == [0, 1, 2, 3]
    assert [step.due_ns for step in steps] == [100 * NS] * 6 + [200 * NS] * 6
    assert [step.sequence for step in steps] == list(range(12))
    times = step_times_ns(steps, start_ns=0)
    assert times[0] >= 100 * NS
    assert times[6] >= 200 * NS


def test_exposures_are_in_seconds_and_numbers_run_on_over_takes(tmp_path):
    more = '[[take]]\nkind = "flat"\nexposure_ms = 3\ncycles = 2\n'
    steps = plan_steps(_session(tmp_path, more, kind="dark", exposure="[1, 20]"))
    assert [(step.sequence, step.kind, step.exposure_s) for step in steps] == [
        (0, "dark", 0.001), (1, "dark", 0.02), (2, "flat", 0.003), (3, "flat", 0.003),
    ]  # fmt: skip
    assert all(step.polarizer_angle_deg is None for step in steps)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ('order = "grouped"\nclosing_repeat = true', "no cycles"),
        ('[[take]]\nkind = "dark"\nexposure_ms = "auto"', r"\[darks\]"),
        ("bracket = [0]", "bracket"),
        ('[[take]]\nkind = "flat"\nexposure_ms = [1, 2]\nangles_deg = [0, 90]', r"second \[\[take\]\].*one angle"),
    ],
)
def test_contradictory_takes_are_refused(tmp_path, text, match):
    with pytest.raises(ConfigError, match=match):
        _session(tmp_path, text)


def test_more_steps_than_memory_holds_are_refused_before_any_is_made(tmp_path):
    angles = list(range(100))
    session = _session(tmp_path, f"cycles = 100000\nangles_deg = {angles}")
    with pytest.raises(ConfigError, match=r"make up to 10100000 frames, allowed are 1000000"):
        plan_steps(session)


def test_time_and_disk_grow_with_the_frames():
    rig, session = load_rig(EXAMPLES / "rig-sim.toml"), load_session(EXAMPLES / "session.toml")
    steps = plan_steps(session)
    (whole_s, whole_bytes), (half_s, half_bytes) = estimate(steps, rig), estimate(steps[: len(steps) // 2], rig)
    assert whole_bytes == 2 * half_bytes
    assert whole_bytes > len(steps) * 2 * 782 * 582
    assert whole_s > half_s
    # Without a camera the size of a frame is not known.
    assert estimate(steps, rig.model_copy(update={"simulation": None}))[1] is None
