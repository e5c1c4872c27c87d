"""Interlocks: the checks of a running session, when each is made, and the reaction.

`TABLE` has one row for each interlock: when it is checked, the error that ends a session for it, and the check. The
session file states the reaction (off, note, retry, hold or stop) under the same name in its table [interlocks]. A new
interlock is a key there and a row here.
"""

import math
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np

from drivers.errors import DeviceError, LimitError, ProtocolError
from drivers.interfaces import Camera, StageStatus
from rigctl.base.numbers import NS_PER_S, wrapped
from rigctl.console import warn
from rigctl.errors import DataError, RunFolderError
from rigctl.files.session_file import PICTURE, Action, InterlockSection
from rigctl.rig.rig import cell_problem
from rigctl.runs.records import HOST_CLOCK_EVENT, SessionNoise
from rigctl.runs.writer import RunWriter
from rigctl.session.numbers import FrameSummary, mean_variance_dn2
from rigctl.session.plan import Step
from rigctl.session.rig_work import CapturedFrame
from rigctl.session.status import RegionDrift
from rigctl.session.timing import Pause, SessionClock, SteadyUtc

# The camera's exposure may differ from the requested one by one step of its clock.
_EXPOSURE_TOLERANCE = 0.01
_BYTES_PER_MB = 1_000_000
_MS_PER_S = 1000.0
_ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
_SIGMAS = 5.0
# A frame has room for a few remarks; the events have all of them.
_MOST_REMARKS = 5
# Properties of the scene are the same in every frame: one event a round is enough; each frame has the remark.
_LASTING = ("low_signal", "saturated")
# As GenICam names them, that of the sensor itself first; a camera warms up within minutes, and each reading is a
# question over the network.
_TEMPERATURES = ("SensorTemperature", "DeviceTemperature")
_TEMPERATURE_EACH_S = 10.0
Name = Literal[
    "angle",
    "black",
    "button",
    "cell",
    "clock",
    "counter",
    "disk",
    "drift",
    "exposure",
    "fault",
    "gone",
    "homed",
    "identical",
    "low_signal",
    "queue",
    "saturated",
    "settings",
    "sum_rule",
    "synchronised",
    "temperature",
]
# An interlock that is not satisfied: its name, and what was found and what to try.
Violation = tuple[Name, str]
Messages = Iterator[str]


@runtime_checkable
class TellsFeatures(Protocol):
    """A camera that lists its settings and sensors."""

    def features(self) -> Mapping[str, str]:
        """Return settings and measured values under the camera's own names."""


class Thermometer:
    """Reads the temperature of a camera, at most every ten seconds."""

    def __init__(self, camera: Camera, clock: SessionClock) -> None:
        self._camera, self._clock = camera, clock
        self._read_ns: int | None = None
        self._temperature_c: float | None = None

    def temperature_c(self) -> float | None:
        """Return the last reading [deg C]; None if the camera has no sensor."""
        now_ns = self._clock.monotonic_ns()
        if self._read_ns is None or now_ns - self._read_ns >= _TEMPERATURE_EACH_S * NS_PER_S:
            features = self._camera.features() if isinstance(self._camera, TellsFeatures) else {}
            self._read_ns = now_ns
            self._temperature_c = next((float(features[name]) for name in _TEMPERATURES if name in features), None)
        return self._temperature_c


class Interlocks:
    """Checks a session by the table, and retries, holds, stops or notes as the session file says.

    `react` and the `look` functions raise DeviceError or DataError if an interlock stops the session, and
    StopAskedError if a stop is requested while an interlock holds it.
    """

    def __init__(
        self,
        section: InterlockSection,
        pause: Pause,
        writer: RunWriter,
        utc: SteadyUtc,
        thermometer: Thermometer,
        noise: SessionNoise | None,
    ) -> None:
        self.section = section
        self._pause, self._writer, self._utc = pause, writer, utc
        self._thermometer, self._noise = thermometer, noise
        self._told_in: set[tuple[str, int]] = set()
        self._is_temperature_off = False
        self._means: dict[float, dict[float, tuple[float, float]]] = {}
        self.remarks: tuple[str, ...] = ()
        """Remarks for every frame from now on."""

    def found(self, name: Name, facts: object) -> tuple[Violation, ...]:
        """Return the violations of one interlock; an empty tuple if it is off."""
        if self._action(name) == "off":
            return ()
        messages = TABLE[name].check(facts, self.section)
        return tuple((name, message) for message in messages)

    def of_frames(self, frames: tuple[CapturedFrame, ...]) -> tuple[Violation, ...]:
        """Return the violations of an exposure; of the parts of a mosaic picture, only the first of each interlock."""
        names = [row.name for row in TABLE.values() if row.when == "frame"]
        if len(frames) == 1:
            return tuple(violation for name in names for violation in self.found(name, frames[0]))
        each = (violation for captured in frames for name in names for violation in self.found(name, captured))
        first: dict[str, Violation] = {}
        for violation in each:
            first.setdefault(violation[0], violation)
        return tuple(first.values())

    def of_cycle(self, seen: FrameSummary, drift: RegionDrift | None, *, ends_cycle: bool) -> tuple[Violation, ...]:
        """Add a frame; return the violations of the cycle that it ends."""
        sums: tuple[Violation, ...] = ()
        if seen.kind == "scene" and seen.angle_deg is not None:
            mean = seen.means[PICTURE]
            dn2 = 0.0 if self._noise is None else mean_variance_dn2(self._noise, mean, seen.exposure_s)
            self._means.setdefault(seen.exposure_s, {}).setdefault(seen.angle_deg, (mean.mean_dn, dn2))
            if ends_cycle:
                cycles, self._means = self._means, {}
                sums = tuple(found for cycle in cycles.values() for found in self.found("sum_rule", cycle))[:1]
        return sums + self.found("drift", drift)

    def look_at_clock(self, clock: SessionClock) -> None:
        """Check that the host's clock is synchronised."""
        self._writer.event(HOST_CLOCK_EVENT, utc_error_s=clock.utc_error_s())
        self._react_while("synchronised", clock.problem)

    def look_at_home(self, home: Callable[[], StageStatus | None]) -> None:
        """Home the stage, and again after each hold."""

        def found() -> tuple[Violation, ...]:
            status = home()
            return () if status is None else self.found("homed", status)

        for violation in found():
            self.react(violation, cleared=lambda: not found())

    def look_at_cell(self, captured: CapturedFrame, cell_deg: Sequence[float] | None) -> None:
        """Check the stated mosaic of polarizers with a picture of the scene."""
        if cell_deg is not None:
            problem = cell_problem(captured.frame.counts, cell_deg, bit_depth=captured.settings.bit_depth)
            self.react_all(self.found("cell", problem))

    def is_held_for_exposure(
        self, captured: CapturedFrame, metered_s: Callable[[], float | None], *, is_attended: bool
    ) -> bool:
        """Check the first frame of an exposure; return True if the session was held, so that the frame is taken again.

        With a person at the terminal (`is_attended`) the session is not held, but warns.
        """
        is_held = False
        for violation in self.found("exposure", (captured, metered_s)):
            action = self._action("exposure")
            is_held = action == "hold" and not is_attended
            if is_held or action == "stop":
                self.react(violation)
            else:
                self.note(violation)
                warn(violation[1])
        return is_held

    def look_ahead(self, frames: int, *, frame_bytes: int) -> None:
        """Warn if the disk has no room for all frames. The session starts nevertheless."""
        run = self._writer.path
        room = int((_free_bytes(run) - self.section.disk_free_mb * _BYTES_PER_MB) // frame_bytes)
        if room < frames:
            need_mb = frames * frame_bytes / _BYTES_PER_MB
            short = (
                f"{run}: {frames} frames are to come, {need_mb:.0f} MB; the disk has room for {max(room, 0)} of them"
            )
            warn(short)
            self._writer.event("disk is short", found=short)

    def look_around(self) -> None:
        """Check clock, disk and temperature between two frames."""
        for violation in self.found("clock", self._utc.jump_s()):
            self.remarks = (*self.remarks, violation[1])[-_MOST_REMARKS:]
            self.react(violation)
        self._react_while("disk", lambda: self._writer.path)
        temperature_c = self._thermometer.temperature_c
        was_off = self._is_temperature_off
        self._is_temperature_off = any(_temperature(temperature_c(), self.section))
        if self._is_temperature_off and not was_off:
            self._react_while("temperature", temperature_c)

    def note(self, violation: Violation, **facts: int) -> None:
        """Note a violation and the reaction as an event."""
        action = self._action(violation[0])
        self._writer.event("interlock", interlock=violation[0], action=action, message=violation[1], **facts)

    def react(self, violation: Violation, *, cleared: Callable[[], bool] = lambda: False) -> None:
        """Note a violation; hold until it is cleared, or stop, as the session file says."""
        self.note(violation)
        if self._action(violation[0]) == "stop":
            raise _failure_of(violation)
        if self._action(violation[0]) == "hold":
            self._pause.hold(violation[1], cleared=cleared)

    def react_all(self, violations: tuple[Violation, ...]) -> None:
        """React to several violations."""
        for violation in violations:
            self.react(violation)

    def wants_again(self, violation: Violation, step: Step, *, tries_left: int) -> bool:
        """Note a violation of a frame; return whether to take the frame again. After the last retry, stop."""
        action = self._action(violation[0])
        if action != "note" or violation[0] not in _LASTING or (violation[0], step.round) not in self._told_in:
            self.note(violation, sequence=step.sequence)
        self._told_in.add((violation[0], step.round))
        if action == "stop" or (action == "retry" and tries_left <= 0):
            raise _failure_of(violation)
        if action == "hold":
            self._pause.hold(violation[1], cleared=lambda: False)
        return action in ("retry", "hold")

    def _action(self, name: Name) -> Action:
        action: Action = getattr(self.section, name)
        return action

    def _react_while(self, name: Name, facts: Callable[[], object]) -> None:
        for violation in self.found(name, facts()):
            self.react(violation, cleared=lambda: not self.found(name, facts()))


class Interlock(NamedTuple):
    """One row: its name, when it is checked, the error that ends a session for it, and the check."""

    name: Name
    when: Literal["start", "between frames", "first frame", "frame", "cycle", "as it happens"]
    error: type[DeviceError] | type[DataError]
    check: Callable[..., Messages]


def _angle(captured: CapturedFrame, _: InterlockSection) -> Messages:
    move = captured.move
    if move is None or not captured.is_new_move:
        return
    if abs(wrapped(move.position.angle_deg - move.target_deg, turn=360.0)) > captured.tolerance_deg:
        text = f"stage: asked for {move.target_deg:g} deg it stands at {move.position.angle_deg:g} deg"
        yield f"{text}, allowed are {captured.tolerance_deg:g} deg"


def _button(captured: CapturedFrame, _: InterlockSection) -> Messages:
    move = captured.move
    if move is not None and captured.is_new_move and move.remarks:
        yield f"stage: {'; '.join(move.remarks)}: was it touched?"


def _settings(captured: CapturedFrame, _: InterlockSection) -> Messages:
    (exposure_s, gain_db), read_back = captured.asked, captured.settings
    if abs(read_back.exposure_s - exposure_s) > _EXPOSURE_TOLERANCE * exposure_s:
        yield f"camera: asked for an exposure of {exposure_s:g} s it says that it took {read_back.exposure_s:g} s"
    elif read_back.gain_db != gain_db:
        yield f"camera: asked for a gain of {gain_db:g} dB it says that it took {read_back.gain_db:g} dB"
    if captured.frame.settings != read_back:
        text = f"camera: was set to {read_back} and took the frame with {captured.frame.settings}"
        yield f"{text}: switch its automatic exposure and gain off"


def _counter(captured: CapturedFrame, _: InterlockSection) -> Messages:
    """Report an old picture (number does not rise) or lost ones (gap). A free-running camera skips numbers anyway."""
    number, last = captured.frame.sequence, captured.number_before
    if last is None:
        return
    said, missing = f"camera: its frame counter says {number} after {last}", number - last - 1
    if missing < 0:
        yield f"{said}: it sent an old picture, or was restarted"
    elif missing and captured.is_triggered:
        yield f"{said}: {missing} pictures were lost on their way"


def _identical(captured: CapturedFrame, _: InterlockSection) -> Messages:
    """Report a picture with exactly the noise of the one before."""
    counts, before = captured.frame.counts, captured.last_counts
    # Comparing two rows in the middle first saves time.
    few = slice(len(counts) // 2, len(counts) // 2 + 2)
    is_alike = before is not None and np.array_equal(counts[few], before[few]) and np.array_equal(counts, before)
    if is_alike and not captured.is_flat:
        text = f"camera: frame {captured.frame.sequence} is identical to the one before, down to the noise"
        yield f"{text}: it sent an old picture again. Restart the camera"


def _black(captured: CapturedFrame, _: InterlockSection) -> Messages:
    frame = captured.frame
    if captured.is_blank:
        text = f"camera: frame {frame.sequence} has the value {frame.counts.flat[0]} everywhere"
        yield f"{text}: no picture came. Check cable, bandwidth and lens cap"


def _exposure(first: tuple[CapturedFrame, Callable[[], float | None]], section: InterlockSection) -> Messages:
    """Check the first scene frame; the second element of `first` meters the light if the frame is too bright."""
    captured, metered_s = first
    share, exposure_ms = captured.saturated_fraction, captured.asked[0] * _MS_PER_S
    if captured.kind == "scene" and share > section.exposure_fraction:
        text = f"{100 * share:.0f} % of the pixels of the first frame are saturated at {exposure_ms:g} ms"
        proposed_s = metered_s()
        advice = "stop down" if proposed_s is None else f"exposure_ms = {proposed_s * _MS_PER_S:.3g} fills the range"
        yield f"{text}; {advice}. `rigctl stop` ends the session, `rigctl resume` continues it as it is"


def _saturated(captured: CapturedFrame, section: InterlockSection) -> Messages:
    share = captured.saturated_fraction
    if captured.kind == "scene" and not captured.is_blank and share > section.saturated_fraction:
        yield f"{100 * share:.2f} % of the pixels are saturated, allowed are {100 * section.saturated_fraction:g} %"


def _low_signal(captured: CapturedFrame, section: InterlockSection) -> Messages:
    if captured.kind != "scene" or captured.is_blank:
        return
    frame = captured.frame
    level_dn = section.low_signal_level * (2**frame.settings.bit_depth - 1)
    if captured.range_dn[0] >= level_dn:
        return
    low = float(np.count_nonzero(frame.counts < math.ceil(level_dn)) / frame.counts.size)
    if low > section.low_signal_fraction:
        text = f"{100 * low:.1f} % of the pixels have less than {level_dn:.0f} DN"
        yield f"{text}, allowed are {100 * section.low_signal_fraction:g} %: expose longer, or bracket"


def _homed(status: StageStatus, _: InterlockSection) -> Messages:
    if not status.homed:
        text = f"stage: after its search for the reference mark it says {status.meaning} ({status.code})"
        yield f"{text}, and not that it has found it: its angles mean nothing"


def _synchronised(problem: str | None, _: InterlockSection) -> Messages:
    if problem is not None:
        yield f"the host's clock is {problem}: times and the sun's place rest on it"


def _clock(jump_s: float, section: InterlockSection) -> Messages:
    if abs(jump_s) > section.clock_jump_s:
        yield f"the host's clock was set by {jump_s:+.1f} s; the schedule keeps to the time by which it began"


def _disk(run: Path, section: InterlockSection) -> Messages:
    free_mb = _free_bytes(run) / _BYTES_PER_MB
    if free_mb < section.disk_free_mb:
        yield (
            f"{run}: only {free_mb:.0f} MB are free on this disk, and {section.disk_free_mb:g} MB must stay free; "
            f"delete files"
        )


def _temperature(temperature_c: float | None, section: InterlockSection) -> Messages:
    least_c, most_c = section.temperature_least_c, section.temperature_most_c
    if temperature_c is not None and not least_c <= temperature_c <= most_c:
        text = f"camera: it is at {temperature_c:.1f} deg C, allowed are {least_c:g} to {most_c:g} deg C"
        yield f"{text}: its dark current is not the calibrated one. Shade or warm it"


def _sum_rule(cycle: Mapping[float, tuple[float, float]], section: InterlockSection) -> Messages:
    """Check the mean and noise variance by angle. Black levels cancel between the sums."""
    if not set(_ANGLES_DEG) <= set(cycle):
        return
    i0, i45, i90, i135 = (cycle[angle][0] for angle in _ANGLES_DEG)
    noise_dn = math.sqrt(sum(cycle[angle][1] for angle in _ANGLES_DEG))
    allowed = section.sum_rule_tolerance * (i0 + i45 + i90 + i135) / 2.0 + _SIGMAS * noise_dn
    if abs(i0 + i90 - i45 - i135) > allowed:
        sums = f"I0 + I90 is {i0 + i90:.1f} DN and I45 + I135 is {i45 + i135:.1f} DN"
        yield f"{sums}, allowed are {allowed:.1f} DN apart: light, exposure or an angle changed within the cycle"


def _drift(drift: RegionDrift | None, section: InterlockSection) -> Messages:
    if drift is None or abs(drift.change) <= section.drift_tolerance + _SIGMAS * (drift.sigma or 0.0):
        return
    text = f"the light changed by {100 * drift.change:+.2f} % in {drift.over_s:.1f} s"
    allowed = f"allowed are {100 * section.drift_tolerance:g} % from cycle to cycle"
    yield f"{text}, {allowed}: polarization of this cycle is doubtful"


def _found_elsewhere(problem: str | None, _: InterlockSection) -> Messages:
    """Yield a problem that was found elsewhere: a driver's error, a full queue, a mosaic that contradicts the light."""
    if problem is not None:
        yield problem


TABLE: Mapping[str, Interlock] = {
    row.name: row
    for row in (
        Interlock("homed", "start", LimitError, _homed),
        Interlock("synchronised", "start", DataError, _synchronised),
        Interlock("clock", "between frames", DataError, _clock),
        Interlock("disk", "between frames", DataError, _disk),
        Interlock("temperature", "between frames", LimitError, _temperature),
        Interlock("exposure", "first frame", DataError, _exposure),
        Interlock("angle", "frame", LimitError, _angle),
        Interlock("button", "frame", LimitError, _button),
        Interlock("settings", "frame", LimitError, _settings),
        Interlock("counter", "frame", LimitError, _counter),
        Interlock("identical", "frame", ProtocolError, _identical),
        Interlock("black", "frame", ProtocolError, _black),
        Interlock("saturated", "frame", DataError, _saturated),
        Interlock("low_signal", "frame", DataError, _low_signal),
        Interlock("sum_rule", "cycle", DataError, _sum_rule),
        Interlock("drift", "cycle", DataError, _drift),
        Interlock("cell", "as it happens", DataError, _found_elsewhere),
        Interlock("queue", "as it happens", LimitError, _found_elsewhere),
        Interlock("gone", "as it happens", LimitError, _found_elsewhere),
        Interlock("fault", "as it happens", LimitError, _found_elsewhere),
    )
}


def _failure_of(violation: Violation) -> DeviceError | DataError:
    error = TABLE[violation[0]].error
    if error is DataError:
        return DataError(f"{violation[1]} (interlock {violation[0]!r}); `rigctl resume` continues")
    return error(violation[1])


def _free_bytes(run: Path) -> int:
    try:
        return shutil.disk_usage(run).free
    except OSError as error:
        text = "its folder was moved or deleted while the session ran, or its disk is gone"
        raise RunFolderError(f"{run}: {text}: {error.strerror}; what was taken until then is in it") from error
