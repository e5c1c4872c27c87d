"""Archives of runs: the index, and what is found in it."""

from dataclasses import dataclass
from pathlib import Path

from rigctl.archive.expression import parse
from rigctl.archive.health import ArchiveHealth, health_of
from rigctl.archive.run_facts import Fact
from rigctl.archive.run_index import Indexed, find, found_below, require_folder, update_index


@dataclass(frozen=True, kw_only=True)
class FoundRuns:
    """Rows of an archive that were asked for."""

    rows: tuple[dict[str, Fact], ...]

    @property
    def runs(self) -> tuple[str, ...]:
        """The runs among them, each once."""
        return tuple(dict.fromkeys(str(row["run"]) for row in self.rows))


def index_archive(root: Path) -> Indexed:
    """Bring the index of an archive to what its folders hold; raises as `update_index`."""
    return update_index(root)


def find_runs(root: Path, expression: str) -> FoundRuns:
    """Return the rows of an archive that an expression holds of; raises as `parse` and `find`."""
    return FoundRuns(rows=tuple(find(root, parse(expression))))


def archive_health(root: Path) -> ArchiveHealth:
    """Return how a rig fared over all runs of an archive; the index is not needed.

    Raises
    ------
    ConfigError
        There is no such folder.
    """
    require_folder(root)
    return health_of(root, found_below(root)[0])
