"""Interlocks on what the devices and the host say of themselves."""

import pytest

from drivers.errors import DeviceFaultError, LimitError, NotConnectedError
from drivers.interfaces import CameraFacts
from rigctl.errors import DataError
from rigctl.runs.folder import read_run
from rigctl.session.control import ask
from tests.rigctl.session.made_rig import NS, MadeWorld, events_of, silent, stalled, unplugged
from tests.rigctl.session.watched_sessions import assert_whole, take_watched, trips_of


def told(*, triggered):
    """What a camera of any driver, a plug-in's too, may tell of itself."""
    return CameraFacts(sample_format="made", justified="right", linear=None, triggered=triggered)


def test_a_gap_of_the_frame_counter_is_noted_in_the_frame_after_it(tmp_path):
    world = MadeWorld()
    world.camera.lost, world.camera.facts = {5: 2}, lambda: told(triggered=True)
    take_watched(world, tmp_path)
    assert trips_of(tmp_path) == [("counter", "note")]
    remarks = {record.sequence: record.remarks for record in read_run(tmp_path / "run").frames if record.remarks}
    assert list(remarks) == [5]
    assert "says 7 after 4: 2 pictures were lost" in remarks[5][0]


def test_a_gap_can_have_the_frame_taken_again(tmp_path):
    world = MadeWorld()
    world.camera.lost, world.camera.facts = {5: 2}, lambda: told(triggered=True)
    take_watched(world, tmp_path, counter="retry")
    assert trips_of(tmp_path) == [("counter", "retry")]
    assert world.camera.taken == 9
    assert_whole(tmp_path)


def test_a_camera_that_does_not_tell_is_not_taken_for_triggered(tmp_path):
    world = MadeWorld()
    world.camera.lost = {5: 2}
    take_watched(world, tmp_path)
    assert trips_of(tmp_path) == []


def test_a_camera_that_runs_by_itself_counts_what_nobody_asked_for(tmp_path):
    world = MadeWorld()
    world.camera.lost, world.camera.facts = {5: 2}, lambda: told(triggered=False)
    take_watched(world, tmp_path)
    assert trips_of(tmp_path) == []


@pytest.mark.parametrize("back", [-1, -2])
def test_a_number_that_does_not_grow_is_an_old_picture_of_any_camera(tmp_path, back):
    world = MadeWorld()
    world.camera.lost = {5: back}
    take_watched(world, tmp_path)
    assert trips_of(tmp_path) == [("counter", "note")]


def test_after_a_picture_that_did_not_come_the_next_number_is_taken_as_it_is(tmp_path):
    world = MadeWorld(camera_faults={4: silent()})
    world.camera.lost, world.camera.facts = {5: 1}, lambda: told(triggered=True)
    take_watched(world, tmp_path)
    assert trips_of(tmp_path) == [("gone", "retry")]
    assert_whole(tmp_path)


def test_a_camera_too_warm_is_noted_once_and_its_temperature_stands_in_every_frame(tmp_path):
    world = MadeWorld()
    world.camera.temperature_c = 71.5
    take_watched(world, tmp_path)
    assert trips_of(tmp_path) == [("temperature", "note")]
    assert {record.camera_temperature_c for record in read_run(tmp_path / "run").frames} == {71.5}


def test_a_camera_too_cold_stops_where_that_is_asked_for(tmp_path):
    world = MadeWorld()
    world.camera.temperature_c = -31.0
    with pytest.raises(LimitError, match=r"at -31\.0 deg C, allowed are -20 to 60"):
        take_watched(world, tmp_path, temperature="stop")


def test_a_camera_too_warm_holds_until_it_has_cooled(tmp_path):
    world = MadeWorld()
    world.camera.temperature_c = 70.0
    began_ns = world.time.monotonic_ns

    def cool():
        if world.time.monotonic_ns > began_ns + 120 * NS:
            world.camera.temperature_c = 40.0

    world.time.wakes.append(cool)
    take_watched(world, tmp_path, temperature="hold")
    names = [event["event"] for event in events_of(tmp_path / "run")]
    assert names.index("hold") < names.index("go on")
    assert world.time.monotonic_ns > began_ns + 120 * NS
    assert_whole(tmp_path)


def test_a_stage_that_lies_about_its_reference_mark_stops_the_session(tmp_path):
    world = MadeWorld()
    world.stage.is_homed = False
    with pytest.raises(LimitError, match="reference mark"):
        take_watched(world, tmp_path)
    assert_whole(tmp_path, frames=0)


def test_a_fault_of_the_stage_can_be_tried_again_from_its_reference_mark(tmp_path):
    world = MadeWorld(stage_faults={3: stalled()})
    take_watched(world, tmp_path, fault="retry")
    assert trips_of(tmp_path) == [("fault", "retry")]
    assert world.stage.homes == 2
    assert_whole(tmp_path)


def test_a_fault_that_stays_stops_after_the_retries(tmp_path):
    with pytest.raises(DeviceFaultError, match="mechanical"):
        take_watched(MadeWorld(stage_faults={k: stalled() for k in range(3, 99)}), tmp_path, fault="retry", retries=2)
    assert trips_of(tmp_path) == [("fault", "retry")] * 3
    assert_whole(tmp_path, frames=2)


def test_a_fault_can_hold_until_a_person_has_mended_it(tmp_path):
    world = MadeWorld(stage_faults={3: stalled()})
    began_ns = world.time.monotonic_ns

    def mended():
        if world.time.monotonic_ns > began_ns + 60 * NS:
            ask(tmp_path / "run", "go on")
            world.time.wakes.clear()

    world.time.wakes.append(mended)
    take_watched(world, tmp_path, fault="hold")
    assert world.time.monotonic_ns > began_ns + 60 * NS
    assert_whole(tmp_path)


def test_settings_can_be_noted_only(tmp_path):
    world = MadeWorld()
    world.camera.lies_s = 0.005
    take_watched(world, tmp_path, settings="note")
    assert set(trips_of(tmp_path)) == {("settings", "note")}
    assert all("asked for an exposure" in record.remarks[0] for record in read_run(tmp_path / "run").frames)


def test_settings_can_be_given_again(tmp_path):
    world = MadeWorld()
    world.camera.lies_s, takes = 0.005, []

    def mends(counts):
        takes.append(1)
        world.camera.lies_s = 0.0
        return counts

    world.camera._faults = {0: mends}
    take_watched(world, tmp_path, settings="retry")
    # The settings that were read back, and those of the frame.
    assert set(trips_of(tmp_path)) == {("settings", "retry")}
    assert world.camera.taken == 9
    assert_whole(tmp_path)


def test_another_device_on_the_same_port_is_not_taken_for_the_one_that_went_away(tmp_path):
    world = MadeWorld(camera_faults={2: unplugged()})
    world.serial_numbers = ["1", "2"]
    with pytest.raises(NotConnectedError, match=r"serial number 2, and this run began with stand-in, 1"):
        take_watched(world, tmp_path)
    assert_whole(tmp_path, frames=2)


def test_gone_hold_waits_for_as_long_as_it_takes(tmp_path):
    world = MadeWorld(camera_faults={2: unplugged()})
    world.refuses_until_ns = 0

    def away():
        if world.opened == 1 and world.camera.taken == 3:
            world.refuses_until_ns = world.time.monotonic_ns + 3 * 3600 * NS
            world.time.wakes.clear()

    world.time.wakes.append(away)
    began_ns = world.time.monotonic_ns
    take_watched(world, tmp_path, gone="hold", reconnect_s=10)
    assert world.time.monotonic_ns > began_ns + 3 * 3600 * NS
    names = [event["event"] for event in events_of(tmp_path / "run")]
    assert names.index("hold") < names.index("devices opened again")
    assert_whole(tmp_path)


def test_a_clock_that_follows_no_time_server_is_noted_at_the_start(tmp_path):
    world = MadeWorld()
    world.time.problem = "not synchronised"
    take_watched(world, tmp_path)
    assert trips_of(tmp_path) == [("synchronised", "note")]


def test_a_session_can_refuse_a_clock_that_follows_no_time_server(tmp_path):
    world = MadeWorld()
    world.time.problem = "not synchronised"
    with pytest.raises(DataError, match="not synchronised"):
        take_watched(world, tmp_path, synchronised="stop")
