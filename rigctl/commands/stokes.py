"""``rigctl stokes``: Stokes, DoLP and AoLP images of a run."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.failures import EXIT_DATA
from rigctl.console.options import (
    CalibrationStore,
    Faults,
    FlatFile,
    ForceRegistration,
    PolarizerFile,
    RegistrationFile,
)
from rigctl.console.terminal import print_json, progress, results, warn

if TYPE_CHECKING:
    from model.processing.texture import Texture
    from rigctl.jobs.stokes import StokesOfRun


def command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for images, pictures and numbers.")],
    regions: Annotated[Path | None, typer.Option(metavar="FILE", help="Regions file.")] = None,
    noise: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Noise calibration: texture and noise, a dark level. none: pick none."),
    ] = None,
    register: RegistrationFile = None,
    force_registration: ForceRegistration = False,
    polarizer: PolarizerFile = None,
    flat: FlatFile = None,
    correct: Faults = None,
    store: CalibrationStore = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Write Stokes, DoLP and AoLP images of a run, masks, pictures, and the numbers of its regions.

    stokes.fits holds (S0, S1, S2) after the dark level, in DN, or in DN/s where exposures differ. Calibrations that are
    not named are picked from the store beside the rig file, if there is one (rigctl calibrations).

    Example: rigctl stokes runs/panels --regions examples/regions.toml --out stokes
    """
    from rigctl.jobs.stokes import StokesRequest, stokes_of_run
    from rigctl.measurement.found_faults import correctable
    from rigctl.measurement.picked_calibrations import calibration_paths

    paths = calibration_paths(
        {"noise": noise, "registration": register, "flat": flat, "polarizer": polarizer},
        store=store,
        force_registration=force_registration,
    )
    asked = () if correct is None else correctable(correct)
    found = stokes_of_run(StokesRequest(run=run, out=out, regions=regions, calibrations=paths, correct=asked))
    for line in () if found.picked is None else found.picked.lines:
        progress().print(line, markup=False)
    for remark in found.remarks:
        warn(remark)
    if as_json:
        print_json(found.as_json())
    else:
        _print(found, out)
    if found.refused:
        for refusal in found.refused:
            warn(refusal)
        raise typer.Exit(EXIT_DATA)


def _print(found: "StokesOfRun", out: Path) -> None:
    from rigctl.reports.tables.numbers_json import region_statistics
    from rigctl.reports.tables.prediction_tables import quantity_tables
    from rigctl.reports.writers.terminal_table import terminal_table

    _print_faults(found)
    regions = {name: region_statistics(region) for name, region in found.measurement.regions.items()}
    for table in quantity_tables(regions):
        results().print(terminal_table(table))
    for name, texture in (found.textures or {}).items():
        results().print(texture_line(name, texture), markup=False)
    progress().print(f"{', '.join(found.files)} in {out}", markup=False)


def _print_faults(found: "StokesOfRun") -> None:
    """Print what is wrong with the run, before its numbers."""
    from rigctl.comparison.verdict import said_of
    from rigctl.measurement.fault_terms import term_text

    console, measurement = results(), found.measurement
    if found.refused:
        console.print("UNSOUND: the numbers below are not those of the light", markup=False)
    for term in found.diagnosis.named:
        console.print(f"the run shows {term_text(term)}", markup=False)
    for title, text in said_of(found.checks, "flagged", "refused"):
        console.print(f"{title}: {text}", markup=False)
    for name, why in measurement.unmeasured.items():
        console.print(f"{name} cannot be measured: {why}", markup=False)
    left_out = int(measurement.saturated.sum()), int(measurement.missing.sum())
    if any(left_out):
        total = measurement.saturated.size
        console.print(
            f"left out of {total} pixels: {left_out[0]} clipped in one frame or more ({left_out[0] / total:.1%}), "
            f"{left_out[1]} missing ({left_out[1] / total:.1%})",
            markup=False,
        )


def texture_line(name: str, texture: "Texture") -> str:
    """Return the texture of a region in a line."""
    if math.isnan(texture.rank_one_share):
        return f"{name}: no texture above the noise"
    return (
        f"{name}: texture of {100 * texture.common_factor_rms:.2f} % as a factor common to S0, S1, S2; "
        f"{100 * texture.rank_one_share:.0f} % of it is one common variation"
        + (f" ({texture.remark})" if texture.remark else "")
    )
