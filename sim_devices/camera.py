"""A simulated camera that looks at a simulated world."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceTimeoutError, LimitError, NotConnectedError
from drivers.interfaces import CameraFacts, CameraSettings, DeviceIdentity, Frame, FrameTally
from sim_devices.exposure import (
    Detector,
    Lens,
    RenderingEffect,
    Shot,
    Stream,
    counts_of,
    draw_fixed_pattern,
    exposure_effects,
    generator,
)
from sim_devices.truth_log import TrueFrame, TruthLog
from sim_devices.world import World

CameraFault = Literal["lost", "repeated", "black"]

_MODEL = "simulated GC780-like camera"
_EXPOSURE_RANGE_S = (1e-6, 60.0)
_GAIN_RANGE_DB = (0.0, 24.0)
_POWER_ON_EXPOSURE_S = 0.01


class SimCamera:
    """A camera that exposes without waiting and whose frames can be reproduced.

    Parameters
    ----------
    world
        The scene, of the same size as the detector.
    lens, detector
        Their true properties.
    pattern_seed
        Determines fixed pattern and serial number, >= 0.
    noise_seed
        Determines the noise of a frame together with its sequence number, >= 0. Frames of equal seed and number have
        the same noise: give each session its own seed or range of numbers.
    first_sequence
        Number of the first frame, >= 0, for example after an earlier session.
    faults
        Faults by sequence number: "lost" (the frame never comes, its number is used up), "repeated" (the counts of the
        frame before, under a new number and time) or "black" (all counts 0).
    utc_ns, monotonic_ns
        The clocks of the host [ns], for the time stamps.
    truth
        Log of the true exposures; None for no log.
    rendering
        Effects in addition to those of lens and detector.

    Raises
    ------
    ValueError
        If world and detector differ in size, or a number is negative.

    Notes
    -----
    The polarizer keeps its angle during an exposure. Frames do not overlap: if the clocks advance by less than the
    exposure, time stamps run ahead of them. Exposures are whole microseconds. The ranges of exposure and gain are
    assumed.
    """

    def __init__(
        self,
        *,
        world: World,
        lens: Lens,
        detector: Detector,
        pattern_seed: int,
        noise_seed: int,
        first_sequence: int = 0,
        faults: Mapping[int, CameraFault] | None = None,
        utc_ns: Callable[[], int] = time.time_ns,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        truth: TruthLog | None = None,
        rendering: Sequence[RenderingEffect] = (),
    ) -> None:
        _refuse_mismatch(world, detector)
        _refuse_negative(pattern_seed=pattern_seed, noise_seed=noise_seed, first_sequence=first_sequence)
        self._world, self._lens, self._detector = world, lens, detector
        self._pattern_seed, self._noise_seed = pattern_seed, noise_seed
        self._pattern = draw_fixed_pattern(detector, generator=generator(pattern_seed, Stream.PATTERN))
        self._utc_ns, self._monotonic_ns = utc_ns, monotonic_ns
        self._next_sequence = first_sequence
        self._faults = dict(faults or {})
        self._truth = truth
        self._rendering = tuple(rendering)
        self._last_counts = np.zeros(world.shape, dtype=np.uint16)
        self._free_at_monotonic_ns = monotonic_ns()
        self._tally = FrameTally()
        self._open = True
        self.configure(exposure_s=_POWER_ON_EXPOSURE_S, gain_db=0.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        """Return a model name that marks a simulation; the serial number is the pattern seed."""
        self._refuse_closed()
        return DeviceIdentity(model=_MODEL, serial_number=f"sim-{self._pattern_seed}", firmware="none")

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        """Set exposure and gain; return them with the exposure rounded to whole microseconds.

        Raises
        ------
        LimitError
            A value is out of range; nothing is changed.
        NotConnectedError
            The camera was closed.
        """
        self._refuse_closed()
        _refuse_outside("exposure_s", exposure_s, unit="s", limits=_EXPOSURE_RANGE_S)
        _refuse_outside("gain_db", gain_db, unit="dB", limits=_GAIN_RANGE_DB)
        self._exposure_us = round(exposure_s * 1e6)
        self._settings = CameraSettings(
            exposure_s=self._exposure_us / 1e6,
            gain_db=gain_db,
            width=self._detector.width,
            height=self._detector.height,
            bit_depth=self._detector.bit_depth,
        )
        self._effects = exposure_effects(
            lens=self._lens,
            detector=self._detector,
            pattern=self._pattern,
            exposure_s=self._settings.exposure_s,
            gain_db=gain_db,
            rendering=self._rendering,
        )
        return self._settings

    def take_frame(self, *, timeout_s: float) -> Frame:
        """Return a picture of the present world.

        Raises
        ------
        DeviceTimeoutError
            The exposure is longer than `timeout_s` (then no number is used up), or the frame was to be lost.
        NotConnectedError
            The camera was closed.
        """
        self._refuse_closed()
        self._refuse_late(timeout_s)
        sequence = self._next_sequence
        self._next_sequence += 1
        start_utc_ns, start_monotonic_ns = self._start_exposure()
        fault = self._faults.get(sequence)
        self._note_truth(sequence, start_utc_ns, start_monotonic_ns, fault)
        if fault == "lost":
            self._tally += FrameTally(never_came=1)
            raise DeviceTimeoutError(f"{_MODEL}: frame {sequence} did not come within {timeout_s} s; try again")
        if fault != "repeated":
            self._last_counts = self._picture(sequence=sequence, black=fault == "black")
        self._tally += FrameTally(accepted=1)
        return Frame(
            counts=self._last_counts.copy(),
            settings=self._settings,
            sequence=sequence,
            start_utc_ns=start_utc_ns,
            end_utc_ns=start_utc_ns + self._exposure_us * 1000,
            start_monotonic_ns=start_monotonic_ns,
            start_uncertainty_s=0.0,
            start_source="simulation",
        )

    def tally(self) -> FrameTally:
        """Return what became of the pictures so far."""
        return self._tally

    def facts(self) -> CameraFacts:
        """Return that it is linear, up to its full well and its range."""
        return CameraFacts(sample_format="none: within the program", justified="right", linear=True, triggered=True)

    def features(self) -> dict[str, str]:
        """Return nothing: it has no named features and no thermometer."""
        return {}

    @property
    def next_sequence(self) -> int:
        """The number of the next frame."""
        return self._next_sequence

    @property
    def busy_until_monotonic_ns(self) -> int:
        """When the last exposure ends or has ended, by the host's monotonic clock [ns]."""
        return self._free_at_monotonic_ns

    def go_on_from(self, sequence: int) -> None:
        """Give the next frame this number, which determines its noise; ValueError if it is used up."""
        if sequence < self._next_sequence:
            raise ValueError(f"sequence is {sequence}; numbers below {self._next_sequence} are used up")
        self._next_sequence = sequence

    def close(self) -> None:
        """Release the camera. May be called twice."""
        self._open = False

    def _start_exposure(self) -> tuple[int, int]:
        """Return UTC and monotonic time of the start, and note the end of the exposure."""
        now_ns = self._monotonic_ns()
        start_ns = max(now_ns, self._free_at_monotonic_ns)
        self._free_at_monotonic_ns = start_ns + self._exposure_us * 1000
        return self._utc_ns() + start_ns - now_ns, start_ns

    def _note_truth(self, sequence: int, start_utc_ns: int, start_monotonic_ns: int, fault: CameraFault | None) -> None:
        if self._truth is None:
            return
        true_frame = TrueFrame(
            sequence=sequence,
            subject=self._world.subject,
            polarizer_angle_deg=self._world.polarizer_angle_deg(),
            exposure_s=self._settings.exposure_s,
            gain_db=self._settings.gain_db,
            start_utc_ns=start_utc_ns,
            start_monotonic_ns=start_monotonic_ns,
            fault=fault,
        )
        self._truth.note(true_frame)

    def _picture(self, *, sequence: int, black: bool) -> NDArray[np.uint16]:
        if black:
            return np.zeros(self._world.shape, dtype=np.uint16)
        return counts_of(
            self._world.radiance_behind_polarizer(),
            effects=self._effects,
            bit_depth=self._detector.bit_depth,
            shot=self._shot(sequence),
        )

    def _shot(self, sequence: int) -> Shot:
        return Shot(
            noise=generator(self._noise_seed, Stream.NOISE, sequence),
            noise_seed=self._noise_seed,
            sequence=sequence,
            exposure_s=self._settings.exposure_s,
            axis_deg=self._world.axis_deg(),
        )

    def _refuse_closed(self) -> None:
        if not self._open:
            raise NotConnectedError(f"{_MODEL}: it was closed; open it again")

    def _refuse_late(self, timeout_s: float) -> None:
        if self._settings.exposure_s > timeout_s:
            raise DeviceTimeoutError(
                f"{_MODEL}: no frame within {timeout_s} s at an exposure of {self._settings.exposure_s} s; allow more "
                "time or expose shorter"
            )


def _refuse_mismatch(world: World, detector: Detector) -> None:
    if world.shape != (detector.height, detector.width):
        raise ValueError(
            f"the world is {world.shape[1]} x {world.shape[0]} pixels and the detector {detector.width} x "
            f"{detector.height}; they must have one size"
        )


def _refuse_negative(**numbers: int) -> None:
    for name, number in numbers.items():
        if number < 0:
            raise ValueError(f"{name} is {number}; allowed is 0 and above")


def _refuse_outside(name: str, value: float, *, unit: str, limits: tuple[float, float]) -> None:
    low, high = limits
    if not low <= value <= high:
        raise LimitError(f"{_MODEL}: {name} is {value} {unit}; it takes {low:g} to {high:g} {unit}")
