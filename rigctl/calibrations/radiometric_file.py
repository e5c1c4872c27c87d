"""The file that a radiometric calibration is kept in: ``radiometric.json``."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from rigctl.calibrations.content_file import read_content
from rigctl.calibrations.fitness import require_fit
from rigctl.calibrations.made_for import MadeFor, read_made_for

SCHEMA_VERSION = 1
# For how long it is trusted where it does not say so itself: lenses and filters gather dust. A choice.
VALID_DAYS = 90.0


def read_radiometric_file(path: Path) -> dict[str, Any]:
    """Return the content of a radiometric calibration, once all that the program uses has been found right.

    Raises
    ------
    DataError
        The file cannot be read, is no radiometric calibration, or is of another version: every problem at once.
    """
    return read_content(path, _Content, made_by="a radiometric calibration is made by `rigctl calibrate radiometric`")


def require_radiometric_fits(content: Mapping[str, Any], used: MadeFor) -> tuple[str, ...]:
    """Return what is doubtful about using a radiometric calibration for frames, in words.

    Raises
    ------
    DataError
        It is of another camera, gain, bit depth or binning.
    """
    return require_fit("radiometric calibration", read_made_for(content, valid_days=VALID_DAYS), used)


class _Part(BaseModel):
    # Keys that are not known are for those who put them there.
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)


class _Response(_Part):
    value: Annotated[float, Field(gt=0)]
    std_error: Annotated[float, Field(ge=0)]
    n: Annotated[int, Field(ge=1)]


class _Content(_Part):
    schema_version: Annotated[int, Field(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
    kind: Literal["radiometric"]
    made_for: MadeFor
    exposure_s: Annotated[float, Field(gt=0)]
    f_number: Annotated[float, Field(gt=0)]
    response_dn_per_radiance: _Response
