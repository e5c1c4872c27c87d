"""Faults of a simulated GigE camera: at which of its pictures, counted from its power-up."""

import threading
from collections.abc import Callable
from dataclasses import dataclass

from sim_devices.cameras.device_clock import ClockTruth


@dataclass(frozen=True, kw_only=True)
class GigeFaults:
    """Faults. A number of a picture is counted from the camera's power-up, from 1; None: never.

    Attributes
    ----------
    lost_share : float
        Share of the packets of pictures that are lost on their way, 0 to below 1.
    resends : bool
        Whether it sends lost packets again when it is asked to.
    die : int or None
        At this picture its power goes for good.
    restart : int or None
        At this picture its power goes and comes back: all settings are those of a power-up. It does so again at this
        picture after that.
    off_s : float
        How long the power is off at a restart.
    hang : int or None
        At this picture it answers nobody for a while.
    hang_s : float
        For how long.
    forget : int or None
        After this picture its exposure is another one, set by nobody.
    clock : ClockTruth or None
        What its clock is like, where it can be read, as behind a network (`serve_behind_network`); None: it cannot.
    """

    lost_share: float = 0.0
    resends: bool = True
    die: int | None = None
    restart: int | None = None
    off_s: float = 0.5
    hang: int | None = None
    hang_s: float = 6.0
    forget: int | None = None
    clock: ClockTruth | None = None


class FaultyPower:
    """Counts pictures, and lets go wrong what is to. A context manager: leaving it ends a hang and whatever waits.

    Parameters
    ----------
    faults : GigeFaults
        What, and when.
    power_down, power_up, forget : callable
        What makes the power go and come back, and changes a setting.
    cut : callable
        What keeps the picture at which the power goes from being sent, on a machine that is slow to let it go.

    Notes
    -----
    The power cannot go in the thread in which the pictures are made, since that thread ends with it: another one waits
    for that.
    """

    def __init__(
        self,
        faults: GigeFaults,
        *,
        power_down: Callable[[], None],
        power_up: Callable[[], None],
        forget: Callable[[], None],
        cut: Callable[[], None] = lambda: None,
    ) -> None:
        self._faults = faults
        self._power_down, self._power_up, self._forget, self._cut = power_down, power_up, forget, cut
        self._pictures = 0
        self._is_for_good = False
        self._is_over = threading.Event()
        self._switch = threading.Event()
        self._thread = threading.Thread(target=self._watch_switch, name="power of a simulated camera", daemon=True)

    def __enter__(self) -> "FaultyPower":
        self._thread.start()
        return self

    def __exit__(self, *exc_info: object) -> None:
        self._is_over.set()
        self._switch.set()
        self._thread.join()

    def before_picture(self) -> None:
        """Count a picture that is about to be made; called in the thread that makes it."""
        self._pictures += 1
        faults, number = self._faults, self._pictures
        if number == faults.hang:
            self._is_over.wait(faults.hang_s)
        if number in (faults.die, faults.restart):
            # Another picture may be counted before the power goes.
            self._is_for_good = number == faults.die
            self._cut()
            self._switch.set()

    def after_picture(self) -> None:
        """Let the settings change, where this picture was to be the last with the right ones."""
        if self._pictures == self._faults.forget:
            self._forget()

    def _watch_switch(self) -> None:
        while self._switch.wait() and not self._is_over.is_set():
            self._switch.clear()
            self._power_down()
            self._pictures = 0
            if self._is_for_good or self._is_over.wait(self._faults.off_s):
                return
            self._power_up()
