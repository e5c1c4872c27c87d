"""Benchmarks and trials: `python -m benchmarks.page` and `python -m benchmarks.trials`."""

import os

# Before numpy is imported, which reads this once: idle threads of linear algebra would be counted as processor time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
