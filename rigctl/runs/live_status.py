"""The file ``status.json`` of a run folder: how the session stands now, for whoever looks from another terminal."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, with_config

from rigctl.errors import RunFolderError
from rigctl.numbers.number_range import LARGEST
from rigctl.runs.run_description import explain_invalid
from rigctl.storage.bounded_file import MOST_TEXT_BYTES, read_bounded

STATUS_FILE = "status.json"


@dataclass(frozen=True, kw_only=True)
class _Estimate:
    value: float
    sigma: float | None


@dataclass(frozen=True, kw_only=True)
class _Angle:
    mean_dn: float
    saturated_fraction: float
    regions_dn: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class _Region:
    dolp: _Estimate
    aolp_deg: float | None


@dataclass(frozen=True, kw_only=True)
class _Dark:
    source: str


@dataclass(frozen=True, kw_only=True)
class _Drift:
    region: str
    per_min: float
    sigma_per_min: float | None
    over_s: float


@with_config(ConfigDict(allow_inf_nan=False))
@dataclass(frozen=True, kw_only=True)
class _Status:
    """What is shown of a status, as far as it is there: the rest is for those who wrote it."""

    frames_planned: int | None = None
    remaining_s: Annotated[float, Field(ge=-LARGEST, le=LARGEST)] = 0.0
    end_utc: str = ""
    angles: dict[str, _Angle] = field(default_factory=dict)
    sum_rule: _Estimate | None = None
    regions: dict[str, _Region] = field(default_factory=dict)
    dark: _Dark | None = None
    drift: _Drift | None = None


_SHAPE = TypeAdapter(_Status)


def write_status(run: Path, status: dict[str, Any]) -> None:
    """Replace the status, in one step and without waiting for the disk: it is of no worth after a power cut.

    Raises
    ------
    OSError
        It cannot be written.
    """
    beside = run / f".{STATUS_FILE}"
    beside.write_text(json.dumps(status, allow_nan=False) + "\n", encoding="ascii")
    beside.replace(run / STATUS_FILE)


def read_status(run: Path) -> dict[str, Any] | None:
    """Return the status, or None where the session never wrote one.

    Raises
    ------
    RunFolderError
        It cannot be read.
    """
    file = run / STATUS_FILE
    if not file.exists():
        return None
    try:
        content = read_bounded(file, MOST_TEXT_BYTES)
        _SHAPE.validate_json(content)
    except OSError as error:
        raise RunFolderError(f"{file}: cannot be read: {error.strerror}") from error
    except ValidationError as error:
        raise RunFolderError(f"{file}: is no status: {explain_invalid(error)}") from error
    status: dict[str, Any] = json.loads(content)
    return status
