"""Angles in degrees, wrapped."""


def difference_deg(one_deg: float, other_deg: float) -> float:
    """Return how far one direction is from another, the short way round, in [-180, 180) deg."""
    return (one_deg - other_deg + 180.0) % 360.0 - 180.0
