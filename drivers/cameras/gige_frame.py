"""From a picture as it came in to a frame: counts, numbers that grow, times of the exposure."""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.cameras.bayer import counts_of_picture
from drivers.cameras.gige_setup import GigeSetup
from drivers.cameras.gige_stream import Received
from drivers.cameras.pixel_format import unpack
from drivers.errors import ProtocolError
from drivers.interfaces import CameraSettings, Frame

_CLOCK_STEP_NS = 2_000_000
_LARGEST_SHORT_ID = 65535


@dataclass(frozen=True, kw_only=True)
class Asked:
    """Moment at which a picture was asked for.

    Attributes
    ----------
    utc_ns, monotonic_ns : int
        By both clocks of the host.
    """

    utc_ns: int
    monotonic_ns: int

    def was_clock_set(self) -> bool:
        """Return whether the host's clock has been set since then."""
        return abs((time.time_ns() - self.utc_ns) - (time.monotonic_ns() - self.monotonic_ns)) > _CLOCK_STEP_NS


def asked_now() -> Asked:
    """Return the time, for a picture that is asked for now."""
    return Asked(utc_ns=time.time_ns(), monotonic_ns=time.monotonic_ns())


class FrameNumbers:
    """Numbers that grow as the camera's own do: 65535 is followed by 1, and a restart begins anew."""

    def __init__(self) -> None:
        self.last_id: int | None = None
        self._sequence = 0

    def forget(self) -> None:
        """Expect no number of the camera's: it may have lost pictures, or begun anew."""
        self.last_id = None

    def of(self, frame_id: int) -> int:
        """Return the number of a picture to which the camera gave this one."""
        last, self.last_id = self.last_id, frame_id
        advance = 1 if last is None else frame_id - last
        self._sequence += advance if advance > 0 else advance + _LARGEST_SHORT_ID
        return self._sequence


def frame_of(
    received: Received, *, setup: GigeSetup, settings: CameraSettings, sequence: int, asked: Asked, runs_by_itself: bool
) -> Frame:
    """Return a whole picture as a frame.

    Raises
    ------
    ProtocolError
        It is of another size or format than the camera was set to, or its samples use bits that they do not have.

    Notes
    -----
    The exposure of a camera that is triggered is taken to begin at the trigger; of one that runs by itself, so long
    before its first packet came in as it lasts.
    """
    exposure_ns = round(settings.exposure_s * 1e9)
    delay_ns = received.first_packet_utc_ns - asked.utc_ns - exposure_ns if runs_by_itself else 0
    return Frame(
        counts=_counts(received, setup),
        settings=settings,
        sequence=sequence,
        start_utc_ns=asked.utc_ns + delay_ns,
        end_utc_ns=asked.utc_ns + delay_ns + exposure_ns,
        start_monotonic_ns=asked.monotonic_ns + delay_ns,
    )


def _counts(received: Received, setup: GigeSetup) -> NDArray[np.uint16]:
    sent = (received.width, received.height, received.pixel_format_code)
    if sent != (setup.sent_width, setup.sent_height, setup.pixel_format_code):
        raise ProtocolError(
            f"the camera sent a picture of {sent[0]} x {sent[1]} pixels in format {sent[2]:#010x}, and was set to "
            f"{setup.sent_width} x {setup.sent_height} in {setup.pixel_format.name}"
        )
    counts = unpack(received.data, pixel_format=setup.pixel_format, width=sent[0], height=sent[1])
    return counts_of_picture(counts, pixel_format=setup.pixel_format, plane=setup.plane)
