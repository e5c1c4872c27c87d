"""A simulated Elliptec rotation stage: mechanics, language and line in one, safe to use from several threads."""

import threading

import numpy as np

from sim_devices.clock import Clock
from sim_devices.faults import LineNoise
from sim_devices.stages.ellx_address import EllxOptions
from sim_devices.stages.ellx_language import EllxLanguage, Reply
from sim_devices.stages.ellx_mechanics import EllxMechanics
from sim_devices.stages.line import Line

_BAUD = 9600


class SimulatedEllx:
    """The stage itself. Serve it on a pseudo-terminal, or in this process, and look at its true angle.

    Parameters
    ----------
    options : EllxOptions
        What it is like.
    clock : Clock
        The time that it lives in.
    """

    def __init__(self, options: EllxOptions, *, clock: Clock) -> None:
        mechanics_generator, line_generator, self._generator = np.random.default_rng(options.seed).spawn(3)
        self._clock = clock
        self._lock = threading.Lock()
        self._noise = LineNoise(drop=options.drop, double=options.double, flip=options.flip)
        self._mechanics = EllxMechanics(
            pulses=options.pulses,
            landing_deg=options.landing_deg,
            mark_deg=options.mark_deg,
            start_deg=options.start_deg,
            generator=mechanics_generator,
        )
        self._language = EllxLanguage(options, self._mechanics)
        self._line = Line(
            baud=_BAUD if options.pace else None,
            in_pieces=options.pieces,
            late_s=options.late_s,
            noise=self._noise,
            generator=line_generator,
        )

    def true_angle_deg(self) -> float:
        """Return the angle at which the ring now stands in its housing [deg], in [0, 360)."""
        with self._lock:
            return self._live() % 360.0 % 360.0  # a tiny negative angle makes 360.0 the first time

    def receive(self, data: bytes) -> None:
        """Take in what the host has sent."""
        with self._lock:
            arriving = self._noise.corrupt(data, self._generator)
            self._send(self._language.receive(self._clock.now_s(), arriving))

    def transmit(self) -> bytes:
        """Return what has reached the host by now and was not returned before."""
        with self._lock:
            self._live()
            return self._line.arrived(self._clock.now_s())

    def next_event_s(self) -> float | None:
        """Return when there will be something new to transmit [s], or None while nothing is under way."""
        with self._lock:
            times = (self._line.next_arrival_s(), self._language.next_event_s())
            return min((time_s for time_s in times if time_s is not None), default=None)

    def _live(self) -> float:
        """Let the stage do what it does until now; return its angle [deg], counted on through full turns."""
        now_s = self._clock.now_s()
        self._send(self._language.advance(now_s))
        return self._mechanics.angle_deg(now_s)

    def _send(self, replies: list[Reply]) -> None:
        for time_s, reply in replies:
            self._line.send(time_s, reply)
