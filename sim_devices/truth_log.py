"""Log of the true state of a simulated rig at each frame, independent of drivers and session."""

import errno
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

_MODE = 0o644
_BEGINNING = b'{"sequence": '


@dataclass(frozen=True, kw_only=True)
class TrueFrame:
    """One exposure as it truly was."""

    sequence: int  #: The camera's number of the frame.
    subject: str  #: In front of the camera: "scene", "dark" or "flat".
    polarizer_angle_deg: float  #: True direction of the transmission axis at the start, in [0, 180).
    exposure_s: float  #: Integration time.
    gain_db: float  #: Gain setting.
    start_utc_ns: int  #: Start by the clocks of the host.
    start_monotonic_ns: int
    fault: str | None  #: Fault of the frame by the simulation.


class TruthLog:
    """A file with one line per exposure, which grows from session to session.

    Parameters
    ----------
    path : Path
        The file; created if missing.

    Raises
    ------
    OSError
        It cannot be written, or is not such a log.

    Notes
    -----
    Each line is one write, so that a kill leaves whole lines; there is no wait for the disk.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        if path.exists() and not _is_log(path):
            raise FileExistsError(errno.EEXIST, "exists, and is not a log of exposures", str(path))
        os.close(self._opened())

    def note(self, frame: TrueFrame) -> None:
        """Add a frame."""
        descriptor = self._opened()
        try:
            os.write(descriptor, (json.dumps(asdict(frame), allow_nan=False) + "\n").encode("ascii"))
        finally:
            os.close(descriptor)

    def _opened(self) -> int:
        return os.open(self._path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, _MODE)


def _is_log(path: Path) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(_BEGINNING)) in (b"", _BEGINNING)


def read_truth(path: Path) -> tuple[TrueFrame, ...]:
    """Return the frames of a truth log in the order in which they were exposed."""
    lines = path.read_text(encoding="ascii").splitlines()
    try:
        return tuple(TrueFrame(**json.loads(line)) for line in lines)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: a line is not a frame: {error}") from error
