"""Finds, once a round, the exposure at which the brightest polarizer angle fills the range and does not saturate."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.files.session_file import MeteringSection
from rigctl.runs.run_events import METERED_EVENT
from rigctl.runs.run_writer import RunWriter
from rigctl.session.captured_frame import CapturedFrame
from rigctl.session.planning.session_steps import Step
from rigctl.session.rig_work import RigWork

# A share above this may be clipped: it says only that the exposure is too long.
_CLIPPED = 0.98
_SHORTEN = 0.25
_LENGTHEN_AT_MOST = 30.0
_NEAR = 0.1
_MOST_ROUNDS = 12
_MS_PER_S = 1000.0

Shares = Mapping[float | None, float]
Probe = Callable[[float], Shares]


@dataclass(frozen=True, kw_only=True)
class Metered:
    """An exposure, and what it gives.

    Attributes
    ----------
    exposure_s : float
        Integration time [s].
    shares : mapping
        By polarizer angle [deg]: share of the largest count that the bright pixels reach.
    remark : str or None
        What one exposure cannot do here.
    """

    exposure_s: float
    shares: Shares
    remark: str | None


def bright_share(counts: NDArray[np.uint16], *, quantile: float, full_dn: float) -> float:
    """Return which share of the largest count a quantile of the pixels reaches."""
    return float(np.quantile(counts, quantile, method="lower")) / full_dn


def meter(probe: Probe, section: MeteringSection) -> Metered:
    """Return the exposure that serves all angles, as far as one can.

    Parameters
    ----------
    probe : callable
        Takes an exposure [s] and returns the share of each angle.
    section : MeteringSection
        Where to begin, and what is wanted.

    Notes
    -----
    The brightest angle decides. Counts need not be proportional to the exposure (black level): it goes on until the
    share is within a tenth of its target, or the exposure is at a limit.
    """
    exposure_s = section.first_exposure_ms / _MS_PER_S
    for _ in range(_MOST_ROUNDS):
        shares = probe(exposure_s)
        wanted_s = _next_exposure_s(exposure_s, max(shares.values()), section)
        if abs(wanted_s - exposure_s) <= _NEAR * exposure_s:
            break
        exposure_s = wanted_s
    return Metered(exposure_s=exposure_s, shares=shares, remark=_remark(shares, section))


def _next_exposure_s(exposure_s: float, brightest: float, section: MeteringSection) -> float:
    factor = _SHORTEN if brightest > _CLIPPED else min(_LENGTHEN_AT_MOST, section.target / max(brightest, 1e-9))
    wanted_s = min(max(exposure_s * factor, section.shortest_ms / _MS_PER_S), section.longest_ms / _MS_PER_S)
    # Cameras count whole microseconds.
    return round(wanted_s, 6)


def _remark(shares: Shares, section: MeteringSection) -> str | None:
    if max(shares.values()) > _CLIPPED:
        return f"the brightest angle saturates at the shortest exposure, {section.shortest_ms:g} ms: stop down"
    if min(shares.values()) < section.least:
        text = f"the darkest angle reaches {min(shares.values()):.3f} of the range, wanted are {section.least:g}"
        return f"{text}: one exposure cannot serve all angles, give a bracket such as [1, 4]"
    return None


class RoundExposures:
    """Meters each round once.

    Parameters
    ----------
    steps : sequence of Step
        Of the session.
    work : RigWork
        Takes the pictures by which it is metered.
    writer : RunWriter
        Where the result is noted, for a resume.
    metering : MeteringSection
        What is wanted.
    metered_s : mapping
        What was metered before, by round [s].
    """

    def __init__(
        self,
        steps: Sequence[Step],
        work: RigWork,
        writer: RunWriter,
        *,
        metering: MeteringSection,
        metered_s: Mapping[int, float],
    ) -> None:
        self._steps, self._work, self._writer = steps, work, writer
        self._metering = metering
        self._metered_s = dict(metered_s)
        self._next_camera_frame: int | None = None

    def of(self, step: Step) -> float:
        """Return the exposure of a step [s].

        Raises
        ------
        DeviceError
            It has to be metered, and a device fails.
        """
        if step.exposure_s is not None:
            return step.exposure_s
        if step.round not in self._metered_s:
            self._metered_s[step.round] = self._metered(step.round)
        return self._metered_s[step.round] * step.exposure_factor

    def _metered(self, number: int) -> float:
        angles = {s.polarizer_angle_deg for s in self._steps if s.round == number and s.kind == "scene"}
        ordered = sorted(angles, key=lambda angle: angle or 0.0)
        self._work.present("scene")
        found = meter(lambda exposure_s: self._bright_shares(exposure_s, ordered), self._metering)
        self._writer.event(
            METERED_EVENT,
            round=number,
            exposure_s=found.exposure_s,
            shares={str(angle): share for angle, share in found.shares.items()},
            remark=found.remark,
            next_camera_frame=self._next_camera_frame,
        )
        return found.exposure_s

    def _bright_shares(self, exposure_s: float, angles_deg: Sequence[float | None]) -> Shares:
        """Return the share of each angle; those of a cell of polarizers are of one exposure."""
        if any(step.part is not None for step in self._steps):
            parts = self._work.capture_parts(exposure_s=exposure_s)
            return {angle_deg: self._share(captured) for angle_deg, captured in parts.items()}
        return {
            angle_deg: self._share(self._work.capture(exposure_s=exposure_s, polarizer_angle_deg=angle_deg))
            for angle_deg in angles_deg
        }

    def _share(self, captured: CapturedFrame) -> float:
        frame = captured.frame
        self._next_camera_frame = frame.sequence + 1
        full_dn = float(2**frame.settings.bit_depth - 1)
        return bright_share(frame.counts, quantile=self._metering.quantile, full_dn=full_dn)
