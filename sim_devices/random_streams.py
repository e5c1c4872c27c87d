"""Random streams by their use: no two uses of a seed share a stream."""

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """First number of a spawn key."""

    PATTERN = 0
    NOISE = 1
    DRIFT = 2
    COSMIC_HITS = 3
    COLUMN_OFFSET = 4
    MICRO_POLARIZERS = 5


def generator(seed: int, stream: Stream, *key: int) -> np.random.Generator:
    """Return the generator of a stream; with a sequence number as `key` a frame's own.

    Notes
    -----
    A spawn key keeps streams apart; plain entropy does not: (5,) and (5, 0) give the same numbers.
    """
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=(int(stream), *key))))
