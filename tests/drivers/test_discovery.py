import sys
from functools import partial
from importlib.metadata import EntryPoint
from types import ModuleType

import pytest

from drivers import discovery
from drivers.discovery import STAGES, Found, find_stages
from drivers.errors import NotConnectedError
from drivers.interfaces import DeviceIdentity
from drivers.serial_port import BytePort, PortInfo
from drivers.stages.apt import ask_apt
from drivers.stages.elliptec import ask_elliptec
from drivers.stages.serial_stage import Answer, StageProbe
from drivers.stages.zaber import ask_zaber
from tests.drivers.stages.lines import Bench


def info(usb_id: tuple[int, int] | None, device: str = "/dev/ttyUSB0") -> PortInfo:
    return PortInfo(device=device, lasting_name="/dev/serial/by-id/x", usb_id=usb_id, usb_serial_number=None)


@pytest.mark.parametrize(
    ("address", "ask", "expected"),
    [
        ("ellx", ask_elliptec, ("0", "ELL14", "11401326", "18")),
        ("ellx?model=17", ask_elliptec, ("0", "ELL17", "11401326", "18")),
        ("zaber", ask_zaber, ("1", "Zaber 50931", "114821", "7.38")),
        ("apt?model=KDC101", ask_apt, (None, "KDC101", "27000123", "3.1.2")),
    ],
)
def test_each_family_says_what_it_is_and_stays_as_it_was(
    address: str, ask: partial[list[Answer]], expected: tuple[str | None, str, str, str]
) -> None:
    bench = Bench(address)
    before_deg = bench.machine.true_angle_deg()
    (answer,) = ask(bench.port(), now_s=bench.clock.now_s)
    identity = answer.identity
    assert (answer.address, identity.model, identity.serial_number, identity.firmware) == expected
    bench.clock.advance(60.0)
    assert bench.machine.true_angle_deg() == before_deg


@pytest.mark.parametrize("address", ["ellx", "zaber", "apt"])
@pytest.mark.parametrize("ask", [ask_elliptec, ask_zaber, ask_apt])
def test_a_question_of_another_family_moves_nothing(address: str, ask: partial[list[Answer]]) -> None:
    bench = Bench(address)
    before_deg = bench.machine.true_angle_deg()
    found = ask(bench.port(), now_s=bench.clock.now_s)
    bench.clock.advance(60.0)
    assert bench.machine.true_angle_deg() == before_deg
    assert len(found) <= 1


def no_port(path: str, *, baud: int) -> BytePort:
    raise AssertionError(f"{path} must not be opened")


@pytest.mark.parametrize("usb_id", [None, (0x0403, 0x6001), (0x2341, 0x0043)])
def test_what_may_be_anything_is_not_even_opened(usb_id: tuple[int, int] | None) -> None:
    (found,) = find_stages([info(usb_id)], probe=False, open_port=no_port)
    assert found.answer is None
    assert "--probe" in found.remark


@pytest.mark.parametrize(
    ("usb_id", "address", "driver"),
    [
        ((0x0403, 0x6015), "ellx", "ellx"),
        ((0x0403, 0xFAF0), "apt", "apt"),
        ((0x2939, 0x495B), "zaber", "zaber"),
    ],
)
def test_a_known_usb_id_is_asked_its_own_question_only(usb_id: tuple[int, int], address: str, driver: str) -> None:
    bench = Bench(address)
    opened: list[int] = []

    def open_port(path: str, *, baud: int) -> BytePort:
        opened.append(baud)
        return bench.port()

    found = find_stages([info(usb_id)], probe=False, open_port=open_port)
    assert [each.driver for each in found if each.answer] == [driver]
    assert len(opened) == 1


def test_a_port_that_cannot_be_opened_is_told_and_the_others_are_asked() -> None:
    bench = Bench("apt")

    def open_port(path: str, *, baud: int) -> BytePort:
        if path == "/dev/ttyUSB0":
            raise NotConnectedError(f"{path}: no permission")
        return bench.port()

    usb_id = (0x0403, 0xFAF0)
    found: list[Found] = find_stages([info(usb_id), info(usb_id, "/dev/ttyUSB1")], probe=False, open_port=open_port)
    assert found[0].remark == "/dev/ttyUSB0: no permission"
    assert found[1].answer is not None


def test_a_silent_port_is_told() -> None:
    bench = Bench("apt?silent=1")
    (found,) = find_stages([info((0x0403, 0xFAF0))], probe=False, open_port=lambda path, *, baud: bench.port())
    assert found.remark.startswith("no stage answers (tried apt)")


def test_stages_of_a_plug_in_are_found_too(monkeypatch: pytest.MonkeyPatch) -> None:
    identity = DeviceIdentity(model="plugged", serial_number="7", firmware="1")
    module = ModuleType("plugged_in")
    probe = StageProbe(baud=4800, usb_ids=((0x1234, None),), ask=lambda port: [Answer(address=None, identity=identity)])
    monkeypatch.setattr(module, "PROBE", probe, raising=False)
    monkeypatch.setitem(sys.modules, "plugged_in", module)
    entry = EntryPoint(name="plugged", value="plugged_in:open", group=STAGES)
    monkeypatch.setattr(discovery, "entry_points", lambda group: [entry])
    bench = Bench("zaber")
    (found,) = find_stages([info((0x1234, 5))], probe=False, open_port=lambda path, *, baud: bench.port())
    assert found.driver == "plugged"
    assert found.answer is not None
    assert found.answer.identity == identity
