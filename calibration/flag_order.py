"""Order of flags: first what takes the most from the results."""

from collections.abc import Iterable

from calibration.flags import Flag

# By what a flag does: numbers that do not exist or are other than they seem, levels that are wrong, numbers that are
# uncertain, remarks. A name that is not listed is of the third kind.
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
    """Return flags with those first that refuse, then those that take most from the results.

    Parameters
    ----------
    flags : iterable of Flag
        In any order; flags of one rank keep theirs.
    """
    return tuple(sorted(flags, key=lambda flag: (not flag.refuses, _RANK.get(flag.name, _UNLISTED))))
