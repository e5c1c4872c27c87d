"""History of a store of calibrations: how gain, read noise, dark current and axis of each device have moved."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from calibration.estimate import control_chart
from rigctl.calibrations.made_for import MadeFor
from rigctl.calibrations.store import CalibrationStore, StoredCalibration
from rigctl.console.json_text import Json
from rigctl.numbers.angles import wrapped
from rigctl.numbers.utc_time import utc_moment

# An axis is the same after half a turn.
_TURN_DEG = {"offset_deg": 180.0}
_SECONDS_A_YEAR = 365.25 * 86400.0


@dataclass(frozen=True, kw_only=True)
class HistoryPoint:
    """A number of one calibration.

    Attributes
    ----------
    utc : str
        When its frames were taken.
    value, std_error : float
        In the unit that the number's name ends in; an axis is followed over half turns.
    limits : (lower, upper)
        Control limits: where it would lie 997 times in 1000 if nothing moved, by its own stated error and that of the
        mean of all of this device.
    is_inside : bool
        It lies within them.
    file : Path
        The calibration.
    """

    utc: str
    value: float
    std_error: float
    limits: tuple[float, float]
    is_inside: bool
    file: Path


@dataclass(frozen=True, kw_only=True)
class History:
    """A number of one device through time.

    Attributes
    ----------
    quantity, device : str
        Its name, and of which camera or stage.
    points : tuple of HistoryPoint
        The oldest first.
    drift_per_year, drift_error : float or None
        Slope of a straight line through them and its standard error, widened by their scatter; None of fewer than
        three.
    """

    quantity: str
    device: str
    points: tuple[HistoryPoint, ...]
    drift_per_year: float | None
    drift_error: float | None

    @property
    def line(self) -> str:
        """It in a line that a person reads."""
        first, last = self.points[0], self.points[-1]
        if len(self.points) == 1:
            return f"{self.quantity} of {self.device}: {first.value:.6g} +- {first.std_error:.2g}, calibrated once"
        text = f"{self.quantity} of {self.device}: {first.value:.6g} to {last.value:.6g} in {len(self.points)}"
        if self.drift_per_year is not None:
            text += f", {self.drift_per_year:+.3g} +- {self.drift_error:.2g} a year"
        outside = sum(not point.is_inside for point in self.points)
        return text + (f"; {outside} outside the control limits: IT MOVES" if outside else "; within control limits")

    def as_json(self) -> dict[str, Json]:
        """Return it as JSON holds it."""
        return {
            "quantity": self.quantity,
            "device": self.device,
            "drift_per_year": self.drift_per_year,
            "drift_error": self.drift_error,
            "is_inside": all(point.is_inside for point in self.points),
            "points": [asdict(point) | {"file": str(point.file)} for point in self.points],
        }


def histories_of(store: CalibrationStore) -> Iterator[History]:
    """Give how the numbers of each device have moved: gain, read noise, dark current of a camera, axis of a stage."""
    series: dict[tuple[str, str], list[StoredCalibration]] = {}
    for one in store.calibrations:
        if one.made_for.taken_utc is not None:
            for quantity in one.numbers:
                series.setdefault((quantity, _device(quantity, one.made_for)), []).append(one)
    for (quantity, device), calibrations in sorted(series.items(), key=lambda item: item[0][0]):
        yield _history(quantity, device, calibrations)


def _device(quantity: str, made: MadeFor) -> str:
    camera = f"camera {made.camera_serial}" if made.camera_serial else "a camera"
    if quantity in _TURN_DEG:
        return f"stage {made.stage_serial}, {camera}" if made.stage_serial else f"a stage, {camera}"
    return f"{camera} at {made.gain_db:g} dB" if made.gain_db is not None else camera


def _history(quantity: str, device: str, calibrations: Sequence[StoredCalibration]) -> History:
    values = np.array([one.numbers[quantity].value for one in calibrations])
    turn_deg = _TURN_DEG.get(quantity)
    if turn_deg is not None:
        values = values[0] + np.cumsum(np.append(0.0, wrapped(np.diff(values), turn=turn_deg)))
    errors = np.array([one.numbers[quantity].std_error for one in calibrations])
    seconds = np.array([utc_moment(one.made_for.taken_utc or "").timestamp() for one in calibrations])
    chart = control_chart(seconds / _SECONDS_A_YEAR, values, errors)
    points = tuple(
        HistoryPoint(
            utc=one.made_for.taken_utc or "",
            value=float(values[place]),
            std_error=float(errors[place]),
            limits=(float(chart.lower[place]), float(chart.upper[place])),
            is_inside=bool(chart.is_inside[place]),
            file=one.file,
        )
        for place, one in enumerate(calibrations)
    )
    drift, error = chart.drift_per_year, chart.drift_error
    return History(quantity=quantity, device=device, points=points, drift_per_year=drift, drift_error=error)
