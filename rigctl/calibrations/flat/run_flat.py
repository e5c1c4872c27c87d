"""Flat fields of a run, one for each polarizer angle."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.pictures import FlatField, flat_field
from calibration.results import CalibrationError
from rigctl.calibrations.checked_values import Measured
from rigctl.errors import DataError
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import Run

FloatArray = NDArray[np.float64]

# Share of saturated pixels in a frame beyond which it is no flat.
_MOST_SATURATED = 1e-3


@dataclass(frozen=True, kw_only=True)
class FlatAngle:
    """Numbers of the flat field at one polarizer angle, in the order in which its file has them.

    Attributes
    ----------
    polarizer_angle_deg : float
        0 to 180 [deg].
    frames : int
        Of the angle.
    mean_dn : float
        Mean count, dark level off [DN].
    throughput : Measured
        Light of the angle over the mean of all angles.
    pattern_rms, noise_rms : float
        Relative deviation over the pixels, of the response and of its error.
    """

    polarizer_angle_deg: float
    frames: int
    mean_dn: float
    throughput: Measured[float]
    pattern_rms: float
    noise_rms: float


@dataclass(frozen=True, kw_only=True, eq=False)
class RunFlat:
    """Flat fields by polarizer angle.

    Attributes
    ----------
    angles_deg : (N,) array
        Polarizer angles, 0 to 180 [deg].
    flats : tuple of FlatField
        One each.
    exposure_s : float
        Of the frames [s].
    records : tuple of FrameRecord
        The frames.
    """

    angles_deg: FloatArray
    flats: tuple[FlatField, ...]
    exposure_s: float
    records: tuple[FrameRecord, ...]

    def rows(self) -> tuple[FlatAngle, ...]:
        """Return the numbers of each angle."""
        values, errors = self.throughput()
        return tuple(
            FlatAngle(
                polarizer_angle_deg=angle,
                frames=flat.frames,
                mean_dn=flat.mean_dn,
                throughput=Measured(value=value, std_error=error),
                pattern_rms=flat.pattern_rms,
                noise_rms=flat.noise_rms,
            )
            for angle, flat, value, error in zip(
                self.angles_deg.tolist(), self.flats, values.tolist(), errors.tolist(), strict=True
            )
        )

    def throughput(self) -> tuple[FloatArray, FloatArray]:
        """Return the light of each angle over the mean of all, and its error: of unpolarized, steady light."""
        means = np.array([flat.mean_dn for flat in self.flats])
        errors = np.array([flat.mean_error_dn for flat in self.flats])
        return means / means.mean(), errors / means.mean()


def flat_of_run(run: Run) -> RunFlat:
    """Return the flat fields of a run, of its longest exposure that does not saturate.

    Raises
    ------
    DataError
        There are no flat frames with a polarizer angle, none is below saturation, or no dark level is known.
    CalibrationError
        An angle has one frame only, or no light.
    """
    flats = [one for one in run.frames if one.kind == "flat" and one.polarizer_angle_deg is not None]
    usable = [one for one in flats if one.saturated_fraction <= _MOST_SATURATED and one.exposure_s is not None]
    if not usable:
        raise DataError(
            f"{run.path}: has {len(flats)} flat frames with a polarizer angle, and none of known exposure below "
            'saturation: take kind = "flat" with angles_deg in a session'
        )
    exposure_s = max(one.exposure_s or 0.0 for one in usable)
    chosen = [one for one in usable if one.exposure_s == exposure_s]
    groups: dict[float, list[FrameRecord]] = defaultdict(list)
    for record in chosen:
        groups[_angle_deg(record)].append(record)
    dark_dn = _dark_dn(run, chosen[0])
    angles = sorted(groups)
    return RunFlat(
        angles_deg=np.array(angles),
        flats=tuple(_flat(run, angle, groups[angle], dark_dn) for angle in angles),
        exposure_s=exposure_s,
        records=tuple(chosen),
    )


def _angle_deg(record: FrameRecord) -> float:
    target = record.polarizer_angle_target_deg
    angle = record.polarizer_angle_deg if target is None else target
    return round(angle or 0.0, 1) % 180.0


def _flat(run: Run, angle_deg: float, records: Iterable[FrameRecord], dark_dn: FloatArray) -> FlatField:
    try:
        return flat_field((run.counts(record) for record in records), dark_dn)
    except CalibrationError as error:
        raise DataError(f"{run.path}: flat frames at {angle_deg:g} deg: {error}") from error


def _dark_dn(run: Run, flat: FrameRecord) -> FloatArray:
    darks = [one for one in run.frames if one.kind == "dark" and one.exposure_s == flat.exposure_s]
    if darks:
        total = np.zeros((flat.height, flat.width))
        for record in darks:
            total += run.counts(record)
        return total / len(darks)
    if flat.black_level_dn is None:
        raise DataError(
            f"{run.path}: has no dark frames at the exposure of its flat frames, and no black level: "
            'take some in the same session (kind = "dark", the same exposure_ms)'
        )
    return np.full((flat.height, flat.width), flat.black_level_dn)
