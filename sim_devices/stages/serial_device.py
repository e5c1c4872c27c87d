"""Interface of a simulated device to whatever carries its bytes."""

from typing import Protocol


class SerialDevice(Protocol):
    """A simulated device on a serial line. Safe to use from several threads."""

    def receive(self, data: bytes) -> None:
        """Take in what the host has sent."""

    def transmit(self) -> bytes:
        """Return what has reached the host by now and was not returned before."""

    def next_event_s(self) -> float | None:
        """Return when there will be something new to transmit [s], or None while nothing is under way."""

    def is_plugged_in(self) -> bool:
        """Return whether the host sees a port at all."""
