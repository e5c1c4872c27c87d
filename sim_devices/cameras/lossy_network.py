"""A network between a GigE Vision camera and whoever uses it: it loses packets of pictures, and sends them again.

From a reading of the GigE Vision standard (control: GVCP, pictures: GVSP). The camera is libaravis's own, which does
not send any packet twice: so what passed is kept here for a while, as a camera's memory would, and what is asked for
again comes from there. It has no clock either that could be read: that of a `DeviceClock` answers for it.
"""

import random
import select
import socket
import struct
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from drivers.errors import NotConnectedError
from sim_devices.cameras.device_clock import DeviceClock

CONTROL_PORT = 3956
_CONTROL = struct.Struct(">BBHHH")  # key or status, flags, command, length, request
_KEY = 0x42
_DISCOVERY_ACK, _READ_REGISTER_ACK = 0x0003, 0x0081
_READ_REGISTER, _WRITE_REGISTER, _RESEND = 0x0080, 0x0082, 0x0040
_READ_MEMORY, _WRITE_MEMORY = 0x0084, 0x0086
_STREAM_PORT, _STREAM_ADDRESS = 0x0D00, 0x0D18
_ADDRESS_IN_DISCOVERY = 36  # of its data, the last four of 16 bytes
_PICTURE = struct.Struct(">HHI")  # status, picture, kind and number of the packet
_NUMBER = 0xFFFFFF
_LEADER, _KIND = 1, 0x7F
_STAMP = slice(12, 20)  # of a leader: when its picture was taken, by the camera's clock
_HEADERS_BYTES = 28  # IP and UDP
_KEPT_PICTURES = 8
_SOCKET_BYTES = 2**22
_LARGEST = 2**16
_LOOK_S = 0.1


@dataclass(frozen=True, kw_only=True)
class Losses:
    """What the network does.

    Attributes
    ----------
    share : float
        Of the packets of pictures, sent again or not, that are lost, 0 to 1.
    resends : bool
        Whether packets that are asked for again are sent again.
    largest_bytes : int or None
        Larger packets (with their headers) do not pass, as behind a switch without jumbo frames.
    """

    share: float = 0.0
    resends: bool = True
    largest_bytes: int | None = None


@dataclass
class Passed:
    """What has passed: packets of pictures, those lost, those asked for again, those sent again."""

    packets: int = 0
    lost: int = 0
    asked_again: int = 0
    sent_again: int = 0


class LossyNetwork:
    """Stands at an address of its own for a camera; `lossy_network` makes one."""

    def __init__(self, *, camera: str, address: str, losses: Losses, clock: DeviceClock | None, seed: int) -> None:
        self.losses, self.passed, self._clock = losses, Passed(), clock
        self._camera, self._address = (camera, CONTROL_PORT), address
        self._random = random.Random(seed)
        self._control = _socket(address, CONTROL_PORT)
        self._to_camera = _socket("0.0.0.0", 0)
        self._pictures = _socket("0.0.0.0", 0)
        self._host: tuple[str, int] | None = None
        self._asked: dict[int, tuple[tuple[str, int], bytes]] = {}
        self._sends_to: dict[int, bytes] = {}
        self._kept: OrderedDict[int, dict[int, bytes]] = OrderedDict()
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._carry, name="lossy network", daemon=True)

    def start(self) -> None:
        """Carry packets from now on."""
        self._thread.start()

    def close(self) -> None:
        """Carry none any more."""
        self._is_over.set()
        self._thread.join()
        for end in (self._control, self._to_camera, self._pictures):
            end.close()

    def _carry(self) -> None:
        ends = {
            self._pictures: self._carry_picture,
            self._control: self._carry_question,
            self._to_camera: self._carry_answer,
        }
        while not self._is_over.is_set():
            for ready in select.select(list(ends), [], [], _LOOK_S)[0]:
                self._empty(ready, ends[ready])

    def _empty(self, end: socket.socket, carry: Callable[[bytes, tuple[str, int]], None]) -> None:
        while True:
            try:
                data, sender = end.recvfrom(_LARGEST)
            except (BlockingIOError, ConnectionRefusedError):
                return
            carry(data, sender)

    def _carry_picture(self, packet: bytes, _camera: tuple[str, int]) -> None:
        _, picture, kind_and_number = _PICTURE.unpack_from(packet)
        if self._clock is not None and kind_and_number >> 24 & _KIND == _LEADER:
            # The device stamps it in nanoseconds of UTC.
            stamp = self._clock.stamp(int.from_bytes(packet[_STAMP], "big")).to_bytes(8, "big")
            packet = packet[: _STAMP.start] + stamp + packet[_STAMP.stop :]
        if picture not in self._kept:
            self._kept[picture] = {}
            if len(self._kept) > _KEPT_PICTURES:
                self._kept.popitem(last=False)
        self._kept[picture][kind_and_number & _NUMBER] = packet
        self.passed.packets += 1
        self._pass_on(packet)

    def _pass_on(self, packet: bytes) -> bool:
        largest = self.losses.largest_bytes
        is_too_large = largest is not None and len(packet) + _HEADERS_BYTES > largest
        if is_too_large or self._random.random() < self.losses.share:
            self.passed.lost += 1
            return False
        if self._host is not None:
            self._pictures.sendto(packet, self._host)
        return True

    def _carry_question(self, data: bytes, asker: tuple[str, int]) -> None:
        if len(data) < _CONTROL.size or data[0] != _KEY:
            return
        _, _, command, _, request = _CONTROL.unpack_from(data)
        if command == _RESEND:
            self._send_again(data[_CONTROL.size :])
            return
        of_clock = self._answer_of_clock(command, data[_CONTROL.size :])
        if of_clock is not None:
            self._control.sendto(_CONTROL.pack(0, 0, command + 1, len(of_clock), request) + of_clock, asker)
            return
        self._asked[request] = (asker, data[_CONTROL.size :] if command == _READ_REGISTER else b"")
        self._to_camera.sendto(self._redirected(data, asker) if command == _WRITE_REGISTER else data, self._camera)

    def _answer_of_clock(self, command: int, content: bytes) -> bytes | None:
        """Return what the camera's clock answers; None where it is not asked."""
        clock = self._clock
        if clock is None or len(content) < 4 or not clock.has(int.from_bytes(content[:4], "big")):
            return None
        address = int.from_bytes(content[:4], "big")
        if command == _READ_REGISTER:
            return b"".join(
                clock.read(int.from_bytes(content[k : k + 4], "big")) for k in range(0, len(content) - 3, 4)
            )
        if command == _READ_MEMORY:
            return content[:4] + clock.read(address, int.from_bytes(content[6:8], "big"))
        if command in (_WRITE_REGISTER, _WRITE_MEMORY):
            clock.write(address, int.from_bytes(content[4:8], "big"))
            return (1 if command == _WRITE_REGISTER else 4).to_bytes(4, "big")
        return None

    def _redirected(self, data: bytes, asker: tuple[str, int]) -> bytes:
        """Let the camera send its pictures here, and remember where they were to go."""
        told = bytearray(data)
        for place in range(_CONTROL.size, len(data) - 7, 8):
            register = int.from_bytes(data[place : place + 4], "big")
            if register not in (_STREAM_PORT, _STREAM_ADDRESS):
                continue
            value = data[place + 4 : place + 8]
            self._sends_to[register] = value
            if register == _STREAM_PORT and any(value):
                self._host = (asker[0], int.from_bytes(value, "big"))
                told[place + 4 : place + 8] = self._pictures.getsockname()[1].to_bytes(4, "big")
            elif register == _STREAM_ADDRESS:
                told[place + 4 : place + 8] = socket.inet_aton(self._camera[0])
        return bytes(told)

    def _carry_answer(self, data: bytes, _camera: tuple[str, int]) -> None:
        _, _, command, _, request = _CONTROL.unpack_from(data)
        if request not in self._asked:
            return
        asker, registers = self._asked[request]
        told = bytearray(data)
        if command == _DISCOVERY_ACK:
            place = _CONTROL.size + _ADDRESS_IN_DISCOVERY
            told[place : place + 4] = socket.inet_aton(self._address)
        if command == _READ_REGISTER_ACK:
            for index in range(0, len(registers), 4):
                value = self._sends_to.get(int.from_bytes(registers[index : index + 4], "big"))
                if value is not None:
                    told[_CONTROL.size + index : _CONTROL.size + index + 4] = value
        self._control.sendto(bytes(told), asker)

    def _send_again(self, wanted: bytes) -> None:
        """Send packets of a picture once more, as far as they are still known."""
        _channel, picture, first, last = struct.unpack(">HHII", wanted[:12])
        for number in range(first & _NUMBER, (last & _NUMBER) + 1):
            self.passed.asked_again += 1
            packet = self._kept.get(picture, {}).get(number) if self.losses.resends else None
            if packet is not None and self._pass_on(packet):
                self.passed.sent_again += 1


@contextmanager
def lossy_network(
    *,
    camera: str,
    address: str = "127.0.0.2",
    losses: Losses | None = None,
    clock: DeviceClock | None = None,
    seed: int = 0,
) -> Iterator[LossyNetwork]:
    """Give the network between a camera at one address and everybody who turns to the other one.

    Parameters
    ----------
    camera, address : str
        IP addresses; the second one is of this machine, as all of 127.0.0.0/8 are on Linux.
    losses : Losses or None
        What it does; may be changed while it runs. None: nothing.
    clock : DeviceClock or None
        The camera's clock, which stamps its pictures; None: it cannot be read, and stamps are of the host's.
    seed : int
        Of what is lost.

    Raises
    ------
    NotConnectedError
        The address is not this machine's, or in use.
    """
    network = LossyNetwork(camera=camera, address=address, losses=losses or Losses(), clock=clock, seed=seed)
    network.start()
    try:
        yield network
    finally:
        network.close()


def _socket(address: str, port: int) -> socket.socket:
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _SOCKET_BYTES)
    try:
        end.bind((address, port))
    except OSError as error:
        end.close()
        raise NotConnectedError(f"no network can be simulated at {address}, port {port}: {error.strerror}") from error
    end.setblocking(False)
    return end
