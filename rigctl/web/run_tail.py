"""The frames of a run that may be growing: each line of its manifest is read once."""

from pathlib import Path

from rigctl.errors import DataError
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_description import SESSION_FILE, RunDescription, first_link, read_description
from rigctl.runs.run_folder import MANIFEST_FILE, Run, parse_record
from rigctl.runs.sealed_lines import first_link_of, read_lines
from rigctl.runs.session_record import session_record

_MOST_BYTES_A_LOOK = 64_000_000


class RunTail:
    """Follows the manifest of a run.

    Parameters
    ----------
    path : Path
        The run folder; it may come later.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._description: RunDescription | None = None
        self._begin_again()

    @property
    def description(self) -> RunDescription | None:
        """What the run says of itself; None until it is there and can be read."""
        return self._description

    def read(self) -> tuple[FrameRecord, ...]:
        """Return all frames of the run so far.

        Raises
        ------
        DataError
            The run cannot be read.
        """
        if self._description is None and (self._path / SESSION_FILE).exists():
            self._description = read_description(self._path / SESSION_FILE)
        try:
            size = (self._path / MANIFEST_FILE).stat().st_size
        except FileNotFoundError:
            self._begin_again()
            return ()
        if size < self._end:  # `resume` has repaired it
            self._begin_again()
        if size > self._end:
            self._take_in(self._read_on())
        return tuple(self._frames)

    def run(self, frames: tuple[FrameRecord, ...]) -> Run | None:
        """Return the run with some of its frames; None while it has not said what it is."""
        if self._description is None:
            return None
        return Run(
            path=self._path,
            session=session_record(self._description.session),
            session_json=self._description.session,
            frames=frames,
            created_by=self._description.created_by,
            created_utc=self._description.created_utc,
        )

    def _begin_again(self) -> None:
        self._end = 0
        self._link: str | None = None
        self._frames: list[FrameRecord] = []
        self.problems: list[str] = []

    def _read_on(self) -> bytes:
        """Return the whole lines behind the place up to which the manifest has been read."""
        with (self._path / MANIFEST_FILE).open("rb") as file:
            file.seek(self._end)
            data = file.read(_MOST_BYTES_A_LOOK)
        whole, end, _ = data.rpartition(b"\n")
        return whole + end

    def _take_in(self, data: bytes) -> None:
        if self._end == 0:
            self._link = first_link_of(data) if self._description is None else first_link(self._description)
        lines = read_lines(data, self._link)
        self._end += len(data)
        self._link = lines.links[-1] if lines.links else None
        for line in lines.lines:
            self._take_line(line.content, line.problem)

    def _take_line(self, content: bytes, problem: str | None) -> None:
        if problem is not None:
            self.problems.append(f"{MANIFEST_FILE}: {problem}")
        if not content:
            return
        try:
            self._frames.append(parse_record(content))
        except DataError as error:
            self.problems.append(f"{MANIFEST_FILE}: {error}")
