"""Numbers of the frames as they come, by angle: for whoever watches, not for processing."""

import threading
from typing import Any

import numpy as np

from model.processing.reconstruction import design, reconstruct
from rigctl.sessions.plan import Step
from rigctl.sessions.shot import Shot

_LEAST_ANGLES = 3


class LiveNumbers:
    """Remembers the last frame of each angle. Filled in one thread, read in another."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._angles: dict[float, dict[str, float]] = {}
        self._dark_dn: float | None = None

    def add(self, step: Step, shot: Shot, *, mean_dn: float) -> None:
        """Take in a frame and its mean count."""
        with self._lock:
            if step.kind == "dark":
                self._dark_dn = mean_dn
            elif step.kind == "scene" and step.polarizer_angle_deg is not None:
                self._angles[step.polarizer_angle_deg % 180.0] = {
                    "mean_dn": mean_dn,
                    "saturated_fraction": shot.saturated_fraction,
                    "exposure_ms": shot.settings.exposure_s * 1000.0,
                }

    def content(self) -> dict[str, Any]:
        """Return the numbers as JSON holds them.

        Notes
        -----
        The DoLP is that of the mean counts of the whole picture, less the last dark frame's where there was one.
        """
        with self._lock:
            angles = dict(sorted(self._angles.items()))
            return {
                "angles": {f"{angle:g}": numbers for angle, numbers in angles.items()},
                "dark_dn": self._dark_dn,
                "sum_rule": _sum_rule(angles, self._dark_dn or 0.0),
                "dolp_of_mean": _dolp(angles, self._dark_dn or 0.0),
            }


def _signals(angles: dict[float, dict[str, float]], dark_dn: float) -> dict[float, float]:
    return {angle: (n["mean_dn"] - dark_dn) / n["exposure_ms"] for angle, n in angles.items()}


def _sum_rule(angles: dict[float, dict[str, float]], dark_dn: float) -> float | None:
    """Return (I0 + I90) / (I45 + I135), where there are all four."""
    signal = _signals(angles, dark_dn)
    if not {0.0, 45.0, 90.0, 135.0} <= set(signal) or signal[45.0] + signal[135.0] <= 0.0:
        return None
    return (signal[0.0] + signal[90.0]) / (signal[45.0] + signal[135.0])


def _dolp(angles: dict[float, dict[str, float]], dark_dn: float) -> float | None:
    signal = _signals(angles, dark_dn)
    if len(signal) < _LEAST_ANGLES:
        return None
    s0, s1, s2 = reconstruct(design(np.deg2rad(list(signal))), list(signal.values()))
    return float(np.hypot(s1, s2) / s0) if s0 > 0.0 else None
