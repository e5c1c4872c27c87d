"""Stores frames in the writer's thread; a full disk makes it wait, so that the frame in hand is not lost."""

import errno
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import RunFolderError
from rigctl.runs.run_folder import FrameRecord
from rigctl.runs.run_writer import RunWriter
from rigctl.session.session_context import SessionContext
from rigctl.terminal import warn

_RETRY_S = 1.0
_FULL = (errno.ENOSPC, errno.EDQUOT)


class FrameStore:
    """Writes frames, and tells of each.

    Parameters
    ----------
    writer : RunWriter
        Where to.
    context : SessionContext
        What is done about a full disk, and who may stop the waiting.
    stored : callable
        Told of each record once it is durable, in the writer's thread.
    """

    def __init__(self, writer: RunWriter, context: SessionContext, stored: Callable[[FrameRecord], None]) -> None:
        self._writer, self._context, self._stored = writer, context, stored
        self.frames = 0

    def store(self, record: FrameRecord, counts: NDArray[np.uint16]) -> None:
        """Return once a frame is durable.

        Raises
        ------
        RunFolderError
            It cannot be written, and waiting is not wanted or was ended.
        """
        waited = 0
        while True:
            try:
                written = self._writer.write_frame(record, counts)
                break
            except RunFolderError as error:
                if not self._waits(error):
                    raise
                if not waited:
                    warn(f"holding: {error}: make room, or stop")
                waited += 1
                self._context.clock.sleep(_RETRY_S)
        if waited:
            self._writer.event("disk was full", sequence=record.sequence, tries=waited + 1)
        self.frames += 1
        self._stored(written)

    def _waits(self, error: RunFolderError) -> bool:
        cause = error.__cause__
        is_full = isinstance(cause, OSError) and cause.errno in _FULL
        return is_full and self._context.interlocks.disk == "hold" and not self._context.control.is_stop_asked()
