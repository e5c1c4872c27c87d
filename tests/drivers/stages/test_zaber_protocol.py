"""The literal messages are those of Zaber's manual, of its own libraries' tests, and of what its client sends."""

from dataclasses import replace

import pytest

from drivers.errors import LimitError, ProtocolError
from drivers.stages import zaber as protocol
from drivers.stages.zaber import Event, Reply, ReplyParser, Unasked


def parse(data: bytes) -> Event | None:
    parser = ReplyParser()
    parser.feed(data)
    return parser.next_event()


@pytest.mark.parametrize(
    ("text", "digits"),
    [
        ("1 tools echo", "BF"),
        ("2 1", "7D"),
        ("get maxspeed", "49"),
        ("0 0 set comm.alert 1", "B1"),
        ("0 0 00", "00"),
        ("01 0 OK IDLE -- 0", "8D"),
        ("01 0 OK IDLE -- 7z", "0C"),
    ],
)
def test_checksums(text: str, digits: str) -> None:
    assert protocol.checksum(text) == digits


def test_the_first_command_of_the_vendors_client() -> None:
    assert protocol.command("", device=0, axis=0, message_id=0) == b"/0 0 00:00\n"


@pytest.mark.parametrize(
    ("words", "axis", "message_id", "text"),
    [
        ("get pos", 1, 7, b"/1 1 07 get pos"),
        ("move abs 384000", 1, 42, b"/1 1 42 move abs 384000"),
        ("move abs -17", 1, 42, b"/1 1 42 move abs -17"),
        ("home", 0, 99, b"/1 0 99 home"),
    ],
)
def test_commands_say_it_and_add_up_to_zero(words: str, axis: int, message_id: int, text: bytes) -> None:
    said, colon, check = protocol.command(words, device=1, axis=axis, message_id=message_id).partition(b":")
    assert said == text
    assert colon == b":"
    assert check.endswith(b"\n")
    assert (sum(said[1:]) + int(check, 16)) % 256 == 0


IDLE = Reply(device=1, axis=0, message_id=None, accepted=True, busy=False, flag="--", data="0", checked=False)


@pytest.mark.parametrize(
    ("line", "event"),
    [
        (b"@01 0 OK IDLE -- 0\r\n", IDLE),
        (b"@01 0 OK IDLE -- 0:8D\r\n", replace(IDLE, checked=True)),
        (b"@01 0 12 OK IDLE -- 0\r\n", replace(IDLE, message_id=12)),
        (b"@01 0 OK IDLE WR 49822\r\n", replace(IDLE, flag="WR", data="49822")),
        (b"@01 1 OK BUSY -- 0\r\n", replace(IDLE, axis=1, busy=True)),
        (b"@02 0 RJ IDLE -- BADCOMMAND\r\n", replace(IDLE, device=2, accepted=False, data="BADCOMMAND")),
        (b"@01 0 OK IDLE FS 02 FS WR\r\n", replace(IDLE, flag="FS", data="02 FS WR")),
        (b"!01 1 IDLE --\r\n", Unasked(kind="!", text="01 1 IDLE --")),
        (b"#01 0 help\r\n", Unasked(kind="#", text="01 0 help")),
    ],
)
def test_messages(line: bytes, event: Event) -> None:
    assert parse(line) == event


@pytest.mark.parametrize(
    "damaged",
    [
        b"@01 0 OK IDLE -- 0:8E\r\n",
        b"@01 0 OK IDLE -- 1:8D\r\n",
        b"@01 0 OK IDLE -- 0:GG\r\n"[:-4] + b"\n",
        b"@01 0 OK IDLE -- 0\n",
        b"@01 0 OK IDLE\r\n",
        b"@01 OK IDLE -- 0\r\n",
        b"01 0 OK IDLE -- 0\r\n",
        b"@01 0 OK SLOW -- 0\r\n",
        b"@01 0 OK IDLE -- \x07\r\n",
        b"\r\n",
    ],
)
def test_a_damaged_message_is_an_error_and_the_next_one_is_read(damaged: bytes) -> None:
    parser = ReplyParser()
    parser.feed(damaged + b"@01 0 OK IDLE -- 0:8D\r\n")
    with pytest.raises(ProtocolError):
        parser.next_event()
    assert parser.next_event() == replace(IDLE, checked=True)


def test_a_flood_without_messages_is_not_kept() -> None:
    parser = ReplyParser()
    with pytest.raises(ProtocolError, match="make no message"):
        parser.feed(b"x" * 1025)
    parser.feed(b"@01 0 OK IDLE -- 0:8D\r\n")
    assert parser.next_event() == replace(IDLE, checked=True)


@pytest.mark.parametrize(("data", "flags"), [("00", ()), ("01 WR", ("WR",)), ("02 FS WR", ("FS", "WR"))])
def test_flags(data: str, flags: tuple[str, ...]) -> None:
    assert protocol.warning_flags(data) == flags


@pytest.mark.parametrize("data", ["", "WR", "02 WR", "01 wr", "01 WRX"])
def test_what_is_no_list_of_flags_is_an_error(data: str) -> None:
    with pytest.raises(ProtocolError, match="no list of warning flags"):
        protocol.warning_flags(data)


@pytest.mark.parametrize("data", ["", "12.5", "0x10", "--3", "1 2"])
def test_what_is_no_whole_number_is_an_error(data: str) -> None:
    with pytest.raises(ProtocolError, match="no whole number"):
        protocol.whole_number(data)


@pytest.mark.parametrize("address", ["", "0", "100", "A", "-1"])
def test_an_address_that_does_not_exist_is_refused(address: str) -> None:
    with pytest.raises(LimitError, match="1 to 99"):
        protocol.check_address(address)
