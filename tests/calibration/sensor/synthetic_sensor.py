"""A sensor with known truth, by random draws alone: what the calibration has to find again."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.sensor.levels import LevelKind, LevelStatistics, level_statistics

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class SyntheticSensor:
    """Truth. `response` bends the analog signal [DN], before the black level."""

    gain_dn_per_e: float = 0.25
    read_noise_e: float = 10.0
    dark_current_e_per_s: float = 400.0
    black_level_dn: float = 60.0
    prnu: float = 0.01
    dsnu_e: float = 4.0
    bit_depth: int = 12
    shape: tuple[int, int] = (56, 56)
    response: Callable[[FloatArray], FloatArray] = lambda signal_dn: signal_dn

    @property
    def full_scale_dn(self) -> int:
        return (1 << self.bit_depth) - 1


class SyntheticCamera:
    """Draws frames of one sensor; its fixed pattern is drawn once."""

    def __init__(self, sensor: SyntheticSensor, seed: int) -> None:
        self.sensor = sensor
        self.generator = np.random.default_rng(seed)
        self.response_map = 1.0 + sensor.prnu * self.generator.standard_normal(sensor.shape)
        self.offset_map_e = sensor.dsnu_e * self.generator.standard_normal(sensor.shape)

    def frame(self, *, light_e: float, exposure_s: float) -> NDArray[np.uint16]:
        s, draw = self.sensor, self.generator
        charge_e = draw.poisson(light_e * self.response_map) + draw.poisson(
            s.dark_current_e_per_s * exposure_s, s.shape
        )
        read_e = self.offset_map_e + s.read_noise_e * draw.standard_normal(s.shape)
        analog_dn = s.response(s.gain_dn_per_e * (charge_e + read_e)) + s.black_level_dn
        return np.clip(np.rint(analog_dn), 0, s.full_scale_dn).astype(np.uint16)

    def frames(self, n: int, *, light_e: float, exposure_s: float, flicker: float = 0.0) -> list[NDArray[np.uint16]]:
        brightness = 1.0 + flicker * self.generator.standard_normal(n)
        return [self.frame(light_e=light_e * factor, exposure_s=exposure_s) for factor in brightness]

    def level(
        self, n: int, *, kind: LevelKind, light_e: float, exposure_s: float | None, flicker: float = 0.0
    ) -> LevelStatistics:
        frames = self.frames(n, light_e=light_e, exposure_s=exposure_s or 0.0, flicker=flicker)
        return level_statistics(frames, kind=kind, exposure_s=exposure_s)

    def sweep(
        self,
        *,
        signals_e: Sequence[float],
        exposures_s: Sequence[float],
        stack: int = 16,
        stack_index: int = 6,
        flicker: float = 0.0,
    ) -> list[LevelStatistics]:
        """Two flats and two darks at each exposure, and a stack of each at one of them."""
        levels = []
        for index, (light_e, exposure_s) in enumerate(zip(signals_e, exposures_s, strict=True)):
            n = stack if index == stack_index else 2
            levels.append(self.level(n, kind="flat", light_e=light_e, exposure_s=exposure_s, flicker=flicker))
            levels.append(self.level(n, kind="dark", light_e=0.0, exposure_s=exposure_s))
        return levels


# An exposure sweep to half of full scale (16140 e- at the default gain), as most sessions have.
SIGNALS_E = tuple(float(signal) for signal in np.linspace(600.0, 12_000.0, 12))
EXPOSURES_S = tuple(signal / 1e6 for signal in SIGNALS_E)
# The same, driven into saturation.
SATURATING_SIGNALS_E = (*SIGNALS_E, 13_500.0, 15_000.0, 18_000.0, 20_000.0)
SATURATING_EXPOSURES_S = tuple(signal / 1e6 for signal in SATURATING_SIGNALS_E)
