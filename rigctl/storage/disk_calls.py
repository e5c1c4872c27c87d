"""Calls to a disk that end in time, also where the disk hangs and the kernel holds whoever writes to it."""

from collections.abc import Callable
from typing import TypeVar

from drivers.caller import Caller, LeftBehindError
from rigctl.errors import RunFolderError

Result = TypeVar("Result")

STALLED_S = 30.0


class DiskCalls:
    """Makes calls in a thread of its own, which is left behind with a disk that hangs.

    Parameters
    ----------
    stalled_s : float or None
        A call that takes longer is not waited for any more; None: as `STALLED_S` says.
    """

    def __init__(self, *, stalled_s: float | None = None) -> None:
        self.stalled_s = STALLED_S if stalled_s is None else stalled_s
        self.is_hung = False
        self._caller: Caller | None = None

    def call(self, job: Callable[[], Result]) -> Result:
        """Return what a call returns.

        Raises
        ------
        RunFolderError
            It does not come back in time, or an earlier one did not.
        Exception
            What it raises.
        """
        if self.is_hung:
            raise RunFolderError(self.told())
        if self._caller is None:
            self._caller = Caller("calls to the disk")
        try:
            return self._caller.call(job, within_s=self.stalled_s)
        except LeftBehindError as error:
            self.is_hung = True
            raise RunFolderError(self.told()) from error

    def give_up(self) -> None:
        """Wait for nothing any more: somebody else has seen that the disk hangs."""
        self.is_hung = True

    def end(self, last: Callable[[], object]) -> None:
        """Make a last call; it is left behind where the disk hangs. May be called twice."""
        if self._caller is None:
            last()
            return
        caller, self._caller = self._caller, None
        try:
            if not self.is_hung:
                caller.call(last, within_s=self.stalled_s)
        except LeftBehindError:
            self.is_hung = True
        finally:
            caller.end(last if self.is_hung else _nothing)

    def told(self) -> str:
        """Return what is said of a disk that hangs."""
        return (
            f"the disk hangs: it has not come back from writing for {self.stalled_s:g} s. Look at its cable and at "
            "`dmesg`, then `rigctl resume`"
        )


def _nothing() -> None:
    """Return: the thread ends with nothing left to do."""
