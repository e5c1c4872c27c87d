"""Bounds of the change of a prediction where an effect is left out."""

from dataclasses import astuple, dataclass, fields

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Bound:
    """Largest change of what is read off a prediction; each is 0 or more, infinite where nothing is known.

    Attributes
    ----------
    radiance
        Of S0, S1 and S2 over S0, and of each angle's counts over themselves.
    ratios
        Of DoLP, S1/S0 and S2/S0 of the mean, and of the mean of the pixels' DoLP.
    deviations
        Of every standard deviation and of the SNR of DoLP, relative.
    detection
        Of every probability of detection, and of the area under its curve.
    """

    radiance: float = 0.0
    ratios: float = 0.0
    deviations: float = 0.0
    detection: float = 0.0

    @property
    def largest(self) -> float:
        """The largest of the four."""
        return max(self.radiance, self.ratios, self.deviations, self.detection)

    @property
    def in_words(self) -> str:
        """What changes by how much, as text."""
        if all(np.isinf(value) for value in astuple(self)):
            return "any amount"
        parts = [
            f"{one.name} {'any amount' if np.isinf(value) else format(value, '.1e')}"
            for one, value in zip(fields(self), astuple(self), strict=True)
            if value > 0.0
        ]
        return ", ".join(parts) or "nothing"

    def __add__(self, other: "Bound") -> "Bound":
        """Return the sums, which bound what two effects change together."""
        return Bound(
            radiance=self.radiance + other.radiance,
            ratios=self.ratios + other.ratios,
            deviations=self.deviations + other.deviations,
            detection=self.detection + other.detection,
        )

    def worse(self, other: "Bound") -> "Bound":
        """Return the larger of each."""
        return Bound(
            radiance=max(self.radiance, other.radiance),
            ratios=max(self.ratios, other.ratios),
            deviations=max(self.deviations, other.deviations),
            detection=max(self.detection, other.detection),
        )

    def tighter(self, other: "Bound") -> "Bound":
        """Return the smaller of each."""
        return Bound(
            radiance=min(self.radiance, other.radiance),
            ratios=min(self.ratios, other.ratios),
            deviations=min(self.deviations, other.deviations),
            detection=min(self.detection, other.detection),
        )

    def times(self, factor: float) -> "Bound":
        """Return each multiplied by a factor, 0 or more."""
        return Bound(
            radiance=factor * self.radiance,
            ratios=factor * self.ratios,
            deviations=factor * self.deviations,
            detection=factor * self.detection,
        )

    def holds(self, actual: "Bound", *, rounding: float = 1e-9) -> bool:
        """Return whether an actual change is within the bound, with room for rounding."""
        return all(
            is_within <= limit + rounding for is_within, limit in zip(astuple(actual), astuple(self), strict=True)
        )


# Where nothing is known.
EVERYTHING = Bound(radiance=np.inf, ratios=np.inf, deviations=np.inf, detection=np.inf)


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Change of a prediction where an effect is left out, as a coarse evaluation has it; nothing is promised.

    Attributes
    ----------
    value
        The change.
    error
        How far it may be off.
    """

    value: Bound
    error: Bound

    @property
    def most(self) -> Bound:
        """The change with its error."""
        return self.value + self.error


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """Largest change of one region where an effect is left out.

    Attributes
    ----------
    s0, polarised
        Change of the mean S0, and length of the change of the mean (S1, S2), over S0.
    factor
        Change of a factor common to the mean Stokes vector.
    share
        Largest change of the covariance over the covariance itself, along any direction of Stokes parameters or of
        channels: its eigenvalues lie within 1 - share and 1 + share.
    counts
        Change of counts that leaves the Stokes parameters alone, over S0.
    share_of_dolp
        The same as `share` for the pixels' DoLP alone, where that is less: a factor common to a pixel's Stokes vector
        is a share of the covariance, and leaves its DoLP alone. None for the share itself.
    """

    s0: float = 0.0
    polarised: float = 0.0
    factor: float = 0.0
    share: float = 0.0
    counts: float = 0.0
    share_of_dolp: float | None = None

    @property
    def is_nothing(self) -> bool:
        """True if the effect is not there at all."""
        return not (self.s0 or self.polarised or self.factor or self.share or self.counts)


NOTHING = Disturbance()
UNKNOWN = Disturbance(s0=np.inf, polarised=np.inf)
