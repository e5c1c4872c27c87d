"""Batches on dask: workers of this machine, or those of a scheduler that somebody else runs."""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.errors import ConfigError, DataError
from rigctl.study.batch import Batch, BatchResult, compute
from rigctl.study.study_case import code_version

_NEEDED = "needs dask.distributed, xarray, zarr and pyarrow: pip install 'rigctl[cluster]'"
# A worker that is killed is started anew and its batch given to another; so often before the batch is to blame.
_LOST_WORKERS = 10
# Batches that wait at each worker: its next is there when one is done, and few are lost with the client.
_WAITING = 2
_CONNECT_S = 15


@dataclass(frozen=True, kw_only=True)
class Engine:
    """Where batches are computed: the address of a scheduler, or so many processes here."""

    scheduler: str | None
    workers: int


@contextmanager
def client_of(engine: Engine) -> Iterator[Any]:
    """Hold a client of dask; workers of this machine end with it.

    Raises
    ------
    ConfigError
        dask is not installed, no scheduler answers, or a worker has another version of the program.
    """
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise ConfigError(f"rigctl study {_NEEDED}") from error
    settings = {
        "distributed.scheduler.allowed-failures": _LOST_WORKERS,
        "distributed.comm.timeouts.connect": _CONNECT_S,
    }
    with dask.config.set(settings):
        if engine.scheduler is None:
            with (
                LocalCluster(
                    n_workers=engine.workers,
                    threads_per_worker=1,
                    processes=True,
                    # Nothing listens beyond this machine.
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                ) as cluster,
                Client(cluster) as client,
            ):
                yield client
            return
        try:
            client = Client(engine.scheduler, timeout=_CONNECT_S)
        except (OSError, ValueError) as error:
            raise ConfigError(f"--scheduler {engine.scheduler}: no scheduler of dask answers there: {error}") from error
        with client:
            require_same_code(client)
            yield client


def require_same_code(client: Any) -> None:
    """Refuse workers of another version, and a scheduler without any."""
    try:
        codes = client.run(code_version)
    except ImportError as error:
        raise ConfigError(f"--scheduler: rigctl is not installed on a worker: {error}") from error
    if not codes:
        raise ConfigError("--scheduler: it has no workers; start some: dask worker ADDRESS --nthreads 1")
    others = {worker: code for worker, code in codes.items() if code != code_version()}
    if others:
        told = ", ".join(f"{worker} has {code}" for worker, code in sorted(others.items()))
        raise ConfigError(f"--scheduler: this is rigctl {code_version()}, and {told}: install the same on all")


def compute_all(client: Any, batches: Iterator[Batch], keep: Callable[[Batch, BatchResult], None]) -> None:
    """Compute batches, and keep each as it comes; which comes first is not said.

    Parameters
    ----------
    client : distributed.Client
        From `client_of`.
    batches : iterator of Batch
        As many as there are; only some for each worker are taken from it at a time.
    keep : callable
        Takes a batch and its result; called in this thread.

    Raises
    ------
    ConfigError
        A worker is of another version.
    DataError
        The scheduler or all of its workers are gone.
    """
    from distributed import as_completed

    under_way: dict[str, Batch] = {}
    workers = max(1, len(client.scheduler_info()["workers"]))
    queue = as_completed()

    def give() -> None:
        batch = next(batches, None)
        if batch is not None:
            future = client.submit(compute, batch, pure=False)
            under_way[future.key] = batch
            queue.add(future)

    for _ in range((1 + _WAITING) * workers):
        give()
    try:
        while under_way:
            future = next(queue)
            batch = under_way.pop(future.key)
            keep(batch, _result(future, batch))
            give()
    except StopIteration as error:
        raise DataError(_gone(len(under_way))) from error


def _result(future: Any, batch: Batch) -> BatchResult:
    from distributed import KilledWorker
    from distributed.client import FutureCancelledError

    try:
        result = future.result()
    except KilledWorker as error:
        return _failed(batch, f"every worker that had this batch of {len(batch.cases)} ended (no memory?): {error}")
    except (FutureCancelledError, OSError) as error:
        raise DataError(_gone(1)) from error
    if not isinstance(result, BatchResult):
        raise DataError(f"a worker sent {type(result).__name__} in the place of a result")
    return result


def _gone(batches: int) -> str:
    return f"the scheduler is gone with {batches} batches under way; what was done is kept: give the command again"


def _failed(batch: Batch, reason: str) -> BatchResult:
    cases = len(batch.cases)
    regions = tuple(region.name for region in batch.scene.file.regions)
    return BatchResult(
        numbers=tuple(case.number for case in batch.cases),
        regions=regions,
        pairs=(),
        values=np.full((cases, len(regions), len(batch.wanted.columns)), np.nan),
        p_detection=np.empty((cases, 0, 0)),
        auc=np.empty((cases, 0)),
        roc=np.empty((cases, 0, 0)),
        seconds=np.full(cases, np.nan),
        is_new_sky=np.zeros(cases, dtype=bool),
        reasons=(reason,) * cases,
    )
