"""Findings in the fixed pattern that speak against a calibration, each by its own name."""

from calibration.flags import Flag
from calibration.sensor.fixed_pattern import FixedPattern
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.spectrogram import spectral_peak

_DEFECT_SHARE = 1e-3
_DEFECT_VARIANCE = 0.05
_LONG_STACK = 16


def pattern_flags(pattern: FixedPattern) -> tuple[Flag, ...]:
    """Return what is odd in the fixed pattern.

    Parameters
    ----------
    pattern : FixedPattern
        Of a dark and a flat stack.
    """
    found = (_periodic_pattern(pattern), _defect_pixels(pattern), _short_stack(pattern))
    return tuple(flag for flag in found if flag is not None)


def _periodic_pattern(pattern: FixedPattern) -> Flag | None:
    spectra = {
        "along dark rows": (pattern.dark_rows, pattern.dark_variance_dn2),
        "down dark columns": (pattern.dark_columns, pattern.dark_variance_dn2),
        "along rows with light": (pattern.response_rows, pattern.response_variance),
        "down columns with light": (pattern.response_columns, pattern.response_variance),
    }
    peaks = {
        name: peak
        for name, (spectrum, variance) in spectra.items()
        if (peak := spectral_peak(spectrum, variance=variance)) is not None
    }
    if not peaks:
        return None
    where = ", ".join(
        f"{name} at {peak.frequency_per_pixel:.4g} cycles a pixel ({peak.share:.0%} of its variance)"
        for name, peak in peaks.items()
    )
    return Flag(
        name="periodic_pattern",
        message=f"the fixed pattern has a period: {where}; DSNU or PRNU hold it, and say less of single pixels: "
        f"look for interference by supply or cables, several readout channels, or fringes of a window",
    )


def _defect_pixels(pattern: FixedPattern) -> Flag | None:
    share = pattern.defects.n_defect / pattern.defects.mask.size
    if share <= _DEFECT_SHARE:
        return None
    kinds = ", ".join(f"{count} {name}" for name, count in pattern.defects.counts.items() if count)
    return Flag(
        name="defect_pixels",
        message=f"{share:.2%} of the pixels are not like the others ({kinds}; more than {_DEFECT_SHARE:.1%}): the best "
        f"DSNU and PRNU leave out those that are 6 standard deviations off, those of EMVA 1288 hold all; leave them "
        f"out of regions: the defect map says which",
    )


def left_out_flags(dark: LevelStatistics, flat: LevelStatistics) -> tuple[Flag, ...]:
    """Return a flag if single pixels make a good part of the fixed pattern.

    Parameters
    ----------
    dark, flat : LevelStatistics
        The levels that DSNU and PRNU are taken from.
    """
    shares = {
        name: 1.0 - level.ordinary.variance_dn2 / level.spatial_variance_dn2
        for name, level in (("dark", dark), ("flat", flat))
        if level.ordinary.left_out and level.spatial_variance_dn2 > 0.0
    }
    if not shares or max(shares.values()) < _DEFECT_VARIANCE:
        return ()
    counts = {"dark": dark.ordinary.left_out, "flat": flat.ordinary.left_out}
    where = " and ".join(
        f"{counts[name]} in the {name} stack ({share:.0%} of its variance)" for name, share in shares.items()
    )
    message = (
        f"single pixels are more than 6 standard deviations from all others: {where}: hot, dead or "
        f"otherwise defect; the best DSNU and PRNU leave them out, those of EMVA 1288 hold them; leave them out of "
        f"regions: --defects writes which"
    )
    return (Flag(name="defect_pixels", message=message),)


def _short_stack(pattern: FixedPattern) -> Flag | None:
    if min(pattern.n_dark_frames, pattern.n_flat_frames) >= _LONG_STACK:
        return None
    return Flag(
        name="short_stack",
        message=f"the fixed pattern is from {pattern.n_flat_frames} flats and {pattern.n_dark_frames} darks, less than "
        f"the {_LONG_STACK} of EMVA 1288; its temporal noise is taken off, but defects and maps show it: take longer "
        f"stacks at half of saturation and in the dark",
    )
