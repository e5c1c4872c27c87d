"""Number of particles whose volume is given, as inversions of sun photometers give it."""

from math import exp, isfinite, pi


def number_of_volume(*, volume: float, volume_median_radius_m: float, ln_sigma: float) -> float:
    """Return how many particles of a log-normal law together have a volume, per unit of that volume.

    Parameters
    ----------
    volume
        Volume of all particles, above 0, in any unit.
    volume_median_radius_m
        Radius [m] that half of the volume lies above, above 0.
    ln_sigma
        Standard deviation of the natural logarithm of the radius, above 0 to 2.

    Raises
    ------
    ValueError
        An argument outside its range.

    References
    ----------
    definition: the mean cube of the radius is that of the volume's median times exp(-9 sigma^2 / 2).
    """
    if not all(isfinite(value) and value > 0.0 for value in (volume, volume_median_radius_m)):
        raise ValueError(f"volume = {volume!r} and volume_median_radius_m = {volume_median_radius_m!r} must be above 0")
    if not 0.0 < ln_sigma <= 2.0:
        raise ValueError(f"ln_sigma = {ln_sigma!r}, allowed is above 0 to 2")
    mean_cube = volume_median_radius_m**3 * exp(-4.5 * ln_sigma**2)
    return volume / (4.0 / 3.0 * pi * mean_cube)
