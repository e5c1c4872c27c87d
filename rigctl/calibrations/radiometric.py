"""Radiometric calibrations: counts of a frame per unit of radiance (``radiometric.json``)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from rigctl.calibrations.kinds import MadeFor, MeasuredOverFrames, Positive
from rigctl.calibrations.record import CalibrationRecord

SCHEMA_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class Panel:
    """The panel of a calibration."""

    name: str = "a panel"


@dataclass(frozen=True, kw_only=True)
class RadiometricResponse(CalibrationRecord):
    """Content of a radiometric calibration."""

    KIND = "radiometric"
    MADE_BY = "a radiometric calibration is made by `rigctl calibrate radiometric`"

    schema_version: Annotated[int, Field(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
    kind: Literal["radiometric"]
    made_for: MadeFor
    exposure_s: Positive  #: of its frames [s]
    f_number: Positive  #: of its lens
    #: counts of a frame per unit of unpolarized radiance in band [DN per W m-2 sr-1]
    response_dn_per_radiance: MeasuredOverFrames[Positive]
    panel: Panel = Panel()  #: the panel it was made on
