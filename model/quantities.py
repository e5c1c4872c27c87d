"""Quantities of a region, common to prediction and measurement, and names of its counts."""

from dataclasses import dataclass

_COUNTS, _RATIO = "dn_", "ratio_"


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A quantity of a region."""

    name: str
    label: str
    turn: float | None = None
    is_share: bool = False
    is_followed: bool = False


QUANTITIES = {
    one.name: one
    for one in (
        Quantity(name="s0", label="S0", is_followed=True),
        Quantity(name="s1", label="S1"),
        Quantity(name="s2", label="S2"),
        Quantity(name="s1n", label="s1", is_share=True, is_followed=True),
        Quantity(name="s2n", label="s2", is_share=True, is_followed=True),
        Quantity(name="dolp", label="DoLP", is_share=True, is_followed=True),
        Quantity(name="aolp_deg", label="AoLP [deg]", turn=180.0, is_followed=True),
        Quantity(name="dolp_pixels", label="DoLP of pixels", is_share=True),
        Quantity(name="dolp_snr", label="DoLP SNR"),
    )
}
SHARES = frozenset(one.name for one in QUANTITIES.values() if one.is_share)
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
