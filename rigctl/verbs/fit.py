"""`rigctl fit surface`: parameters of a surface from measured regions."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Unpack

from rigctl.console.json_text import Json
from rigctl.console.terminal import note, warn
from rigctl.verbs.options import FilePath, RunOptions, Writes
from rigctl.verbs.result import Part, Result

if TYPE_CHECKING:
    from rigctl.comparison.surface_fit import FittedMaterial


def surface(
    file: FilePath,
    /,
    *,
    profile: bool = False,
    out: Annotated[FilePath | None, Writes()] = None,
    **frames: Unpack[RunOptions],
) -> "FitResult":
    """Fit refractive index, roughness, reflectance and specular weight to regions of one or several runs.

    The light is taken to be the sun alone, and the scale of each run to be unknown: the fit rests on the polarization
    of every region, and on how bright the regions of one run are relative to each other. Take regions in and next to
    the glint.

    Example: rigctl fit surface examples/fit-black-panel.toml --out fitted.toml

    Parameters
    ----------
    file : path
        Fit file: which regions, which geometry, what to find.
    profile : bool
        Intervals from the profile of chi-square: slower, good at a bound too.
    out : path
        Material file to write.
    **frames
        See `RunOptions`.

    Returns
    -------
    FitResult
        Values with their intervals.

    Raises
    ------
    ConfigError, DataError
        A file is wrong or asks for what cannot be, a run is unfit, or the search does not end.
    """
    from rigctl.base.durable import write_durably
    from rigctl.comparison.surface_fit import fit_regions
    from rigctl.files.materials import load_surface_fit, material_toml

    fitted = fit_regions(
        load_surface_fit(Path(file)),
        beside=Path(file).parent,
        profile=profile,
        ignore_exclusions=frames.get("ignore_exclusions", False),
    )
    if out is not None and fitted.material is None:
        warn(f"{out} is not written: {'; '.join(fitted.fit.findings)}")
    elif out is not None and fitted.material is not None:
        write_durably(Path(out), material_toml(fitted.material).encode())
        note(f"material: {out}")
    return FitResult(fitted=fitted, is_unwritten=out is not None and fitted.material is None)


@dataclass(frozen=True, kw_only=True, eq=False)
class FitResult(Result):
    """A surface as measured regions give it."""

    fitted: "FittedMaterial"
    is_unwritten: bool = False  #: a material file was asked for, and the regions leave the material undetermined

    @property
    def exit_code(self) -> int:
        """4 where a material was asked for and is undetermined."""
        from rigctl.console.failures import EXIT_DATA

        return EXIT_DATA if self.is_unwritten else 0

    def content(self) -> Iterable[Part]:
        """Return parameters and observations as tables, the goodness of the fit, and what limits it."""
        from rigctl.base.numbers import p_value
        from rigctl.report.surface import fit_tables

        fit = self.fitted.fit
        yield from fit_tables(self.fitted)
        yield (
            f"chi-square {fit.chi_square:.4g} with {fit.degrees_of_freedom} degrees of freedom, {p_value(fit.p_value)}"
        )
        yield from fit.findings
        yield from self.fitted.assumptions

    def as_json(self) -> dict[str, Json]:
        """Return parameters with intervals and correlation, held values, observations and findings."""
        from rigctl.report.surface import fit_json

        return fit_json(self.fitted)
