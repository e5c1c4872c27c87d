"""Each interlock trips when it must, does what the session file says, and loses nothing that is good."""

import errno
import re
import threading

import numpy as np
import pytest

from drivers.errors import DeviceFaultError, DeviceTimeoutError, LimitError, NotConnectedError, ProtocolError
from drivers.interfaces import CameraFacts
from rigctl.errors import DataError, RunFolderError
from rigctl.runs import writer as run_writer
from rigctl.runs.folder import read_run
from rigctl.runs.records import SessionNoise
from rigctl.session import interlocks
from rigctl.session.control import ask
from rigctl.session.take import resume_session
from tests.rigctl.session.made_rig import (
    NS,
    MadeWorld,
    assert_whole,
    events_of,
    silent,
    stalled,
    take_watched,
    trips_of,
    unplugged,
)


def told(*, triggered):
    """What a camera of any driver, a plug-in's too, may tell of itself."""
    return CameraFacts(sample_format="made", justified="right", linear=None, triggered=triggered)


def brighter(counts):
    return (counts * 1.2).astype(np.uint16)


def after(world, duration_s, act):
    """Have something done once, so many seconds of simulated time from now."""
    due_ns = world.time.monotonic_ns + duration_s * NS

    def look():
        if world.time.monotonic_ns > due_ns:
            world.time.wakes.clear()
            act()

    world.time.wakes.append(look)
    return due_ns


def names_of(tmp_path):
    return [event["event"] for event in events_of(tmp_path / "run")]


def test_a_quiet_session_trips_nothing(tmp_path):
    assert take_watched(MadeWorld(), tmp_path).is_finished
    assert trips_of(tmp_path) == []
    assert_whole(tmp_path)


@pytest.mark.parametrize(
    ("name", "faults", "locks"),
    [
        ("angle", {"stage_faults": {2: 0.5}}, {}),
        ("button", {"stage_faults": {2: "a button was pressed"}}, {}),
        ("black", {"camera_faults": {3: np.zeros_like}}, {}),
        ("black", {"camera_faults": {3: lambda counts: np.full_like(counts, 17)}}, {}),
        ("gone", {"camera_faults": {3: silent()}}, {}),
        ("fault", {"stage_faults": {3: stalled()}}, {"fault": "retry"}),
    ],
)
def test_a_bad_frame_is_taken_again(tmp_path, name, faults, locks):
    world = MadeWorld(**faults)
    take_watched(world, tmp_path, **locks)
    assert trips_of(tmp_path) == [(name, "retry")]
    assert_whole(tmp_path)
    run = read_run(tmp_path / "run")
    assert max(abs(r.polarizer_angle_deg - r.polarizer_angle_target_deg) for r in run.frames) < 1e-9
    assert all(run.counts(record).std() > 0 for record in run.frames)
    # After a fault the stage is sent to its reference mark.
    assert world.stage.homes == (2 if name == "fault" else 1)


def test_a_picture_sent_twice_is_taken_again(tmp_path):
    sent = []

    def keep(counts):
        sent.append(counts)
        return counts

    take_watched(MadeWorld(camera_faults={2: keep, 3: lambda _: sent[0]}), tmp_path)
    assert trips_of(tmp_path) == [("identical", "retry")]
    assert_whole(tmp_path)


@pytest.mark.parametrize(
    ("locks", "error", "match", "faults"),
    [
        ({"angle": "stop"}, LimitError, "asked for", {"stage_faults": {2: 0.5}}),
        ({"button": "stop"}, LimitError, "touched", {"stage_faults": {2: "a button"}}),
        ({"black": "stop"}, ProtocolError, "no picture", {"camera_faults": {3: np.zeros_like}}),
        ({"gone": "stop"}, DeviceTimeoutError, "no answer", {"camera_faults": {2: silent()}}),
        ({}, DeviceFaultError, "mechanical", {"stage_faults": {3: stalled()}}),
    ],
)
def test_stop_ends_the_session_and_resume_continues(tmp_path, locks, error, match, faults):
    world = MadeWorld(**faults)
    with pytest.raises(error, match=match):
        take_watched(world, tmp_path, **locks)
    assert world.opened == 1
    assert read_run(tmp_path / "run").frames
    assert resume_session(tmp_path / "run", clock=world.time.clock, opener=world.open).is_finished
    assert_whole(tmp_path)


@pytest.mark.parametrize(
    ("name", "error", "faults", "frames"),
    [
        ("black", ProtocolError, {"camera_faults": dict.fromkeys(range(3, 6), np.zeros_like)}, 3),
        ("fault", DeviceFaultError, {"stage_faults": {k: stalled() for k in range(3, 99)}}, 2),
    ],
)
def test_a_lasting_violation_stops_after_the_retries(tmp_path, name, error, faults, frames):
    with pytest.raises(error):
        take_watched(MadeWorld(**faults), tmp_path, retries=2, **{name: "retry"})
    assert trips_of(tmp_path) == [(name, "retry")] * 3
    assert_whole(tmp_path, frames=frames)


@pytest.mark.parametrize(
    ("name", "faults"),
    [
        ("black", {"camera_faults": {3: np.zeros_like}}),
        ("fault", {"stage_faults": {3: stalled()}}),
        ("temperature", {}),
    ],
)
def test_hold_waits_until_the_session_is_continued_or_the_reason_has_gone(tmp_path, name, faults):
    world = MadeWorld(**faults)
    if name == "temperature":
        world.camera.temperature_c = 70.0
        due_ns = after(world, 60, lambda: setattr(world.camera, "temperature_c", 40.0))
    else:
        due_ns = after(world, 60, lambda: ask(tmp_path / "run", "continue"))
    take_watched(world, tmp_path, **{name: "hold"})
    names = names_of(tmp_path)
    assert names.index("hold") < names.index("continue")
    assert world.time.monotonic_ns > due_ns
    assert_whole(tmp_path)


@pytest.mark.parametrize(("name", "dn_per_s"), [("saturated", 20_000.0), ("low_signal", 1.0)])
def test_properties_of_the_scene_are_one_event_and_a_remark_in_every_frame(tmp_path, name, dn_per_s):
    take_watched(MadeWorld(dn_per_s=dn_per_s), tmp_path, low_signal="note", low_signal_level=0.05, sum_rule="off")
    assert trips_of(tmp_path) == [(name, "note")]
    assert all("of the pixels" in record.remarks[0] for record in read_run(tmp_path / "run").frames)
    assert_whole(tmp_path)


def test_a_first_frame_that_is_far_too_bright_holds_with_a_proposal_until_it_is_mended(tmp_path):
    world = MadeWorld(dn_per_s=1e6)

    def stop_down():
        world.camera._dn_per_s = 1000.0
        ask(tmp_path / "run", "continue")

    due_ns = after(world, 60, stop_down)
    take_watched(world, tmp_path, exposure="hold")
    assert trips_of(tmp_path) == [("exposure", "hold")]
    assert world.time.monotonic_ns > due_ns
    (hold,) = [event["facts"]["reason"] for event in events_of(tmp_path / "run") if event["event"] == "hold"]
    # 1e6 * 100 * 1.3 / 2 DN a second fill 0.8 of 4095 in 50 us; metering is content within a tenth.
    found = re.search(r"100 % of the pixels of the first frame are saturated at 10 ms; exposure_ms = (\S+) fills", hold)
    assert 0.04 < float(found[1]) < 0.06
    assert_whole(tmp_path)
    run = read_run(tmp_path / "run")
    assert max(run.counts(record).max() for record in run.frames) < 4095


@pytest.mark.parametrize(
    ("action", "is_terminal"), [("stop", False), ("note", False), ("hold", True)], ids=["stop", "note", "at a terminal"]
)
def test_a_first_frame_that_is_far_too_bright_stops_or_is_warned_of(tmp_path, monkeypatch, caplog, action, is_terminal):
    monkeypatch.setattr("sys.stdin", type("Stdin", (), {"isatty": lambda _: is_terminal})())
    world = MadeWorld(dn_per_s=1e6)
    if action == "stop":
        with pytest.raises(DataError, match="exposure_ms = "):
            take_watched(world, tmp_path, exposure=action)
        return
    take_watched(world, tmp_path, exposure=action, sum_rule="off", saturated="off")
    assert trips_of(tmp_path) == [("exposure", action)]
    assert "exposure_ms = " in " ".join(caplog.text.split())
    assert_whole(tmp_path)


def with_camera(**state):
    return lambda world: vars(world.camera).update(state)


@pytest.mark.parametrize(
    ("prepare", "locks", "error", "match"),
    [
        (
            with_camera(_dn_per_s=1.0),
            {"low_signal": "stop", "low_signal_level": 0.05},
            DataError,
            "less than 205 DN.*lon",
        ),
        (
            with_camera(temperature_c=-31.0),
            {"temperature": "stop"},
            LimitError,
            r"at -31\.0 deg C, allowed are -20 to 60",
        ),
        (with_camera(lies_s=0.005), {}, LimitError, r"asked for an exposure of 0\.01 s"),
        (lambda world: setattr(world.stage, "is_homed", False), {}, LimitError, "reference mark"),
        (lambda world: setattr(world.time, "problem", "off"), {"synchronised": "stop"}, DataError, "clock is off"),
    ],
    ids=["low_signal", "temperature", "settings", "homed", "synchronised"],
)
def test_an_interlock_stops_before_the_first_frame_is_stored(tmp_path, prepare, locks, error, match):
    world = MadeWorld()
    prepare(world)
    with pytest.raises(error, match=match):
        take_watched(world, tmp_path, **locks)
    assert_whole(tmp_path, frames=0)


def test_interlocks_note_and_the_frames_keep_the_remarks(tmp_path):
    world = MadeWorld()
    world.camera.lies_s, world.camera.temperature_c, world.time.problem = 0.005, 71.5, "not synchronised"
    take_watched(world, tmp_path, settings="note")
    trips = trips_of(tmp_path)
    assert set(trips) == {("settings", "note"), ("temperature", "note"), ("synchronised", "note")}
    assert trips.count(("temperature", "note")) == 1
    frames = read_run(tmp_path / "run").frames
    assert all("asked for an exposure" in record.remarks[0] for record in frames)
    assert {record.camera_temperature_c for record in frames} == {71.5}


def test_off_does_not_look(tmp_path):
    take_watched(MadeWorld(camera_faults={3: np.zeros_like}), tmp_path, black="off", sum_rule="off")
    assert trips_of(tmp_path) == []


def test_settings_that_change_by_themselves_stop_the_session(tmp_path):
    world = MadeWorld()

    def automatic(counts):
        world.camera.lies_s = 0.005
        return counts

    world.camera._faults = {2: automatic}
    with pytest.raises(LimitError, match="automatic exposure"):
        take_watched(world, tmp_path)
    assert_whole(tmp_path, frames=2)


def test_settings_can_be_given_again(tmp_path):
    world = MadeWorld()
    world.camera.lies_s = 0.005

    def mends(counts):
        world.camera.lies_s = 0.0
        return counts

    world.camera._faults = {0: mends}
    take_watched(world, tmp_path, settings="retry")
    # The settings that were read back, and those of the frame.
    assert set(trips_of(tmp_path)) == {("settings", "retry")}
    assert world.camera.taken == 9
    assert_whole(tmp_path)


@pytest.mark.parametrize(
    ("lost", "facts", "locks", "trips"),
    [
        ({5: 2}, told(triggered=True), {}, [("counter", "note")]),
        ({5: 2}, told(triggered=True), {"counter": "retry"}, [("counter", "retry")]),
        # A camera that runs by itself counts pictures that nobody asked for; one that does not tell may do so.
        ({5: 2}, told(triggered=False), {}, []),
        ({5: 2}, None, {}, []),
        # A number that does not grow is an old picture of any camera.
        ({5: -1}, None, {}, [("counter", "note")]),
        ({5: -2}, None, {}, [("counter", "note")]),
    ],
)
def test_gaps_of_the_frame_counter(tmp_path, lost, facts, locks, trips):
    world = MadeWorld()
    world.camera.lost = lost
    if facts is not None:
        world.camera.facts = lambda: facts
    take_watched(world, tmp_path, **locks)
    assert trips_of(tmp_path) == trips
    assert world.camera.taken == (9 if locks else 8)
    assert_whole(tmp_path)
    remarks = {record.sequence: record.remarks[0] for record in read_run(tmp_path / "run").frames if record.remarks}
    if trips == [("counter", "note")] and lost[5] == 2:
        assert list(remarks) == [5]
        assert "says 7 after 4: 2 pictures were lost" in remarks[5]


def test_after_a_picture_that_did_not_come_the_next_number_is_taken_as_it_is(tmp_path):
    world = MadeWorld(camera_faults={4: silent()})
    world.camera.lost, world.camera.facts = {5: 1}, lambda: told(triggered=True)
    take_watched(world, tmp_path)
    assert trips_of(tmp_path) == [("gone", "retry")]
    assert_whole(tmp_path)


def test_the_sum_rule_finds_light_that_changes_within_a_cycle(tmp_path):
    # The second frame of the first cycle (90 deg, about 325 + 100 DN) has a fifth more light: I0 + I90 is too large by
    # 85 of about 1200 DN, 7 %; allowed are 2 %.
    take_watched(MadeWorld(camera_faults={1: brighter}), tmp_path)
    assert trips_of(tmp_path) == [("sum_rule", "note")]
    assert [record.sequence for record in read_run(tmp_path / "run").frames if record.remarks] == [3]
    (tmp_path / "stops").mkdir()
    with pytest.raises(DataError, match=r"I0 \+ I90"):
        take_watched(MadeWorld(camera_faults={1: brighter}), tmp_path / "stops", sum_rule="stop")
    assert_whole(tmp_path / "stops", frames=4)  # the whole cycle is kept


def test_noise_widens_the_limit_of_the_sum_rule(tmp_path):
    # Read noise of 1000 DN in 192 pixels: 72 DN in a mean, 144 DN in the sum of four; five of that are far above 85 DN.
    noise = SessionNoise(gain_dn_per_e=0.1, read_noise_e=1e4, black_level_dn=100.0, dark_current_e_per_s=0.0)
    take_watched(MadeWorld(camera_faults={1: brighter}), tmp_path, noise=noise)
    assert trips_of(tmp_path) == []


@pytest.mark.parametrize(
    ("faults", "take"),
    # A fifth more counts, black level included, in all four angles: far above 2 %; or within a cycle that ends where
    # it began.
    [(dict.fromkeys((4, 5, 6, 7), brighter), {}), ({4: brighter}, {"closing_repeat": True, "cycles": 1})],
)
def test_light_that_jumps_is_noted(tmp_path, faults, take):
    take_watched(MadeWorld(camera_faults=faults), tmp_path, take=take, drift="note", sum_rule="off")
    assert trips_of(tmp_path) == [("drift", "note")]


@pytest.mark.parametrize("faults", [{"stage_faults": {3: unplugged()}}, {"camera_faults": {2: unplugged()}}])
def test_a_device_that_is_gone_for_ten_seconds_is_opened_again(tmp_path, faults):
    world = MadeWorld(**faults)
    world.refuses_until_ns = world.time.monotonic_ns

    def unplug():
        if world.opened == 1 and world.stage.moves == 3 and not world.refuses_until_ns > world.time.monotonic_ns:
            world.refuses_until_ns = world.time.monotonic_ns + 10 * NS

    world.time.wakes.append(unplug)
    take_watched(world, tmp_path)
    assert ("gone", "retry") in trips_of(tmp_path)
    assert world.opened > 2
    assert "devices opened again" in names_of(tmp_path)
    assert_whole(tmp_path)


def test_a_device_that_stays_away_ends_the_session_after_its_time(tmp_path):
    world = MadeWorld(stage_faults={k: unplugged() for k in range(3, 500)})
    began_ns = world.time.monotonic_ns
    with pytest.raises(NotConnectedError, match="disconnected"):
        take_watched(world, tmp_path, reconnect_s=60)
    assert 60 * NS < world.time.monotonic_ns - began_ns < 90 * NS
    assert_whole(tmp_path, frames=2)


def test_gone_hold_waits_for_as_long_as_it_takes(tmp_path):
    world = MadeWorld(camera_faults={2: unplugged()})
    world.refuses_until_ns = 0

    def away():
        if world.opened == 1 and world.camera.taken == 3:
            world.refuses_until_ns = world.time.monotonic_ns + 20 * 60 * NS
            world.time.wakes.clear()

    world.time.wakes.append(away)
    began_ns = world.time.monotonic_ns
    take_watched(world, tmp_path, gone="hold", reconnect_s=10)
    assert world.time.monotonic_ns > began_ns + 20 * 60 * NS
    names = names_of(tmp_path)
    assert names.index("hold") < names.index("devices opened again")
    assert_whole(tmp_path)


def test_another_device_on_the_same_port_is_refused(tmp_path):
    world = MadeWorld(camera_faults={2: unplugged()})
    world.serial_numbers = ["1", "2"]
    with pytest.raises(NotConnectedError, match=r"serial number 2, and this run began with stand-in, 1"):
        take_watched(world, tmp_path)
    assert_whole(tmp_path, frames=2)


def test_a_clock_set_back_an_hour_is_noted_and_the_frames_keep_their_order(tmp_path):
    world = MadeWorld()

    def set_back():
        if world.camera.taken == 4:
            world.time.set_ns -= 3600 * NS
            world.time.wakes.clear()

    world.time.wakes.append(set_back)
    take_watched(world, tmp_path)
    assert trips_of(tmp_path) == [("clock", "note")]
    assert_whole(tmp_path)
    frames = read_run(tmp_path / "run").frames
    assert any("set by -3600.0 s" in remark for remark in frames[-1].remarks)
    monotonic = [record.start_monotonic_ns for record in frames]
    assert monotonic == sorted(monotonic)


def test_a_clock_that_is_set_again_and_again_fills_no_header(tmp_path):
    world = MadeWorld()

    def set_on():
        world.time.set_ns += 10 * NS

    world.time.wakes.append(set_on)
    take_watched(world, tmp_path, take={"cycles": 30})
    assert_whole(tmp_path, frames=120)
    assert len(read_run(tmp_path / "run").frames[-1].remarks) == 5


def free_bytes(monkeypatch, free):
    """Let the disk have so many bytes free, look by look."""
    usage = type("Usage", (), {"free": property(lambda _: next(free))})
    monkeypatch.setattr(interlocks.shutil, "disk_usage", lambda _: usage())


def test_a_disk_that_is_nearly_full_holds_until_there_is_room(tmp_path, monkeypatch):
    free_bytes(monkeypatch, (mb * 1_000_000 for mb in [500, 500, 100, 100, 100, 100, *[500] * 100]))
    take_watched(MadeWorld(), tmp_path, disk_free_mb=200)
    assert trips_of(tmp_path) == [("disk", "hold")]
    assert "continue" in names_of(tmp_path)
    assert_whole(tmp_path)


def test_a_disk_without_room_for_all_frames_gives_a_warning_at_the_start(tmp_path, monkeypatch, caplog):
    free_bytes(monkeypatch, iter([20_000] * 100))
    take_watched(MadeWorld(), tmp_path)
    # A frame has 12 * 16 * 2 bytes of pixels, 5760 of header and about 1024 of manifest: 7168.
    events = [event for event in events_of(tmp_path / "run") if event["event"] == "disk is short"]
    assert len(events) == 1
    assert "has room for 2 of them" in events[0]["facts"]["found"]
    assert "has room for 2 of them" in " ".join(caplog.text.split())
    assert_whole(tmp_path)


def fail_writes(monkeypatch, code, fails):
    write = run_writer.write_durably

    def sometimes(path, data):
        if fails(path.name):
            raise OSError(code, "simulated")
        write(path, data)

    monkeypatch.setattr(run_writer, "write_durably", sometimes)


def test_a_full_disk_keeps_the_frame_in_hand_until_it_can_be_written(tmp_path, monkeypatch):
    fails = iter([True, True, True])
    fail_writes(monkeypatch, errno.ENOSPC, lambda name: "000003" in name and next(fails, False))
    take_watched(MadeWorld(), tmp_path)
    assert {"tries": 4, "sequence": 3} in [event["facts"] for event in events_of(tmp_path / "run")]
    assert_whole(tmp_path)


@pytest.mark.parametrize(("code", "locks"), [(errno.EROFS, {}), (errno.ENOSPC, {"disk": "stop"})])
def test_a_disk_that_cannot_be_written_stops_and_resume_continues(tmp_path, monkeypatch, code, locks):
    world, broken = MadeWorld(), [True]
    fail_writes(monkeypatch, code, lambda name: "000003" in name and bool(broken))
    with pytest.raises(RunFolderError, match="cannot be written"):
        take_watched(world, tmp_path, **locks)
    assert_whole(tmp_path, frames=3)
    broken.clear()
    assert resume_session(tmp_path / "run", clock=world.time.clock, opener=world.open).is_finished
    assert_whole(tmp_path)


def test_a_session_waits_for_a_slow_disk_notes_it_and_loses_nothing(tmp_path, monkeypatch):
    is_noted = threading.Event()
    write, event = run_writer.write_durably, run_writer.RunWriter.event

    def slow(path, data):
        # The first frame takes until the session has found its queue full.
        assert path.suffix != ".fits" or is_noted.wait(30)
        write(path, data)

    def telling(self, name, **facts):
        event(self, name, **facts)
        if facts.get("interlock") == "queue":
            is_noted.set()

    monkeypatch.setattr(run_writer, "write_durably", slow)
    monkeypatch.setattr(run_writer.RunWriter, "event", telling)
    take_watched(MadeWorld(), tmp_path, queue="note")
    assert ("queue", "note") in trips_of(tmp_path)
    assert_whole(tmp_path)
