"""Words that options and files choose from. Nothing heavy is imported here, so that help is at hand at once."""

from enum import StrEnum
from typing import Literal, get_args

# What the camera looked at.
FrameKind = Literal["scene", "dark", "flat"]
FRAME_KINDS: tuple[FrameKind, ...] = get_args(FrameKind)

# What is made of a picture behind polarizers on the pixels, as `model.processing.mosaic.Interpolation` has it.
Interpolation = Literal["none", "bilinear"]

# What a run can be exported as.
ExportFormat = Literal["csv", "fits", "tiff", "hdf5", "zarr"]

# What the counts of a prediction are scaled by: the scene file, a panel, or the run itself.
ScaleKind = Literal["absolute", "panel", "free"]

# Parts of the light of a material, as `model.scene.field.Source` has them.
LightPart = Literal["total", "reflected", "reflected_sun", "reflected_sky", "path"]

# What decides whether an effect is left out: its bound, or nothing.
EffectRule = Literal["safe", "all"]

# Vectors that the RX detector works on: Stokes parameters, or the counts behind each angle of the polarizer.
RocKind = Literal["stokes", "intensity"]
ROC_KINDS: tuple[RocKind, ...] = get_args(RocKind)

# DoLP SNR that tables and plots show: of the exact law, or to first order as [MK14] has it.
SnrKind = Literal["exact", "first-order", "both"]

# DoLP SNR in which the paper's statements are checked.
SnrForm = Literal["exact", "first-order"]

# What solves the light of the air: the project's own solver, or an independent one beside it as a check.
Engine = Literal["own", "sasktran2"]

# What the demo changes in its simulated rig between calibration and run.
Perturbation = Literal["gain", "angle-offset", "angle-sense", "extinction"]
PERTURBATIONS: tuple[Perturbation, ...] = get_args(Perturbation)

# What changes in a simulated roof against the scene file that lights it.
RoofChange = Literal["visibility", "aerosol", "dhr", "tilt", "drift"]
ROOF_CHANGES: tuple[RoofChange, ...] = get_args(RoofChange)

# How facets hide one another, and the form of the diffuse term, as `model.surface.pbrdf.Surface` has them.
Shadowing = Literal["none", "v-cavity", "smith", "smith-correlated"]
DiffuseKind = Literal["lambert", "balance", "coupled", "polarised", "volume"]


# Units of exposures, and seconds in each.
ExposureUnit = Literal["ns", "us", "ms", "s"]
EXPOSURE_UNITS: tuple[ExposureUnit, ...] = get_args(ExposureUnit)
SECONDS_PER_UNIT: dict[ExposureUnit, float] = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0}


# Families of ArUco markers, by cells a side and how many markers they have.
Dictionary = Literal[
    "4x4_50", "4x4_100", "4x4_250", "5x5_50", "5x5_100", "6x6_50", "6x6_250", "aruco_original"
]  # fmt: skip


class Asked(StrEnum):
    """How a session asks for hands: at its terminal, or by a hold that somebody ends from elsewhere."""

    TERMINAL = "terminal"
    HOLD = "hold"
