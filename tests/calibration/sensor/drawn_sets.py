"""Noise sets whose every setting is drawn: bit depth, gain, offset, number of levels, way of the sweep, and a fault."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from calibration.results import RefusedFramesError
from calibration.sensor.curves import match_darks, mean_sampling_variance
from calibration.sensor.judging import mean_variance_dn2
from calibration.sensor.noise import calibrate_noise
from tests.calibration.sensor.noise_sets import STACK, Exposure, NoiseSet, Sensor, noise_set

_BITS = (8, 10, 12, 14, 16)
_LEAST_FULL_E, _MOST_FULL_E = 400.0, 2.0e5
_PLACES: dict[str, Callable[[int], int]] = {
    "first": lambda n: 0,
    "middle": lambda n: n // 2 - 1,
    "last": lambda n: n - 1,
}


def drawn_sensor(seed: int) -> Sensor:
    """A camera with a gain of 0.05 to 8 DN/e-, as its bit depth allows, and noise, offset and patterns of its own."""
    draw = np.random.default_rng([seed, 1])
    bits = int(draw.choice(_BITS))
    full_dn = float((1 << bits) - 1)
    lowest, highest = max(0.05, full_dn / _MOST_FULL_E), min(8.0, full_dn / _LEAST_FULL_E)
    gain = float(np.exp(draw.uniform(np.log(lowest), np.log(highest))))
    read_e = float(np.exp(draw.uniform(np.log(1.0), np.log(30.0))))
    black_dn = 6.0 * gain * read_e + 3.0 + float(np.exp(draw.uniform(np.log(0.01), np.log(0.06)))) * full_dn
    return Sensor(
        seed=seed,
        bits=bits,
        gain=gain,
        read_e=read_e,
        black_dn=float(black_dn),
        dark_e_per_s=float(np.exp(draw.uniform(np.log(1.0), np.log(3000.0)))),
        dsnu_e=float(draw.uniform(0.1, 1.0)) * read_e,
        prnu=float(draw.uniform(0.003, 0.015)),
        gain_spread=float(draw.choice([0.0, 0.0, 0.01])),
    )


def drawn_sweep(sensor: Sensor, seed: int, *, drift: float = 0.0, least: int = 6) -> list[Exposure]:
    """A sweep of 6 to 40 levels by exposure alone, by photons alone, or by exposure with photons stated.

    Light may flicker by up to 0.5 % from frame to frame; `drift` is what the lamp loses during the sweep.
    """
    draw = np.random.default_rng([seed, 2])
    n_levels, way = max(least, int(draw.integers(6, 41))), str(draw.choice(["exposure", "photons", "both"]))
    flicker = float(draw.choice([0.0, 0.001, 0.005]))
    full_e = (sensor.full_dn - sensor.black_dn) / sensor.gain
    full_s = float(np.exp(draw.uniform(np.log(3e-3), np.log(1.0))))
    stack_at, found = n_levels // 2, list[Exposure]()
    for place, fraction in enumerate(np.linspace(draw.uniform(0.01, 0.08), draw.uniform(0.65, 0.95), n_levels)):
        light_e = float(fraction) * full_e
        time_s = 0.3 * full_s if way == "photons" else float(fraction) * full_s
        n = STACK if place == stack_at else 2
        lamp = 1.0 - drift * place / n_levels
        flats = [
            sensor.frame(light_e * lamp * (1.0 + flicker * sensor.draws.standard_normal()), time_s) for _ in range(n)
        ]
        stated = None if way == "exposure" else light_e / 0.55
        found.append(Exposure(kind="flat", time_s=time_s, light_e=light_e, frames=flats, photons=stated))
        # A lamp that is swept at one exposure has darks of this exposure, and of two others.
        dark_s = time_s * (1.0, 0.5, 2.0)[place % 3] if way == "photons" else time_s
        darks = [sensor.frame(0.0, dark_s) for _ in range(n)]
        found.append(Exposure(kind="dark", time_s=dark_s, light_e=0.0, frames=darks))
    return found


def _set(
    sensor: Sensor, exposures: list[Exposure], *, wrong: Sequence[Exposure] = (), stated_over_true: float = 1.0
) -> NoiseSet:
    """Levels and truth; where pixels have gains of their own, dark current adds to what they differ by in the dark."""
    stack = max((one for one in exposures if one.kind == "dark"), key=lambda one: len(one.frames))
    of_gains_e = sensor.gain_spread * sensor.dark_e_per_s * stack.time_s / stated_over_true
    found = noise_set(sensor, exposures, wrong=wrong)
    return replace(found, truth=found.truth | {"dsnu_e": float(np.hypot(sensor.dsnu_e, of_gains_e))})


def drawn_good(seed: int) -> NoiseSet:
    sensor = drawn_sensor(seed)
    return _set(sensor, drawn_sweep(sensor, seed))


def drawn_drift(seed: int) -> NoiseSet:
    """The lamp loses 3 % evenly during the sweep."""
    sensor = drawn_sensor(seed)
    return _set(sensor, drawn_sweep(sensor, seed, drift=0.03))


def drawn_unit(seed: int) -> NoiseSet:
    """All exposures stated a thousand times too short or too long: the dark current has no truth then."""
    sensor = drawn_sensor(seed)
    exposures, factor = drawn_sweep(sensor, seed), 1e-3 if seed % 2 else 1e3
    for one in exposures:
        one.time_s *= factor
    found = _set(sensor, exposures, stated_over_true=factor)
    truth = {name: value for name, value in found.truth.items() if name != "dark_current_e_per_s"}
    return replace(found, truth=truth | {"dark_current_e_per_s": sensor.dark_e_per_s / factor})


def _wrong_light(exposure: Exposure, factor: float) -> None:
    """State another light than there was, on the axis that the sweep has."""
    if exposure.photons is None:
        exposure.time_s *= factor
    else:
        exposure.photons *= factor


def _with_wrong(seed: int, places: tuple[str, ...], *, least: int = 6) -> NoiseSet:
    """Levels that are stated to have 8 % more or less light, one at each of the places."""
    sensor = drawn_sensor(seed)
    exposures = drawn_sweep(sensor, seed, least=least)
    flats = [one for one in exposures if one.kind == "flat"]
    wrong = [flats[_PLACES[place](len(flats))] for place in places]
    for one in wrong:
        _wrong_light(one, 1.0 + 0.08 * float(sensor.draws.choice([-1.0, 1.0])))
    return _set(sensor, exposures, wrong=wrong)


def drawn_wrong_first(seed: int) -> NoiseSet:
    return _with_wrong(seed, ("first",))


def drawn_wrong_middle(seed: int) -> NoiseSet:
    return _with_wrong(seed, ("middle",))


def drawn_wrong_last(seed: int) -> NoiseSet:
    return _with_wrong(seed, ("last",))


def drawn_two_wrong(seed: int) -> NoiseSet:
    """Two of ten levels or more; of fewer, a quarter is less than two."""
    return _with_wrong(seed, ("first", "middle"), least=10)


def drawn_other_gain(seed: int) -> NoiseSet:
    """One level, anywhere, was taken at a gain that is 10 % higher."""
    sensor = drawn_sensor(seed)
    exposures = drawn_sweep(sensor, seed)
    place = int(sensor.draws.integers(0, len(exposures) // 2))
    level = exposures[2 * place]
    level.frames = [sensor.frame(level.light_e, level.time_s, gain=1.1) for _ in level.frames]
    return _set(sensor, exposures, wrong=[level])


def drawn_ten_errors(seed: int) -> NoiseSet:
    """The faintest level (in every second set any that numbers are taken from) is off by ten of its own errors.

    These hold noise and rounding of flat and darks, and the flicker that repeats show.
    """
    sensor = drawn_sensor(seed)
    exposures = drawn_sweep(sensor, seed)
    try:
        sound = calibrate_noise([one.level() for one in exposures], bit_depth=sensor.bits)
    except RefusedFramesError:
        return _set(sensor, exposures)
    signal_dn = sound.transfer.points.signal_dn
    of_darks = np.square(match_darks(sound.flats, sound.darks)) @ mean_sampling_variance(sound.darks)
    own_dn2 = mean_variance_dn2(sound.flats, signal_dn, sound.light_stability) + of_darks
    place = int(sensor.draws.choice(np.flatnonzero(sound.transfer.used))) if seed % 2 else 0
    relative = 10.0 * float(np.sqrt(own_dn2[place]) / signal_dn[place])
    # Flats by ascending mean are by ascending light.
    off = exposures[2 * place]
    _wrong_light(off, 1.0 / (1.0 + relative * float(sensor.draws.choice([-1.0, 1.0]))))
    return _set(sensor, exposures, wrong=[off])


DRAWN_GOOD = (drawn_good, drawn_drift)
DRAWN_WRONG = (
    drawn_wrong_first,
    drawn_wrong_middle,
    drawn_wrong_last,
    drawn_two_wrong,
    drawn_other_gain,
    drawn_ten_errors,
)
DRAWN_OUTSIDE = (drawn_unit,)
