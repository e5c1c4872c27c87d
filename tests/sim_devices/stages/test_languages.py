"""What the simulated stages of each family answer; see `tests.sim_devices.stages.conversations` for how to read it."""

import pytest

from sim_devices.stages.apt import AptLanguage
from sim_devices.stages.ellx import EllxLanguage
from sim_devices.stages.zaber import ZaberLanguage
from tests.sim_devices.stages.conversations import blocks, hold

# It turns by 90 degrees a second, from its mark at 45 degrees in the housing.
ELLX = """
questions and settings, answered at once
1 > 0in < 0IN0E1140132620251801016800023000
1 > 0gs < 0GS00
1 > 0gp < 0PO00000000
1 > 0st < 0GS00
1 > 0gv < 0GV64
1 > 0sv32 < 0GS00
1 > 0us < 0GS00
1 > 0sk < 0GS00
1 > 0go < 0HO0000018E
1 > 0so00000400 < 0GS00
1 > 0gj < 0GJ00000F8E
1 > 0sj00002000 < 0GS00
1 > 0i1 < 0I110005DFFFFFFFF00BD008B
1 > 0i2 < 0I210005DFFFFFFFF00BC008C
1 > 0b2FFFF < 0GS00

what it refuses, and remembers until it is read
1 > 0sv00 < 0GS04
1 > 0sv65 < 0GS04
1 > 0ma7FFFFFFF < 0GS04
1 > 0ma0000460z < 0GS04
1 > 0soFFFFFFFF < 0GS04
1 > 0sj00023001 < 0GS04
1 > 0b10001 < 0GS04
1 > 0i3 < 0GS03
1 > 0zz < 0GS03
1 > 0gp0gs0gs < 0PO00000000 < 0GS03 < 0GS00

to what is not whole, or not its own, it has nothing to say
1 > 3gs
1 > 3ma00004600
1 > ?!
1 > 0ma0000460
9 @ 45

a move is answered when it ends; before, it is busy and takes no other
1 > 0ma00004600
1.1 > 0gs < 0GS09
1.2 > 0ma00000000 < 0GS09
1.3 > 0st < 0GS09
1.5 < 0PO00004600
2 @ 90

a relative move may end below zero
0 > 0mrFFFFFFFF
0.00002790 < 0POFFFFFFFF

homing is answered when it ends
0 > 0ma00004600
0.5 < 0PO00004600
1 > 0ho0
1.5 < 0PO00000000

half the velocity takes twice the time
0 > 0sv32 < 0GS00
0 > 0ma00004600
1 < 0PO00004600

on request a move is first answered by busy
? busy=1
0 > 0ma00004600 < 0GS09
0.5 < 0PO00004600

a command may come in pieces, and one that pauses for two seconds is forgotten with error 1
0 > 0g
1.9 > p < 0PO00000000
2 > 0ma0000
4.1 > 0gs < 0GS01
4.2 > 0gs < 0GS00

a stall stops half-way and is told after two seconds
? stall=2
0 > 0ma00002300
0.25 < 0PO00002300
1 > 0ma00004600
3.125 < 0GS02
5 @ 78.75
5 > 0gs < 0GS02

a pressed button is told unasked and turns the stage
? button=1
0 > 0ma00004600
0.5 < 0BS09
0.555551 < 0BO00004DC7
0.555551 < 0PO00004DC7

a move too soon after another goes to zero
? gap=0.1
0 > 0ma00004600
0.5 < 0PO00004600
0.55 > 0ma00002300
1.05 < 0PO00000000
2.1 > 0ma00002300
2.35 < 0PO00002300

it falls silent from the command on that was asked for
? silent=2
0 > 0gs < 0GS00
0.1 > 0gs

a period that is set is told until the search finds the resonance
0 > 0f180C0 < 0GS00
0 > 0i1 < 0I110005DFFFFFFFF00C0008B
0 > 0s1
0.5 > 0gs < 0GS09
1.5 < 0GS00
2 > 0i1 < 0I110005DFFFFFFFF00BD008B

jogs go by the step; a jog of nothing goes on until it is stopped
0 > 0sj00000800 < 0GS00
0 > 0fw
0.057143 < 0PO00000800
5 > 0bw
5.057143 < 0PO00000000
6 > 0sj00000000 < 0GS00
6 > 0fw < 0GS00
8 > 0ma00000000 < 0GS09
15 > 0st < 0GS00
20 @ 855

upkeep takes minutes and can be stopped
0 > 0om
60 > 0gs < 0GS09
61 > 0st < 0GS00
62 > 0cm
302 < 0GS00

another home offset moves the zero by its change, here a degree
0 > 0so0000031C < 0GS00
0 > 0ho1
0.011105 < 0PO00000000
9 @ 45.9994

another address is the only one it then listens to
0 > 0caB < BGS00
0.1 > 0gs
0.2 > Bgs < BGS00

the address of a group holds for one motion
0 > 0ga3 < 0GS00
0.1 > 3gs
0.2 > 3ma00004600
0.7 < 0PO00004600
3 > 3ma00000000
9 @ 90

in isolation it is deaf and tells so afterwards
0 > 0is02 < 0GS00
119 > 0gs0ma00004600
121 > 0gs < 0GS06
122 > 0gs < 0GS00
"""
# A K10CR1 at its mark; its parameters make 10 degrees a second. Data of a status: position, encoder, bits.
APT = """
questions, answered at once
1 > 80 04 01 00 50 01 < 81 04 0e 00 81 50 01 00 00 00 00 00 00 00 00 00 00 21 00 80
1 > 90 04 01 00 50 01 < 91 04 0e 00 81 50 01 00 00 00 00 00 00 00 00 00 00 21 00 80
1 > 29 04 01 00 50 01 < 2a 04 06 00 81 50 01 00 00 21 00 80
1 > 11 04 01 00 50 01 < 12 04 06 00 81 50 01 00 00 00 00 00
1 > 11 02 01 00 50 01 < 12 02 01 01 01 50
1 > 3b 04 01 00 50 01 < 3c 04 06 00 81 50 01 00 00 00 00 00

to what is no question, not its own, or of another controller, it has nothing to say
1 > 18 00 00 00 50 01
2 > 00 00 00 00 00 00
3 > 80 04 01 00 22 01
4 > a1 04 01 00 50 01

settings are kept and told
0 > 00 05 01 04 50 01
0 > 01 05 01 00 50 01 < 02 05 01 04 01 50
0 > 13 04 0e 00 d0 01 01 00 00 00 00 00 b0 35 00 00 cd cc cc 00
0 > 14 04 01 00 50 01 < 15 04 0e 00 81 50 01 00 00 00 00 00 b0 35 00 00 cd cc cc 00

while it moves the status says so, and its end is told
0 > 53 04 06 00 d0 01 01 00 00 c0 5d 00
1 > 29 04 01 00 50 01 < 2a 04 06 00 81 50 01 00 20 01 00 80
4.5 < 64 04 0e 00 81 50 01 00 00 c0 5d 00 00 00 00 00 00 21 00 80
9 @ 45

moves without data go by the parameters
0 > 50 04 06 00 d0 01 01 00 00 c0 5d 00
0 > 53 04 01 00 50 01
4.5 < 64 04 0e 00 81 50 01 00 00 c0 5d 00 00 00 00 00 00 21 00 80
9 > 45 04 06 00 d0 01 01 00 00 40 a2 ff
9 > 48 04 01 00 50 01
13.5 < 64 04 0e 00 81 50 01 00 00 00 00 00 00 00 00 00 00 21 00 80
20 @ 0

a jog goes by a step either way
0 > 6a 04 01 01 50 01
0.1 > 29 04 01 00 50 01 < 2a 04 06 00 81 50 01 00 40 01 00 80
0.5 < 64 04 0e 00 81 50 01 00 55 95 f5 ff 00 00 00 00 00 21 00 80
1 > 6a 04 01 02 50 01
1.5 < 64 04 0e 00 81 50 01 00 00 00 00 00 00 00 00 00 00 21 00 80

a motion without end ends at a stop
0 > 57 04 01 02 50 01
99 > 65 04 01 02 50 01 < 66 04 0e *
200 @ 990

soft limits end a move and are told
0 > 23 04 10 00 d0 01 01 00 01 00 01 00 00 40 1f 00 00 c0 e0 ff 02 00
0 > 53 04 06 00 d0 01 01 00 00 c0 5d 00
1.5 < 64 04 0e 00 81 50 01 00 00 40 1f 00 00 00 00 00 08 21 00 80
9 @ 15

the place where it stands may get another number
0 > 10 04 06 00 d0 01 01 00 00 c0 5d 00
0 > 11 04 01 00 50 01 < 12 04 06 00 81 50 01 00 00 c0 5d 00
0 @ 0

ends are not told while that is suspended
0 > 6b 04 01 00 50 01
0 > 53 04 06 00 d0 01 01 00 00 c0 5d 00
9 > 6c 04 01 00 50 01
9 > 43 04 01 00 50 01
13.5 < 44 04 01 00 01 50

homing sets its bit and says so; another home offset moves the zero
? start=20
0 > 40 04 0e 00 d0 01 01 00 02 00 01 00 27 7b 5e 04 aa aa 0a 00
0 > 43 04 01 00 50 01
1 > 29 04 01 00 50 01 < 2a 04 06 00 81 50 01 00 10 03 00 80
1.888 < 44 04 01 00 01 50
5 @ 1.12
5 > 29 04 01 00 50 01 < 2a 04 06 00 81 50 01 00 00 25 00 80

on request homing says nothing
? start=20&quiethome=1
0 > 43 04 01 00 50 01
5 > 29 04 01 00 50 01 < 2a 04 06 00 81 50 01 00 00 25 00 80

without parameters it says that it moves, and stands still
? forgets=1
0 > 53 04 06 00 d0 01 01 00 00 c0 5d 00
99 > 29 04 01 00 50 01 < 2a 04 06 00 81 50 01 00 20 01 00 80
99 @ 0

a servo that is not switched on does not move
? model=KDC101
0 > 43 04 01 00 50 01
0 > 27 04 01 00 50 01
99 > 10 02 01 01 50 01
99 > 43 04 01 00 50 01
99 < 44 04 01 00 01 50

what came in part is forgotten after a silence
0 > 53 04 06 00 d0 01 01
1 > 11 04 01 00 50 01 < 12 04 06 00 81 50 01 00 00 00 00 00
"""
# It turns by 90 degrees a second, from its mark at 0.
ZABER = """
questions, answered at once
1 > / < @01 0 OK IDLE WR 0
1 > /0 0 00:00 < @01 0 00 OK IDLE WR 0
1 > /1 1 42 < @01 1 42 OK IDLE WR 0
1 > /get system.serial < @01 0 OK IDLE WR 114821
1 > /1 1 get resolution < @01 1 OK IDLE WR 64
1 > /1 1 get limit.cycle.dist < @01 1 OK IDLE WR 1536000
1 > noise/1 1 get pos < @01 1 OK IDLE WR 0
1 > /1 0 warnings < @01 0 OK IDLE WR 01 WR
1 > /1 get 1 maxspeed accel < @01 0 OK IDLE WR 699051 ; 205
1 > /1 1 get motion.index.num < @01 1 OK IDLE WR 1
1 > /1 trigger show < @01 0 OK IDLE WR d d d d d d
1 > /1 io info < @01 0 OK IDLE WR 0 0 0 0

what it refuses
1 > /1 tools echo:BF < @01 0 RJ IDLE WR BADCOMMAND
1 > /1 1 get no.such < @01 1 RJ IDLE WR BADCOMMAND
1 > /1 2 get pos < @01 2 RJ IDLE WR BADAXIS
1 > /1 1 move abs x < @01 1 RJ IDLE WR BADDATA
1 > /1 1 move abs 1000000001 < @01 1 RJ IDLE WR BADDATA
1 > /1 1 set accel x < @01 1 RJ IDLE WR BADDATA
1 > /1 1 set deviceid 5 < @01 1 RJ IDLE WR BADCOMMAND
1 > /1 1 move sin 100 100 < @01 1 RJ IDLE WR BADDATA
1 > /1 trigger 7 enable < @01 0 RJ IDLE WR BADDATA
1 > /1 storage get a < @01 0 RJ IDLE WR BADDATA
1 > /1 renumber 100 < @01 0 RJ IDLE WR BADDATA
1 > /1 trigger 1 when time 0 < @01 0 RJ IDLE WR BADDATA
1 > /1 trigger 1 when 1 dist x < @01 0 RJ IDLE WR BADDATA
1 > /1 trigger 1 action c 1 stop < @01 0 RJ IDLE WR BADDATA
1 > /1 trigger 1 enable often < @01 0 RJ IDLE WR BADDATA

to what is not its own or not sound it has nothing to say
1 > /2 get pos
1 > get pos
1 > /1 tools echo:BE

with checksums switched on every message has one
0 > /1 set comm.checksum 1 < @01 0 OK IDLE WR 0:3E

homing takes the warning away
? start=45
0 > /1 1 home < @01 1 OK BUSY WR 0
0.4 > /1 1 < @01 1 OK BUSY WR 0
0.6 > /1 1 < @01 1 OK IDLE -- 0

a move is accepted at once, ends in its time, and can be stopped
0 > /1 1 move abs 384000 < @01 1 OK BUSY WR 0
0.5 > /1 1 get pos < @01 1 OK BUSY WR 192000
1.5 > /1 1 get encoder.pos < @01 1 OK IDLE WR 384000
2 @ 90
2 > /1 1 move rel 384000 < @01 1 OK BUSY WR 0
2.5 > /1 1 stop < @01 1 OK IDLE WR 0
9 @ 135

alerts tell the end of a motion when they are on
0 > /0 0 set comm.alert 1:B1 < @01 0 OK IDLE WR 0
0 > /1 1 move rel 384000 < @01 1 OK BUSY WR 0
1 < !01 1 IDLE WR

a stall stops half-way with its flag until that is cleared
? stall=1
0 > /1 1 move abs 384000 < @01 1 OK BUSY WR 0
1 > /1 1 < @01 1 OK IDLE FS 0
1 @ 45
1 > /1 1 warnings clear < @01 1 OK IDLE WR 02 FS WR

a lower top speed takes longer; a motion at a speed goes on until it is stopped
0 > /1 1 set maxspeed 69905 < @01 1 OK IDLE WR 0
0 > /1 1 move abs 384000 < @01 1 OK BUSY WR 0
8 @ 80
9.1 > /1 1 move vel -69905 < @01 1 OK BUSY WR 0
14.1 > /1 1 stop < @01 1 OK IDLE WR 0
99 @ 40

moves to an end and to an index
? oneturn=1
0 > /1 1 move max < @01 1 OK BUSY WR 0
9 @ 360
9 > /1 1 move index 3 < @01 1 OK BUSY WR 0
20 @ 90
20 > /1 1 get motion.index.num < @01 1 OK IDLE WR 3

a stage that may not move says why
0 > /1 tools parking park < @01 0 OK IDLE WR 0
0 > /1 1 move abs 9 < @01 1 RJ IDLE WR PARKED
0 > /1 tools parking unpark < @01 0 OK IDLE WR 0
0 > /1 driver disable < @01 0 OK IDLE FO 0
0 > /1 1 move abs 9 < @01 1 RJ IDLE FO DRIVERDISABLED
0 > /1 driver enable < @01 0 OK IDLE WR 0

another number is the only one it then listens to
0 > /1 renumber 5 < @05 0 OK IDLE WR 0
0 > /1 get pos
0 > /5 get pos < @05 0 OK IDLE WR 0

texts are kept for device and axis apart
0 > /1 storage set a two words < @01 0 OK IDLE WR 0
0 > /1 1 storage axis set a other < @01 1 OK IDLE WR 0
0 > /1 storage append a more < @01 0 OK IDLE WR 0
0 > /1 storage get a < @01 0 OK IDLE WR two words more
0 > /1 storage axis get a < @01 0 OK IDLE WR other
0 > /1 storage erase a < @01 0 OK IDLE WR 0
0 > /1 storage exists a < @01 0 OK IDLE WR 0

settings can be made what they were
0 > /1 set accel 300 < @01 0 OK IDLE WR 0
0 > /1 system restore < @01 0 OK IDLE WR 0
0 > /1 get accel < @01 0 OK IDLE WR 205

a trigger is told as the commands that make it
0 > /1 trigger 2 when 1 pos > 5 < @01 0 OK IDLE WR 0
0 > /1 trigger 2 action a 1 stop < @01 0 OK IDLE WR 0
0 > /1 trigger 2 enable 3 < @01 0 OK IDLE WR 0
0 > /1 0 7 trigger 2 print < @01 0 7 OK IDLE WR 0 < #01 0 7 when 1 pos > 5 < #01 0 7 action a 1 stop
0 < #01 0 7 action b none
0 < #01 0 7 enable 3

a trigger fires each time its condition comes true, and at once where it is
0 > /1 trigger 1 when 1 accel > 300 < @01 0 OK IDLE WR 0
0 > /1 trigger 1 action b 1 motion.accelonly += 5 < @01 0 OK IDLE WR 0
0 > /1 trigger 1 enable < @01 0 OK IDLE WR 0
1 > /1 set accel 301 < @01 0 OK IDLE WR 0
2 > /1 set accel 302 < @01 0 OK IDLE WR 0
3 > /1 set accel 300 < @01 0 OK IDLE WR 0
4 > /1 set accel 303 < @01 0 OK IDLE WR 0
5 > /1 get motion.accelonly < @01 0 OK IDLE WR 215

a trigger fires by distance in both directions
0 > /1 trigger 1 when 1 dist 1000 < @01 0 OK IDLE WR 0
0 > /1 trigger 1 action a 1 accel += 1 < @01 0 OK IDLE WR 0
0 > /1 trigger 1 enable < @01 0 OK IDLE WR 0
5 > /1 1 move rel 10500 < @01 1 OK BUSY WR 0
20 > /1 get accel < @01 0 OK IDLE WR 215
20 > /1 1 move rel -10500 < @01 1 OK BUSY WR 0
40 > /1 get accel < @01 0 OK IDLE WR 225

a trigger fires by time and sets a setting to another; what cannot be done is left
0 > /1 trigger 1 when time 100 < @01 0 OK IDLE WR 0
0 > /1 trigger 1 action a 1 accel += 1 < @01 0 OK IDLE WR 0
0 > /1 trigger 1 action b 1 driver.current.hold = setting 1 accel < @01 0 OK IDLE WR 0
0 > /1 trigger 2 when 1 pos >= 0 < @01 0 OK IDLE WR 0
0 > /1 trigger 2 action a 1 move abs far < @01 0 OK IDLE WR 0
0 > /1 trigger 2 enable < @01 0 OK IDLE WR 0
0 > /1 set accel 90 < @01 0 OK IDLE WR 0
0 > /1 trigger 1 enable 7 < @01 0 OK IDLE WR 0
0.35 > /1 get accel < @01 0 OK IDLE WR 93
5 > /1 get driver.current.hold < @01 0 OK IDLE WR 97
"""


def conversations(text: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("lines", [pytest.param(lines[1:], id=lines[0]) for lines in blocks(text)])


@conversations(ELLX)
def test_elliptec(lines: list[str]) -> None:
    hold(
        lines,
        address="sim:ellx?landing=0&start=45&mark=45&slow=90",
        make=EllxLanguage,
        encode=str.encode,
        decode=lambda reply: reply.decode().removesuffix("\r\n"),
    )


@pytest.mark.parametrize("ending", [b"\r\n", b"\n", b"\r"])
def test_an_elliptec_command_may_end_in_a_line(ending: bytes) -> None:
    lines = ["0 > 0ma0000", "0.1 > !0gs", "0.1 < 0GS00"]  # a carriage return makes it forget a command in part
    make_bytes = {"0ma0000": b"", "!0gs": ending + b"0gs" + ending}
    hold(lines, address="sim:ellx?", make=EllxLanguage, encode=make_bytes.__getitem__, decode=lambda b: b.decode()[:-2])


def test_the_current_curve_of_elliptec_motors_has_its_peak_at_the_resonance() -> None:
    curves: list[bytes] = []

    def keep(reply: bytes) -> str:
        curves.append(reply)
        return "curve"

    hold(["0 > 0c1", "12 < curve"], address="sim:ellx?", make=EllxLanguage, encode=str.encode, decode=keep)
    points = [bytes.fromhex(curves[0][start : start + 12].decode()) for start in range(3, len(curves[0]) - 2, 12)]
    currents = {int.from_bytes(point[:2], "little"): int.from_bytes(point[2:], "little") for point in points}
    assert (curves[0][:3], len(points)) == (b"0C1", 87)
    assert max(currents, key=lambda period: currents[period]) in (0x8B, 0xBD)


def hold_apt(lines: list[str]) -> None:
    address = "sim:apt?landing=0" if any("start=" in line for line in lines) else "sim:apt?landing=0&start=0"
    hold(lines, address=address, make=AptLanguage, encode=bytes.fromhex, decode=lambda reply: reply.hex(" "))


@conversations(APT)
def test_apt(lines: list[str]) -> None:
    hold_apt(lines)


@pytest.mark.parametrize(
    ("model", "number", "length"),
    [
        ("K10CR1", 0x0416, 20),
        ("K10CR1", 0x0423, 14),
        ("K10CR1", 0x0426, 4),
        ("K10CR1", 0x0440, 12),
        ("K10CR1", 0x0450, 4),
        ("KDC101", 0x04A0, 18),
        ("KDC101", 0x04B0, 24),
        ("KDC101", 0x04B3, 2),
        ("KDC101", 0x04B6, 14),
        ("KDC101", 0x0520, 28),
        ("KDC101", 0x0523, 8),
        ("KDC101", 0x0526, 32),
    ],
)
def test_parameters_of_apt_are_kept_and_told(model: str, number: int, length: int) -> None:
    low, high, data = f"{number & 0xFF:02x}", f"{number >> 8:02x}", bytes([1, 0, *range(1, length + 1)]).hex(" ")
    size = f"{length + 2:02x} 00"
    asks, tells = f"{(number + 1) & 0xFF:02x}", f"{(number + 2) & 0xFF:02x}"
    hold_apt(
        [
            f"? model={model}",
            f"0 > {low} {high} {size} d0 01 {data}",
            f"0 > {asks} {high} 01 00 50 01",
            f"0 < {tells} {high} {size} 81 50 {data}",
        ]
    )


@pytest.mark.parametrize(("model", "serial", "stage_id"), [("K10CR1", 55000123, 0), ("KDC101", 27000123, 6)])
def test_an_apt_controller_says_what_it_is(model: str, serial: int, stage_id: int) -> None:
    said: list[bytes] = []

    def keep(reply: bytes) -> str:
        said.append(reply)
        return "information"

    lines = ["0 > 05 00 00 00 50 01", "0 < information"]
    hold(lines, address=f"sim:apt?model={model}", make=AptLanguage, encode=bytes.fromhex, decode=keep)
    assert (said[0][:6].hex(" "), len(said[0])) == ("06 00 54 00 81 50", 6 + 84)
    assert (int.from_bytes(said[0][6:10], "little"), said[0][10:18]) == (serial, model.encode() + bytes(8 - len(model)))
    assert said[0][6 + 76] == stage_id


def test_an_apt_controller_that_nobody_acknowledges_tells_its_status_fifty_times() -> None:
    status = "81 04 0e 00 81 50 01 00 00 00 00 00 00 00 00 00 00 21 00 80"
    told = [f"{0.1 * number} < {status}" for number in range(50)]
    again = [f"{20.0 + 0.1 * number} < {status}" for number in range(10)]
    acknowledged = ["20 > 92 04 00 00 50 01", *again, "20.95 > 12 00 00 00 50 01", "30 @ 0"]
    hold_apt(["0 > 11 00 00 00 50 01", *told, *acknowledged])


@conversations(ZABER)
def test_zaber(lines: list[str]) -> None:
    address = "sim:zaber?landing=0&slow=90" if "start=" in lines[0] else "sim:zaber?landing=0&start=0&slow=90"
    hold(
        lines,
        address=address,
        make=ZaberLanguage,
        encode=lambda text: f"{text}\n".encode(),
        decode=lambda reply: reply.decode().removesuffix("\r\n"),
    )
