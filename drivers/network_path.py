"""The path of packets to a device on the network."""

import fcntl
import socket
import struct
from pathlib import Path

from drivers.errors import LimitError

_IP_MTU = 14  # of Linux; the socket module has no name for it
_ANY_PORT = 3956
_ASK_ADDRESS = 0x8915  # SIOCGIFADDR
_REQUEST_BYTES, _ADDRESS_PLACE = 40, slice(20, 24)  # of struct ifreq
_BUFFER = Path("/proc/sys/net/core/rmem_max")


def path_mtu(address: str) -> int:
    """Return the largest packet that the interface to an IP address sends unfragmented [bytes]."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((address, _ANY_PORT))
            return int(probe.getsockopt(socket.IPPROTO_IP, _IP_MTU))
        except OSError as error:
            raise LimitError(f"{address}: there is no route to this address: {error.strerror}") from error


def interface_of(address: str) -> str:
    """Return the name of the interface to an IP address, or "unknown"."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((address, _ANY_PORT))
            own = socket.inet_aton(probe.getsockname()[0])
            names = [name for _, name in socket.if_nameindex() if _address_of(probe, name) == own]
        except OSError:
            return "unknown"
    return names[0] if names else "unknown"


def largest_receive_buffer() -> int | None:
    """Return the largest buffer of a socket [bytes]; None if unknown."""
    try:
        return int(_BUFFER.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def _address_of(probe: socket.socket, interface: str) -> bytes | None:
    request = struct.pack("16s", interface.encode()).ljust(_REQUEST_BYTES, b"\0")
    try:
        return fcntl.ioctl(probe.fileno(), _ASK_ADDRESS, request)[_ADDRESS_PLACE]
    except OSError:
        return None  # an interface without an address
