import pytest

from sim_devices.stages.ellx import EllxOptions, parse_address
from sim_devices.stages.options import LineOptions, MotionOptions


def test_a_bare_address_is_a_sound_stage() -> None:
    motion = MotionOptions(motor_deg_per_s=430.0, landing_deg=0.004)
    assert parse_address("sim:ellx") == EllxOptions(motion=motion, line=LineOptions())


def test_flags_are_true_or_false_and_no_numbers() -> None:
    options = parse_address("sim:ellx?busy=1&pace=0")
    assert options.motion.busy is True
    assert options.line.pace is False


def test_every_key_is_read() -> None:
    text = (
        "sim:ellx?model=18&serial=42&pulses=0x40000&slow=20&landing=0.01&mark=1.5&start=-3&busy=1&gap=0.1&stall=3"
        "&button=2&silent=9&late=0.3&drop=0.01&double=0.02&flip=0.03&pieces=1&pace=1&seed=7&speed=50&fault=8@3"
        "&unhomed=1&minus=1&backlash=0.05&creep=0.2&vanish=4&back=1.5"
    )
    assert parse_address(text) == EllxOptions(
        model=18,
        serial_number=42,
        pulses=262144,
        gap_s=0.1,
        seed=7,
        speed=50.0,
        motion=MotionOptions(
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
        ),
        line=LineOptions(
            drop=0.01,
            double=0.02,
            flip=0.03,
            late_s=0.3,
            pieces=True,
            pace=True,
            silent=9,
            vanish=4,
            back_s=1.5,
        ),
    )


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("sim:ell14", "'sim:ell14', not 'sim:ellx'"),
        ("/dev/ttyUSB0", "not 'sim:ellx'"),
        ("sim:ellx?stal=3", "'stal' is no key"),
        ("sim:ellx?busy", "busy=: must be a whole number from 0 to 1"),
        ("sim:ellx?busy=2", "busy=2"),
        ("sim:ellx?drop=1.5", "drop=1.5: must be a number from 0 to 1"),
        ("sim:ellx?late=nan", "late=nan"),
        ("sim:ellx?stall=0", "stall=0"),
        ("sim:ellx?stall=2.5", "stall=2.5"),
        ("sim:ellx?fault=8", "fault=8: must be CODE@MOVE"),
        ("sim:ellx?fault=0@1", "fault=0@1"),
        ("sim:ellx?fault=8@0", "fault=8@0"),
        ("sim:ellx?seed=1&seed=2", "'seed' stands twice"),
    ],
)
def test_a_wrong_address_is_refused_with_the_reason(text: str, problem: str) -> None:
    with pytest.raises(ValueError, match="Allowed after") as caught:
        parse_address(text)
    assert problem in str(caught.value)


def test_all_problems_are_named_at_once_with_all_that_is_allowed() -> None:
    with pytest.raises(ValueError) as caught:
        parse_address("sim:ellx?stal=3&busy=7")
    message = str(caught.value)
    assert "'stal' is no key" in message
    assert "busy=7" in message
    assert "stall= number of the move that stalls: a whole number from 1 to 1000000000" in message
