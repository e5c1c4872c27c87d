"""Archives of runs: the index, and what is found in it."""

from dataclasses import dataclass
from pathlib import Path

from rigctl.archive.health import ArchiveHealth, health_of
from rigctl.archive.index import Fact, Indexed, find, found_below, parse, require_folder, update_index


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


def matching_runs(root: Path, where: str | None) -> list[str]:
    """Return the runs of an archive that an expression holds of, all where there is none, from its root.

    The index is brought up to date where an expression asks it.

    Raises
    ------
    ConfigError
        There is no such folder, or the expression is none.
    """
    require_folder(root)
    if where is None:
        return sorted(run.relative_to(root).as_posix() for run in found_below(root)[0])
    condition = parse(where)
    update_index(root)
    return sorted({str(row["run"]) for row in find(root, condition)})


def archive_health(root: Path) -> ArchiveHealth:
    """Return how a rig fared over all runs of an archive; the index is not needed.

    Raises
    ------
    ConfigError
        There is no such folder.
    """
    require_folder(root)
    return health_of(root, found_below(root)[0])
