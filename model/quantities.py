"""Quantities of a region, common to prediction and measurement, and names of its counts."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

_COUNTS, _RATIO = "dn_", "ratio_"


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A quantity of a region."""

    name: str
    label: str
    #: What an error of its mean is a share of. Not of itself, where it may be 0.
    error_of: Literal["itself", "one", "s0"] = "itself"
    is_signed: bool = False  #: Its sign is that of the frame of reference.
    turn: float | None = None  #: Of an angle, after which it is the same again.
    is_followed: bool = False  #: From run to run of a series.
    #: Value and gradient by s1 and s2, of a plain function of both.
    of_ratios: Callable[[float, float], tuple[float, tuple[float, float]]] | None = None


QUANTITIES = {
    one.name: one
    for one in (
        Quantity(name="s0", label="S0", is_followed=True),
        Quantity(name="s1", label="S1", error_of="s0", is_signed=True),
        Quantity(name="s2", label="S2", error_of="s0", is_signed=True),
        Quantity(
            name="s1n",
            label="s1",
            error_of="one",
            is_signed=True,
            is_followed=True,
            of_ratios=lambda s1, _: (s1, (1.0, 0.0)),
        ),
        Quantity(
            name="s2n",
            label="s2",
            error_of="one",
            is_signed=True,
            is_followed=True,
            of_ratios=lambda _, s2: (s2, (0.0, 1.0)),
        ),
        Quantity(name="dolp", label="DoLP", error_of="one", is_followed=True),
        Quantity(name="aolp_deg", label="AoLP [deg]", turn=180.0, is_followed=True),
        Quantity(name="dolp_pixels", label="DoLP of pixels", error_of="one"),
        Quantity(name="dolp_snr", label="DoLP SNR"),
    )
}
OF_RATIOS = {one.name: one.of_ratios for one in QUANTITIES.values() if one.of_ratios is not None}
# On a circle there is no order, and no error estimate for weak polarization.
CIRCULAR = frozenset(one.name for one in QUANTITIES.values() if one.turn is not None)
FOLLOWED = tuple(one.name for one in QUANTITIES.values() if one.is_followed)
ORDERED = tuple(name for name in FOLLOWED if name not in CIRCULAR)


def counts_name(angle: str) -> str:
    """Return the name of the counts behind an angle, "dn_45"."""
    return _COUNTS + angle


def ratio_name(counts: str) -> str:
    """Return the name of the counts behind an angle over the mean of all, "ratio_45" for "dn_45"."""
    return _RATIO + angle_of(counts)


def angle_of(counts: str) -> str:
    """Return the angle of a name of counts as text, "45" for "dn_45"."""
    return counts.removeprefix(_COUNTS)


def is_counts(name: str) -> bool:
    """Return whether a quantity is the counts behind an angle."""
    return name.startswith(_COUNTS)


def error_scale(name: str, statistic: str, value: float, s0: float) -> float:
    """Return what an error of a statistic is a share of, 0 or more.

    Parameters
    ----------
    name
        Of the quantity.
    statistic
        "mean", "std", ...
    value
        Of the statistic, in its own unit.
    s0
        S0 of the region, in the unit of S1 and S2.
    """
    kind = QUANTITIES[name].error_of if statistic == "mean" and name in QUANTITIES else "itself"
    return {"itself": abs(value), "one": 1.0, "s0": abs(s0)}[kind]


def difference(name: str, value: float, reference: float) -> float:
    """Return value less reference of a quantity; on a circle, the shorter way.

    Parameters
    ----------
    name
        Of the quantity.
    value, reference
        In its own unit.
    """
    plain = value - reference
    turn = QUANTITIES[name].turn if name in QUANTITIES else None
    return plain if turn is None else (plain + turn / 2) % turn - turn / 2
