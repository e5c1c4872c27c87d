"""The way from a simulated device to its host: when each byte arrives, and which do not."""

from collections import deque

import numpy as np

from sim_devices.faults import LineNoise

_BITS_PER_BYTE = 10  # start bit, eight data bits, stop bit
_PIECE_BYTES = 2
_PIECE_GAP_S = 0.002
_LATE_EVERY = 3


class Line:
    """A serial line that keeps the order of what is sent.

    Parameters
    ----------
    baud : int or None
        Bits per second when the bytes are to be paced as on a true line; None sends at once.
    in_pieces : bool
        Whether replies arrive two bytes at a time, 2 ms apart.
    late_s : float
        How much later than sent every third reply arrives [s]; what is sent after it waits behind it.
    noise : LineNoise
        Damage on the way.
    generator : numpy.random.Generator
        Where the damage is drawn from.
    """

    def __init__(
        self,
        *,
        baud: int | None,
        in_pieces: bool,
        late_s: float,
        noise: LineNoise,
        generator: np.random.Generator,
    ) -> None:
        self._byte_s = 0.0 if baud is None else _BITS_PER_BYTE / baud
        self._in_pieces = in_pieces
        self._late_s = late_s
        self._noise = noise
        self._generator = generator
        self._sent = 0
        self._free_s = 0.0
        self._queue: deque[tuple[float, bytes]] = deque()

    def send(self, time_s: float, reply: bytes) -> None:
        """Put one reply on its way at a time [s]."""
        self._sent += 1
        delay_s = self._late_s if self._sent % _LATE_EVERY == 0 else 0.0
        self._free_s = max(self._free_s, time_s + delay_s)
        for piece in self._cut(self._noise.corrupt(reply, self._generator)):
            self._free_s += len(piece) * self._byte_s
            self._queue.append((self._free_s, piece))
            self._free_s += _PIECE_GAP_S if self._in_pieces else 0.0

    def arrived(self, time_s: float) -> bytes:
        """Return what has arrived by a time [s] and was not returned before."""
        data = b""
        while self._queue and self._queue[0][0] <= time_s:
            data += self._queue.popleft()[1]
        return data

    def next_arrival_s(self) -> float | None:
        """Return when the next byte arrives [s], or None when nothing is on its way."""
        return self._queue[0][0] if self._queue else None

    def _cut(self, data: bytes) -> list[bytes]:
        size = 1 if self._byte_s else _PIECE_BYTES if self._in_pieces else len(data)
        return [data[start : start + size] for start in range(0, len(data), max(1, size))]
