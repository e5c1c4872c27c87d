"""Damage to what goes over a line: bytes that get lost, doubled or changed."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class LineNoise:
    """Probability that a byte meets each kind of damage."""

    drop: float = 0.0  #: Probability, per byte, that it is lost, sent twice, or changed in one of its bits.
    double: float = 0.0
    flip: float = 0.0

    def corrupt(self, data: bytes, generator: np.random.Generator) -> bytes:
        """Return the bytes as they arrive at the other end."""
        if self.drop == self.double == self.flip == 0.0:
            return data
        return b"".join(self._corrupt_byte(byte, generator) for byte in data)

    def _corrupt_byte(self, byte: int, generator: np.random.Generator) -> bytes:
        drop, double, flip = generator.random(3) < (self.drop, self.double, self.flip)
        if flip:
            byte ^= 1 << int(generator.integers(8))
        return bytes([byte]) * (0 if drop else 2 if double else 1)
