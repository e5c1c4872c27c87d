"""Lens calibrations (``lens.json``): focal lengths, principal point, distortion."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from calibration.pointing.pose import NAMES, Lens, LensCalibration
from rigctl.base.durable import source_of
from rigctl.base.numbers import utc_text
from rigctl.calibrations.kinds import Bounded, Measured, Positive, UtcText
from rigctl.calibrations.record import read_record
from rigctl.console import Json
from rigctl.version import VERSION

SCHEMA_VERSION = 1
Number = Measured[Bounded]


@dataclass(frozen=True, kw_only=True)
class LensFile:
    """Content of a lens calibration: focal lengths and principal point [pixel], distortion."""

    schema_version: Annotated[int, Field(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
    kind: Literal["lens"]
    width: Annotated[int, Field(ge=1)]
    height: Annotated[int, Field(ge=1)]
    rms_px: Positive
    fx_px: Number
    fy_px: Number
    cx_px: Number
    cy_px: Number
    k1: Number
    k2: Number
    p1: Number
    p2: Number
    created_utc: UtcText | None = None

    def lens(self) -> Lens:
        """Return the lens."""
        numbers = [getattr(self, name) for name in NAMES]
        return Lens(
            parameters=np.array([one.value for one in numbers]),
            covariance=np.diag([one.std_error**2 for one in numbers]),
        )


def lens_content(found: LensCalibration, pictures: Sequence[Path]) -> dict[str, Json]:
    """Return the content of the file of a lens."""
    stds = np.sqrt(np.diag(found.lens.covariance)).tolist()
    numbers = zip(NAMES, found.lens.parameters.tolist(), stds, strict=True)
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": "lens",
        "created_by": f"rigctl {VERSION}",
        "created_utc": utc_text(time.time_ns()),
        "source": [source_of(pictures[place]) for place in found.used],
        "without_board": [str(pictures[place]) for place in found.unused],
        "width": found.width,
        "height": found.height,
        "rms_px": found.rms_px,
        **{name: {"value": value, "std_error": std} for name, value, std in numbers},
    }


def read_lens_file(path: Path) -> LensFile:
    """Return a lens calibration."""
    return read_record(path, LensFile, made_by="a lens calibration is made by `rigctl calibrate lens`")
