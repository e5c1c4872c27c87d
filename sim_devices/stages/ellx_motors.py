"""Motors of a simulated Elliptec stage: periods, currents, and what keeps them well; see `ellx_language`."""

_TICKS_HZ = 14_740_000  # a period counts these
_CURRENT_PER_A = 1866
_TUNED = 0x8000  # in front of a period that the host gives
_FACTORY = 0xFFFF  # asks for the period that the motor left the factory with
_LOWEST_HZ, _HIGHEST_HZ = 70_000, 120_000
_CURVE_FROM, _CURVE_POINTS = 123, 87
_IDLE_A, _RESONANT_A, _RESONANCE_WIDTH = 0.05, 0.55, 6.0
_RAMP = "FFFF"  # unused, as every motor in public says

_BORN = {"1": {"f": 189, "b": 139}, "2": {"f": 188, "b": 140}}  # 78.0 and 106.0 kHz; 78.4 and 105.3


class EllxMotors:
    """The two resonant motors of a rotary stage, each with a period for either way round."""

    def __init__(self) -> None:
        self._periods = {motor: dict(ways) for motor, ways in _BORN.items()}

    def information(self, motor: str) -> str:
        """Return what `i1` and `i2` are answered: loop, motor, current, ramps, periods forward and backward."""
        ways = self._periods[motor]
        return f"I{motor}10{round(_IDLE_A * _CURRENT_PER_A):04X}{_RAMP}{_RAMP}{ways['f']:04X}{ways['b']:04X}"

    def set_period(self, letters: str, period: int) -> bool:
        """Obey `f1`, `b1`, `f2`, `b2`; return whether the motor can follow."""
        way, motor = letters[0], letters[1]
        asked = _BORN[motor][way] if period == _FACTORY else period & ~_TUNED
        if not asked or not _LOWEST_HZ <= _TICKS_HZ / asked <= _HIGHEST_HZ:
            return False
        self._periods[motor][way] = asked
        return True

    def search(self, motor: str) -> None:
        """Find the resonances again: those that the motor was born with."""
        self._periods[motor] = dict(_BORN[motor])

    def curve(self, motor: str) -> str:
        """Return what `c1` and `c2` are answered: current against period, little-endian unlike all else."""
        points = (self._point(motor, _CURVE_FROM + index) for index in range(_CURVE_POINTS))
        return f"C{motor}{''.join(points)}"

    def _point(self, motor: str, period: int) -> str:
        off = min(abs(period - resonance) for resonance in _BORN[motor].values()) / _RESONANCE_WIDTH
        current = round((_IDLE_A + _RESONANT_A / (1.0 + off * off)) * _CURRENT_PER_A)
        return (period.to_bytes(2, "little") + current.to_bytes(4, "little")).hex().upper()
