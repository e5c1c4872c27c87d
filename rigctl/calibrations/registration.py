"""Image registration (``registration.json``): the shift of a run's picture at each stage angle."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from calibration.polarimeter.pictures import Registration, Wander, fit_wander, register
from rigctl.base.numbers import wrapped
from rigctl.calibrations.kinds import Bounded, MadeFor, NotNegative, at_least
from rigctl.calibrations.record import CalibrationRecord, header_of, source_of_run
from rigctl.errors import DataError
from rigctl.runs.folder import Run
from rigctl.runs.records import FrameRecord

FloatArray = NDArray[np.float64]

SCHEMA_VERSION = 1
# Causes a false DoLP of 0.003 on a natural scene, and up to 0.05 at edges.
_WORTH_A_WORD_PIXELS = 0.1
_SIGMAS = 4.0
# Largest number of pictures in memory.
_MOST_PICTURES = 16


# Larger than any picture.
Pixels = Annotated[float, Field(ge=-1e5, le=1e5)]


@dataclass(frozen=True, kw_only=True)
class AngleShift:
    """Shift (x, y) of the picture at an angle relative to that at the first, in the order of the file."""

    angle_deg: Bounded
    shift_pixels: tuple[Pixels, Pixels]
    std_error_pixels: tuple[NotNegative, NotNegative] | None = None


def before_and_after(found: Registration, index: int) -> str:
    """Return the residual of the edges of a picture before and after the correction, as text."""
    before, after = found.edge_residual[index]
    return f"{before:.2%} before, {after:.2%} after"


def shifted(found: Registration) -> list[int]:
    """Return the indices of the pictures whose shift affects DoLP."""
    sizes = np.linalg.norm(found.shift_pixels, axis=1)
    errors = np.linalg.norm(found.std_error_pixels, axis=1)
    return np.flatnonzero(sizes - _SIGMAS * errors > _WORTH_A_WORD_PIXELS).tolist()


def _finding(angles_deg: FloatArray, found: Registration) -> str | None:
    """Return a sentence on the pictures whose shift affects DoLP; None without any."""
    off = shifted(found)
    if not off:
        return None
    sizes = np.linalg.norm(found.shift_pixels, axis=1)
    errors = np.linalg.norm(found.std_error_pixels, axis=1)
    pictures = ", ".join(
        f"at {angles_deg[index]:.1f} deg lies {sizes[index]:.2f} +- {errors[index]:.2f} pixel" for index in off
    )
    return (
        f"shifted_frames: the picture {pictures} from that at {angles_deg[0]:.1f} deg; DoLP is false at every "
        "edge: calibrate registration and give --register, or leave edges out of regions"
    )


def registration_doubt(file: Mapping[str, Any], found: Registration) -> str | None:
    """Return a sentence on pictures that differ by more than a shift; None without any."""
    sizes = np.linalg.norm(found.shift_pixels, axis=1)
    off = [k for k in range(len(sizes)) if sizes[k] > _WORTH_A_WORD_PIXELS and not found.is_plain(k)]
    if not off:
        return None
    pictures = "; ".join(
        f"at {file['angles'][index]['angle_deg']:.1f} deg {sizes[index]:.2f} pixel, ninths of the picture scatter by "
        f"{found.scatter_pixels[index]:.2f} pixel, left of the edges {before_and_after(found, index)}"
        for index in off
    )
    return (
        f"not a plain shift: {pictures}: parts of the picture do not agree on it, or edges lie no better on one "
        "another for it where it was not fitted, as after a turn, a change of scale, or where something moved"
    )


def register_run(
    run: Run, *, cycle: int | None = None, valid_days: float | None = None
) -> tuple[dict[str, Any], Registration]:
    """Return the content of the file that holds the walk of a run's picture, and the shifts with their edges."""
    scenes = [record for record in run.frames if record.kind == "scene"]
    wanted = cycle if cycle is not None else (scenes[0].cycle if scenes else None)
    records = [record for record in scenes if record.cycle == wanted]
    if len(records) > _MOST_PICTURES:
        # Repeats without a cycle number: the first at each angle.
        records = list({_near(angle_deg(run, record)): record for record in reversed(records)}.values())[::-1]
    angles = np.array([angle_deg(run, record) for record in records])
    if len(records) < 2:
        where = "" if wanted is None else f" in cycle {wanted}"
        raise DataError(f"{run.path}: has {len(records)} scene frames{where}; at least two angles are needed")
    pictures = np.array([run.counts(record).astype(np.float64) for record in records])
    usable = np.all([usable_pixels(record, counts) for record, counts in zip(records, pictures, strict=True)], axis=0)
    found = register(pictures, usable)
    circle = _wander(np.radians(angles), found.shift_pixels)
    source = source_of_run(run)
    header = header_of("registration", SCHEMA_VERSION, source=source, run=run, records=records, valid_days=valid_days)
    return header | {
        "angles": [
            {"angle_deg": angle, "shift_pixels": shift, "std_error_pixels": error}
            for angle, shift, error in zip(
                angles.tolist(), found.shift_pixels.tolist(), found.std_error_pixels.tolist(), strict=True
            )
        ],
        "wander": None
        if circle is None
        else {
            "turning_pixels": [circle.turning_pixels.real, circle.turning_pixels.imag],
            "sense": circle.sense,
            "radius_pixels": abs(circle.turning_pixels),
            "residual_pixels": circle.residual_pixels,
        },
        "finding": _finding(angles, found),
    }, found


def _near(angle: float) -> float:
    """Return the angle that identifies repeats [deg]."""
    return round(angle % 360.0, 1)


def usable_pixels(record: FrameRecord, counts: FloatArray) -> NDArray[np.bool_]:
    """Return the pixels of a frame that are neither saturated nor missing."""
    received = np.ones(counts.shape, dtype=np.bool_) if record.missing_dn is None else counts != record.missing_dn
    return np.asarray(received & (counts < record.saturation_dn))


def angle_deg(run: Run, record: FrameRecord) -> float:
    """Return the angle that a frame's shift depends on: of the stage, or without one of the polarizer [deg]."""
    angle = record.stage_angle_deg if record.stage_angle_deg is not None else record.polarizer_angle_deg
    if angle is None:
        raise DataError(f"{run.path}: frame {record.sequence} has no angle, which registration needs")
    return angle


def _wander(stage_rad: FloatArray, shifts: FloatArray) -> Wander | None:
    if len(stage_rad) < 3 or np.ptp(stage_rad) == 0.0:
        return None
    return min((fit_wander(stage_rad, shifts, sense=sense) for sense in (1, -1)), key=lambda one: one.residual_pixels)


# Largest distance of shifts from a circle that describes them.
_CIRCLE_PIXELS = 0.05
# Largest difference of a frame's angle from one of the table.
_NEAR_DEG = 1.0


@dataclass(frozen=True, kw_only=True)
class Circle:
    """The circle that the picture walks on, as `Wander` has it."""

    turning_pixels: tuple[Pixels, Pixels]
    sense: Literal[1, -1]
    residual_pixels: NotNegative


@dataclass(frozen=True, kw_only=True)
class ImageRegistration(CalibrationRecord):
    """A registration as its file holds it."""

    KIND = "registration"
    MADE_BY = "a registration is made by `rigctl calibrate registration RUN --out FILE`"

    schema_version: Annotated[int, Field(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
    kind: Literal["registration"]
    made_for: MadeFor
    angles: Annotated[tuple[AngleShift, ...], at_least(2)]  #: as measured
    wander: Circle | None  #: Through the shifts; None of two angles.

    def shift_pixels(self, angle_deg: float, *, against_deg: float) -> FloatArray:
        """Return the shift (x, y) of the picture at one angle relative to that at another."""
        circle = self.wander
        if circle is not None and circle.residual_pixels <= _CIRCLE_PIXELS:
            wander = Wander(
                centre_pixels=0j,
                turning_pixels=complex(*circle.turning_pixels),
                sense=circle.sense,
                residual_pixels=circle.residual_pixels,
            )
            return wander.shift_pixels(float(np.radians(angle_deg)), against_rad=float(np.radians(against_deg)))
        return self._looked_up(angle_deg) - self._looked_up(against_deg)

    def _looked_up(self, angle_deg: float) -> FloatArray:
        angles = np.array([row.angle_deg for row in self.angles])
        apart = np.abs(wrapped(angles - angle_deg, turn=360.0))
        nearest = int(np.argmin(apart))
        if apart[nearest] > _NEAR_DEG:
            raise DataError(
                f"the registration has no shift for {angle_deg:.2f} deg: it was measured at "
                f"{', '.join(f'{angle:.1f}' for angle in angles)} deg, and no circle fits its shifts: measure "
                "it at the angles of use"
            )
        return np.array(self.angles[nearest].shift_pixels)
