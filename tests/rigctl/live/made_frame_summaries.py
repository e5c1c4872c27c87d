"""FrameSummaries of light that is known."""

import math

from rigctl.session.numbers import FrameSummary, PixelMean

BLACK_DN = 64.0
EXPOSURE_S = 0.01


def seen(
    angle_deg,
    *,
    level_dn,
    time_s=0.0,
    kind="scene",
    cycle=0,
    round_number=None,
    exposure_s=EXPOSURE_S,
    saturated=0.0,
    pixels=1,
    measured_deg=None,
):
    """Return a frame in which picture and panel have a level above black [DN]."""
    mean = PixelMean(mean_dn=BLACK_DN + level_dn, pixels=pixels)
    return FrameSummary(
        kind=kind,
        round=round_number,
        cycle=cycle,
        angle_deg=angle_deg,
        measured_deg=angle_deg if measured_deg is None else measured_deg,
        exposure_s=exposure_s,
        time_s=time_s,
        saturated_fraction=saturated,
        means={"picture": mean, "panel": mean},
    )


def dark(*, level_dn=0.0, exposure_s=EXPOSURE_S):
    """Return a dark frame."""
    return seen(None, level_dn=level_dn, kind="dark", exposure_s=exposure_s)


def behind(stokes_dn, angle_deg):
    """Return what an ideal polarizer lets through (Malus) [DN]."""
    s0, s1, s2 = stokes_dn
    return (s0 + s1 * math.cos(math.radians(2 * angle_deg)) + s2 * math.sin(math.radians(2 * angle_deg))) / 2


def cycle_of(stokes_dn, *, angles=(0.0, 90.0, 45.0, 135.0), start_s=0.0, step_s=1.0, **more):
    """Return a cycle of unchanging light."""
    return tuple(
        seen(angle, level_dn=behind(stokes_dn, angle), time_s=start_s + k * step_s, **more)
        for k, angle in enumerate(angles)
    )
