"""The file that `rigctl calibrate stage` writes, and of which a session uses the time to settle."""

import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drivers.errors import NotConnectedError
from drivers.interfaces import DeviceIdentity
from rigctl.calibrations.checked_values import Measured
from rigctl.devices.characterise import Characterisation, Visit
from rigctl.errors import DataError
from rigctl.files.config import describe, newer_schema
from rigctl.numbers.utc_time import utc_text
from rigctl.storage.bounded_file import MOST_TEXT_BYTES, read_bounded
from rigctl.version import VERSION

_KIND = "stage characterisation"


@dataclass(frozen=True, kw_only=True)
class CharacterisationFile:
    """All that was measured of a stage, in the order in which the file has it."""

    schema_version: int = 1
    kind: str = _KIND
    created_by: str = f"rigctl {VERSION}"
    created_utc: str
    stage: DeviceIdentity
    settle_s: float
    is_settled: bool
    largest_error_deg: float
    repeatability_deg: float
    backlash_deg: Measured[float]
    band_deg: float
    watch_s: float
    visits: tuple[Visit, ...]


def characterisation_file(result: Characterisation) -> CharacterisationFile:
    """Return the file of a measurement."""
    return CharacterisationFile(
        created_utc=utc_text(time.time_ns()),
        stage=result.identity,
        settle_s=result.settle_s,
        is_settled=result.is_settled,
        largest_error_deg=result.largest_error_deg,
        repeatability_deg=result.repeatability_deg,
        backlash_deg=Measured(value=result.backlash_deg, std_error=result.backlash_std_error_deg),
        band_deg=result.band_deg,
        watch_s=result.watch_s,
        visits=tuple(result.visits),
    )


def as_text(file: CharacterisationFile) -> bytes:
    """Return the file's bytes."""
    return (json.dumps(asdict(file), indent=1, allow_nan=False) + "\n").encode()


class _Stage(BaseModel):
    model_config = ConfigDict(extra="ignore")

    model: str
    serial_number: str


class _Content(BaseModel):
    # Keys that are not known are for those who put them there.
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    schema_version: Literal[1]
    kind: Literal["stage characterisation"]
    stage: _Stage
    settle_s: Annotated[float, Field(ge=0, le=60)]
    is_settled: bool


def load_settle_s(path: Path, *, identity: DeviceIdentity) -> float:
    """Return the time that a stage needs to come to rest [s], as it was measured.

    Parameters
    ----------
    path : Path
        What `rigctl calibrate stage` wrote.
    identity : DeviceIdentity
        The stage that is to be used: it must be the one that was measured.

    Raises
    ------
    DataError
        The file cannot be read, is no characterisation, or its stage was never seen to rest.
    NotConnectedError
        Another stage was measured.
    """
    found: object = None
    try:
        found = json.loads(read_bounded(path, MOST_TEXT_BYTES))
        content = _Content.model_validate(found)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        later = newer_schema(found, _Content)
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
