"""Effects that a simulated picture goes through beside lens and detector: one table of the rig file each."""

from typing import Annotated, Literal

from pydantic import Field

from rigctl.files.config import Section

NotNegativeNumber = Annotated[float, Field(ge=0)]
PositiveNumber = Annotated[float, Field(gt=0)]


class PointSpreadSection(Section):
    """A blur by a Gaussian."""

    effect: Literal["point-spread"]
    """A blur by a Gaussian. Example: `"point-spread"`."""
    sigma_px: PositiveNumber
    """Deviation of the Gaussian. Example: `0.8`."""


class VignettingSection(Section):
    """The fourth power of the cosine of the field angle, which follows from focal length and pixel pitch."""

    effect: Literal["vignetting"]
    """The fourth power of the cosine of the field angle. Example: `"vignetting"`."""


class FixedPatternSection(Section):
    """An offset of each column, beside the pixels' own prnu and dsnu_e in [simulation.camera]."""

    effect: Literal["fixed-pattern"]
    """An offset of each column. Example: `"fixed-pattern"`."""
    column_offset_e: PositiveNumber
    """Deviation of the columns' offsets. Example: `3.0`."""


class DriftSection(Section):
    """Light that changes from frame to frame: by a compounded rate, and by a flicker beside."""

    effect: Literal["drift"]
    """Light that changes from frame to frame. Example: `"drift"`."""
    rate_per_frame: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.0
    """Change from each frame to the next, compounded. Example: `0.001`."""
    flicker_std: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    """Deviation of each frame's light beside, relative. Example: `0.002`."""


class BeamWanderSection(Section):
    """A picture that goes round a circle as the polarizer turns."""

    effect: Literal["beam-wander"]
    """A picture that goes round a circle as the polarizer turns. Example: `"beam-wander"`."""
    radius_px: PositiveNumber
    """Radius of the circle. Example: `0.5`."""
    phase_deg: float = 0.0
    """Direction of the shift beyond that of the polarizer's axis, counter-clockwise. Example: `30.0`."""


class SmearSection(Section):
    """Light that falls on charge while a CCD without shutter moves it."""

    effect: Literal["smear"]
    """Light on charge while a CCD without shutter moves it. Example: `"smear"`."""
    row_transfer_us: PositiveNumber
    """Time in which a row is moved by one. Example: `1.5`."""


class CosmicHitsSection(Section):
    """Charge that particles leave in single pixels."""

    effect: Literal["cosmic-hits"]
    """Charge that particles leave in single pixels. Example: `"cosmic-hits"`."""
    rate_per_s: PositiveNumber
    """Hits a second on the whole sensor. Example: `0.5`."""
    mean_e: PositiveNumber
    """Mean charge of a hit. Example: `2000.0`."""


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
