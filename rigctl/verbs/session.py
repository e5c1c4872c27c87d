"""`rigctl plan`, `acquire`, `resume`, `hold` and `stop`: sessions."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from cyclopts import Parameter

from rigctl.base.numbers import percent, time_option
from rigctl.console import Json, note, warn
from rigctl.errors import ConfigError, RunFolderError
from rigctl.files.choices import RoofChange
from rigctl.report.document import Column, Table
from rigctl.verbs.options import FilePath, Part, Result, RunPath, Writes

if TYPE_CHECKING:
    from rigctl.python import Run
    from rigctl.session.control import Request
    from rigctl.session.plan import SessionPlan
    from rigctl.session.take import Outcome

#: When the lens has to be covered: ask at the terminal, or hold until `rigctl resume`.
Ask: TypeAlias = Literal["terminal", "hold"]

# Rows without --all.
_MOST_STEPS, _MOST_ROUNDS = 12, 12
_DATE_DIGITS, _UTC_DIGITS = 11, 19
# A false DoLP below this is a rounding error.
_ROUNDING = 1e-9
_TITLES = {
    "sequence": "step",
    "round": "round",
    "utc": "UTC",
    "time": "UTC",
    "sun_zenith_deg": "zenith",
    "sun_azimuth_deg": "azimuth",
    "phi_deg": "phi",
    "kind": "kind",
    "cycle": "cycle",
    "angle_deg": "angle",
    "exposure_ms": "exposure",
}
# Largest width or height of a picture.
_MOST_DIGITS = 6
# Share of saturated pixels above which a predicted DoLP means nothing.
_MOST_SATURATED = 0.01


def plan(
    rig: FilePath,
    session: FilePath,
    /,
    *,
    at: str | None = None,
    until: str | None = None,
    scene: FilePath | None = None,
    noise: FilePath | None = None,
    frame: str | None = None,
    all_steps: Annotated[bool, Parameter(name="--all")] = False,
) -> "PlannedSession":
    """Print the steps of a session with times, sun angles, disk space and duration; with a scene, predict each round.

    No device is opened. Regions that are given by materials are lit by the sun at the time of each round.

    Example: rigctl plan examples/rig-rooftop.toml examples/session-rooftop.toml --at 2026-05-04T10:00Z

    Parameters
    ----------
    rig : path
        Rig file: devices, site, camera's direction.
    session : path
        Session file.
    at : str
        Start time, such as 2026-05-04T10:00Z; default: now.
    until : str
        End time: no frame is taken after it.
    scene : path
        Scene file: also predict each round.
    noise : path
        Noise calibration for the prediction.
    frame : str
        Picture size of a real camera, WIDTHxHEIGHT, to compute the disk space.
    all_steps : bool
        Print all rounds and steps.
    """
    from rigctl.calibrations.store import store_doubts
    from rigctl.files.rig_file import load_rig, placeholder_doubt
    from rigctl.files.session_file import load_session
    from rigctl.session.plan import plan_session
    from rigctl.session.timing import SessionClock

    if noise is not None and scene is None:
        raise ConfigError("--noise: is for a prediction; give --scene too")
    rig_file, session_file = load_rig(Path(rig)), load_session(Path(session))
    now_ns = time_option("--at", at) or SessionClock().utc_ns()
    pixels = None if frame is None else _pixels(frame)
    planned = plan_session(rig_file, session_file, now_ns=now_ns, until_ns=time_option("--until", until), pixels=pixels)
    for doubt in (placeholder_doubt(rig_file), *store_doubts(rig_file, Path(rig), now_ns=now_ns)):
        if doubt is not None:
            warn(doubt)
    for remark in planned.remarks:
        note(remark, below=True)
    if scene is None:
        return PlannedSession(plan=planned, all_steps=all_steps)
    from rigctl.calibrations.noise import read_noise_file
    from rigctl.files.scene_file import load_scene
    from rigctl.session.forecast import predict_rounds

    parameters = None if noise is None else read_noise_file(Path(noise))
    predictions = predict_rounds(load_scene(Path(scene)), parameters, planned, rig_file, session_file.metering)
    return PlannedSession(plan=planned, predictions=tuple(predictions), all_steps=all_steps)


def acquire(
    rig: FilePath,
    session: FilePath,
    /,
    *,
    out: Annotated[FilePath, Writes(kind="new")],
    dry_run: bool = False,
    at: str | None = None,
    until: str | None = None,
    noise: FilePath | None = None,
    polarizer: FilePath | None = None,
    calibrations: FilePath | None = None,
    scene: FilePath | None = None,
    target_dolp_sigma: float | None = None,
    regions: FilePath | None = None,
    clock: str | None = None,
    perturb: RoofChange | None = None,
    ask: Ask = "terminal",
    trace: Annotated[FilePath | None, Writes(kind="absent")] = None,
) -> "SessionResult":
    """Take a session into a new run folder; every frame is safely on the disk before the next step.

    Ctrl-C or `rigctl stop` ends the session after the current frame (exit code 75), and `rigctl resume` continues it. A
    second Ctrl-C stops at once (exit code 130).

    Example: rigctl acquire examples/rig-sim.toml examples/session.toml --out runs/panels

    Example: rigctl acquire examples/rig-sim.toml examples/session.toml --out runs/panels --scene
    examples/scene-panels.toml --target-dolp-sigma 0.01

    Example: rigctl acquire examples/rig-roof.toml examples/session-roof.toml --out runs/noon --clock 2010-05-25T17:07Z

    Parameters
    ----------
    rig : path
        Rig file: devices and how they are mounted.
    session : path
        Session file: frames to take.
    out : path
        New run folder.
    dry_run : bool
        Check the session and print its plan, without opening a device.
    at : str
        Start time with a time zone, such as 2026-05-04T10:00Z; default: now.
    until : str
        End time: no frame is taken after it.
    noise : path or "none"
        Noise calibration file, for the expected errors shown during the session. "none" uses none.
    polarizer : path or "none"
        Polarizer calibration file that the rig file must agree with. "none" uses none.
    calibrations : path or "none"
        Folder from which calibrations that are not given are selected; default: the folder ``calibrations``
        next to the rig file. "none" selects none.
    scene : path
        Scene file, for --target-dolp-sigma.
    target_dolp_sigma : float
        Take as many cycles as are needed for this standard error of a pixel's DoLP, predicted from --scene.
    regions : path
        Regions file: watch these regions too. They replace regions of the same name in the session file.
    clock : str
        Simulated rigs only: time at which the clock starts; the session does not wait.
    perturb : {"visibility", "aerosol", "dhr", "tilt", "drift"}
        Simulated rooftop only: make the scene differ from its scene file.
    ask : {"terminal", "hold"}
        When the lens has to be covered: ask at the terminal, or hold until `rigctl resume`.
    trace : path
        Text file to write: bytes sent to and received from the stage, settings and frames of the camera, with times.

    Returns
    -------
    SessionResult
        Frames that were taken; `.run` opens them.

    Raises
    ------
    ConfigError, DataError, DeviceError, RunFolderError
        A file is wrong, a calibration does not fit, a device fails, or the folder cannot be written.
    """
    from rigctl.rig.rig import trace_into
    from rigctl.session.control import outliving_terminal
    from rigctl.session.plan import plan_session
    from rigctl.session.preparation import prepare_session, require_takeable, take_prepared
    from rigctl.session.timing import clock_of

    def path(given: FilePath | None) -> Path | None:
        return None if given is None else Path(given)

    with outliving_terminal():
        prepared = prepare_session(
            Path(rig),
            Path(session),
            noise=path(noise),
            polarizer=path(polarizer),
            store=path(calibrations),
            scene=path(scene),
            target_dolp_sigma=target_dolp_sigma,
            clock_ns=time_option("--clock", clock),
            perturb=perturb,
            regions=path(regions),
        )
        folder, by_hold = Path(out), ask == "hold"
        at_ns, until_ns = time_option("--at", at), time_option("--until", until)
        prepared.report()
        doubts, light = require_takeable(prepared, folder, at_ns=at_ns, until_ns=until_ns, asks_by_hold=by_hold)
        for line in light:
            note(line)
        if not dry_run:
            with trace_into(path(trace)) as traced:
                outcome = take_prepared(
                    prepared, folder, at_ns=at_ns, until_ns=until_ns, asks_by_hold=by_hold, trace=traced
                )
            return SessionResult(path=folder, outcome=outcome)
    now_ns = clock_of(prepared.rig_file).utc_ns() if at_ns is None else at_ns
    planned = plan_session(prepared.rig_file, prepared.session_file, now_ns=now_ns, until_ns=until_ns)
    for doubt in doubts:
        warn(doubt)
    for remark in planned.remarks:
        if remark not in prepared.doubts:
            note(remark, below=True)
    return SessionResult(path=folder, planned=PlannedSession(plan=planned))


def resume(run: RunPath, /, *, ask: Ask = "terminal") -> "SessionResult":
    """Continue a session that holds, or that was interrupted: by a kill, a power cut, a full disk, a lost device.

    A session that runs and holds continues. Otherwise the run is verified, undamaged frames that are missing in the
    manifest are added to it, damaged ones are set aside, and the session continues at the first missing step.

    Example: rigctl resume runs/2026-05-04

    Parameters
    ----------
    run : path or Run
        Run folder.
    ask : {"terminal", "hold"}
        When the lens has to be covered: ask at the terminal, or hold until `rigctl resume`.
    """
    from rigctl.runs.folder import writing_process
    from rigctl.session.control import ask_process, outliving_terminal

    folder = Path(run)
    with outliving_terminal():
        process = writing_process(folder)
        if process is not None:
            ask_process(folder, process, "continue")
            return SessionResult(path=folder, process=process)
        from rigctl.files.rig_file import unset_polarizer
        from rigctl.runs.folder import read_run
        from rigctl.session.take import resume_session

        outcome = resume_session(folder, asks_by_hold=ask == "hold")
    if outcome.repair is not None:
        for finding in outcome.repair.adopted:
            note(f"adopted: {finding.file}")
        for finding in outcome.repair.set_aside:
            note(f"set aside: {finding.file}: {finding.problem}")
    for doubt in unset_polarizer(folder, placeholder=read_run(folder).session.polarizer.placeholder):
        warn(doubt)
    return SessionResult(path=folder, outcome=outcome)


def hold(run: RunPath, /) -> "Asked":
    """Hold the session that is writing a run after its current frame. `rigctl resume` continues it.

    Example: rigctl hold runs/2026-05-04

    Parameters
    ----------
    run : path or Run
        Run folder.
    """
    return _ask_running(Path(run), "hold")


def stop(run: RunPath, /) -> "Asked":
    """Stop the session that is writing a run after its current frame. `rigctl resume` continues it.

    Example: rigctl stop runs/2026-05-04

    Parameters
    ----------
    run : path or Run
        Run folder.
    """
    return _ask_running(Path(run), "stop")


def _ask_running(run: Path, request: "Request") -> "Asked":
    from rigctl.runs.folder import writing_process
    from rigctl.session.control import ask_process

    process = writing_process(run) if run.is_dir() else None
    if process is None:
        raise RunFolderError(f"{run}: no session writes into this run; look at `rigctl status {run}`")
    ask_process(run, process, request)
    return Asked(path=run, process=process, request=request)


@dataclass(frozen=True, kw_only=True)
class Asked(Result):
    """A request to the session of a run."""

    path: Path
    process: int  #: the session's process
    request: str

    def content(self) -> Iterable[Part]:
        """Return a sentence about the request."""
        yield f"{self.request} requested from process {self.process}, after this frame"

    def as_json(self) -> dict[str, Json]:
        """Return run, process and request."""
        return {"run": str(self.path), "process": self.process, "request": self.request}


@dataclass(frozen=True, kw_only=True)
class SessionResult(Result):
    """The end of a session, or the process that continues it, or its plan."""

    path: Path  #: run folder
    process: int | None = None  #: process that was requested to continue; None if the session has ended
    outcome: "Outcome | None" = None  #: frames taken and planned; None while the session runs
    planned: "PlannedSession | None" = None  #: plan of a dry run

    @property
    def run(self) -> "Run":
        """The run, opened as by `rigctl.open_run`."""
        from rigctl.python import open_run

        return open_run(self.path)

    @property
    def exit_code(self) -> int:
        """75 if the session ended before its last frame: for schedulers, try again."""
        from rigctl.console import EXIT_INCOMPLETE

        return 0 if self.outcome is None or self.outcome.is_finished else EXIT_INCOMPLETE

    def content(self) -> Iterable[Part]:
        """Return the number of frames, and how to continue."""
        outcome = self.outcome
        if self.planned is not None:
            yield from self.planned.content()
        elif outcome is None:
            yield f"process {self.process} continues"
        elif outcome.was_finished:
            yield f"nothing to do: this session is finished, {outcome.frames} frames in {self.path}"
        elif outcome.is_finished:
            yield f"{outcome.frames} frames in {self.path}"
        else:
            yield f"{outcome.frames} of {outcome.planned} frames in {self.path}; rigctl resume {self.path} continues"

    def as_json(self) -> dict[str, Json]:
        """Return the process that continues, or the frames with those that were adopted and set aside."""
        if self.planned is not None:
            return self.planned.as_json()
        content: dict[str, Json] = {"run": str(self.path), "process": self.process}
        outcome = self.outcome
        if outcome is None:
            return content
        return content | {
            "frames": outcome.frames,
            "planned": outcome.planned,
            "is_finished": outcome.is_finished,
            "was_finished": outcome.was_finished,
            "adopted": [] if outcome.repair is None else [found.file for found in outcome.repair.adopted],
            "set_aside": [] if outcome.repair is None else [found.file for found in outcome.repair.set_aside],
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedSession(Result):
    """The plan of a session, with predictions of its rounds if a scene is given."""

    plan: "SessionPlan"
    predictions: tuple[Mapping[str, Json], ...] | None = None  #: None without a scene
    all_steps: bool = False  #: show all steps

    def content(self) -> Iterable[Part]:
        """Return frames, duration and disk space, then rounds, predictions and the first steps."""
        from rigctl.session.plan import SUN_ANGLES

        plan, rounds, steps = self.plan, self.plan.planned_rounds(), self.plan.planned_steps()
        disk = "disk not known" if plan.disk_bytes is None else f"disk {plan.disk_bytes / 1e6:.0f} MB"
        many = f" in {len(rounds)} rounds" if len(rounds) > 1 else ""
        yield f"{len(steps)} frames{many} from {_cell(steps[0], 'utc')}Z, about {_duration(plan.duration_s)}, {disk}"
        for kind in dict.fromkeys(step["kind"] for step in steps):
            yield _kind_line(kind, [step for step in steps if step["kind"] == kind])
        if plan.disk_bytes is None:
            yield "`rigctl plan --frame WIDTHxHEIGHT` computes the disk before the camera is opened"
        if plan.false_dolp is not None:
            shown_dolp = plan.false_dolp if plan.false_dolp > _ROUNDING else 0.0
            yield f"light that drifts by 1 % a minute shows a false DoLP of {shown_dolp:.2g} in a round"
        sun = [name for name in SUN_ANGLES if name in steps[0]]
        if len(rounds) > 1:
            yield _table(rounds if self.all_steps else rounds[:_MOST_ROUNDS], ("round", "utc", *sun))
            if len(rounds) > _MOST_ROUNDS and not self.all_steps:
                yield f"... and {len(rounds) - _MOST_ROUNDS} more rounds; `rigctl plan --all` prints all"
        yield from self._predicted()
        shown = steps if self.all_steps else steps[:_MOST_STEPS]
        yield _table(shown, ("sequence", "round", "time", *sun, "kind", "cycle", "angle_deg", "exposure_ms"))
        if len(shown) < len(steps):
            yield f"... and {len(steps) - len(shown)} more steps; `rigctl plan --all` prints all"
        yield "angles are in degrees, exposures in ms"
        if sun:
            yield "zenith and azimuth are the sun's, phi is its azimuth minus the camera's"

    def _predicted(self) -> Iterable[Part]:
        """Yield the number of saturated predictions, a table of the first ones, and problems."""
        from model.quantities import angle_of

        rows: list[Mapping[str, Any]] = [row for row in self.predictions or () if "problem" not in row]
        if rows:
            full = [row for row in rows if row["saturated_fraction"] > _MOST_SATURATED]
            names = ", ".join(dict.fromkeys(str(row["region"]) for row in full))
            yield f"predicted: {len(full)} of {len(rows)} signals saturate{f' ({names})' if names else ''}"
            columns = (
                Column[Mapping[str, Any]](title="round", text=lambda row: str(row["round"])),
                Column(title="exposure", text=lambda row: f"{row['exposure_ms']:.3g}"),
                Column(title="region", text=lambda row: row["region"], left=True),
                *(
                    Column(title=f"{angle_of(name)} deg", text=partial(_count, name=name))
                    for name in rows[0]["mean_dn"]
                ),
                Column(title="saturated", text=lambda row: percent(row["saturated_fraction"])),
                Column(title="DoLP SNR", text=_snr),
            )
            shown = rows if self.all_steps else rows[:_MOST_STEPS]
            yield Table(title="counts above black [DN]", columns=columns, rows=tuple(shown))
            if len(shown) < len(rows):
                yield f"... and {len(rows) - len(shown)} more signals; `rigctl plan --all` prints all"
        for row in self.predictions or ():
            if "problem" in row:
                yield f"round {row['round']}: {row['problem']}"

    def as_json(self) -> dict[str, Json]:
        """Return the plan, and with a scene the predictions."""
        if self.predictions is None:
            return self.plan.content()
        return self.plan.content() | {"predictions": list(self.predictions)}


def _duration(duration_s: float) -> str:
    minutes, seconds = divmod(round(duration_s), 60)
    return f"{minutes} min {seconds} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


def _kind_line(kind: Json, steps: Sequence[Mapping[str, Json]]) -> str:
    """Return the number of frames of a kind, and their angles and exposures."""
    angles = [f"{step['angle_deg']:g}" for step in steps if step["angle_deg"] is not None]
    exposures = dict.fromkeys(_cell(step, "exposure_ms") for step in steps)
    at = [f"{', '.join(dict.fromkeys(angles))} deg"] if angles else []
    at += [" and ".join(exposures).replace("metered", "metered exposure") + ("" if "metered" in exposures else " ms")]
    return f"  {len(steps)} {kind}: {'; '.join(at)}"


def _pixels(frame: str) -> int:
    from rigctl.base.numbers import shown

    width, times, height = frame.partition("x")
    sizes = [int(text) if text.isdecimal() and len(text) <= _MOST_DIGITS else 0 for text in (width, height)]
    if not times or 0 in sizes:
        raise ConfigError(f"--frame: {shown(frame)} is not a size; write it like 782x582")
    return sizes[0] * sizes[1]


def _table(rows: Sequence[Mapping[str, Json]], names: tuple[str, ...]) -> Table[Mapping[str, Json]]:
    return Table(
        columns=tuple(Column(title=_TITLES[name], text=partial(_cell, name=name)) for name in names), rows=tuple(rows)
    )


def _cell(row: Mapping[str, Json], name: str) -> str:
    if name == "time":
        return str(row["utc"])[_DATE_DIGITS:_UTC_DIGITS]
    value = row[name]
    if name == "exposure_ms":
        return "metered" if value is None else f"{value:.6g}"
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:g}" if name == "angle_deg" else f"{value:.2f}"
    return str(value)[:_UTC_DIGITS]


def _count(row: Mapping[str, Any], name: str) -> str:
    return f"{row['mean_dn'][name]:.0f}"


def _snr(row: Mapping[str, Any]) -> str:
    if row["saturated_fraction"] > _MOST_SATURATED:
        return "none"
    return "not known" if row["dolp_snr"] is None else f"{row['dolp_snr']:.3g}"
