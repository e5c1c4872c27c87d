"""The sun over a session: where it stands at any moment, at the price of one exact position a minute."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache

from rigctl.files.place import SiteSection
from rigctl.numbers.utc_time import NS_PER_S
from rigctl.scene.skies.sun_position import sun_position

Vector = tuple[float, float, float]
# Between two exact positions the direction is interpolated along the chord: over a minute the sun moves by at most
# 0.0044 rad, the chord leaves the arc by 0.0044^2 / 8 = 2.4e-6 rad at most (0.14 millidegrees).
_NODE_NS = 60 * NS_PER_S
_NODES_KEPT = 4096
# The crossing of an elevation is sought within such steps: the sun does not turn back twice within one [s].
_SCAN_S = 600
_CROSSING_TOLERANCE_NS = NS_PER_S // 10


@dataclass(frozen=True, kw_only=True)
class SunAngles:
    """Direction of the sun: azimuth clockwise from north in [0, 360), elevation without refraction [deg]."""

    azimuth_deg: float
    elevation_deg: float

    @property
    def zenith_deg(self) -> float:
        """Angle from the vertical [deg]."""
        return 90.0 - self.elevation_deg


class SunTrack:
    """The sun above one site.

    Parameters
    ----------
    site : SiteSection
        Where.
    """

    def __init__(self, site: SiteSection) -> None:
        self.site = site
        self._node: Callable[[int], Vector] = lru_cache(maxsize=_NODES_KEPT)(self._exact)

    def at(self, utc_ns: int) -> SunAngles:
        """Return where the sun stands at a time since 1970 (UTC) [ns]."""
        number, rest_ns = divmod(utc_ns, _NODE_NS)
        before, after = self._node(number), self._node(number + 1)
        share = rest_ns / _NODE_NS
        east, north, up = (a + share * (b - a) for a, b in zip(before, after, strict=True))
        return SunAngles(
            azimuth_deg=math.degrees(math.atan2(east, north)) % 360.0,
            elevation_deg=math.degrees(math.atan2(up, math.hypot(east, north))),
        )

    def crossings_ns(self, zenith_deg: float, *, start_ns: int, end_ns: int) -> Iterator[int]:
        """Give each time between two others at which the sun's zenith angle passes a value, either way."""
        left = start_ns
        while left < end_ns:
            right = min(left + _SCAN_S * NS_PER_S, end_ns)
            if self._is_below(zenith_deg, left) != self._is_below(zenith_deg, right):
                yield self._bisect(zenith_deg, left, right)
            left = right

    def _bisect(self, zenith_deg: float, left: int, right: int) -> int:
        state = self._is_below(zenith_deg, left)
        while right - left > _CROSSING_TOLERANCE_NS:
            middle = (left + right) // 2
            left, right = (middle, right) if self._is_below(zenith_deg, middle) == state else (left, middle)
        return right

    def _is_below(self, zenith_deg: float, utc_ns: int) -> bool:
        return self.at(utc_ns).zenith_deg < zenith_deg

    def _exact(self, number: int) -> Vector:
        time = datetime.fromtimestamp(number * _NODE_NS // NS_PER_S, tz=UTC)
        found = sun_position(time, self.site.place)
        level = math.sin(found.zenith_rad)
        return (
            level * math.sin(found.azimuth_rad),
            level * math.cos(found.azimuth_rad),
            math.cos(found.zenith_rad),
        )
