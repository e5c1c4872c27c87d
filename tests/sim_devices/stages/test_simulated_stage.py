import numpy as np
import pytest

from sim_devices.faults import LineNoise
from sim_devices.stages.stage import Line


def line(
    *, baud: int | None = None, in_pieces: bool = False, late_s: float = 0.0, noise: LineNoise | None = None
) -> Line:
    return Line(
        baud=baud,
        in_pieces=in_pieces,
        late_s=late_s,
        noise=noise or LineNoise(),
        generator=np.random.default_rng(0),
    )


def test_a_reply_arrives_when_it_is_sent_and_once() -> None:
    plain = line()
    plain.send(1.0, b"0GS00\r\n")
    assert plain.next_arrival_s() == 1.0
    assert plain.arrived(0.9) == b""
    assert plain.arrived(1.0) == b"0GS00\r\n"
    assert plain.arrived(9.0) == b""
    assert plain.next_arrival_s() is None


def test_paced_bytes_take_ten_bits_each() -> None:
    paced = line(baud=9600)
    paced.send(0.0, b"0PO00004600\r\n")
    # 1e-9 s is far below a byte's 1.04 ms and far above the rounding of the sum.
    assert paced.arrived(5 * 10 / 9600 + 1e-9) == b"0PO00"
    assert paced.arrived(13 * 10 / 9600 + 1e-9) == b"004600\r\n"


def test_pieces_arrive_one_after_the_other() -> None:
    pieces = line(in_pieces=True)
    pieces.send(0.0, b"0GS00\r\n")
    got = []
    while (time_s := pieces.next_arrival_s()) is not None:
        got.append(pieces.arrived(time_s))
    assert got == [b"0G", b"S0", b"0\r", b"\n"]


def test_every_third_reply_is_late_and_what_follows_waits() -> None:
    slow = line(late_s=2.0)
    for number in range(4):
        slow.send(float(number) / 10, b"%d" % number)
    assert slow.arrived(2.1) == b"01"
    assert slow.arrived(2.2) == b"23"


@pytest.mark.parametrize("baud", [None, 9600])
def test_a_reply_of_which_all_is_lost_never_arrives(baud: int | None) -> None:
    dead = line(baud=baud, noise=LineNoise(drop=1.0))
    dead.send(0.0, b"0GS00\r\n")
    assert dead.next_arrival_s() is None
