"""`rigctl calibrate stage`: readback error, backlash and settling of a rotation stage, from its own readings."""

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.console import Json, progress, warn
from rigctl.errors import ConfigError
from rigctl.report.document import Column, Table
from rigctl.verbs.options import FilePath, Part, Result, Writes

if TYPE_CHECKING:
    from rigctl.files.rig_file import RigFile
    from rigctl.rig.characterise import Characterisation, Side

# A wide tolerance, so that no correction from the other side hides the backlash.
_TOLERANCE_DEG = 1.0


def stage(
    rig: FilePath,
    session: FilePath | None = None,
    /,
    *,
    out: Annotated[FilePath | None, Writes()] = None,
    plot: Annotated[FilePath | None, Writes()] = None,
    repeats: Annotated[int, Parameter(validator=Number(gte=2, lte=1000))] = 3,
    watch_s: Annotated[float, Parameter(validator=Number(gte=0.1, lte=60.0))] = 1.0,
    band_deg: Annotated[float, Parameter(validator=Number(gte=0.0, lte=5.0))] = 0.01,
) -> "StageCalibration":
    """Measure readback error, backlash and settling time of a rotation stage.

    Name the file as `characterisation` under [stage] of the rig file, and every move of a session waits until the stage
    rests. Play between encoder and polarizer does not show in readings.

    Example: rigctl calibrate stage examples/rig-sim.toml examples/session.toml --out stage.json --plot stage.png

    Parameters
    ----------
    rig : path
        Rig file; only its stage is opened.
    session : path
        Session file whose angles are visited; default: 0, 45, 90 and 135 deg.
    out : path
        File to write (.json).
    plot : path
        Picture of errors and settling to write (.png).
    repeats : int
        Number of visits of each angle from each side.
    watch_s : float
        Time of observation after each move [s].
    band_deg : float
        Width of the band of readings that counts as rest [deg].
    """
    from rigctl.base.durable import write_durably
    from rigctl.files.rig_file import load_rig
    from rigctl.rig.characterise import SIDES, characterisation_file, characterise
    from rigctl.rig.rig import open_stage

    for file in (out, plot):
        if file is not None and not Path(file).parent.is_dir():
            raise ConfigError(f"{file}: there is no folder {Path(file).parent}")
    rig_file = load_rig(Path(rig))
    angles_deg = _stage_angles_deg(rig_file, None if session is None else Path(session))
    if rig_file.stage is None:
        raise ConfigError(f"rig {rig_file.name}: has no [stage] to characterise")
    section = rig_file.stage.model_copy(update={"characterisation": None, "tolerance_deg": _TOLERANCE_DEG})
    with _visits_shown(len(angles_deg) * repeats * len(SIDES)) as visited, open_stage(section, warn=warn) as opened:
        result = characterise(opened, angles_deg, repeats=repeats, band_deg=band_deg, watch_s=watch_s, progress=visited)
    measured = StageCalibration(result=result, file=characterisation_file(result))
    if out is not None:
        write_durably(Path(out), (json.dumps(measured.file, indent=1, allow_nan=False) + "\n").encode())
    if plot is not None:
        from rigctl.report.polarizer import characterisation_png

        write_durably(Path(plot), characterisation_png(result))
    return measured


@contextmanager
def _visits_shown(visits: int) -> Iterator[Callable[[object], None]]:
    """Show a progress bar."""
    from rich.progress import Progress

    with Progress(console=progress(), transient=True) as bar:
        task = bar.add_task("visits", total=visits)
        yield lambda _: bar.advance(task)


def _stage_angles_deg(rig: "RigFile", session: Path | None) -> tuple[float, ...]:
    """Return the different stage angles of a session's polarizer angles."""
    from rigctl.files.session_file import DEFAULT_ANGLES_DEG, load_session

    if session is None:
        polarizer_deg: tuple[float | None, ...] = DEFAULT_ANGLES_DEG
    else:
        polarizer_deg = tuple(angle for take in load_session(session).take for angle in take.polarizer_angles_deg)
    turned = (rig.polarizer.sense * (angle - rig.polarizer.offset_deg) for angle in polarizer_deg if angle is not None)
    angles_deg = tuple(dict.fromkeys(angle % 360.0 for angle in turned))
    if not angles_deg:
        raise ConfigError(f"{session}: names no angle")
    return angles_deg


@dataclass(frozen=True, kw_only=True, eq=False)
class StageCalibration(Result):
    """A characterisation of a stage."""

    result: "Characterisation"
    file: dict[str, Json]  #: content of the file for the rig

    def content(self) -> Iterable[Part]:
        """Return largest error, repeatability, backlash and settling time, then each angle."""
        result, identity = self.result, self.result.identity
        backlash = f"{result.backlash_deg:+.4f} ± {result.backlash_std_error_deg:.4f} deg"
        rest = f"not within {result.watch_s:g} s: use a longer --watch-s"
        if result.is_settled:
            rest = f"{result.settle_s:.2f} s"
        yield f"stage           {identity.model} {identity.serial_number}"
        yield f"largest error   {result.largest_error_deg:.4f} deg"
        yield f"repeatability   {result.repeatability_deg:.4f} deg (standard deviation)"
        yield f"backlash        {backlash} (from above less from below)"
        yield f"at rest after   {rest}, within {result.band_deg:g} deg"
        yield self._angles()

    def as_json(self) -> dict[str, Json]:
        """Return the content of the file."""
        return self.file

    def _angles(self) -> Table[float]:
        result = self.result

        def error(angle_deg: float, side: "Side") -> str:
            return f"{result.errors_deg(angle_deg, side).mean():+.4f}"

        def settle_s(angle_deg: float) -> float:
            return max(visit.settle_s for visit in result.visits if visit.angle_deg == angle_deg)

        columns: tuple[Column[float], ...] = (
            Column(title="angle [deg]", text=lambda angle_deg: f"{angle_deg:.3f}"),
            Column(title="from below [deg]", text=lambda angle_deg: error(angle_deg, "forward")),
            Column(title="from above [deg]", text=lambda angle_deg: error(angle_deg, "backward")),
            Column(title="backlash [deg]", text=lambda angle_deg: f"{result.backlash_at_deg(angle_deg):+.4f}"),
            Column(title="at rest after [s]", text=lambda angle_deg: f"{settle_s(angle_deg):.2f}"),
        )
        return Table(columns=columns, rows=tuple(result.angles_deg))
