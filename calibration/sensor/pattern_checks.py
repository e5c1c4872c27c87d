"""What the fixed pattern says against a calibration: each finding by its own name."""

from calibration.flags import Flag
from calibration.sensor.fixed_pattern import FixedPattern
from calibration.sensor.spectrogram import spectral_peak

_DEFECT_SHARE = 1e-3
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
        message=f"{share:.2%} of the pixels are not like the others ({kinds}; more than {_DEFECT_SHARE:.1%}): DSNU, "
        f"PRNU and read noise hold them; leave them out of regions: the defect map says which",
    )


def _short_stack(pattern: FixedPattern) -> Flag | None:
    if min(pattern.n_dark_frames, pattern.n_flat_frames) >= _LONG_STACK:
        return None
    return Flag(
        name="short_stack",
        message=f"the fixed pattern is from {pattern.n_flat_frames} flats and {pattern.n_dark_frames} darks, less than "
        f"the {_LONG_STACK} of EMVA 1288; its temporal noise is taken off, but defects and maps show it: take longer "
        f"stacks at half of saturation and in the dark",
    )
