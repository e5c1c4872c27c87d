"""The session file: which frames to take, in which order."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from rigctl.config import Section, load

# 0 and 90 next to each other, 45 and 135 next to each other: a linear drift of the light then makes half the
# false polarization that 0, 45, 90, 135 makes.
DEFAULT_ANGLES_DEG = (0.0, 90.0, 45.0, 135.0)

ExposureMs = Annotated[float, Field(gt=0, le=3_600_000)]


class Take(Section):
    """One group of frames. `cycles` goes through all angles, then through all angles again."""

    kind: Literal["scene", "dark", "flat"]
    exposure_ms: ExposureMs | Annotated[list[ExposureMs], Field(min_length=1)]
    angles_deg: Annotated[list[float], Field(min_length=1)] | None = None
    cycles: Annotated[int, Field(ge=1, le=100_000)] = 1

    @property
    def exposures_s(self) -> tuple[float, ...]:
        """The exposures of this take, in seconds."""
        given = self.exposure_ms if isinstance(self.exposure_ms, list) else [self.exposure_ms]
        return tuple(exposure / 1000 for exposure in given)

    @property
    def polarizer_angles_deg(self) -> tuple[float | None, ...]:
        """The polarizer angles of one cycle; None leaves the polarizer where it is."""
        if self.angles_deg is not None:
            return tuple(self.angles_deg)
        return DEFAULT_ANGLES_DEG if self.kind == "scene" else (None,)

    @model_validator(mode="after")
    def _one_angle_for_flats(self) -> "Take":
        if self.kind == "flat" and self.angles_deg is not None and len(self.angles_deg) > 1:
            raise ValueError("flats for a noise calibration are taken at one angle: give one, or leave angles_deg out")
        return self


class SessionFile(Section):
    """What a session file holds."""

    schema_version: Literal[1] = 1
    name: str
    take: Annotated[list[Take], Field(min_length=1)]


def load_session(path: Path) -> SessionFile:
    """Return the checked session file."""
    return load(path, SessionFile)
