"""Fitting a surface to measured regions."""

from pathlib import Path

from rigctl.comparison.surface_fit import FittedMaterial, fit_regions
from rigctl.console.exclusion_option import are_exclusions_ignored
from rigctl.errors import ConfigError
from rigctl.files.material_file import material_toml
from rigctl.files.surface_fit_file import load_surface_fit
from rigctl.storage.durable_file import write_durably


def fit_surface_file(file: Path, *, profile: bool = False, out: Path | None = None) -> FittedMaterial:
    """Return the material that the regions of a fit file make.

    Parameters
    ----------
    file : Path
        Which regions of which runs, which geometry, what to find.
    profile : bool
        Intervals from the profile of chi-square, good at a bound too, instead of first-order ones.
    out : Path or None
        Material file to write, where the regions determine the material.

    Raises
    ------
    ConfigError, DataError
        A file is wrong or asks for what cannot be, a run is unfit, or the search does not end.
    """
    if out is not None and not out.parent.is_dir():
        raise ConfigError(f"--out: there is no folder {out.parent}")
    fitted = fit_regions(
        load_surface_fit(file), beside=file.parent, profile=profile, ignore_exclusions=are_exclusions_ignored()
    )
    if out is not None and fitted.material is not None:
        write_durably(out, material_toml(fitted.material).encode())
    return fitted
