"""Devices that a page operates: a preview for focusing, or live polarimetry as fast as the stage turns.

Nothing is stored.
"""

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, with_config

from drivers.errors import DeviceError, LimitError
from drivers.interfaces import Camera, Frame, RotationStage
from model.processing.mosaic import planes
from rigctl.base.numbers import LARGEST, percent
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import Interpolation
from rigctl.files.rig_file import CameraSection, PolarizerSection, RigFile, load_rig, polarizer_axes_deg
from rigctl.rig.rig import SIMULATED, find_driver, open_rig
from rigctl.web.pictures import (
    MAP_WIDTH,
    MAPS,
    MOST_WIDTH,
    CyclePictures,
    Picture,
    Shelf,
    brightness_of,
    map_pictures,
    middle,
    picture_of,
    sharpness_of,
    smaller,
)

VIEW = "view"
# Target of an automatic exposure, as a share of the range; between the other two shares the exposure is kept.
_AIM, _LEAST_FILLED, _MOST_FILLED = 0.7, 0.4, 0.9
_SHORTEST_MS, _LONGEST_MS = 0.001, 2000.0
_STEP_WORTH = 0.1
_LEAST_ANGLES = 3
_KEPT = 8
_TURN_DEG = 180.0
_TIMEOUT_S = 10.0
_MS_PER_S = 1e3
_QUALITY = 90
_RIG_FILE = ".toml"
_EXAMPLE = "rig-sim.toml"
TaskKind = Literal["rest", "preview", "polarimetry"]


@with_config(ConfigDict(extra="forbid", allow_inf_nan=False))
@dataclass(frozen=True, kw_only=True)
class Task:
    """A task for the devices."""

    #: "rest" closes the devices, "preview" takes one picture after another, "polarimetry" turns through the angles.
    kind: TaskKind
    exposure_ms: Annotated[float, Field(gt=0.0, le=600_000.0)] | None = None  #: None for an automatic exposure.
    gain_db: Annotated[float, Field(ge=-100.0, le=100.0)] = 0.0
    zoom: Annotated[int, Field(ge=1, le=64)] = 1  #: Factor by which the middle of the picture is enlarged.
    #: Polarizer angles for "polarimetry".
    angles_deg: Annotated[tuple[Annotated[float, Field(ge=-LARGEST, le=LARGEST)], ...], Field(max_length=64)] = (
        0.0,
        45.0,
        90.0,
        135.0,
    )


REST = Task(kind="rest")


@dataclass(frozen=True, kw_only=True)
class LiveLook:
    """State of the devices and numbers of the newest picture."""

    task: TaskKind = "rest"
    exposure_ms: float = 10.0  #: Settings of the camera [ms], [dB].
    gain_db: float = 0.0
    is_automatic: bool = True  #: The exposure is automatic.
    sequence: int = 0  #: Number of the newest picture and of the newest maps; 0 without one.
    maps_sequence: int = 0
    angle_deg: float | None = None  #: Polarizer angle of the newest picture by readback [deg].
    #: Sharpness of the newest picture, and the largest since the task began; in arbitrary units.
    sharpness: float = 0.0
    best_sharpness: float = 0.0
    brightest: float = 0.0  #: 99.5 % quantile of the counts as a share of the range, and share of saturated pixels.
    clipped: float = 0.0
    cycles_per_min: float | None = None  #: Passes through the angles per minute.
    #: Dark level that is subtracted in maps [DN]; None if it was not taken at this exposure, so DoLP reads too low.
    dark_dn: float | None = None
    zoom: int = 1  #: As in `Task`.
    left: int = 0  #: Part of the camera's picture that is shown: first column and row, and size [pixel].
    top: int = 0
    width: int = 0
    height: int = 0
    problem: str = ""  #: The error that stopped the task.

    def __str__(self) -> str:
        """Return a line with the numbers for focusing."""
        return (
            f"sharpness {self.sharpness * 1e3:.4g} (best {self.best_sharpness * 1e3:.4g}), brightest "
            f"{100 * self.brightest:.0f} % of the range, {percent(self.clipped)} saturated"
        )


class LiveRig:
    """The rig of a rig file, or the camera at an address such as ``gige:192.168.0.5`` alone.

    It works in a thread of its own. With the task "rest" the devices are closed, so that a session can open them.
    """

    def __init__(self, what: str, *, camera_only: bool = False) -> None:
        self._what, self._is_rig = what, what.endswith(_RIG_FILE) and not camera_only
        # Without a stage, angles are those of the polarizer.
        self._polarizer = load_rig(Path(what)).polarizer if self._is_rig else PolarizerSection(sense=1, offset_deg=0.0)
        self._camera: CameraSection | None = None
        self._changed = threading.Condition()
        self._task = REST
        self._turn_to_deg: float | None = None
        self._thread: threading.Thread | None = None
        self._look = LiveLook()
        self._failure: Exception | None = None
        self._counts: NDArray[np.uint16] | None = None
        self._saturation_dn = 1.0
        self._cycle: CyclePictures | None = None
        self._dark: tuple[float, float] | None = None
        self._drawn: Shelf[dict[str, Picture]] = Shelf(_KEPT)

    def look(self) -> LiveLook:
        """Return the state of the devices and the numbers of the newest picture."""
        with self._changed:
            return self._look

    def newer_look(self, sequence: int, *, timeout_s: float) -> LiveLook:
        """Wait for a picture with another number, or the timeout; return its numbers.

        `width` is 0 as long as a task has no picture.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._failure or self._is_of_another(sequence), timeout=timeout_s)
            if self._failure is not None:
                raise self._failure
            return self._look

    def _is_of_another(self, sequence: int) -> bool:
        return self._look.width > 0 and self._look.sequence != sequence

    def begin(self, task: Task) -> None:
        """Begin a task; "rest" returns after the devices are closed."""
        with self._changed:
            self._task, self._failure = task, None
            last_exposure_s = self._look.exposure_ms / _MS_PER_S
            self._look = LiveLook(
                task=task.kind,
                exposure_ms=task.exposure_ms or self._look.exposure_ms,
                is_automatic=task.exposure_ms is None,
                gain_db=task.gain_db,
                zoom=task.zoom,
                sequence=self._look.sequence,
                maps_sequence=self._look.maps_sequence,
            )
            self._changed.notify_all()
            if task.kind != "rest" and (self._thread is None or not self._thread.is_alive()):
                self._thread = threading.Thread(target=self._work, name="live rig", daemon=True)
                self._thread.start()
            thread = self._thread
        if task.kind == "rest" and thread is not None:
            thread.join(timeout=_TIMEOUT_S + last_exposure_s)

    def turn(self, angle_deg: float) -> None:
        """Turn the polarizer to an angle [deg] while a preview runs."""
        with self._changed:
            self._turn_to_deg = angle_deg

    def take_dark(self) -> None:
        """Take the newest picture as dark frame. Its mean is subtracted in maps at this exposure."""
        with self._changed:
            if self._counts is None or self._look.task == "rest":
                raise ConfigError("begin a preview, cover the lens, and then take the dark level")
            self._dark = (self._look.exposure_ms, float(self._counts.mean()))
            self._look = replace(self._look, dark_dn=self._dark[1])

    def newest_counts(self) -> NDArray[np.uint16] | None:
        """Return the newest picture [DN]; None if there is none."""
        with self._changed:
            return self._counts

    def newest_sequence(self, name: str) -> int | None:
        """Return the number of the newest picture of a name; None if there is none."""
        look = self.look()
        number = look.maps_sequence if name in MAPS else look.sequence if name == VIEW else 0
        return number or None

    def picture(self, name: str, *, zebra: bool = True, dolp_top: float = 1.0) -> Picture | None:
        """Return the newest picture or map of a name; None if there is none."""
        with self._changed:
            look, counts, cycle, saturation_dn = self._look, self._counts, self._cycle, self._saturation_dn
        if name == VIEW and counts is not None:
            shown = middle(counts, zoom=look.zoom)
            draw = partial(picture_of, shown, saturation_dn=saturation_dn, most_width=MOST_WIDTH, zebra=zebra)
            return self._drawn.kept((VIEW, look.sequence, look.zoom, zebra), lambda: {VIEW: draw()})[VIEW]
        if name not in MAPS or cycle is None:
            return None
        key = ("maps", look.maps_sequence, dolp_top)
        try:
            return self._drawn.kept(key, lambda: map_pictures(cycle, dolp_top=dolp_top))[name]
        except ValueError as error:
            raise DataError(f"no maps: {error}") from error

    def _work(self) -> None:
        try:
            with self._open() as (camera, stage):
                while (task := self._wanted()).kind != "rest":
                    self._do(camera, stage, task)
        except (DeviceError, ConfigError, DataError) as error:
            with self._changed:
                self._look = replace(self._look, task="rest", problem=str(error))
                self._task, self._failure = REST, error
                self._changed.notify_all()

    @contextmanager
    def _open(self) -> Iterator[tuple[Camera, RotationStage | None]]:
        if not self._is_rig:
            with _open_camera(self._what) as camera:
                yield camera, None
            return
        rig_file = load_rig(Path(self._what))  # read again, because it may have been edited
        self._polarizer, self._camera = rig_file.polarizer, rig_file.camera
        with open_rig(rig_file, session_name="live") as rig:
            rig.present("scene")
            yield rig.camera, rig.stage

    def _wanted(self) -> Task:
        with self._changed:
            return self._task

    def _do(self, camera: Camera, stage: RotationStage | None, task: Task) -> None:
        """Work on a task until another begins."""
        camera.configure(exposure_s=self.look().exposure_ms / _MS_PER_S, gain_db=task.gain_db)
        mosaic, polarizer = self._camera, self._polarizer
        if mosaic is not None and mosaic.mosaic_deg is not None:
            axes_deg = polarizer_axes_deg(mosaic.mosaic_deg, sense=polarizer.sense, offset_deg=polarizer.offset_deg)
            while self._wanted() is task:
                self._take_mosaics(camera, axes_deg or (), mosaic.interpolation, task)
            return
        if task.kind == "preview":
            while self._wanted() is task:
                angle_deg = self._turned(stage)
                self._show(self._exposed(camera, task), angle_deg)
            return
        if stage is None or len(task.angles_deg) < _LEAST_ANGLES:
            raise ConfigError("live polarimetry needs a stage, and three angles at least")
        stage.home()
        self._exposed(camera, task)
        while self._wanted() is task:
            self._take_cycles(camera, stage, task)

    def _take_mosaics(
        self, camera: Camera, axes_deg: tuple[float, ...], interpolation: Interpolation, task: Task
    ) -> None:
        """Take pictures with polarizers on the pixels: each has all angles, and its own maps."""
        began_s = time.monotonic()
        frame = self._exposed(camera, task)
        saturation_dn = 2.0**frame.settings.bit_depth - 1.0
        parts = planes(frame.counts, interpolation=interpolation, saturation_dn=saturation_dn)
        # The mean of all angles is shown, because the pattern of the cell is not in the scene.
        stacked = np.stack(parts)
        full = (stacked >= saturation_dn).any(axis=0)
        mean = np.where(full, saturation_dn, stacked.mean(axis=0, dtype=np.float32)).astype(np.uint16)
        self._show(replace(frame, counts=mean), None)
        small = [smaller(part, most_width=MOST_WIDTH) for part in parts]
        self._add_cycle(small, axes_deg, time.monotonic() - began_s)

    def _take_cycles(self, camera: Camera, stage: RotationStage, task: Task) -> None:
        began_s = time.monotonic()
        frames: list[NDArray[np.float32]] = []
        angles_deg: list[float] = []
        brightest = 0.0
        for angle_deg in task.angles_deg:
            if self._wanted() is not task:
                return
            angles_deg.append(self._move(stage, angle_deg))
            frame = self._frame(camera)
            frames.append(smaller(frame.counts, most_width=MAP_WIDTH))
            self._show(frame, angles_deg[-1])
            brightest = max(brightest, self._look.brightest)
        self._add_cycle(frames, angles_deg, time.monotonic() - began_s)
        self._expose_for_light(camera, task, self._look.exposure_ms, brightest)

    def _turned(self, stage: RotationStage | None) -> float | None:
        with self._changed:
            wanted_deg, self._turn_to_deg = self._turn_to_deg, None
            angle_deg = self._look.angle_deg
        if stage is None or wanted_deg is None:
            return angle_deg
        if angle_deg is None:
            stage.home()
        return self._move(stage, wanted_deg)

    def _move(self, stage: RotationStage, angle_deg: float) -> float:
        """Turn the polarizer; return its angle by the stage's readback [deg]."""
        polarizer = self._polarizer
        position = stage.move_to(polarizer.sense * (angle_deg - polarizer.offset_deg)).position
        return (polarizer.sense * position.angle_deg + polarizer.offset_deg) % _TURN_DEG

    def _frame(self, camera: Camera) -> Frame:
        return camera.take_frame(timeout_s=self._look.exposure_ms / _MS_PER_S + _TIMEOUT_S)

    def _exposed(self, camera: Camera, task: Task) -> Frame:
        """Return a picture; it is saturated only if the exposure is given or cannot be shorter."""
        while True:
            frame = self._frame(camera)
            shown = middle(frame.counts, zoom=self._look.zoom)
            brightest, _ = brightness_of(shown, bit_depth=frame.settings.bit_depth)
            is_changed = self._expose_for_light(camera, task, frame.settings.exposure_s * _MS_PER_S, brightest)
            if brightest < 1.0 or not is_changed or self._wanted() is not task:
                return frame

    def _expose_for_light(self, camera: Camera, task: Task, before_ms: float, brightest: float) -> bool:
        """Correct an automatic exposure by the brightest pixels of a picture; return whether it has changed."""
        if task.exposure_ms is not None or _LEAST_FILLED <= brightest <= _MOST_FILLED:
            return False
        wanted_ms = _next_exposure_ms(before_ms, brightest)
        if abs(wanted_ms - before_ms) > _STEP_WORTH * before_ms:
            with suppress(LimitError):  # the exposure is at a limit of the camera
                settings = camera.configure(exposure_s=wanted_ms / _MS_PER_S, gain_db=task.gain_db)
                with self._changed:
                    self._look = replace(self._look, exposure_ms=settings.exposure_s * _MS_PER_S)
                return settings.exposure_s * _MS_PER_S != before_ms
        return False

    def _show(self, frame: Frame, angle_deg: float | None) -> None:
        full, shown = frame.counts, middle(frame.counts, zoom=self._look.zoom)
        brightest, clipped = brightness_of(shown, bit_depth=frame.settings.bit_depth)
        # Computed for focusing only, because it takes five times as long as the rest.
        sharpness = sharpness_of(shown) if self._task.kind == "preview" else 0.0
        exposure_ms = frame.settings.exposure_s * _MS_PER_S
        with self._changed:
            self._counts, self._saturation_dn = frame.counts, 2.0**frame.settings.bit_depth - 1.0
            self._look = replace(
                self._look,
                sequence=self._look.sequence + 1,
                exposure_ms=exposure_ms,
                angle_deg=angle_deg,
                sharpness=sharpness,
                best_sharpness=max(self._look.best_sharpness, sharpness),
                brightest=brightest,
                clipped=clipped,
                dark_dn=self._dark[1] if self._dark is not None and self._dark[0] == exposure_ms else None,
                left=(full.shape[1] - shown.shape[1]) // 2,
                top=(full.shape[0] - shown.shape[0]) // 2,
                width=shown.shape[1],
                height=shown.shape[0],
            )
            self._changed.notify_all()

    def _add_cycle(self, frames: Sequence[NDArray[np.float32]], angles_deg: Sequence[float], took_s: float) -> None:
        ratio = self._polarizer.extinction_ratio
        with self._changed:
            self._cycle = CyclePictures(
                frames=np.stack(frames),
                angles_rad=np.deg2rad(angles_deg),
                dark_dn=np.full(len(frames), self._look.dark_dn or 0.0),
                extinction_ratio=np.inf if ratio is None else ratio,
            )
            self._look = replace(
                self._look, maps_sequence=self._look.maps_sequence + 1, cycles_per_min=60.0 / max(took_s, 1e-3)
            )


def _next_exposure_ms(exposure_ms: float, brightest: float) -> float:
    """Return the exposure that fills the range, or a step towards it from a saturated or nearly black picture."""
    wanted_ms = exposure_ms / 8.0 if brightest >= 1.0 else exposure_ms * min(_AIM / max(brightest, 1e-3), 8.0)
    return min(max(wanted_ms, _SHORTEST_MS), _LONGEST_MS)


@contextmanager
def _open_camera(what: str) -> Iterator[Camera]:
    """Open the camera of a rig file, or the one at an address such as ``gige:192.168.0.5``, without a stage.

    A simulated camera sees the scene of its rig file, or of the example rig.
    """
    with as_file(files("rigctl") / "data" / "examples") as examples:
        rig = load_rig(Path(what)) if what.endswith(_RIG_FILE) else _with_address(load_rig(examples / _EXAMPLE), what)
        if rig.camera.address.startswith(SIMULATED):
            with open_rig(rig, session_name="preview") as opened:
                yield opened.camera
            return
    scheme, _, place = rig.camera.address.partition(":")
    camera: Camera
    with find_driver("rigctl.cameras", scheme, key="camera.address").load()(place) as camera:
        yield camera


def _with_address(rig: RigFile, address: str) -> RigFile:
    return rig.model_copy(update={"camera": rig.camera.model_copy(update={"address": address})})


class StillPicture:
    """A single picture, as a `rigctl.web.page.View`."""

    def __init__(self, grey: NDArray[np.uint8]) -> None:
        self._picture = Picture(jpeg=cv2.imencode(".jpg", grey, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))[1].tobytes())
        self._look = LiveLook(sequence=1, width=grey.shape[1], height=grey.shape[0])

    def look(self) -> LiveLook:
        """Return its size."""
        return self._look

    def newest_sequence(self, name: str) -> int | None:
        """Return 1 for the name of the picture, None for other names."""
        return self._look.sequence if name == VIEW else None

    def picture(self, name: str, *, zebra: bool = True, dolp_top: float = 1.0) -> Picture | None:
        """Return the picture, None for other names; saturation is not marked."""
        return self._picture if name == VIEW else None
