"""Simulated noise sets with known truth: good ones, spoilt ones, and ones that no photon transfer can read."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dctn, idctn

from calibration.results import Flag
from calibration.sensor.levels import LevelKind, LevelStatistics, level_statistics
from calibration.sensor.noise import NoiseCalibration, calibrate_noise, with_pattern
from calibration.sensor.pattern import fixed_pattern

FloatArray = NDArray[np.float64]
Frame = NDArray[np.uint16]
FRACTIONS = np.linspace(0.04, 0.76, 16)
STACK, PAIR = 12, 2


@dataclass(kw_only=True)
class Sensor:
    """A camera as its maker would describe it; maps are drawn once."""

    seed: int
    gain: float = 0.25
    read_e: float = 8.0
    black_dn: float = 64.0
    dark_e_per_s: float = 300.0
    dsnu_e: float = 3.0
    prnu: float = 0.008
    bits: int = 12
    shape: tuple[int, int] = (80, 96)
    hot_share: float = 0.0
    row_e: float = 0.0
    gain_spread: float = 0.0
    draws: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self.draws = np.random.default_rng(self.seed)
        normal = self.draws.standard_normal
        self.response = 1.0 + self.prnu * normal(self.shape)
        self.offset_e = self.dsnu_e * normal(self.shape)
        self.gains = self.gain * (1.0 + self.gain_spread * normal(self.shape))
        self.dark_map = np.full(self.shape, self.dark_e_per_s)
        hot = self.draws.random(self.shape) < self.hot_share
        self.dark_map[hot] *= self.draws.uniform(20.0, 200.0, int(hot.sum()))

    @property
    def full_dn(self) -> int:
        return (1 << self.bits) - 1

    def frame(self, light: float | FloatArray, time_s: float, *, gain: float = 1.0, warm: float = 1.0) -> Frame:
        """One exposure: `light` in electrons of an average pixel."""
        draw = self.draws
        charge = draw.poisson(light * self.response + warm * self.dark_map * time_s) + self.offset_e
        charge = charge + self.read_e * draw.standard_normal(self.shape)
        if self.row_e:
            charge = charge + self.row_e * draw.standard_normal((self.shape[0], 1))
        return np.clip(np.rint(gain * self.gains * charge + self.black_dn), 0, self.full_dn).astype(np.uint16)


@dataclass(kw_only=True)
class Exposure:
    """Frames of one level, and what is stated of them."""

    kind: LevelKind
    time_s: float
    light_e: float
    frames: list[Frame]
    photons: float | None = None

    def level(self) -> LevelStatistics:
        return level_statistics(
            self.frames,
            kind=self.kind,
            exposure_s=self.time_s,
            photons=self.photons,
            keep_picture=len(self.frames) > PAIR,
        )


SetMaker = Callable[[int], "NoiseSet"]


@dataclass(frozen=True, kw_only=True)
class NoiseSet:
    """Levels, what is true of their sensor, and the means of the levels that are wrong."""

    levels: tuple[LevelStatistics, ...]
    truth: dict[str, float]
    bits: int
    wrong_means_dn: tuple[float, ...] = ()
    # How many of them have to be named; of a flat and its dark at another gain the flat will do.
    n_to_name: int | None = None


def names_level(flag: Flag, mean_dn: float) -> bool:
    """Whether a flag is about the level of this mean."""
    return flag.level is not None and f"mean {mean_dn:.4g} DN" in flag.level


def tells_of_level(flag: Flag, mean_dn: float) -> bool:
    """Whether a flag says what is odd about the level of this mean, be it blamed or not."""
    return f"mean {mean_dn:.4g} DN" in flag.message


def calibrated(found: NoiseSet) -> NoiseCalibration:
    """The calibration of a set, with its fixed pattern as from files."""
    noise = calibrate_noise(found.levels, bit_depth=found.bits)
    flat, dark = noise.stacks
    return with_pattern(noise, fixed_pattern(dark, flat))


FULL_E_PER_S = 1.0e6


def sweep(
    sensor: Sensor,
    *,
    fractions: Sequence[float] | FloatArray = FRACTIONS,
    flicker: Callable[[float], float] = lambda _: 1.0,
    lamp: bool = False,
    gain_of: Callable[[int], float] = lambda _: 1.0,
    warm_of: Callable[[int], float] = lambda _: 1.0,
    leak_e_per_s: float = 0.0,
    photons: bool = False,
) -> list[Exposure]:
    """Flats and darks of one sweep: by exposure, or by the lamp at one exposure."""
    full_e = (sensor.full_dn - sensor.black_dn) / sensor.gain
    found = []
    for place, fraction in enumerate(fractions):
        light_e = float(fraction) * full_e
        time_s = 0.01 if lamp else light_e / FULL_E_PER_S
        n = STACK if place == len(fractions) // 2 else PAIR
        gain, warm = gain_of(place), warm_of(place)
        flats = [sensor.frame(light_e * flicker(time_s), time_s, gain=gain, warm=warm) for _ in range(n)]
        stated = light_e / 0.6 if photons or lamp else None
        found.append(Exposure(kind="flat", time_s=time_s, light_e=light_e, frames=flats, photons=stated))
        dark_s = light_e / FULL_E_PER_S
        darks = [sensor.frame(leak_e_per_s * dark_s, dark_s, gain=gain, warm=warm) for _ in range(n)]
        found.append(Exposure(kind="dark", time_s=dark_s, light_e=0.0, frames=darks))
    return found


def noise_set(sensor: Sensor, exposures: Sequence[Exposure], *, wrong: Sequence[Exposure] = ()) -> NoiseSet:
    truth = {
        "gain_dn_per_e": sensor.gain,
        "read_noise_e": float(np.hypot(sensor.read_e, sensor.row_e)),
        "black_level_dn": sensor.black_dn,
        "prnu": float(np.hypot(sensor.prnu, sensor.gain_spread)),
        "dsnu_e": sensor.dsnu_e,
        "dark_current_e_per_s": sensor.dark_e_per_s,
    }
    levels = {id(one): one.level() for one in exposures}
    return NoiseSet(
        levels=tuple(levels.values()),
        truth=truth,
        bits=sensor.bits,
        wrong_means_dn=tuple(levels[id(one)].mean_dn for one in wrong),
    )


def good(seed: int) -> NoiseSet:
    sensor = Sensor(seed=seed)
    return noise_set(sensor, sweep(sensor))


def good_lamp(seed: int) -> NoiseSet:
    sensor = Sensor(seed=seed)
    return noise_set(sensor, sweep(sensor, lamp=True, flicker=lambda _: 1.0 + 0.002 * sensor.draws.standard_normal()))


def scmos(seed: int) -> NoiseSet:
    sensor = Sensor(seed=seed, bits=16, gain=2.1, read_e=1.6, black_dn=100.0, dsnu_e=0.5, gain_spread=0.02, prnu=0.004)
    return noise_set(sensor, sweep(sensor))


def coarse(seed: int) -> NoiseSet:
    sensor = Sensor(seed=seed, bits=8, gain=0.02, read_e=15.0, black_dn=4.0 + 0.013 * (seed % 77), dsnu_e=6.0)
    return noise_set(sensor, sweep(sensor))


def flickering(seed: int) -> NoiseSet:
    sensor = Sensor(seed=seed)
    return noise_set(sensor, sweep(sensor, flicker=lambda _: 1.0 + 0.01 * sensor.draws.standard_normal()))


def mains_beat(seed: int) -> NoiseSet:
    """A global shutter under a lamp of 100 Hz with 60 % of modulation."""
    sensor = Sensor(seed=seed)

    def beat(time_s: float) -> float:
        start = sensor.draws.uniform(0.0, 0.01)
        wave = 2.0 * np.pi * 100.0
        return float(1.0 + 0.6 * (np.sin(wave * (start + time_s)) - np.sin(wave * start)) / (wave * time_s))

    return noise_set(sensor, sweep(sensor, flicker=beat))


def hot_pixels(seed: int) -> NoiseSet:
    sensor = Sensor(seed=seed, hot_share=0.01)
    found = noise_set(sensor, sweep(sensor))
    return replace(found, truth={k: v for k, v in found.truth.items() if "dark_current" not in k})


def row_noise(seed: int) -> NoiseSet:
    sensor = Sensor(seed=seed, row_e=5.0)
    return noise_set(sensor, sweep(sensor))


def warming(seed: int) -> NoiseSet:
    """The dark current triples during the sweep."""
    sensor = Sensor(seed=seed, dark_e_per_s=2000.0)
    found = noise_set(sensor, sweep(sensor, warm_of=lambda place: 3.0 ** (place / len(FRACTIONS))))
    return replace(found, truth={k: v for k, v in found.truth.items() if "dark_current" not in k})


def wrong_photons(seed: int) -> NoiseSet:
    """One of the levels has photons 4 % off."""
    sensor = Sensor(seed=seed)
    exposures = sweep(
        sensor,
        fractions=np.linspace(0.04, 0.76, 24),
        lamp=True,
        flicker=lambda _: 1.0 + 0.003 * sensor.draws.standard_normal(),
    )
    flats = [one for one in exposures if one.kind == "flat"]
    worst = flats[int(sensor.draws.integers(1, len(flats)))]
    worst.photons = (worst.photons or 0.0) * (1.0 + 0.04 * sensor.draws.choice([-1.0, 1.0]))
    return noise_set(sensor, exposures, wrong=[worst])


def mislabelled_stack(seed: int) -> NoiseSet:
    sensor = Sensor(seed=seed)
    exposures = sweep(sensor)
    stack = max((one for one in exposures if one.kind == "flat"), key=lambda one: len(one.frames))
    stack.time_s *= 0.1
    return noise_set(sensor, exposures, wrong=[stack])


def one_other_gain(seed: int) -> NoiseSet:
    sensor = Sensor(seed=seed)
    place = int(sensor.draws.integers(1, len(FRACTIONS)))
    exposures = sweep(sensor, gain_of=lambda at: 1.1 if at == place else 1.0)
    found = noise_set(sensor, exposures, wrong=exposures[2 * place : 2 * place + 2])
    return replace(found, n_to_name=1)


def averaged_frames(seed: int) -> NoiseSet:
    """One level whose frames are means of two."""
    sensor = Sensor(seed=seed)
    exposures = sweep(sensor)
    level = exposures[2 * int(sensor.draws.integers(0, len(FRACTIONS)))]
    more = [sensor.frame(level.light_e, level.time_s) for _ in level.frames]
    level.frames = [
        np.rint(0.5 * (one.astype(float) + other)).astype(np.uint16)
        for one, other in zip(level.frames, more, strict=True)
    ]
    return noise_set(sensor, exposures, wrong=[level])


def lit_dark(seed: int) -> NoiseSet:
    """One dark level that saw light."""
    sensor = Sensor(seed=seed)
    exposures = sweep(sensor)
    level = exposures[2 * int(sensor.draws.integers(0, len(FRACTIONS))) + 1]
    level.frames = [sensor.frame(40.0, level.time_s) for _ in level.frames]
    return noise_set(sensor, exposures, wrong=[level])


def gain_changed(seed: int) -> NoiseSet:
    sensor = Sensor(seed=seed)
    return noise_set(sensor, sweep(sensor, gain_of=lambda place: 1.06 if place >= len(FRACTIONS) // 2 else 1.0))


def leak(seed: int) -> NoiseSet:
    sensor = Sensor(seed=seed)
    return noise_set(sensor, sweep(sensor, leak_e_per_s=8000.0))


def clipped_black(seed: int) -> NoiseSet:
    sensor = Sensor(seed=seed, black_dn=3.0)
    return noise_set(sensor, sweep(sensor))


def hardly_clipped(seed: int) -> NoiseSet:
    """0.3 % of the dark samples are cut off at 0."""
    sensor = Sensor(seed=seed, black_dn=6.4)
    return noise_set(sensor, sweep(sensor))


def left_justified(seed: int) -> NoiseSet:
    sensor = Sensor(seed=seed)
    exposures = sweep(sensor)
    for one in exposures:
        one.frames = [np.left_shift(frame, np.uint16(4)) for frame in one.frames]
    return replace(noise_set(sensor, exposures), bits=16)


def compressed(seed: int) -> NoiseSet:
    """Blocks of 8 x 8 pixels whose smaller cosine terms are thrown away, as a coder does."""
    sensor = Sensor(seed=seed)
    exposures = sweep(sensor)
    rows, columns = sensor.shape
    for one in exposures:
        for place, frame in enumerate(one.frames):
            blocks = frame.reshape(rows // 8, 8, columns // 8, 8).astype(float)
            terms = dctn(blocks, axes=(1, 3), norm="ortho")
            kept = idctn(12.0 * np.rint(terms / 12.0), axes=(1, 3), norm="ortho")
            one.frames[place] = np.clip(np.rint(kept), 0, sensor.full_dn).astype(np.uint16).reshape(frame.shape)
    return noise_set(sensor, exposures)


GOOD = (good, good_lamp, scmos, coarse, flickering, mains_beat, hot_pixels, row_noise, warming)
ONE_WRONG = (wrong_photons, mislabelled_stack, one_other_gain, averaged_frames, lit_dark)
OUTSIDE = (gain_changed, leak, clipped_black, hardly_clipped, left_justified, compressed)
