"""Effects that a simulated picture goes through beside lens and detector: one table of the rig file each."""

from typing import Annotated, Literal

from pydantic import Field

from rigctl.files.config import Section

NotNegativeNumber = Annotated[float, Field(ge=0)]
PositiveNumber = Annotated[float, Field(gt=0)]


class PointSpreadSection(Section):
    """A blur by a Gaussian."""

    effect: Literal["point-spread"]
    sigma_px: PositiveNumber


class VignettingSection(Section):
    """The fourth power of the cosine of the field angle, which follows from focal length and pixel pitch."""

    effect: Literal["vignetting"]


class FixedPatternSection(Section):
    """An offset of each column, beside the pixels' own prnu and dsnu_e in [simulation.camera]."""

    effect: Literal["fixed-pattern"]
    column_offset_e: PositiveNumber


class DriftSection(Section):
    """Light that changes from frame to frame: by a compounded rate, and by a flicker beside."""

    effect: Literal["drift"]
    rate_per_frame: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.0
    flicker_std: Annotated[float, Field(ge=0, le=0.5)] = 0.0


class BeamWanderSection(Section):
    """A picture that goes round a circle as the polarizer turns."""

    effect: Literal["beam-wander"]
    radius_px: PositiveNumber
    phase_deg: float = 0.0


class SmearSection(Section):
    """Light that falls on charge while a CCD without shutter moves it."""

    effect: Literal["smear"]
    row_transfer_us: PositiveNumber


class CosmicHitsSection(Section):
    """Charge that particles leave in single pixels."""

    effect: Literal["cosmic-hits"]
    rate_per_s: PositiveNumber
    mean_e: PositiveNumber


RenderingSection = Annotated[
    PointSpreadSection
    | VignettingSection
    | FixedPatternSection
    | DriftSection
    | BeamWanderSection
    | SmearSection
    | CosmicHitsSection,
    Field(discriminator="effect"),
]
