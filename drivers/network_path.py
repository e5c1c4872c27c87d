"""The way of packets to a device on the network."""

import socket

from drivers.errors import LimitError

_IP_MTU = 14  # of Linux; the socket module has no name for it
_ANY_PORT = 3956


def path_mtu(address: str) -> int:
    """Return the bytes that the interface to an IP address sends in one piece."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((address, _ANY_PORT))
            return int(probe.getsockopt(socket.IPPROTO_IP, _IP_MTU))
        except OSError as error:
            raise LimitError(f"{address}: there is no way to this address: {error.strerror}") from error
