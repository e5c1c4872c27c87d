"""The vendor's library, unchanged, in native units: names of devices would come from a database in the network."""

import sys

from every_method import Every, near
from pickering import drive
from zaber_motion.ascii import (
    Connection,
    GetAxisSetting,
    GetSetting,
    IoPortType,
    TriggerAction,
    TriggerCondition,
    TriggerOperation,
)

DATABASE = "needs the maker's database of devices, which is in the network"
ASYNC = "is the same once more"
NO_LINES = "the stage has no lines in or out"
MOST_AXIS = {
    "get_state": DATABASE,
    "set_state": DATABASE,
    "can_set_state": DATABASE,
    "has_command": DATABASE,
    "prepare_command": DATABASE,
    "get_command_unit_conversion_descriptors": DATABASE,
    "activate": "is of peripherals",
    "move_sin": "does not turn a polarizer",
    "move_sin_stop": "does not turn a polarizer",
}
SETTINGS = {
    "get_default": DATABASE,
    "get_default_string": DATABASE,
    "get_default_int": DATABASE,
    "get_default_bool": DATABASE,
    "has_setting": DATABASE,
    "can_convert_native_units": DATABASE,
    "convert_to_native_units": DATABASE,
    "convert_from_native_units": DATABASE,
    "get_unit_conversion_descriptor": DATABASE,
    "set_custom_unit_conversions": DATABASE,
    "get_typed": DATABASE,
    "get_many_typed": DATABASE,
}


def every(subject: object, left_out: dict[str, str]) -> Every:
    """All methods but those that wait in another way."""
    asynchronous = {name: ASYNC for name in dir(subject) if name.endswith("_async")}
    return Every(subject, {name: why for name, why in left_out.items() if hasattr(subject, name)} | asynchronous)


def first(result: object) -> float:
    """The value in an answer of several."""
    return result.values[0] if hasattr(result, "values") else result.value


def go_round_axis(axis: object, turn: int) -> None:
    """Call everything that an axis can."""
    a = every(axis, MOST_AXIS)
    a.home()
    if not a.is_homed() or a.is_busy() or a.is_parked():
        sys.exit("it is not ready")
    a.move_absolute(turn / 4)
    a.move_relative(turn / 8)
    near(a.get_position(), turn * 3 / 8, turn * 2e-5)
    near(a.get_number_of_index_positions(), 8)
    near(a.get_index_position(), 4)
    a.move_index(2)
    near(a.get_index_position(), 2)
    a.move_max()
    near(a.get_position(), turn, turn * 2e-5)
    a.move_min()
    a.move_velocity(turn / 10)
    if not a.is_busy():
        sys.exit("it does not go on")
    a.stop()
    a.park()
    a.unpark()
    a.driver_disable()
    a.driver_enable()
    a.wait_until_idle()
    near(float(a.generic_command("get pos").data), a.get_position(), turn * 2e-5)
    a.generic_command_multi_response("get pos")
    a.generic_command_no_response("get pos")
    a.set_label("polarizer")
    a.restore()
    a.finish()


def go_round_settings(settings: object, name: str, request: object) -> None:
    """Call everything that settings can."""
    s = every(settings, SETTINGS | {"get_from_all_axes": "is below", "get_many_by_type": DATABASE})
    was = s.get(name)
    s.set(name, was)
    s.set_int(name, int(was))
    s.set_string(name, str(int(was)))
    s.set_bool(name, True)
    if not s.get_bool(name) or s.get_int(name) != 1 or s.get_string(name) != "1":
        sys.exit(f"{name} is not what was set")
    s.set(name, was)
    near(first(s.get_many(request)[0]), was)
    near(first(s.get_synchronized(request)[0]), was)
    s.finish()


def go_round_triggers(device: object) -> None:
    """Call everything that triggers can."""
    t = every(device.triggers, {})
    number = t.get_number_of_triggers()
    if len(t.get_trigger_states()) != number or len(t.get_enabled_states()) != number:
        sys.exit("triggers are missing")
    t.get_number_of_actions()
    t.get_all_labels()
    g = every(t.get_trigger(2), {})
    g.fire_when("1 pos > 100")
    g.fire_when_distance_travelled(1, 100)
    g.fire_when_encoder_distance_travelled(1, 100)
    g.fire_when_io(IoPortType.DIGITAL_INPUT, 1, TriggerCondition.EQ, 1)
    g.fire_when_setting(1, "pos", TriggerCondition.GE, 100)
    g.fire_when_absolute_setting(1, "pos", TriggerCondition.GE, 100)
    g.fire_at_interval(1000)
    g.on_fire(TriggerAction.A, 1, "stop")
    g.on_fire_set(TriggerAction.B, 1, "maxspeed", TriggerOperation.SET_TO, 100)
    g.on_fire_set_to_setting(TriggerAction.B, 1, "maxspeed", TriggerOperation.SET_TO, 1, "pos")
    g.enable(3)
    state = g.get_state()
    if (state.condition, state.actions[0], state.fires_remaining) != ("when time 1000", "action a 1 stop", 3):
        sys.exit(f"the trigger is {state}")
    g.disable()
    if g.get_enabled_state().enabled:
        sys.exit("it is not disabled")
    fire_triggers(device, g)
    g.clear_action(TriggerAction.ALL)
    g.set_label("second")
    if g.get_label() != "second":
        sys.exit("it has no label")
    g.finish()
    t.finish()


def fire_triggers(device: object, trigger: object) -> None:
    """Stop the stage at a position by a trigger, and count eighths of a turn by another."""
    axis = device.get_axis(1)
    turn = int(axis.generic_command("get limit.cycle.dist").data)
    axis.move_absolute(0)
    trigger.fire_when_setting(1, "pos", TriggerCondition.GE, turn // 4)
    trigger.on_fire(TriggerAction.A, 1, "stop")
    trigger.clear_action(TriggerAction.B)
    trigger.enable(1)
    axis.move_absolute(turn // 2, wait_until_idle=False)
    axis.wait_until_idle(throw_error_on_fault=False)
    near(axis.get_position(), turn / 4, turn * 0.02)
    if trigger.get_enabled_state().enabled:
        sys.exit("it fires more than once")
    axis.warnings.clear_flags()
    axis.move_absolute(0)
    before = axis.settings.get("driver.current.hold")
    trigger.fire_when_distance_travelled(1, turn // 8)
    trigger.on_fire_set(TriggerAction.A, 1, "driver.current.hold", TriggerOperation.INCREMENT_BY, 1)
    trigger.enable()
    axis.move_absolute(round(turn * 0.55))
    trigger.disable()
    near(axis.settings.get("driver.current.hold"), before + 4)


def go_round_storage(storage: object) -> None:
    """Call everything that a storage can."""
    s = every(storage, {})
    s.set_string("lab.note", "two words")
    s.set_number("lab.number", 1.5)
    s.set_bool("lab.switch", True)
    near(s.get_number("lab.number"), 1.5)
    if s.get_string("lab.note") != "two words" or not s.get_bool("lab.switch") or len(s.list_keys("lab.")) != 3:
        sys.exit("it has forgotten")
    if not s.key_exists("lab.note") or not s.erase_key("lab.note") or s.key_exists("lab.note"):
        sys.exit("it does not erase")
    s.finish()


def go_round_warnings(warnings: object) -> None:
    """Call everything that warnings can."""
    w = every(warnings, {})
    w.clear_flags()
    if w.get_flags() - {"NI"}:
        sys.exit("there are warnings")
    w.wait_to_clear(500)
    w.finish()


def go_round_device(device: object) -> None:
    """Call everything that the device can."""
    d = every(device, MOST_AXIS | {"identify": DATABASE, "get_lockstep": "there is one axis"})
    d.generic_command("get pos")
    d.generic_command_multi_response("get pos")
    d.generic_command_no_response("get pos")
    d.get_axis(1)
    d.set_label("rotator")
    d.wait_to_respond(500)
    near(d.renumber(2).device_address, 2)
    near(device.connection.get_device(2).renumber(1).device_address, 1)
    d.restore()
    d.finish()
    near(device.settings.get_from_all_axes("maxspeed")[0], device.get_axis(1).settings.get("maxspeed"))
    io = device.io.get_channels_info()
    near(io.number_digital_outputs + io.number_digital_inputs, 0)
    a = every(device.all_axes, {})
    for name in ("home", "is_busy", "is_homed", "wait_until_idle", "stop", "park", "unpark"):
        getattr(a, name)()
    a.driver_disable()
    a.driver_enable()
    a.finish()


def go_round_connection(connection: object) -> None:
    """Call what concerns the line."""
    near(connection.home_all()[0], 1)
    near(connection.stop_all()[0], 1)
    connection.enable_alerts()
    connection.disable_alerts()
    connection.renumber_devices()
    connection.checksum_enabled = True
    connection.generic_command("get pos", 1)
    connection.generic_command_multi_response("get pos", 1)
    near(len(connection.detect_devices(identify_devices=False)), 1)


with Connection.open_serial_port(sys.argv[1]) as connection:
    (device,) = connection.detect_devices(identify_devices=False)
    axis = device.get_axis(1)
    turn = int(axis.generic_command("get limit.cycle.dist").data)
    axis.home()
    drive(
        lambda angle_deg: axis.generic_command(f"move abs {round(angle_deg * turn / 360)}") and axis.wait_until_idle(),
        lambda: int(axis.generic_command("get pos").data) * 360 / turn,
    )
    go_round_axis(axis, turn)
    go_round_settings(axis.settings, "accel", GetAxisSetting("accel"))
    go_round_settings(device.settings, "system.led.enable", GetSetting("system.led.enable"))
    go_round_triggers(device)
    go_round_storage(axis.storage)
    go_round_storage(device.storage)
    go_round_warnings(axis.warnings)
    go_round_warnings(device.warnings)
    go_round_device(device)
    go_round_connection(connection)
