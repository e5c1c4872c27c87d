"""Errors and flags: faults that a calibration finds in its frames."""

from collections.abc import Iterable
from dataclasses import dataclass

# Flags: oddities in the frames


@dataclass(frozen=True, kw_only=True)
class Flag:
    """One remark on the frames."""

    name: str  #: ``lower_case_with_underscores``; names stay the same from version to version
    level: str | None = None  #: None for the whole set
    message: str  #: what was found, what is allowed, and what to try
    refuses: bool = False  #: whether it stops the calibration


# Errors of frames that are unfit for a calibration


class CalibrationError(Exception):
    """The frames do not allow the requested calibration."""


class RefusedFramesError(CalibrationError):
    """The frames have a fault that makes every number wrong.

    Attributes
    ----------
    flags : tuple of Flag
        All findings, whether they refuse the frames or not.
    """

    def __init__(self, flags: tuple[Flag, ...]) -> None:
        refusing = [f"{flag.name}: {flag.message}" for flag in flags if flag.refuses]
        super().__init__("the frames are refused:\n  " + "\n  ".join(refusing))
        self.flags = flags


def refused(name: str, message: str) -> RefusedFramesError:
    """Return the error for frames that a single finding makes unfit."""
    return RefusedFramesError((Flag(name=name, message=message, refuses=True),))


# Order of flags: largest effect on the results first

# By effect: missing or misleading numbers, wrong levels, uncertain numbers, remarks. Names that are not listed count as
# uncertain numbers.
_GROUPS: tuple[tuple[str, ...], ...] = (
    (
        "gain_changed",
        "light_or_gain_changed",
        "wrong_time_unit",
        "light_in_darks",
        "dark_current_or_light",
        "wrong_bit_depth",
        "quantum_efficiency_above_one",
        "negative_dark_current",
        "correlated_noise",
        "frames_go_together",
        "banded_light",
        "colour_mosaic",
        "missing_codes",
    ),
    (
        "another_gain",
        "wrong_level",
        "wrong_dark",
        "wrong_variance",
        "wrong_light",
        "unclear_level",
        "non_monotonic_sweep",
    ),
    (
        "dark_current_changed",
        "black_clamp",
        "quantisation_limited",
        "too_few_levels",
        "bent_photon_transfer",
        "scattered_photon_transfer",
    ),
    (),
    (
        "read_noise_not_resolved",
        "dsnu_not_resolved",
        "prnu_not_resolved",
        "dark_current_not_resolved",
        "saturation_not_reached",
        "single_dark_exposure",
    ),
    (
        "saturated_levels",
        "exposure_offset",
        "outlier_pixels",
        "periodic_pattern",
        "short_stack",
        "single_frames",
        "low_ceiling",
    ),
)
_RANK = {name: rank for rank, names in enumerate(_GROUPS) for name in names}
_UNLISTED = _GROUPS.index(())


def by_consequence(flags: Iterable[Flag]) -> tuple[Flag, ...]:
    """Return flags by severity, refusing ones first."""
    return tuple(sorted(flags, key=lambda flag: (not flag.refuses, _RANK.get(flag.name, _UNLISTED))))
