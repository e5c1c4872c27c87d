"""How many frames a second one core unpacks, for every format, at 782 x 582.

The bar for Mono12Packed is 1000 frames/s: `python benchmarks/unpack.py` returns 1 where it is missed.
"""

import sys
import time

import numpy as np

from drivers.cameras.samples import GENICAM, V4L2, PixelFormat, needed_bytes, unpack

WIDTH, HEIGHT = 782, 582
BAR_FRAMES_PER_S = 1000.0
REPEATS = 100


def frames_per_s(pixel_format: PixelFormat) -> float:
    """Return the rate by the median of many frames: single ones are held up by whatever else runs."""
    generator = np.random.default_rng(1)
    data = generator.integers(0, 256, needed_bytes(pixel_format, samples=WIDTH * HEIGHT), dtype=np.uint8)
    if pixel_format.packing is None and pixel_format.sample_bytes == 2:
        data[1::2] &= (2 ** (pixel_format.bit_depth - 8)) - 1
    raw = data.tobytes()
    times_s = []
    for _ in range(REPEATS):
        start_s = time.perf_counter()
        unpack(raw, pixel_format=pixel_format, width=WIDTH, height=HEIGHT)
        times_s.append(time.perf_counter() - start_s)
    return 1.0 / float(np.median(times_s))


def main() -> int:
    """Print the table; return 1 where the bar is missed."""
    grey = [fmt for fmt in (*GENICAM.values(), *V4L2.values()) if fmt.cell is None]  # a mosaic comes in the same bytes
    rates = {fmt.name: frames_per_s(fmt) for fmt in grey}
    for name, rate in rates.items():
        print(f"{name:>14} {rate:8.0f} frames/s")
    return 0 if rates["Mono12Packed"] >= BAR_FRAMES_PER_S else 1


if __name__ == "__main__":
    sys.exit(main())
