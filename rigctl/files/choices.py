"""Choices in options and files. Nothing heavy is imported here, so that help is fast."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated, Any, Literal, TypeAlias, get_args

from cyclopts import Parameter, Token, convert
from cyclopts.validators import Number


def _words(kind: type, tokens: Sequence[Token]) -> Any:
    texts = [word.strip() for token in tokens for word in token.value.split(",")]
    return convert(kind, [tokens[0].evolve(value=word) for word in texts])


#: Several words in one option, separated by commas.
COMMA_SEPARATED = Parameter(converter=_words, n_tokens=1, allow_leading_hyphen=True)

#: Largest picture that is read [MB of samples].
MaxFrameMb: TypeAlias = Annotated[int, Parameter(validator=Number(gte=1, lte=100_000))]
# Object before the camera.
FrameKind = Literal["scene", "dark", "flat"]
FRAME_KINDS: tuple[FrameKind, ...] = get_args(FrameKind)

# Interpolation of a picture behind polarizers on the pixels, as in `model.processing.mosaic.Interpolation`.
Interpolation = Literal["none", "bilinear"]

# Formats of export.
ExportFormat = Literal["csv", "fits", "tiff", "hdf5", "zarr"]

# Source of the scale of predicted counts: the scene file, a panel, or the run itself.
ScaleKind = Literal["absolute", "panel", "free"]

# Parts of the light of a material, as in `model.scene.field.Source`.
LightPart = Literal["total", "reflected", "reflected_sun", "reflected_sky", "path"]

# Rule for leaving out effects: by their bounds, or never.
EffectRule = Literal["safe", "all"]

# Vectors that the RX detector works on: Stokes parameters, or the counts behind each angle of the polarizer.
RocKind = Literal["stokes", "intensity"]
ROC_KINDS: tuple[RocKind, ...] = get_args(RocKind)

# DoLP SNR in tables and plots: of the exact law, or to first order as in [MK14].
SnrKind = Literal["exact", "first-order", "both"]

# DoLP SNR for the check of the paper's statements.
SnrForm = Literal["exact", "first-order"]

# Solver of the light of the air: the project's own, or an independent one as a check.
Engine = Literal["own", "sasktran2"]

# Changes of the demo's simulated rig between calibration and run.
Perturbation = Literal["gain", "angle-offset", "angle-sense", "extinction"]
PERTURBATIONS: tuple[Perturbation, ...] = get_args(Perturbation)

# Changes of a simulated roof relative to its scene file.
RoofChange = Literal["visibility", "aerosol", "dhr", "tilt", "drift"]
ROOF_CHANGES: tuple[RoofChange, ...] = get_args(RoofChange)

# Shadowing and diffuse term, as in `model.surface.pbrdf.Surface`.
Shadowing = Literal["none", "v-cavity", "smith", "smith-correlated"]
DiffuseKind = Literal["lambert", "balance", "coupled", "polarised", "volume"]


# Units of exposures, and seconds in each.
ExposureUnit = Literal["ns", "us", "ms", "s"]
EXPOSURE_UNITS: tuple[ExposureUnit, ...] = get_args(ExposureUnit)
SECONDS_PER_UNIT: dict[ExposureUnit, float] = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0}


# Families of ArUco markers, by cells per side and number of markers.
Dictionary = Literal[
    "4x4_50", "4x4_100", "4x4_250", "5x5_50", "5x5_100", "6x6_50", "6x6_250", "aruco_original"
]  # fmt: skip


class Asked(StrEnum):
    """How a session asks the operator: at its terminal, or by a hold that is ended from elsewhere."""

    TERMINAL = "terminal"
    HOLD = "hold"
