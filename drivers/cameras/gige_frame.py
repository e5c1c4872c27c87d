"""From a picture as it came in to a frame: counts, numbers that grow, times of the exposure."""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.cameras.bayer import counts_of_picture
from drivers.cameras.gige_clock import CameraClock
from drivers.cameras.gige_setup import GigeSetup
from drivers.cameras.gige_stream import Received
from drivers.cameras.pixel_format import unpack
from drivers.errors import ProtocolError
from drivers.interfaces import CameraSettings, Frame, StartSource

_CLOCK_STEP_NS = 2_000_000
_LARGEST_SHORT_ID = 65535
_TRIGGER: StartSource = "trigger"
_ARRIVAL: StartSource = "arrival"


@dataclass(frozen=True, kw_only=True)
class Asked:
    """Moment at which a picture was asked for.

    Attributes
    ----------
    utc_ns, monotonic_ns : int
        By both clocks of the host.
    error_ns : int
        How far from each other they may have been read.
    """

    utc_ns: int
    monotonic_ns: int
    error_ns: int = 0

    def was_clock_set(self) -> bool:
        """Return whether the host's clock has been set since then."""
        return abs((time.time_ns() - self.utc_ns) - (time.monotonic_ns() - self.monotonic_ns)) > _CLOCK_STEP_NS


def asked_now() -> Asked:
    """Return the time, for a picture that is asked for now."""
    before_ns, utc_ns, after_ns = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
    # The earlier one: no exposure that was asked for then is taken for an older one.
    return Asked(utc_ns=utc_ns, monotonic_ns=before_ns, error_ns=after_ns - before_ns)


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


@dataclass(frozen=True, kw_only=True)
class _Start:
    """Start of an exposure: by the host's clocks, by how much it may be off, and by what it was found [ns]."""

    monotonic_ns: int
    utc_ns: int
    error_ns: int
    source: StartSource


def frame_of(
    received: Received,
    *,
    setup: GigeSetup,
    settings: CameraSettings,
    sequence: int,
    asked: Asked,
    clock: CameraClock,
    free_period_s: float | None,
) -> Frame:
    """Return a whole picture as a frame.

    Parameters
    ----------
    received, setup, settings, sequence
        The picture, and what is known of it.
    asked : Asked
        When it was asked for.
    clock : CameraClock
        Of the camera.
    free_period_s : float or None
        From one picture to the next of a camera that runs by itself; None: it was triggered [s].

    Raises
    ------
    ProtocolError
        It is of another size or format than the camera was set to, or its samples use bits that they do not have.

    Notes
    -----
    The exposure begins when the picture's own time stamp says, if the camera's clock can be held against the host's.
    Else that of a camera that is triggered is taken to begin at the trigger, and cannot have begun later than an
    exposure before the first packet came in; of one that runs by itself, an exposure before its first packet, and not
    earlier than a period before that.
    """
    exposure_ns = round(settings.exposure_s * 1e9)
    start = _start_of(received, exposure_ns, asked, None if free_period_s is None else round(free_period_s * 1e9))
    start = _by_stamp(received, start, exposure_ns, asked, clock)
    return Frame(
        counts=_counts(received, setup),
        settings=settings,
        sequence=sequence,
        start_utc_ns=start.utc_ns,
        end_utc_ns=start.utc_ns + exposure_ns,
        start_monotonic_ns=start.monotonic_ns,
        start_uncertainty_s=start.error_ns / 1e9,
        start_source=start.source,
    )


def _start_of(received: Received, exposure_ns: int, asked: Asked, free_period_ns: int | None) -> _Start:
    """Return when an exposure began, by the host alone."""
    latest_ns = received.first_packet_utc_ns - asked.utc_ns - exposure_ns
    if free_period_ns is None:
        delay_ns, error_ns, source = 0, max(0, latest_ns), _TRIGGER
    else:
        delay_ns, error_ns, source = latest_ns, free_period_ns, _ARRIVAL
    return _Start(
        monotonic_ns=asked.monotonic_ns + delay_ns,
        utc_ns=asked.utc_ns + delay_ns,
        error_ns=error_ns + asked.error_ns,
        source=source,
    )


def _by_stamp(received: Received, start: _Start, exposure_ns: int, asked: Asked, clock: CameraClock) -> _Start:
    """Return a start by the camera's clock, where the picture's stamp lies in the time in which it must have begun.

    Notes
    -----
    Cameras stamp the beginning of an exposure, and some its end. A stamp that can only be one of them is taken as
    that. Where it can be both, the start is between, and known to half an exposure more.
    """
    moment = None if received.stamp_ns is None else clock.moment_of(received.stamp_ns)
    if moment is None:
        return start
    earliest_ns = start.monotonic_ns - (start.error_ns if start.source == _ARRIVAL else 0)
    latest_ns = start.monotonic_ns + (start.error_ns if start.source == _TRIGGER else 0)
    slack_ns = moment.error_ns + asked.error_ns
    back_ns = [
        before_ns
        for before_ns in (0, exposure_ns)
        if earliest_ns - slack_ns <= moment.monotonic_ns - before_ns <= latest_ns + slack_ns
    ]
    if not back_ns:
        return start
    middle_ns, unsure_ns = sum(back_ns) // len(back_ns), (back_ns[-1] - back_ns[0] + 1) // 2
    begin_ns = moment.monotonic_ns - middle_ns
    if clock.ptp is not None and received.stamp_ns is not None:
        return _Start(
            monotonic_ns=begin_ns,
            utc_ns=received.stamp_ns - middle_ns - clock.ptp.ahead_s * 10**9,
            error_ns=clock.ptp.offset_ns + unsure_ns,
            source="ptp",
        )
    return _Start(
        monotonic_ns=begin_ns,
        utc_ns=begin_ns - asked.monotonic_ns + asked.utc_ns,
        error_ns=moment.error_ns + asked.error_ns + unsure_ns,
        source="camera clock",
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
