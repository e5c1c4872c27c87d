"""Prepares a session before any device is opened: reads files, selects calibrations, chooses cycles, refuses errors."""

import json
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from rigctl.base.numbers import utc_text
from rigctl.calibrations.kinds import CalibrationKind, MadeFor, made_for_rig
from rigctl.calibrations.noise import NoiseParameters, read_noise_file
from rigctl.calibrations.polarizer import read_polarizer_file, require_polarizer_fits
from rigctl.calibrations.store import NONE, RigSelection, selected_for_rig
from rigctl.console import json_text, note, warn
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import RoofChange
from rigctl.files.regions import load_regions
from rigctl.files.rig_file import RigFile, load_rig, placeholder_doubt
from rigctl.files.session_file import SessionFile, load_session
from rigctl.rig.rig import Rig, Trace, open_rig, require_drivers
from rigctl.rig.simulation import rehearse, with_simulation
from rigctl.runs.writer import require_new_folder
from rigctl.session.numbers import noise_numbers
from rigctl.session.plan import Step, grouping_cost, missing_axes, plan_steps, round_times_ns
from rigctl.session.take import Outcome, require_person, take_session
from rigctl.session.timing import SessionClock, clock_of


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedSession:
    """A session before any device is opened."""

    files: dict[str, Path]  #: rig and session file
    rig_file: RigFile
    session_file: SessionFile  #: with the cycles that reach the target
    noise: NoiseParameters | None
    polarizer: Path | None  #: polarizer calibration; it must be of the same devices
    chosen: tuple[str, ...]  #: which cycles were chosen for the target
    doubts: tuple[str, ...]
    selected: RigSelection  #: calibrations that were selected from the store

    @property
    def steps(self) -> tuple[Step, ...]:
        """The frames of one round in the order of time."""
        return plan_steps(self.session_file, cell_deg=self.rig_file.cell_deg)

    def report(self) -> None:
        """Report calibrations and cycles that were chosen, and doubts."""
        self.selected.report()
        for line in self.chosen:
            note(f"--target-dolp-sigma: {line}")
        for doubt in self.doubts:
            warn(doubt)


def prepare_session(
    rig: Path,
    session: Path,
    *,
    noise: Path | None = None,
    polarizer: Path | None = None,
    store: Path | None = None,
    scene: Path | None = None,
    target_dolp_sigma: float | None = None,
    clock_ns: int | None = None,
    perturb: RoofChange | None = None,
    regions: Path | None = None,
) -> PreparedSession:
    """Return a session ready to be taken; calibrations that are not named are selected from the store."""
    rig_file = with_simulation(load_rig(rig), clock_ns=clock_ns, perturb=perturb)
    session_file = load_session(session) if regions is None else _with_regions(load_session(session), regions)
    named: dict[CalibrationKind, Path | None] = {"noise": noise, "polarizer": polarizer}
    selected = selected_for_rig(rig_file, rig, now_ns=clock_of(rig_file).utc_ns(), store=store, named=named)
    found = selected.files | {kind: path for kind, path in named.items() if path not in (None, NONE)}
    parameters = read_noise_file(found["noise"]) if "noise" in found else None
    session_file, chosen = with_target(session_file, parameters, scene=scene, target_dolp_sigma=target_dolp_sigma)
    grouping = grouping_cost(session_file) if rig_file.cell_deg is None else None
    axes = None if session_file.polarimetry else missing_axes(plan_steps(session_file, cell_deg=rig_file.cell_deg))
    doubts = (placeholder_doubt(rig_file), grouping, axes)
    return PreparedSession(
        files={"rig": rig, "session": session},
        rig_file=rig_file,
        session_file=session_file,
        noise=parameters,
        polarizer=found.get("polarizer"),
        chosen=chosen,
        doubts=tuple(doubt for doubt in doubts if doubt is not None),
        selected=selected,
    )


def _with_regions(session: SessionFile, file: Path) -> SessionFile:
    """Return a session with the regions of a file; they replace its own regions of the same names."""
    drawn = load_regions(file)
    names = {region.name for region in drawn}
    return session.model_copy(update={"regions": [*drawn, *(own for own in session.regions if own.name not in names)]})


def with_target(
    session: SessionFile, noise: NoiseParameters | None, *, scene: Path | None, target_dolp_sigma: float | None
) -> tuple[SessionFile, tuple[str, ...]]:
    """Return a session with the cycles that reach a target, and a sentence about the choice."""
    if (scene is None) != (target_dolp_sigma is None):
        raise ConfigError("--scene and --target-dolp-sigma: give both, or neither")
    if scene is None or target_dolp_sigma is None:
        return session, ()
    # The model is imported only if needed, so that a session without a target starts at once.
    from rigctl.files.scene_file import load_scene
    from rigctl.session.forecast import with_cycles_for

    return with_cycles_for(session, load_scene(scene), noise, target_dolp_sigma=target_dolp_sigma)


def require_takeable(
    prepared: PreparedSession,
    out: Path,
    *,
    at_ns: int | None = None,
    until_ns: int | None = None,
    asks_by_hold: bool = False,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Raise any error that shows before a device is opened; return doubts, and the sun of a simulated roof."""
    rig_file, session = prepared.rig_file, prepared.session_file
    require_new_folder(out)
    now_ns = clock_of(rig_file).utc_ns() if at_ns is None else at_ns
    rounds = round_times_ns(session, rig_file.site, now_ns=now_ns, until_ns=until_ns)
    steps = plan_steps(session, rounds, cell_deg=rig_file.cell_deg)
    axes = missing_axes(steps)
    if axes is not None and session.polarimetry:
        raise ConfigError(
            f"{axes}. Add angles, or write polarimetry = false in the session file to take them all the same"
        )
    require_person(steps, are_asked=rig_file.is_simulated or asks_by_hold)
    require_drivers(rig_file)
    doubts = _calibration_doubts(prepared, made_for_rig(rig_file, now_utc=utc_text(now_ns)))
    if rig_file.simulation is None:
        return doubts, ()
    times_ns = sorted({now_ns if due_ns is None else due_ns for due_ns in rounds})
    exposures_s = sorted({step.exposure_s for step in steps if step.exposure_s is not None})
    return doubts, rehearse(rig_file, times_ns=times_ns, exposures_s=exposures_s, regions=session.regions)


def take_prepared(
    prepared: PreparedSession,
    out: Path,
    *,
    at_ns: int | None = None,
    until_ns: int | None = None,
    asks_by_hold: bool = False,
    trace: Trace | None = None,
) -> Outcome:
    """Take a session into a new run folder; report doubts about the calibrations once the devices are open."""
    clock = clock_of(prepared.rig_file)

    def opener() -> AbstractContextManager[Rig]:
        opened = _open_calibrated_rig(prepared, out, clock=clock)
        return opened if trace is None else trace.of(opened)

    return take_session(
        prepared.rig_file,
        prepared.session_file,
        out,
        files=prepared.files,
        at_ns=at_ns,
        until_ns=until_ns,
        noise=None if prepared.noise is None else noise_numbers(prepared.noise),
        clock=clock,
        opener=opener,
        asks_by_hold=asks_by_hold,
        calibrations=json.loads(json_text(prepared.selected.as_json())),
    )


@contextmanager
def _open_calibrated_rig(prepared: PreparedSession, run: Path, *, clock: SessionClock) -> Iterator[Rig]:
    """Open the devices of a rig and check that the calibrations are of these devices; warn of doubts."""
    rig_file = prepared.rig_file
    with open_rig(rig_file, session_name=prepared.session_file.name, run=run, clock=clock.simulated) as rig:
        used = replace(
            made_for_rig(rig_file, now_utc=utc_text(clock.utc_ns())),
            camera_serial=rig.camera_identity.serial_number,
            stage_serial=None if rig.stage_identity is None else rig.stage_identity.serial_number,
        )
        for doubt in _calibration_doubts(prepared, used):
            warn(doubt)
        yield rig


def _calibration_doubts(prepared: PreparedSession, used: MadeFor) -> tuple[str, ...]:
    """Return doubts about the calibrations; raise DataError if one belongs to other devices."""
    try:
        doubts = () if prepared.noise is None else prepared.noise.doubts(used)
        if prepared.polarizer is not None:
            polarizer = read_polarizer_file(prepared.polarizer)
            doubts += require_polarizer_fits(polarizer, used, polarizer=prepared.rig_file.polarizer)
    except DataError as error:
        if not prepared.selected.files:
            raise
        selected = ", ".join(str(file) for file in prepared.selected.files.values())
        raise DataError(
            f"{error}\n  selected from the store: {selected}. State camera.serial_number and stage.serial_number in "
            "the rig file to select those of the right devices; --noise none and --polarizer none select none"
        ) from error
    return doubts
