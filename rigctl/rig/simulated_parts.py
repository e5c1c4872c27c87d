"""Parts of a simulated rig, made from its rig file: clock, camera address, lens, noise, stage, world, camera.

The address of a simulated camera carries options after a question mark: the log of what is true of its frames
(``truth=FILE``), polarizers on its pixels, and faults of a camera on the network::

    sim:gc780?truth=/tmp/truth.jsonl
    sim:gige?lost=0.001&hang=20
    sim:mosaic?cell=90,45,135,0&crosstalk=0.02&angle_error_deg=0.5

The noise of a frame depends on the place of the frame in its session, so that a resumed session gives the same frames
as one without an interruption.
"""

import hashlib
import re
import threading
import time
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, assert_never

import numpy as np
from numpy.typing import NDArray

from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded, write_durably
from rigctl.base.numbers import NS_PER_S
from rigctl.errors import ConfigError
from rigctl.files.regions import Region, masks
from rigctl.files.rig_file import (
    MOST_DEFOCUS_MM,
    BeamWanderSection,
    CosmicHitsSection,
    DriftSection,
    FixedPatternSection,
    PointSpreadSection,
    RenderingSection,
    RigFile,
    SimulatedCamera,
    SimulatedPolarizer,
    SimulationSection,
    SmearSection,
    VignettingSection,
    load_rig,
)
from rigctl.files.scene_file import SceneFile, SceneRegion
from rigctl.runs.folder import read_run
from rigctl.runs.records import EXPOSURE_PARTS, FrameRecord, RunEvent, metered_exposures, read_events
from sim_devices.camera import SimCamera
from sim_devices.cameras.gige_server import ClockTruth, GigeFaults
from sim_devices.exposure import (
    Detector,
    Lens,
    RenderingEffect,
    Stream,
    beam_wander,
    cosmic_hits,
    defocus,
    drift,
    fixed_pattern,
    generator,
    point_spread,
    smear,
    vignetting,
)
from sim_devices.micro_polarizers import MicroPolarizers, crosstalk
from sim_devices.stages.catalogue import parse_stage_address
from sim_devices.stages.options import StageOptions
from sim_devices.stages.stage import SimulatedStage
from sim_devices.truth_log import TruthLog
from sim_devices.world import Polarizer, Surface, World, paint_scene

# A camera at this address is served on the network, at an address of this machine.
ON_NETWORK = "sim:gige"
THIS_MACHINE = "127.0.0.1"
# A camera with polarizers on its pixels.
MOSAIC = "sim:mosaic"
# The camera that `rigctl sim camera` serves to other programs; rig files do not use it.
SERVED = "sim:served"
_PLAIN = "sim:gc780"
_SIMULATED = (_PLAIN, ON_NETWORK, MOSAIC)
# Option of an address: field, function that reads its text, check of the value, and a text on allowed values.
_Key = tuple[str, Callable[[str], Any], Callable[[Any], bool], str]


def _any(_: object) -> bool:
    return True


def _angles(text: str) -> tuple[float, ...]:
    return tuple(map(float, text.split(",")))


def _picture(field: str) -> _Key:
    text = "whole number from 2 on: the driver takes the first picture when it opens the camera"
    return (field, int, lambda number: number >= 2, text)


def _seconds(field: str) -> _Key:
    return (field, float, lambda seconds: 0.0 <= seconds <= 3600.0, "number of seconds, 0 to 3600")


_TRUTH: dict[str, _Key] = {"truth": ("truth", Path, lambda file: bool(file.name), "file, such as truth=/tmp/t.jsonl")}
_POLARIZERS: dict[str, _Key] = {
    "cell": ("cell_deg", _angles, _any, "list of angles, such as cell=90,45,135,0"),
    "angle_error_deg": ("place_error_deg", float, _any, "number"),
    "pixel_error_deg": ("pixel_error_deg", float, _any, "number"),
    "crosstalk": ("crosstalk", float, _any, "number"),
}
_FAULTS: dict[str, _Key] = {
    "lost": ("lost_share", float, lambda share: 0.0 <= share < 1.0, "number from 0 to below 1"),
    "resend": ("resends", {"0": False, "1": True}.__getitem__, _any, "of 0 and 1"),
    "die": _picture("die"),
    "restart": _picture("restart"),
    "off_s": _seconds("off_s"),
    "hang": _picture("hang"),
    "hang_s": _seconds("hang_s"),
    "forget": _picture("forget"),
    "clock_ppm": ("drift_ppm", float, lambda ppm: abs(ppm) <= 1000.0, "number from -1000 to 1000"),
    "ptp_offset_ns": (
        "ptp_offset_ns",
        int,
        lambda number: abs(number) <= 10**9,
        "whole number of nanoseconds, a second at most",
    ),
}
# The camera's table in a rig file, and its line with the defocus.
_TABLE = re.compile(r"^\[simulation\.camera\][^\n]*\n(?:(?!\[)[^\n]*(?:\n|\Z))*", re.MULTILINE)
_LINE = re.compile(r"^(defocus_mm\s*=\s*)[^#\r\n]*?([ \t]*#[^\r\n]*)?(\r?)$", re.MULTILINE)
_UM_PER_MM, _MM_PER_M = 1e3, 1e3
# Events after which a session begins again.
_BEGINNINGS = ("resumed", "devices opened again")
# More than the pictures between two beginnings, including damaged ones and those of a free-running camera.
_NUMBERS_EACH = 10_000_000
# Effects that move or blur the light before it reaches polarizers on the pixels.
_BEFORE_POLARIZERS = ("point-spread", "beam-wander")
# Second number of a seed sequence: each use of a rig's seed has a stream of its own.
TEXTURE_STREAM = 1
FloatArray = NDArray[np.float64]


class SimulatedClock:
    """A clock that waits by moving on."""

    def __init__(self, start_ns: int) -> None:
        self._now_ns = start_ns
        self._lock = threading.Lock()

    def utc_ns(self) -> int:
        """Return the time since 1970 UTC [ns]."""
        with self._lock:
            return self._now_ns

    def monotonic_ns(self) -> int:
        """Return the time since 1970 UTC [ns]; this clock is never set."""
        return self.utc_ns()

    def sleep(self, duration_s: float) -> None:
        """Move the time on by a duration [s]; return at once."""
        with self._lock:
            self._now_ns += max(0, round(duration_s * NS_PER_S))

    def reach(self, time_ns: int) -> None:
        """Move the time on to a point [ns], unless it has passed."""
        with self._lock:
            self._now_ns = max(self._now_ns, time_ns)


def require_known_camera(address: str, *, is_mosaic: bool = False) -> None:
    """Raise ConfigError for an unknown simulated camera, or one that does not match mosaic_deg of the rig file."""
    name, _, options = address.partition("?")
    if is_mosaic and name.startswith("sim:") and name not in (MOSAIC, ON_NETWORK, SERVED):
        raise ConfigError(f"camera.address: {name} has no polarizers on its pixels; {MOSAIC} and {ON_NETWORK} may have")
    if name == MOSAIC and not is_mosaic:
        raise ConfigError(f"camera.address: {name} has polarizers on its pixels: state mosaic_deg = [90, 45, 135, 0]")
    if name.startswith("sim:") and name not in (*_SIMULATED, SERVED):
        raise ConfigError(f"camera.address: there is no simulated camera {name!r}; there are {', '.join(_SIMULATED)}")
    if name in (_PLAIN, MOSAIC):
        allowed = _TRUTH if name == _PLAIN else _TRUTH | _POLARIZERS
        unknown = [option for option in options.split("&") if option and option.partition("=")[0] not in allowed]
        if unknown:
            keys = ", ".join(sorted(allowed)).replace("truth", "truth=FILE")
            raise ConfigError(f"camera.address: {unknown[0]!r} is no key of {name}: allowed is {keys}")


def split_truth(address: str) -> tuple[str, TruthLog | None]:
    """Return an address without its truth option, and the log of that option."""
    name, _, options = address.partition("?")
    found, rest = _split(options, _TRUTH)
    plain = f"{name}?{rest}" if rest else name
    if not found:
        return plain, None
    try:
        return plain, TruthLog(found["truth"])
    except OSError as error:
        raise ConfigError(f"camera.address: truth={found['truth']}: cannot be written: {error.strerror}") from error


def split_polarizers(options: str) -> tuple[MicroPolarizers, str]:
    """Return the polarizers on the pixels that an address describes, and the other options."""
    found, rest = _split(options, _POLARIZERS)
    try:
        return MicroPolarizers(**found), rest
    except ValueError as error:
        raise ConfigError(f"camera.address: {error}") from error


def split_faults(options: str) -> tuple[GigeFaults, str]:
    """Return the faults that an address states, and the other options."""
    found, rest = _split(options, _FAULTS)
    clock = {name: found.pop(name) for name in ("drift_ppm", "ptp_offset_ns") if name in found}
    if clock:
        found["clock"] = ClockTruth(**clock, has_ptp="ptp_offset_ns" in clock)
    return GigeFaults(**found), rest


def _split(options: str, keys: Mapping[str, _Key]) -> tuple[dict[str, Any], str]:
    """Return the values of known options by field, and the unknown options."""
    values: dict[str, Any] = {}
    rest, problems = [], []
    for option in filter(None, options.split("&")):
        key, _, text = option.partition("=")
        if key not in keys:
            rest.append(option)
            continue
        field, read, is_allowed, allowed = keys[key]
        try:
            value = read(text)
            is_good = is_allowed(value) and field not in values
        except (ValueError, LookupError):
            is_good = False
        if is_good:
            values[field] = value
        else:
            problems.append(f"{option}: must be one {allowed}")
    if problems:
        raise ConfigError(f"camera.address: {'; '.join(problems)}")
    return values, "&".join(rest)


class LensPosition:
    """The focus of a simulated lens, read again whenever its rig file changes."""

    def __init__(self, simulation: SimulationSection) -> None:
        self._file = simulation.file
        self._defocus_mm = simulation.camera.defocus_mm
        self._seen = self._state()

    def defocus_m(self) -> float:
        """Return the distance of the detector behind the focus [m]; the last known one if the file cannot be read."""
        state = self._state()
        if state != self._seen and self._file is not None:
            self._seen = state
            self._defocus_mm = _stated_mm(self._file, self._defocus_mm)
        return self._defocus_mm / _MM_PER_M

    def _state(self) -> tuple[int, int] | None:
        """Return numbers that change when the file is written."""
        try:
            found = None if self._file is None else self._file.stat()
        except OSError:
            return None
        return None if found is None else (found.st_mtime_ns, found.st_ino)


def _stated_mm(file: Path, before_mm: float) -> float:
    try:
        content = tomllib.loads(read_bounded(file, MOST_TEXT_BYTES).decode("utf-8"))
        stated_mm = float(content["simulation"]["camera"].get("defocus_mm", 0.0))
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return before_mm
    return stated_mm if abs(stated_mm) <= MOST_DEFOCUS_MM else before_mm


def turn_lens(rig: Path, *, defocus_mm: float) -> tuple[float, float]:
    """Turn the lens of a simulated camera, even while it runs, by changing one key of its rig file.

    Return the previous defocus [mm], and the diameter of the disk to which a point is now blurred [pixels].
    """
    if not abs(defocus_mm) <= MOST_DEFOCUS_MM:
        raise ConfigError(
            f"--defocus-mm: is {defocus_mm:g}; must be from {-MOST_DEFOCUS_MM:g} to {MOST_DEFOCUS_MM:g} mm"
        )
    simulation = load_rig(rig).simulation
    if simulation is None:
        raise ConfigError(f"{rig}: has no [simulation]: the lens of a real camera is turned by hand")
    camera = simulation.camera
    # As bytes, to keep the ends of lines.
    text = read_bounded(rig, MOST_TEXT_BYTES).decode("utf-8")
    table = _TABLE.search(text)
    if table is None:
        raise ConfigError(f"{rig}: has no table [simulation.camera] of its own to write into")
    inside = _with_line(table[0], f"{defocus_mm:g}")
    try:
        write_durably(rig, (text[: table.start()] + inside + text[table.end() :]).encode("utf-8"))
    except OSError as error:
        raise ConfigError(f"{rig}: cannot be written: {error.strerror}") from error
    cone = camera.aperture_diameter_mm / camera.focal_length_mm
    return camera.defocus_mm, cone * abs(defocus_mm) * _UM_PER_MM / camera.pixel_pitch_um


def _with_line(table: str, number: str) -> str:
    was = _LINE.search(table)
    if was is None:
        end = "\r\n" if table.partition("\n")[0].endswith("\r") else "\n"
        return table.replace("\n", f"\ndefocus_mm = {number}{end}", 1)
    return f"{table[: was.start()]}{was[1]}{number}{was[2] or ''}{was[3]}{table[was.end() :]}"


class NoiseNumbers:
    """Gives each frame the number that it would have in a session without an interruption."""

    def __init__(self, camera: SimCamera, run: Path | None) -> None:
        self._camera, self._run = camera, run
        self._last: int | None = None

    def begin_step(self, sequence: int) -> bool:
        """Set the camera to the number of a step; return whether its numbers jump."""
        number = self._first_number(sequence) if self._last is None else self._after(sequence, self._last)
        self._last = sequence
        if number <= self._camera.next_sequence:
            return False
        self._camera.go_on_from(number)
        return True

    def _after(self, sequence: int, last: int) -> int:
        """Return the number of a step; steps that were left out before it count, too."""
        return self._camera.next_sequence + sequence - last - 1

    def _first_number(self, sequence: int) -> int:
        if self._run is None or not self._run.is_dir():
            return 0
        return number_after(read_run(self._run).frames, read_events(self._run), sequence)


class FreshNoise:
    """Draws new noise after each interruption, for a simulated camera on the network.

    On the network pictures are lost and taken again, so the noise cannot continue where it was.
    """

    def __init__(self, camera: SimCamera, run: Path | None) -> None:
        self._camera, self._run = camera, run
        self._has_begun = False

    def begin_step(self, sequence: int) -> bool:
        """Skip the numbers of earlier parts before the first step; the camera's own numbers never jump."""
        if not self._has_begun and self._run is not None and self._run.is_dir():
            beginnings = sum(event.event in _BEGINNINGS for event in read_events(self._run))
            if beginnings > 0:
                self._camera.go_on_from(beginnings * _NUMBERS_EACH)
        self._has_begun = True
        return False


def number_after(frames: Iterable[FrameRecord], events: Iterable[RunEvent], sequence: int) -> int:
    """Return the number that a step would have in a session without an interruption."""
    used = max((following for _, _, following in metered_exposures(events)), default=0)
    before = [frame for frame in frames if _place(frame) < sequence and frame.camera_frame is not None]
    if not before:
        return used
    last = max(before, key=_place)
    return max((last.camera_frame or 0) + sequence - _place(last), used)


def _place(frame: FrameRecord) -> int:
    """Return the number of the exposure of a frame in the session, from 0."""
    return frame.sequence if frame.exposure_id is None else frame.exposure_id // EXPOSURE_PARTS


def stage_options(port: str, seed: int) -> StageOptions:
    """Return the options of a simulated stage; without a seed, the seed of the rig is added."""
    options = parse_stage_address(port)
    return options if "seed=" in port else replace(options, seed=seed)


def on_sensor(regions: Sequence[Region], rig: RigFile, camera: SimulatedCamera) -> dict[str, NDArray[np.bool_]]:
    """Return the sensor pixels of each region; regions are drawn on frames, whose pixels may be whole cells."""
    width, height = frame_size(rig, camera)
    inside = masks(list(regions), width=width, height=height)
    if (width, height) == (camera.width, camera.height):
        return inside
    return {name: mask.repeat(2, axis=0).repeat(2, axis=1) for name, mask in inside.items()}


def frame_size(rig: RigFile, camera: SimulatedCamera) -> tuple[int, int]:
    """Return width and height of the frames of a simulated rig."""
    if rig.camera.mosaic_deg is None:
        return camera.width, camera.height
    if camera.width % 2 or camera.height % 2:
        raise ValueError(f"the sensor has {camera.width} x {camera.height} pixels; cells of 2 x 2 need even sides")
    halved = 2 if rig.camera.interpolation == "none" else 1
    return camera.width // halved, camera.height // halved


def stated_radiance(scene: SceneFile, rig: RigFile, camera: SimulatedCamera, seed: int) -> FloatArray:
    """Return the radiance that a scene file states, with its texture: a (3, H, W) array [W m-2 sr-1]."""
    inside = on_sensor(scene.regions, rig, camera)
    return paint_scene(
        width=camera.width,
        height=camera.height,
        background=Surface(mean_stokes=(scene.background_radiance, 0.0, 0.0)),
        regions=[(_surface(region), inside[region.name]) for region in scene.regions],
        generator=np.random.default_rng([seed, TEXTURE_STREAM]),
    )


def _surface(region: SceneRegion) -> Surface:
    s0, s1, s2 = (component.value for component in region.given_radiance())
    covariance = region.texture_covariance
    return Surface(
        mean_stokes=(s0, s1, s2),
        texture_rms=region.texture_rms.value,
        extra_covariance=None if covariance is None else np.array([[one.value for one in row] for row in covariance]),
    )


def stated_world(
    simulation: SimulationSection,
    radiance: FloatArray,
    stage: SimulatedStage | None,
    polarizers: MicroPolarizers | None = None,
) -> World:
    """Return the scene behind the polarizer that a stage turns, or behind the polarizers on the pixels."""
    pixel_axes_deg = None
    if polarizers is not None:
        height, width = radiance.shape[1:]
        made_with = generator(simulation.seed, Stream.MICRO_POLARIZERS)
        pixel_axes_deg = polarizers.axes_deg((height, width), generator=made_with)
    return World(
        radiance=radiance,
        polarizer=stated_polarizer(simulation.polarizer),
        stage_angle_deg=(lambda: 0.0) if stage is None else stage.true_angle_deg,
        flat_radiance=simulation.flat_radiance,
        pixel_axes_deg=pixel_axes_deg,
    )


def stated_polarizer(truth: SimulatedPolarizer) -> Polarizer:
    """Return the polarizer of a simulated rig."""
    return Polarizer(
        transmittance_along=truth.transmittance_along,
        transmittance_across=truth.transmittance_along / truth.extinction_ratio,
        offset_deg=truth.offset_deg,
        sense=truth.sense,
    )


def stated_camera(
    simulation: SimulationSection,
    world: World,
    session_name: str,
    log: TruthLog | None,
    clock: SimulatedClock | None,
    *,
    wrapped: Callable[[RenderingEffect], RenderingEffect] = lambda effect: effect,
    polarizers: MicroPolarizers | None = None,
) -> SimCamera:
    """Return the camera that sees a world. `log` records the truth about its frames; `clock` defaults to the host's.

    `wrapped` may wrap each effect of its pictures, for instance to time it.
    """
    lens, detector = _lens(simulation.camera), _detector(simulation.camera)
    # Blur by the lens before polarizers on the pixels is not simulated.
    lens_blur = [defocus(lens, detector, defocus_m=LensPosition(simulation).defocus_m)] if polarizers is None else []
    leaks = [crosstalk(polarizers.crosstalk)] if polarizers is not None and polarizers.crosstalk else []
    blurred = [section.effect for section in simulation.effects if section.effect in _BEFORE_POLARIZERS]
    if polarizers is not None and blurred:
        raise ValueError(f"{', '.join(blurred)}: acts before the polarizers on the pixels, which is not simulated")
    return SimCamera(
        world=world,
        lens=lens,
        detector=detector,
        pattern_seed=simulation.seed,
        noise_seed=_noise_seed(simulation.seed, session_name),
        truth=log,
        utc_ns=time.time_ns if clock is None else clock.utc_ns,
        monotonic_ns=time.monotonic_ns if clock is None else clock.monotonic_ns,
        rendering=[
            *lens_blur,
            *(
                wrapped(rendering_effect(section, lens=lens, detector=detector, pattern_seed=simulation.seed))
                for section in simulation.effects
            ),
            *leaks,
        ],
    )


def _lens(truth: SimulatedCamera) -> Lens:
    return Lens(
        focal_length_m=truth.focal_length_mm / 1e3,
        aperture_diameter_m=truth.aperture_diameter_mm / 1e3,
        transmittance=truth.optics_transmittance,
    )


def _detector(truth: SimulatedCamera) -> Detector:
    return Detector(
        width=truth.width,
        height=truth.height,
        pixel_pitch_m=truth.pixel_pitch_um / 1e6,
        effective_wavelength_m=truth.wavelength_nm / 1e9,
        quantum_efficiency=truth.quantum_efficiency,
        gain_dn_per_e=truth.gain_dn_per_e,
        read_noise_e=truth.read_noise_e,
        dark_current_e_per_s=truth.dark_current_e_per_s,
        black_level_dn=truth.black_level_dn,
        prnu=truth.prnu,
        dsnu_e=truth.dsnu_e,
        full_well_e=truth.full_well_e,
        bit_depth=truth.bit_depth,
    )


def _noise_seed(seed: int, session_name: str) -> int:
    digest = hashlib.sha256(f"{seed}/{session_name}".encode()).digest()
    return int.from_bytes(digest[:8], "big")


def rendering_effect(
    section: RenderingSection, *, lens: Lens, detector: Detector, pattern_seed: int
) -> RenderingEffect:
    """Return the effect of a table of the rig file."""
    match section:
        case PointSpreadSection():
            return point_spread(sigma_px=section.sigma_px)
        case VignettingSection():
            return vignetting(lens, detector)
        case FixedPatternSection():
            return fixed_pattern(
                column_offset_e=section.column_offset_e, width=detector.width, pattern_seed=pattern_seed
            )
        case DriftSection():
            return drift(rate_per_frame=section.rate_per_frame, flicker_std=section.flicker_std)
        case BeamWanderSection():
            return beam_wander(radius_px=section.radius_px, phase_deg=section.phase_deg)
        case SmearSection():
            return smear(row_transfer_us=section.row_transfer_us)
        case CosmicHitsSection():
            return cosmic_hits(rate_per_s=section.rate_per_s, mean_e=section.mean_e)
        case _:
            assert_never(section)
