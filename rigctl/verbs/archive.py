"""`rigctl archive`: an index of many runs, questions to it, and the verbs of single runs over all of them."""

import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, Unpack, cast, get_type_hints

from rigctl.console import Json, note, warn
from rigctl.errors import ConfigError
from rigctl.verbs.options import (
    NOT_AN_INPUT,
    CompareOptions,
    EngineOptions,
    FilePath,
    FrameOptions,
    Part,
    Result,
    Writes,
    engine_of,
    extend_help,
)

if TYPE_CHECKING:
    from rigctl.archive.health import ArchiveHealth
    from rigctl.archive.index import Fact, Indexed
    from rigctl.archive.rows import Verb

_FILES = ("archive.csv", "archive.json", "archive.html")

Root: TypeAlias = Annotated[FilePath, NOT_AN_INPUT]
Out: TypeAlias = Annotated[FilePath, Writes(kind="folder", names=_FILES)]


def index(root: Root, /) -> "IndexUpdate":
    """Make or update the index of an archive: time, sun, devices, state, verdict and regions of each run.

    The index is the file ROOT/.rigctl-index.sqlite; it can be removed and made again. Run folders are not changed. Only
    runs that changed are read again. Verdicts and regions come from the newest comparison.json of each run below ROOT.

    Example: rigctl archive index runs

    Parameters
    ----------
    root : path
        Folder with runs at any depth below it.
    """
    from rigctl.archive.index import update_index

    return IndexUpdate(update_index(Path(root)))


@dataclass(frozen=True)
class IndexUpdate(Result):
    """Result of an update of the index."""

    found: "Indexed"

    def content(self) -> Iterable[Part]:
        """Return the numbers in one line."""
        found = self.found
        yield (
            f"{found.runs} runs: {found.new} new, {found.changed} changed, {found.gone} gone, {found.damaged} damaged; "
            f"{found.comparisons} comparisons"
        )

    def as_json(self) -> dict[str, Json]:
        """Return the numbers."""
        return {"schema_version": 1, **asdict(self.found)}


def find(root: Root, expression: str, /, *, csv: bool = False) -> "FoundRows":
    """Print the runs and regions that fulfil a condition.

    The condition is an SQL expression: comparisons such as column < number or column = 'text', joined by and, or, not
    and brackets. docs/how-to/archives.md lists the columns. A run that was never compared has no regions and no
    verdict, and fulfils no condition on them.

    Example: rigctl archive find runs "sun_zenith < 40 and region = 'asphalt' and verdict = 'disagree'"

    Parameters
    ----------
    root : path
        Folder with runs at any depth below it.
    expression : str
        SQL condition on the columns of the index.
    csv : bool
        Print CSV with all columns.
    """
    from rigctl.archive.index import find as found_in

    found = FoundRows(rows=tuple(found_in(Path(root), expression)), csv=csv)
    if not csv:
        note(f"{len(found.rows)} rows of {len(found.runs)} runs")
    return found


@dataclass(frozen=True, kw_only=True)
class FoundRows(Result):
    """Rows of an archive that fulfil a condition."""

    rows: "tuple[dict[str, Fact], ...]"
    csv: bool = False  #: print CSV with all columns

    @property
    def runs(self) -> tuple[str, ...]:
        """The different runs among the rows."""
        return tuple(dict.fromkeys(str(row["run"]) for row in self.rows))

    def content(self) -> Iterable[Part]:
        """Return the rows as a table."""
        from rigctl.archive.report import found_table

        yield found_table(self.rows)

    def show(self) -> None:
        """Print the rows."""
        from rigctl.archive.report import found_table

        if self.csv:
            sys.stdout.write(found_table(self.rows).csv())
        else:
            super().show()

    def as_json(self) -> list[Mapping[str, Json]]:
        """Return the rows with all columns."""
        return list(self.rows)


def health(root: Root, /) -> "RigHealth":
    """Print how the rig changed from run to run: stage, lost frames, dark level, gain, axis and clock.

    The command reads the runs, not the index, and opens one dark frame of each. Numbers far from those of other runs of
    the same device are listed.

    Example: rigctl archive health runs

    Parameters
    ----------
    root : path
        Folder with runs at any depth below it.
    """
    from rigctl.archive.health import health_of
    from rigctl.archive.index import found_below, require_folder

    folder = Path(root)
    require_folder(folder)
    return RigHealth(health_of(folder, found_below(folder)[0]))


@dataclass(frozen=True)
class RigHealth(Result):
    """Changes of a rig over the runs of an archive."""

    found: "ArchiveHealth"

    def content(self) -> Iterable[Part]:
        """Return how much changed, a row for each run, changes, numbers that stand out, and runs not read."""
        from rigctl.archive.report import health_table

        found = self.found
        yield (
            f"{len(found.runs)} runs: {len(found.changes)} changes of the rig, {len(found.outlying)} numbers stand "
            f"out, {len(found.unread)} runs cannot be read"
        )
        yield health_table(found.runs)
        for change in found.changes:
            yield f"{change.utc[:16]}Z  {change.run}: {change.what}: {change.before} -> {change.after}"
        for one in found.outlying:
            yield f"stands out: {one.run}: {one.what} = {one.value:.6g}, usually {one.usual:.6g}"
        for name, problem in found.unread.items():
            yield f"not read: {name}: {problem}"

    def as_json(self) -> dict[str, Json]:
        """Return runs, changes, numbers that stand out and runs that cannot be read."""
        return self.found.as_json()


class ManyRuns(EngineOptions, total=False):
    """Selection of runs of an archive.

    Parameters
    ----------
    where : str
        Only runs that fulfil this expression, as in `archive find`; default: all runs.
    """

    where: str | None


extend_help(ManyRuns, EngineOptions)


class ManyResults(ManyRuns, total=False):
    """Selection of runs of an archive, and files to write for each.

    Parameters
    ----------
    regions : path
        Regions file.
    full : bool
        Also write to OUT/runs/RUN all files that the command for a single run writes.
    """

    regions: FilePath | None
    full: bool


class ManyMeasured(FrameOptions, ManyResults, total=False):
    """Options of `archive stokes`."""


class ManyCompared(CompareOptions, ManyResults, total=False):
    """Options of `archive compare`."""


extend_help(ManyResults, ManyRuns)
extend_help(ManyMeasured, FrameOptions, ManyResults)
extend_help(ManyCompared, CompareOptions, ManyResults)


def compare(
    root: Root,
    /,
    *,
    out: Out,
    scene: FilePath | None = None,
    **options: Unpack[ManyCompared],
) -> Result:
    """Compare every selected run with the model, like `rigctl compare`; write one table and one page.

    Each run has its own sun, and its comparison.json in OUT/runs/RUN. If OUT is below ROOT, the index gets the
    verdicts. A run that is damaged or unfit is a row with its reason. Ctrl-C stops (exit code 75), and the same command
    continues.

    Exit codes: 0 all agree, 5 a run disagrees, 4 none disagrees but a run is unfit or cannot be judged, 75 stopped.

    Example: rigctl archive compare runs --scene scene.toml --where "sun_zenith < 60" --out runs/compared

    Parameters
    ----------
    root : path
        Folder with runs at any depth below it.
    out : path
        Folder for table, page and finished runs.
    scene : path
        Scene file.
    **options
        As of `rigctl compare`, and a selection of runs, see `ManyCompared`.
    """
    from rigctl.verbs.compare import require_possible

    require_possible(scene, options.get("regions"), _of_single(options))
    return _over_runs("compare", root, out, options, scene=scene)


def stokes(root: Root, /, *, out: Out, **options: Unpack[ManyMeasured]) -> Result:
    """Measure every selected run, like `rigctl stokes`: DoLP and AoLP of the regions, soundness.

    Images are written only with --full. A damaged run is a row with its reason. Ctrl-C stops (exit code 75), and the
    same command continues; runs that did not change are not measured twice.

    Exit codes: 0 all sound, 4 a run is refused or unfit, 75 stopped.

    Example: rigctl archive stokes runs --regions regions.toml --out runs/measured

    Parameters
    ----------
    root : path
        Folder with runs at any depth below it.
    out : path
        Folder for table, page and finished runs.
    **options
        As of a single run, and which runs, see `ManyMeasured`.
    """
    return _over_runs("stokes", root, out, options)


def verify(root: Root, /, *, out: Out, **options: Unpack[ManyRuns]) -> Result:
    """Check every checksum of every selected run, like `rigctl verify`.

    A run is checked again only if its journals, or sizes or times of its frames, have changed. To check all runs again,
    give another folder as --out.

    Exit codes: 0 all complete, 4 a run is damaged, 75 a run is unfinished or the check was stopped.

    Example: rigctl archive verify runs --out checked --workers 2

    Parameters
    ----------
    root : path
        Folder with runs at any depth below it.
    out : path
        Folder for table, page and finished runs.
    **options
        Selection of runs, see `ManyRuns`.
    """
    return _over_runs("verify", root, out, options)


def recalibrate(root: Root, /, *, out: Out, scene: FilePath | None = None, **options: Unpack[ManyMeasured]) -> Result:
    """Measure every selected run again, with other calibrations or the present ones of the store.

    The table has each number twice: with the new calibrations, and without calibration and with the axis of the run's
    rig file. Polarizer angles are computed again from the stage angles with the calibrated axis. The runs are not
    changed; OUT/runs/RUN/stokes.json has the new numbers and the hashes of the calibrations.

    Exit codes: 0 all sound, 4 a run is refused or unfit, 75 stopped.

    Example: rigctl archive recalibrate runs --regions regions.toml --polarizer polarizer.json --out recalibrated

    Parameters
    ----------
    root : path
        Folder with runs at any depth below it.
    out : path
        Folder for table, page and finished runs.
    scene : path
        Scene file, for its regions.
    **options
        As of a single run, and which runs, see `ManyMeasured`.
    """
    if options.get("regions") is None and scene is None:
        raise ConfigError("give --regions FILE, or --scene FILE for its regions: numbers are given for regions")
    return _over_runs("recalibrate", root, out, options, scene=scene)


def _of_single(options: Mapping[str, Any]) -> CompareOptions:
    """Return the options of the verb for a single run."""
    many = get_type_hints(ManyResults)
    return cast("CompareOptions", {name: value for name, value in options.items() if name not in many})


def _over_runs(
    verb: "Verb", root: FilePath, out: FilePath, options: Mapping[str, Any], *, scene: FilePath | None = None
) -> Result:
    from rigctl.mapped import count_shown
    from rigctl.verbs.over_runs import ArchiveJob, run_over_archive

    regions = options.get("regions")
    job = ArchiveJob(
        verb=verb,
        root=Path(root),
        out=Path(out),
        engine=engine_of(cast("EngineOptions", options)),
        where=options.get("where"),
        scene=None if scene is None else Path(scene),
        regions=None if regions is None else Path(regions),
        options=_of_single(options),
        full=options.get("full", False),
    )
    with count_shown("runs") as tell:
        found = run_over_archive(job, tell=tell)
    for text in found.damaged:
        warn(f"{text}; its runs were done again")
    note(f"table and page: {job.out / 'archive.csv'}, {job.out / 'archive.html'}")
    return found
