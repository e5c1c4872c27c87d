"""A folder that another program fills, as a camera: for cameras that only their own software can run."""

import struct
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.cameras.bounded_camera import one_of, split_place, whole
from drivers.cameras.raw_files import RAW_SUFFIXES, read_raw
from drivers.cameras.raw_planes import PLANES, Plane
from drivers.cameras.samples import Justified
from drivers.errors import DeviceTimeoutError, LimitError, NotConnectedError, ProtocolError
from drivers.interfaces import CameraFacts, CameraSettings, DeviceIdentity, Frame, FrameTally

_SUFFIXES = frozenset((".png", ".tif", ".tiff")) | RAW_SUFFIXES
_LOOK_S = 0.02
_EXPOSURE_TOLERANCE = 0.02  # exposures in files are rounded
_LONGEST_EXPOSURE_S = 3600.0
_FILE_BITS = 16
# 2 bytes per pixel of the largest sensor; a PNG has width and height in bytes 16 to 24.
_MOST_BYTES = 268_000_000
_PNG, _PNG_HEADER, _PNG_SIZE = b"\x89PNG", 24, struct.Struct(">II")
# With fewer different values than this, such as in a dark picture, a common factor may be chance.
_FEW_VALUES = 16

# Length and last change of a file.
_Looks = dict[Path, tuple[int, int]]


# Counts, bits of the camera, and the exposure [s] if the file states it.
_Still = tuple[NDArray[np.uint16], int, float | None]


class FolderCamera:
    """A camera run by another program that writes a file for every picture; `open_folder` makes one.

    `configure` changes nothing on the camera: it states the settings of that program. If files state their exposure,
    another one is refused; otherwise the configured one is assumed.

    A picture was exposed after the call if the last change of its file, minus the exposure, is after the call. So the
    clock of a machine that serves the folder must agree with this one, and a slow program may make a picture seem later
    than it was. A file is read once its size and time have not changed since the last look.

    Parameters
    ----------
    folder : Path
        Where the files appear. Nothing is written there.
    plane : str or None
        Colour of RAW files.
    bit_depth : int or None
        Bits of the camera; needed for PNG and TIFF, which do not state them.
    justified : {"right", "left"}
        End of the 16 bits at which the samples of PNG and TIFF are.
    """

    def __init__(
        self,
        folder: Path,
        *,
        plane: Plane | None = None,
        bit_depth: int | None = None,
        justified: Justified = "right",
        now_s: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._folder, self._plane, self._stated_bits, self._justified = folder, plane, bit_depth, justified
        self._now_s, self._sleep = now_s, sleep
        if not folder.is_dir():
            raise NotConnectedError(f"camera files:{folder}: there is no such folder")
        self._seen: set[str] = set()
        self._exposure_s = 0.01
        self._width, self._height, self._bit_depth = self._size_of_last()
        self._sequence = 0
        self._tally = FrameTally()
        self._open = True

    def __enter__(self) -> "FolderCamera":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        """Return the folder, since the camera that fills it is unknown."""
        self._refuse_closed()
        return DeviceIdentity(model="files of another program", serial_number=str(self._folder), firmware="none")

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        """Note the camera's settings in its own program; gain must be 0, since it is not known."""
        self._refuse_closed()
        if not 0.0 < exposure_s <= _LONGEST_EXPOSURE_S:
            raise LimitError(f"{self._name}: exposure_s is {exposure_s} s; allowed is above 0, up to 3600 s")
        if gain_db != 0.0:
            raise LimitError(f"{self._name}: gain_db is {gain_db} dB; set it in the camera's own program, and 0 here")
        self._exposure_s = exposure_s
        return self._settings()

    def tally(self) -> FrameTally:
        """Return the fate of the files so far."""
        return self._tally

    def facts(self) -> CameraFacts:
        """Return the facts about the files; the processing by the camera's own program is not known."""
        return CameraFacts(sample_format="files", justified=self._justified, linear=None)

    def features(self) -> dict[str, str]:
        """Return the chosen colour, if files have several."""
        return {} if self._plane is None else {"plane": self._plane}

    def take_frame(self, *, timeout_s: float) -> Frame:
        """Return the picture of the next file whose exposure began after this call."""
        self._refuse_closed()
        asked_utc_ns, asked_monotonic_ns = time.time_ns(), time.monotonic_ns()
        deadline_s = self._now_s() + timeout_s
        damage: ProtocolError | None = None
        looks: _Looks = {}
        while self._now_s() < deadline_s:
            for path in self._left_alone(looks):
                start_utc_ns = path.stat().st_mtime_ns - round(self._exposure_s * 1e9)
                if start_utc_ns < asked_utc_ns:
                    self._pass_over(path)
                    continue
                try:
                    still = self._read(path)
                except ProtocolError as error:
                    damage = error  # it may not be complete yet
                    continue
                return self._frame(path, still, start_utc_ns, asked_monotonic_ns + start_utc_ns - asked_utc_ns)
            self._sleep(_LOOK_S)
        if damage is not None:
            raise damage
        raise DeviceTimeoutError(
            f"{self._name}: no new picture appeared within {timeout_s} s. Let the camera's own program save pictures "
            f"({', '.join(sorted(_SUFFIXES))}), and check that its clock agrees with this one"
        )

    def close(self) -> None:
        """Stop watching the folder. May be called twice."""
        self._open = False

    @property
    def _name(self) -> str:
        return f"camera files:{self._folder}"

    def _refuse_closed(self) -> None:
        if not self._open:
            raise NotConnectedError(f"{self._name}: it was closed; open it again")

    def _files(self) -> list[Path]:
        # Names that begin with a dot are of unfinished files and of other systems.
        there = (path for path in self._folder.iterdir() if not path.name.startswith("."))
        return [path for path in there if path.suffix.lower() in _SUFFIXES and path.is_file()]

    def _size_of_last(self) -> tuple[int, int, int]:
        """Return width, height and bits of the newest picture; all present ones count as seen."""
        there = sorted(self._files(), key=_age)
        if not there:
            raise NotConnectedError(
                f"{self._name}: no picture is in the folder; take one first, which gives the size of all"
            )
        self._seen = {path.name for path in there}
        counts, bit_depth, _ = self._read(there[-1])
        return counts.shape[1], counts.shape[0], bit_depth

    def _left_alone(self, looks: "_Looks") -> list[Path]:
        """Return new files that have not changed since the last look, oldest first; note the state of all."""
        new = sorted((path for path in self._files() if path.name not in self._seen), key=_age)
        before = dict(looks)
        looks.update({path: (path.stat().st_size, path.stat().st_mtime_ns) for path in new})
        return [path for path in new if looks[path][0] > 0 and looks[path] == before.get(path)]

    def _pass_over(self, path: Path) -> None:
        self._seen.add(path.name)
        self._tally += FrameTally(too_old=1)

    def _settings(self) -> CameraSettings:
        return CameraSettings(
            exposure_s=self._exposure_s,
            gain_db=0.0,
            width=self._width,
            height=self._height,
            bit_depth=self._bit_depth,
        )

    def _read(self, path: Path) -> _Still:
        if path.suffix.lower() in RAW_SUFFIXES:
            raw = read_raw(path, plane=self._plane)
            return raw.counts, self._stated_bits or raw.bit_depth, raw.exposure_s
        if self._stated_bits is None:
            raise LimitError(f"{self._name}: {path.name} does not state its bit depth; add bit_depth=N to the address")
        counts = _right_justified(_grey(path), path, bit_depth=self._stated_bits, justified=self._justified)
        return counts, self._stated_bits, None

    def _frame(self, path: Path, still: _Still, start_utc_ns: int, start_monotonic_ns: int) -> Frame:
        self._require_fit(path, still)
        self._seen.add(path.name)
        self._sequence += 1
        self._tally += FrameTally(accepted=1)
        return Frame(
            counts=still[0],
            settings=self._settings(),
            sequence=self._sequence,
            start_utc_ns=start_utc_ns,
            end_utc_ns=start_utc_ns + round(self._exposure_s * 1e9),
            start_monotonic_ns=start_monotonic_ns,
            start_source="file",
        )

    def _require_fit(self, path: Path, still: _Still) -> None:
        counts, bit_depth, exposure_s = still
        if exposure_s is not None:
            off = abs(exposure_s - self._exposure_s)
            if off > _EXPOSURE_TOLERANCE * self._exposure_s:
                raise LimitError(
                    f"{self._name}: {path.name} was exposed {exposure_s:g} s instead of {self._exposure_s:g} s: set "
                    "this in the camera's own program"
                )
        height, width = counts.shape
        if (width, height, bit_depth) != (self._width, self._height, self._bit_depth):
            raise ProtocolError(
                f"{self._name}: {path.name} has {width} x {height} pixels of {bit_depth} bits; earlier ones had "
                f"{self._width} x {self._height} of {self._bit_depth}"
            )
        if int(counts.max()) >= 2**bit_depth:
            raise ProtocolError(f"{self._name}: {path.name} has counts above {bit_depth} bits")


def _right_justified(
    counts: NDArray[np.uint16], path: Path, *, bit_depth: int, justified: Justified
) -> NDArray[np.uint16]:
    """Return right-justified counts; refuse those that are not justified as stated."""
    used = int(np.bitwise_or.reduce(counts, axis=None))
    unused_low = (used & -used).bit_length() - 1 if used else 0
    if justified == "left":
        spare = _FILE_BITS - bit_depth
        if used and unused_low < spare:
            raise ProtocolError(
                f"{path}: samples are not left-justified with {bit_depth} bits in {_FILE_BITS}: their lowest "
                f"bits are used; state the camera's true bit_depth, or justified=right"
            )
        return np.right_shift(counts, np.uint16(spare))
    if unused_low and len(np.unique(counts)) > _FEW_VALUES:
        raise ProtocolError(
            f"{path}: all samples are multiples of {2**unused_low}: they are left-justified in {_FILE_BITS} bits; add "
            f"bit_depth={_FILE_BITS - unused_low}&justified=left to the address"
        )
    return counts


def _age(path: Path) -> tuple[int, str]:
    return path.stat().st_mtime_ns, path.name


def open_folder(place: str) -> FolderCamera:
    """Return a folder as a camera, by ``FOLDER?plane=green-1&bit_depth=12&justified=left``; see `FolderCamera`.

    Raises
    ------
    NotConnectedError
        There is no such folder, or no picture in it.
    LimitError
        The address has keys or values that are not allowed.
    """
    readers = {"plane": one_of(*PLANES), "bit_depth": whole(8, 16), "justified": one_of("right", "left")}
    folder, values = split_place(place, readers)
    return FolderCamera(Path(folder), **values)


def _grey(path: Path) -> NDArray[np.uint16]:
    import cv2  # slow to import, and needed for PNG and TIFF only

    data = _bounded(path)
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.ndim != 2 or pixels.dtype not in (np.uint8, np.uint16):
        raise ProtocolError(f"{path}: is not complete, or no grey picture of 8 or 16 bits")
    return np.asarray(pixels, dtype=np.uint16)


def _bounded(path: Path) -> bytes:
    """Return the bytes of a file that, and whose picture by the header of a PNG, is no larger than any sensor's."""
    size = path.stat().st_size
    data = path.read_bytes() if size <= _MOST_BYTES else b""
    if data.startswith(_PNG):
        width, height = _PNG_SIZE.unpack_from(data.ljust(_PNG_HEADER, b"\0"), _PNG_HEADER - _PNG_SIZE.size)
        size = max(size, _FILE_BITS // 8 * width * height)
    if size > _MOST_BYTES:
        raise ProtocolError(f"{path}: would take {size / 1e6:.4g} MB, at most {_MOST_BYTES / 1e6:.4g} MB are read")
    return data
