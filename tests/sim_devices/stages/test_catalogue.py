import pytest

from sim_devices.clock import ManualClock
from sim_devices.stages.catalogue import SCHEMES, make_stage, parse_stage_address
from sim_devices.stages.ellx import EllxOptions


@pytest.mark.parametrize("scheme", SCHEMES)
def test_every_family_is_made_from_its_address(scheme: str) -> None:
    address = f"{scheme}?start=12.5&seed=3&stall=3&busy=1&drop=0.01&vanish=2&back=0.5&unhomed=1&minus=1&pace=1"
    machine = make_stage(parse_stage_address(address), clock=ManualClock())
    assert machine.true_angle_deg() == 12.5
    assert machine.commands_heard() == 0


def test_every_key_is_read() -> None:
    text = (
        "sim:ellx?model=18&serial=42&pulses=0x40000&slow=20&landing=0.01&mark=1.5&start=-3&busy=1&gap=0.1&stall=3"
        "&button=2&silent=9&late=0.3&drop=0.01&double=0.02&flip=0.03&pieces=1&pace=0&seed=7&speed=50&fault=8@3"
        "&unhomed=1&minus=1&backlash=0.05&creep=0.2&vanish=4&back=1.5"
    )
    assert parse_stage_address(text) == EllxOptions(
        model=18,
        serial_number=42,
        pulses=262144,
        gap_s=0.1,
        seed=7,
        speed=50.0,
        motor_deg_per_s=20.0,
        landing_deg=0.01,
        mark_deg=1.5,
        start_deg=-3.0,
        backlash_deg=0.05,
        creep_deg=0.2,
        busy=True,
        stall=3,
        button=2,
        fault=(8, 3),
        unhomed=True,
        minus_one=True,
        drop=0.01,
        double=0.02,
        flip=0.03,
        late_s=0.3,
        pieces=True,
        silent=9,
        vanish=4,
        back_s=1.5,
    )


@pytest.mark.parametrize(
    ("address", "problem"),
    [
        ("sim:smc100", "allowed are sim:ellx, sim:zaber, sim:apt"),
        ("/dev/ttyUSB0", "allowed are sim:ellx"),
        ("sim:zaber?fault=XX@1", "a warning flag that begins with F"),
        ("sim:apt?model=BSC201", "one of K10CR1, K10CR2, KDC101"),
        ("sim:apt?fault=0@1", "status bits"),
        ("sim:ellx?busy", "busy=: must be one of 0, 1"),
        ("sim:ellx?busy=2", "busy=2"),
        ("sim:ellx?drop=1.5", "drop=1.5: must be a number from 0 to 1"),
        ("sim:ellx?late=nan", "late=nan"),
        ("sim:ellx?stall=0", "stall=0"),
        ("sim:ellx?stall=2.5", "stall=2.5"),
        ("sim:ellx?fault=8", "fault=8: must be CODE@MOVE"),
        ("sim:ellx?fault=8@0", "fault=8@0"),
        ("sim:ellx?seed=1&seed=2", "'seed' stands twice"),
        # All problems at once, and all that is allowed.
        (
            "sim:ellx?stal=3&busy=7",
            "(?s)'stal' is no key.*busy=7.*stall= number of the move that stalls: a whole number",
        ),
    ],
)
def test_a_wrong_address_is_refused_with_the_reason(address: str, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        parse_stage_address(address)
