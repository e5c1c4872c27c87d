"""Frames of a run, corrected one by one as they are read, and what is told of all of them."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rigctl.measurement.corrections import Corrections
from rigctl.measurement.dark_level import DarkLevel
from rigctl.measurement.frame_grid import FrameGrid
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import Run

FloatArray = NDArray[np.float64]


class CorrectedFrames:
    """Reads frames one by one; keeps their sum by angle, mean by cycle, and which pixels were ever unusable."""

    def __init__(self, run: Run, grid: FrameGrid, dark_level: DarkLevel, corrections: Corrections) -> None:
        """Take the run, which frame is which, and what is done to each; nothing is read yet."""
        shape = (grid.height, grid.width)
        self._run, self.interpolation = run, run.session.interpolation
        self.grid, self.dark_level, self.corrections = grid, dark_level, corrections
        self.sums = np.zeros((grid.angles, *shape))
        self.light = np.zeros(grid.cycles)
        self.saturated = np.zeros(shape, dtype=np.bool_)
        self.missing = np.zeros(shape, dtype=np.bool_)

    def anew(self) -> "CorrectedFrames":
        """Return a reader of the same frames that has seen none."""
        return CorrectedFrames(self._run, self.grid, self.dark_level, self.corrections)

    def pixels(self, inside: Mapping[str, NDArray[np.bool_]]) -> dict[str, FloatArray]:
        """Return the signal of every frame in each region, shape (cycles, N, P)."""
        pixels = {
            name: np.empty((self.grid.cycles, self.grid.angles, int(mask.sum()))) for name, mask in inside.items()
        }
        for cycle in range(self.grid.cycles):
            for name, found in self.cycle(cycle, inside).items():
                pixels[name][cycle] = found
        return pixels

    def cycle(self, cycle: int, inside: Mapping[str, NDArray[np.bool_]]) -> dict[str, FloatArray]:
        """Return the signal of the frames of a cycle in each region, shape (N, P)."""
        pixels = {name: np.empty((self.grid.angles, int(mask.sum()))) for name, mask in inside.items()}
        for angle in range(self.grid.angles):
            signal = self.read(cycle, angle)
            for name, mask in inside.items():
                pixels[name][angle] = signal[mask]
        return pixels

    def read(self, cycle: int, angle: int) -> FloatArray:
        """Return the signal of a frame, shape (H, W), and add it to what is kept."""
        record = self.grid.records[cycle][angle]
        counts = self._run.counts(record)
        self._note_unusable(record, counts)
        signal = (counts - self.dark_level.level_dn[angle]) * self.grid.to_unit[angle]
        signal = self.corrections.corrected(signal, record, angle)
        self.sums[angle] += signal
        self.light[cycle] += float(signal.mean()) / self.grid.angles
        return np.asarray(signal)

    def _note_unusable(self, record: FrameRecord, counts: NDArray[np.uint16]) -> None:
        self.saturated |= self.corrections.touched(counts >= record.saturation_dn, record)
        if self.corrections.is_any:
            self.missing |= self.corrections.missing(record, self.missing.shape)
        if record.missing_dn is not None:
            self.missing |= self.corrections.touched(counts == record.missing_dn, record)
