"""Shared by all families of stages on serial ports: opening, and the remarks that their lines make."""

from collections import deque
from collections.abc import Callable
from typing import TypeVar

from drivers.serial_port import SerialPort, open_serial_port

_NOTES_KEPT = 20

StageT = TypeVar("StageT")


def open_stage_on(path: str, *, baud: int, connect: Callable[[SerialPort], StageT]) -> StageT:
    """Return the stage on a serial port; the port is closed again where none can be made.

    Parameters
    ----------
    path : str
        Of the port.
    baud : int
        Bit rate of the family [1/s].
    connect : callable
        Makes the stage on the open port, and closes it with the stage.

    Raises
    ------
    NotConnectedError
        There is no such port, or it may not be opened, or another program holds it.
    DeviceError
        What `connect` raises.
    """
    port = open_serial_port(path, baud=baud)
    try:
        return connect(port)
    except BaseException:
        port.close()
        raise


class Notes:
    """Remarks on what was noticed on a line, the newest 20, for the next move."""

    def __init__(self) -> None:
        self._texts: deque[str] = deque(maxlen=_NOTES_KEPT)

    def add(self, text: str) -> None:
        """Keep a remark."""
        self._texts.append(text)

    def take(self) -> tuple[str, ...]:
        """Return the remarks since the last call."""
        texts = tuple(self._texts)
        self._texts.clear()
        return texts
