"""Measures a stage with its own encoder (readback error, backlash, settling time), and stores the results."""

import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import from_json

from drivers.errors import NotConnectedError
from drivers.interfaces import DeviceIdentity, RotationStage
from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
from rigctl.base.numbers import utc_text, wrapped
from rigctl.console import Json
from rigctl.errors import DataError
from rigctl.files.toml import describe, other_schema
from rigctl.version import VERSION

Side = Literal["forward", "backward"]
SIDES: tuple[Side, ...] = ("forward", "backward")
_RUN_UP_DEG = 10.0  # far more than any backlash
_SETTLED_BEFORE = 0.5  # a stage whose readings still change in the second half of the watch has not come to rest
_BETWEEN_READINGS_S = 0.02


@dataclass(frozen=True, kw_only=True)
class Visit:
    """One move to one angle, with readings until the stage rests."""

    angle_deg: float  #: The target.
    side: Side  #: The move came from smaller or from larger angles.
    error_deg: float  #: Readback at rest minus the target, in [-180, 180).
    settle_s: float  #: From the end of the move to the last reading outside the band around the reading at rest.
    tries: int  #: Number of times the move was commanded.
    duration_s: float  #: Duration of the move.
    #: Time since the end of the move [s], and reading minus that at rest [deg].
    watched: tuple[tuple[float, float], ...]


@dataclass(frozen=True, kw_only=True)
class Characterisation:
    """Measured properties of a stage."""

    identity: DeviceIdentity  #: The stage.
    band_deg: float  #: Readings within this band count as rest [deg]; time for which each visit was watched [s].
    watch_s: float
    visits: tuple[Visit, ...]  #: In the order of time.

    @property
    def largest_error_deg(self) -> float:
        """The largest absolute difference between readback and target."""
        return max(abs(visit.error_deg) for visit in self.visits)

    @property
    def repeatability_deg(self) -> float:
        """Pooled standard deviation of the errors of visits to one angle from one side."""
        groups = [self.errors_deg(angle, side) for angle in self.angles_deg for side in SIDES]
        freedom = sum(len(group) - 1 for group in groups)
        return float(np.sqrt(sum(group.var() * len(group) for group in groups) / freedom))

    @property
    def backlash_deg(self) -> float:
        """Mean over the angles of readback after moves from larger angles minus that from smaller ones."""
        return float(np.mean([self.backlash_at_deg(angle) for angle in self.angles_deg]))

    @property
    def backlash_std_error_deg(self) -> float:
        """Standard error of the backlash, from the repeatability and the number of visits."""
        per_side = len(self.visits) / len(SIDES)
        return self.repeatability_deg * float(np.sqrt(2.0 / per_side))

    @property
    def settle_s(self) -> float:
        """The longest settling time of a visit."""
        return max(visit.settle_s for visit in self.visits)

    @property
    def is_settled(self) -> bool:
        """True if every visit came to rest in the first half of its watch."""
        return self.settle_s <= _SETTLED_BEFORE * self.watch_s

    @property
    def angles_deg(self) -> tuple[float, ...]:
        """The angles in the order of their first visits."""
        return tuple(dict.fromkeys(visit.angle_deg for visit in self.visits))

    def errors_deg(self, angle_deg: float, side: Side) -> NDArray[np.float64]:
        """Return the errors of visits to one angle from one side."""
        chosen = [v.error_deg for v in self.visits if v.angle_deg == angle_deg and v.side == side]
        return np.array(chosen)

    def backlash_at_deg(self, angle_deg: float) -> float:
        """Return the backlash at one angle."""
        backward, forward = (self.errors_deg(angle_deg, side).mean() for side in ("backward", "forward"))
        return float(backward - forward)


def characterise(
    stage: RotationStage,
    angles_deg: Iterable[float],
    *,
    repeats: int,
    band_deg: float,
    watch_s: float,
    progress: Callable[[Visit], None],
    now_s: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Characterisation:
    """Measure a stage by its own readings: home it, then visit each angle from both sides.

    Play between the encoder and the polarizer does not show in readings; a camera sees it.
    """
    if repeats < 2:
        raise ValueError(f"repeats = {repeats}: must be 2 or more")
    stage.home()
    visits = []
    for angle_deg in list(angles_deg) * repeats:
        for side in SIDES:
            visit = _visit(stage, angle_deg, side, band_deg=band_deg, watch_s=watch_s, now_s=now_s, sleep=sleep)
            visits.append(visit)
            progress(visit)
    return Characterisation(identity=stage.identify(), band_deg=band_deg, watch_s=watch_s, visits=tuple(visits))


def characterisation_file(result: Characterisation) -> dict[str, Json]:
    """Return the content of the file of a characterisation."""
    return {
        "schema_version": 1,
        "kind": "stage characterisation",
        "created_by": f"rigctl {VERSION}",
        "created_utc": utc_text(time.time_ns()),
        "stage": asdict(result.identity),
        "settle_s": result.settle_s,
        "is_settled": result.is_settled,
        "largest_error_deg": result.largest_error_deg,
        "repeatability_deg": result.repeatability_deg,
        "backlash_deg": {"value": result.backlash_deg, "std_error": result.backlash_std_error_deg},
        "band_deg": result.band_deg,
        "watch_s": result.watch_s,
        "visits": [asdict(visit) for visit in result.visits],
    }


def load_settle_s(path: Path, *, identity: DeviceIdentity) -> float:
    """Return the measured settling time of a stage [s]."""
    found: object = None
    try:
        found = from_json(read_bounded(path, MOST_TEXT_BYTES))
        content = _Content.model_validate(found)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        later = other_schema(found, _Content)
        if later is not None:
            raise DataError(f"{path}: {later}") from error
        problem = describe(path, error) if isinstance(error, ValidationError) else f"{path}: is no JSON: {error}"
        raise DataError(f"{problem}\n  this file is made by `rigctl calibrate stage`") from error
    if content.stage.serial_number != identity.serial_number:
        raise NotConnectedError(
            f"{path}: that stage was {content.stage.model} {content.stage.serial_number}, and this one is "
            f"{identity.model} {identity.serial_number}: characterise it too"
        )
    if not content.is_settled:
        raise DataError(f"{path}: the stage was not seen to rest: characterise it again with a longer --watch")
    return content.settle_s


def _visit(
    stage: RotationStage,
    angle_deg: float,
    side: Side,
    *,
    band_deg: float,
    watch_s: float,
    now_s: Callable[[], float],
    sleep: Callable[[float], None],
) -> Visit:
    stage.move_to(angle_deg - _RUN_UP_DEG if side == "forward" else angle_deg + _RUN_UP_DEG)
    move = stage.move_to(angle_deg, way=side)
    readings = _watch(stage, watch_s=watch_s, now_s=now_s, sleep=sleep)
    rest_deg = readings[-1][1]
    watched = tuple((time_s, wrapped(reading_deg - rest_deg, turn=360.0)) for time_s, reading_deg in readings)
    return Visit(
        angle_deg=angle_deg,
        side=side,
        error_deg=wrapped(rest_deg - angle_deg, turn=360.0),
        settle_s=max((time_s for time_s, off_deg in watched if abs(off_deg) > band_deg), default=0.0),
        tries=move.tries,
        duration_s=move.duration_s,
        watched=watched,
    )


def _watch(
    stage: RotationStage, *, watch_s: float, now_s: Callable[[], float], sleep: Callable[[float], None]
) -> list[tuple[float, float]]:
    """Return readings [deg] and their times since the first [s]."""
    start_s = now_s()
    readings: list[tuple[float, float]] = []
    while not readings or readings[-1][0] < watch_s:
        angle_deg = stage.position().angle_deg
        readings.append((now_s() - start_s, angle_deg))
        sleep(_BETWEEN_READINGS_S)
    return readings


class _Content(BaseModel):
    # People may add keys as notes.
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    schema_version: Literal[1]
    kind: Literal["stage characterisation"]
    stage: DeviceIdentity
    settle_s: Annotated[float, Field(ge=0, le=60)]
    is_settled: bool
