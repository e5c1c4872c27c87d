"""Work items computed, stored and resumed, on workers of this machine or of another dask scheduler.

`mapped` does the remaining items and stores each result at once; after Ctrl-C the same command continues. Only one
command at a time may use a folder of results.
"""

import fcntl
import hashlib
import logging
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, TypeVar

from rigctl.console import progress
from rigctl.errors import ConfigError, DataError
from rigctl.scene.light import sources_of
from rigctl.version import VERSION

TaskT = TypeVar("TaskT")
ResultT = TypeVar("ResultT")
#: True if all items were tried, False if the work was stopped.
Outcome = Literal["whole", "stopped"]

_NEEDED = "needs dask.distributed, xarray, zarr and pyarrow: pip install 'rigctl[cluster]'"
_TOLD_DIGITS = 12
# Restarts of killed workers after which their task counts as the cause.
_LOST_WORKERS = 10
# Of workers of this machine. One thread of linear algebra each, as they are as many as cores. dask has them give freed
# memory back at once, which costs arrays of some 100 kB a page fault every time, look at the stack every 10 ms, and
# wake every 20 ms to see how long that took: each time the thread that computes has to let go of the interpreter.
_OF_WORKERS = {
    "distributed.nanny.pre-spawn-environ": {"OMP_NUM_THREADS": 1, "MKL_NUM_THREADS": 1, "OPENBLAS_NUM_THREADS": 1},
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "5s",
}
# Tasks queued at each worker, so that it never waits and few are lost with the client.
_WAITING = 2
_CONNECT_S = 15
# Longest time without workers, for a cluster's queue, and interval of counting them.
_FIRST_WORKER_S, _ASKED_EVERY_S = 60, 5.0


@dataclass(frozen=True, kw_only=True)
class Engine:
    """Address of a scheduler, or a number of processes on this machine."""

    scheduler: str | None
    workers: int


@cache
def code_version(packages: tuple[str, ...]) -> str:
    """Return the program's version with a hash of the packages and modules that determine results."""
    digest = hashlib.sha256()
    for package in packages:
        spec = find_spec(package)
        if spec is None or spec.origin is None:
            raise ModuleNotFoundError(package)
        is_package = spec.submodule_search_locations is not None
        sources = sources_of(files(package)) if is_package else {f"{package}.py": Path(spec.origin)}
        for name, source in sorted(sources.items()):
            digest.update(f"{package}/{name}\0".encode() + source.read_bytes() + b"\0")
    return f"{VERSION}+{digest.hexdigest()[:_TOLD_DIGITS]}"


@contextmanager
def client_of(engine: Engine, *, command: str, packages: tuple[str, ...]) -> Iterator[Any]:
    """Provide a client of dask within the context; workers of this machine end with it."""
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise ConfigError(f"rigctl {command} {_NEEDED}") from error
    settings = {
        "distributed.scheduler.allowed-failures": _LOST_WORKERS,
        "distributed.comm.timeouts.connect": _CONNECT_S,
        **_OF_WORKERS,
    }
    with dask.config.set(settings):
        if engine.scheduler is None:
            with _local_cluster(LocalCluster, engine.workers) as cluster, Client(cluster) as client:
                yield client
            return
        try:
            client = Client(engine.scheduler, timeout=_CONNECT_S)
        except (OSError, ValueError) as error:
            raise ConfigError(f"--scheduler {engine.scheduler}: no dask scheduler answers there: {error}") from error
        with client:
            require_same_code(client, packages)
            yield client


def _local_cluster(kind: Any, workers: int) -> Any:
    """Return workers of this machine, which listen locally only."""
    try:
        return kind(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        )
    except RuntimeError as error:
        raise DataError(
            f"workers do not start on this machine: {error} They need memory, ports of 127.0.0.1, a writable /dev/shm "
            "and a writable folder for temporary files"
        ) from error


def require_same_code(client: Any, packages: tuple[str, ...]) -> None:
    """Refuse workers of another version, and a scheduler without any."""
    try:
        client.wait_for_workers(1, timeout=_FIRST_WORKER_S)
        codes = client.run(code_version, packages)
    except TimeoutError as error:
        raise ConfigError("--scheduler: it has no workers; start some: dask worker ADDRESS --nthreads 1") from error
    except ImportError as error:
        raise ConfigError(f"--scheduler: rigctl is not installed on a worker: {error}") from error
    own = code_version(packages)
    others = {worker: code for worker, code in codes.items() if code != own}
    if others:
        told = ", ".join(f"{worker} has {code}" for worker, code in sorted(others.items()))
        raise ConfigError(f"--scheduler: this is rigctl {own}, and {told}: install the same on all")


def mapped(
    engine: Engine,
    work: Callable[[TaskT], ResultT],
    tasks: Callable[[int], Iterator[TaskT]],
    keep: Callable[[TaskT, ResultT], None],
    *,
    command: str,
    packages: tuple[str, ...],
    size: Callable[[TaskT], int],
    parts: Callable[[TaskT], Sequence[TaskT]],
    lost: Callable[[TaskT, str], ResultT],
    done: int,
    total: int,
    tell: Callable[[int, int], None],
) -> Outcome:
    """Do the remaining items of a map, and store each result at once; Ctrl-C stops.

    `tasks` takes how many tasks run at once and gives the items that are left, some in each task; `size` counts those
    of a task. `done` of `total` items were done before; `tell` takes both as they come. `work`, `keep`, `parts` and
    `lost` are those of `compute_all`. Raises as `client_of` and `compute_all`.
    """
    tell(done, total)
    if done == total:
        return "whole"

    def kept(task: TaskT, result: ResultT) -> None:
        nonlocal done
        keep(task, result)
        done += size(task)
        tell(done, total)

    try:
        with client_of(engine, command=command, packages=packages) as client:
            compute_all(client, work, tasks(slots_of(client)), kept, parts=parts, lost=lost)
    except KeyboardInterrupt:
        return "stopped"
    except RuntimeError as error:
        # Ctrl-C while dask waits for a condition can appear as its failure to release a lock that it no longer holds.
        if not isinstance(error.__context__, KeyboardInterrupt):
            raise
        return "stopped"
    return "whole"


@contextmanager
def count_shown(what: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar on a terminal; the yielded function takes the numbers of finished and of all items."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("left"))
    with Progress(*columns, console=progress(), transient=True) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def compute_all(
    client: Any,
    work: Callable[[TaskT], ResultT],
    tasks: Iterator[TaskT],
    keep: Callable[[TaskT, ResultT], None],
    *,
    parts: Callable[[TaskT], Sequence[TaskT]],
    lost: Callable[[TaskT, str], ResultT],
) -> None:
    """Do tasks, and store each result at once, in any order."""
    from distributed import KilledWorker, as_completed
    from distributed.client import FutureCancelledError

    under_way: dict[str, TaskT] = {}
    slots = _Slots(client)
    queue = as_completed()

    def give(task: TaskT) -> None:
        future = client.submit(work, task, pure=False)
        under_way[future.key] = task
        queue.add(future)

    while True:
        for _, task in zip(range((1 + _WAITING) * slots.count() - len(under_way)), tasks, strict=False):
            give(task)
        if not under_way:
            return
        try:
            future = next(queue)
            task = under_way.pop(future.key)
            result = future.result()
        except KilledWorker as error:
            smaller = parts(task)
            if len(smaller) > 1:
                for one in smaller:
                    give(one)
                continue
            result = lost(task, f"every worker with this task ended, perhaps for lack of memory: {error}")
        except (StopIteration, FutureCancelledError, OSError) as error:
            raise DataError(_gone(len(under_way) + 1)) from error
        keep(task, result)


class _Slots:
    """Number of tasks at once; workers come and go, on a cluster for minutes after the first."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._count, self._asked_s = slots_of(client), time.monotonic()

    def count(self) -> int:
        """Return how many, as of a few seconds ago."""
        if time.monotonic() > self._asked_s + _ASKED_EVERY_S:
            # The next missing result shows a lost scheduler.
            with suppress(OSError):
                self._count = slots_of(self._client)
            self._asked_s = time.monotonic()
        return self._count


def slots_of(client: Any) -> int:
    """Return the number of tasks that a client's workers run at once, at least 1."""
    threads: int = sum(client.nthreads().values())
    return max(1, threads)


def _gone(tasks: int) -> str:
    return f"the scheduler was lost with {tasks} running tasks; finished ones are stored: repeat the command"


PARTS_FOLDER = "parts"
_LOCK_FILE = ".lock"


@contextmanager
def held_folder(out: Path) -> Iterator[None]:
    """Lock a folder of results, created if needed, against other commands.

    If the work cannot begin (no dask, no scheduler), a new folder is removed again.
    """
    made = [path for path in (out / _LOCK_FILE, out / PARTS_FOLDER, out, *out.parents) if not path.exists()]
    (out / PARTS_FOLDER).mkdir(parents=True, exist_ok=True)
    descriptor = os.open(out / _LOCK_FILE, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise DataError(f"{out}: another command computes into this folder now; name another --out") from error
        yield
    except ConfigError:
        with suppress(OSError):  # a folder with content stays
            for path in made:
                path.unlink() if path.name == _LOCK_FILE else path.rmdir()
        raise
    finally:
        os.close(descriptor)
