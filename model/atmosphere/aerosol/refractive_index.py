"""Complex refractive index over wavelength."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class RefractiveIndex:
    """Index n + ik (k >= 0 absorbs) as a table over wavelength; one row stands for all wavelengths.

    Attributes
    ----------
    n, k
        Real part, above 0, and absorbing part, 0 or more; linear between rows.
    wavelength_m
        Increasing wavelengths of the rows [m]; empty for one row that holds everywhere.
    """

    n: tuple[float, ...]
    k: tuple[float, ...]
    wavelength_m: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        rows = len(self.wavelength_m) or 1
        if len(self.n) != rows or len(self.k) != rows:
            raise ValueError(f"RefractiveIndex: {rows} rows, but {len(self.n)} values of n and {len(self.k)} of k")
        if not all(0.0 < value < np.inf for value in self.n):
            raise ValueError(f"RefractiveIndex: n = {self.n!r}, but all must be finite and above 0")
        if not all(0.0 <= value < np.inf for value in self.k):
            raise ValueError(f"RefractiveIndex: k = {self.k!r}, but all must be finite and 0 or more (n + ik absorbs)")
        if not np.all(np.diff([0.0, *self.wavelength_m]) > 0.0):
            raise ValueError("RefractiveIndex: wavelength_m must be above 0 and increase")

    def at(self, wavelength_m: float) -> complex:
        """Index n + ik at a wavelength [m].

        Raises
        ------
        ValueError
            The wavelength is outside the table.
        """
        if not self.wavelength_m:
            return complex(self.n[0], self.k[0])
        first, last = self.wavelength_m[0], self.wavelength_m[-1]
        if not first <= wavelength_m <= last:
            raise ValueError(
                f"wavelength_m = {wavelength_m!r} m, but the refractive index is given for {first} to {last} m"
            )
        n, k = (float(np.interp(wavelength_m, self.wavelength_m, values)) for values in (self.n, self.k))
        return complex(n, k)


def mixed_index(*, parts: tuple[RefractiveIndex, ...], volume_shares: tuple[float, ...]) -> RefractiveIndex:
    """Index of substances mixed within each particle: the mean of n and of k by volume.

    Parameters
    ----------
    parts
        Tables on the same wavelengths.
    volume_shares
        One for each, 0 or more, of sum 1.

    Raises
    ------
    ValueError
        The tables differ in their wavelengths, or the shares do not sum to 1.

    References
    ----------
    Haenel, Adv. Geophys. 19 (1976) 73, doi:10.1016/S0065-2687(08)60142-9.
    """
    wavelengths = {part.wavelength_m for part in parts}
    if len(wavelengths) != 1 or len(parts) != len(volume_shares):
        raise ValueError("mixed_index: all parts must be given at the same wavelengths, each with a share")
    if min(volume_shares) < 0.0 or abs(sum(volume_shares) - 1.0) > 1e-9:
        raise ValueError(f"mixed_index: volume_shares = {volume_shares!r} must be 0 or more and sum to 1")
    n, k = (
        tuple(float(value) for value in np.array(volume_shares) @ np.array([getattr(part, name) for part in parts]))
        for name in ("n", "k")
    )
    return RefractiveIndex(n=n, k=k, wavelength_m=parts[0].wavelength_m)
