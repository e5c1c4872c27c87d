"""Findings in the parameters themselves: numbers that no sensor has, each by its own name."""

from calibration.estimate import Estimate, number_with_error
from calibration.flags import Flag

_SIGMA = 5.0


def parameter_flags(*, dark_current_e_per_s: Estimate | None, quantum_efficiency: Estimate | None) -> tuple[Flag, ...]:
    """Return what is odd in the parameters.

    Parameters
    ----------
    dark_current_e_per_s : Estimate or None
        By the dark mean.
    quantum_efficiency : Estimate or None
        Electrons per photon, where photons are stated.
    """
    found = (_negative(dark_current_e_per_s), _too_efficient(quantum_efficiency))
    return tuple(flag for flag in found if flag is not None)


def _negative(found: Estimate | None) -> Flag | None:
    if found is None or found.value > -_SIGMA * found.std_error:
        return None
    return Flag(
        name="negative_dark_current",
        message=f"the dark mean falls with exposure, by "
        f"{number_with_error(-found.value, found.std_error)} e-/s: the camera "
        f"takes off more than its dark signal, its black level drifts, or exposures are mixed up; see the dark "
        f"current by variance",
    )


def _too_efficient(found: Estimate | None) -> Flag | None:
    if found is None or found.value - _SIGMA * found.std_error < 1.0:
        return None
    return Flag(
        name="quantum_efficiency_above_one",
        message=f"there are "
        f"{number_with_error(found.value, found.std_error)} electrons a photon, of which there can be one "
        f"at most: the photons are not those of one pixel and one exposure, or irradiance or pixel area are wrong",
    )
