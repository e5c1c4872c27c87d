"""``rigctl stage``: what a rotation stage does by itself."""

from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress
from rich.table import Table

from rigctl.devices.characterisation_file import as_json, as_text
from rigctl.devices.characterise import SIDES, Characterisation, characterise
from rigctl.devices.stages import open_stage
from rigctl.durable_file import write_durably
from rigctl.errors import ConfigError
from rigctl.files.rig_file import RigFile, load_rig
from rigctl.files.session_file import DEFAULT_ANGLES_DEG, load_session
from rigctl.reports.characterisation_figure import characterisation_png
from rigctl.terminal import print_json, progress, results, warn

app = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None)

# So wide that a landing is measured as it is: a correction would come from the other side.
_TOLERANCE_DEG = 1.0
_COLUMNS = ("angle [deg]", "from below [deg]", "from above [deg]", "backlash [deg]", "at rest after [s]")


@app.callback()
def stage() -> None:
    """Measure a rotation stage by itself.

    Example: rigctl stage characterise examples/rig-sim.toml examples/session.toml --out stage.json
    """


@app.command("characterise")
def characterise_command(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="Rig file; only its stage is opened.")],
    session: Annotated[
        Path | None, typer.Argument(metavar="[SESSION.toml]", help="Session file: its angles are visited.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE.json", help="File to write, for the rig file.")] = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Draw errors and settling.")] = None,
    repeats: Annotated[int, typer.Option(metavar="N", min=2, max=1000, help="Visits from each side.")] = 3,
    watch_s: Annotated[float, typer.Option(metavar="S", min=0.1, max=60.0, help="How long to watch each.")] = 1.0,
    band_deg: Annotated[float, typer.Option(metavar="DEG", min=0.0, max=5.0, help="What counts as rest.")] = 0.01,
    as_json_too: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Visit the session's angles from both sides; tell readback error, backlash and the time until the stage rests.

    Name the file in the rig file, and every move of a session waits until the stage rests:

        [stage]
        characterisation = "stage.json"

    Play between encoder and polarizer does not show in readings.

    Example: rigctl stage characterise examples/rig-sim.toml examples/session.toml --out stage.json --plot stage.png
    """
    _require_folders(out, plot)
    rig_file = load_rig(rig)
    angles_deg = _stage_angles_deg(rig_file, session)
    result = _measure(rig_file, angles_deg, repeats=repeats, band_deg=band_deg, watch_s=watch_s)
    content = as_json(result)
    if out is not None:
        write_durably(out, as_text(content))
    if plot is not None:
        write_durably(plot, characterisation_png(result))
    if as_json_too:
        print_json(content)
    else:
        _print(result)


def _require_folders(*files: Path | None) -> None:
    for file in files:
        if file is not None and not file.parent.is_dir():
            raise ConfigError(f"{file}: there is no folder {file.parent}")


def _stage_angles_deg(rig: RigFile, session: Path | None) -> tuple[float, ...]:
    """Return the stage angles of a session's polarizer angles, each once."""
    if session is None:
        polarizer_deg: tuple[float | None, ...] = DEFAULT_ANGLES_DEG
    else:
        polarizer_deg = tuple(angle for take in load_session(session).take for angle in take.polarizer_angles_deg)
    turned = (rig.polarizer.sense * (angle - rig.polarizer.offset_deg) for angle in polarizer_deg if angle is not None)
    angles_deg = tuple(dict.fromkeys(angle % 360.0 for angle in turned))
    if not angles_deg:
        raise ConfigError(f"{session}: names no angle")
    return angles_deg


def _measure(
    rig: RigFile, angles_deg: tuple[float, ...], *, repeats: int, band_deg: float, watch_s: float
) -> Characterisation:
    section = rig.stage.model_copy(update={"characterisation": None, "tolerance_deg": _TOLERANCE_DEG})
    with open_stage(section, warn=warn) as opened, Progress(console=progress(), transient=True) as bar:
        task = bar.add_task("visits", total=len(angles_deg) * repeats * len(SIDES))
        return characterise(
            opened,
            angles_deg,
            repeats=repeats,
            band_deg=band_deg,
            watch_s=watch_s,
            progress=lambda _: bar.advance(task),
        )


def _print(result: Characterisation) -> None:
    console = results()
    table = Table(box=None, pad_edge=False)
    for title in _COLUMNS:
        table.add_column(title, justify="right")
    for angle_deg in result.angles_deg:
        chosen = [visit for visit in result.visits if visit.angle_deg == angle_deg]
        below, above = (result.errors_deg(angle_deg, side).mean() for side in SIDES)
        settle_s = max(visit.settle_s for visit in chosen)
        numbers = (f"{below:+.4f}", f"{above:+.4f}", f"{result.backlash_at_deg(angle_deg):+.4f}")
        table.add_row(f"{angle_deg:.3f}", *numbers, f"{settle_s:.2f}")
    console.print(table)
    identity = result.identity
    console.print(f"stage           {identity.model} {identity.serial_number}", markup=False)
    console.print(f"largest error   {result.largest_error_deg:.4f} deg", markup=False)
    console.print(f"repeatability   {result.repeatability_deg:.4f} deg (standard deviation)", markup=False)
    backlash = f"{result.backlash_deg:+.4f} ± {result.backlash_std_error_deg:.4f} deg"
    console.print(f"backlash        {backlash} (from above less from below)", markup=False)
    rest = (
        f"{result.settle_s:.2f} s" if result.is_settled else f"not within {result.watch_s:g} s: use a longer --watch-s"
    )
    console.print(f"at rest after   {rest}, within {result.band_deg:g} deg", markup=False)
