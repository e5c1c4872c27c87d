"""Work items done on dask: Ctrl-C keeps what was done."""

import signal
from collections.abc import Callable
from contextlib import nullcontext, suppress
from types import SimpleNamespace

import pytest

from rigctl import mapped

Kept = Callable[[int, int], None]


def _outcome_of(happens: Callable[[Kept], None], monkeypatch: pytest.MonkeyPatch) -> mapped.Outcome:
    """Return the outcome if this happens while the work is done."""

    def compute_all(client: object, work: object, tasks: object, keep: Kept, **_: object) -> None:
        happens(keep)

    client = SimpleNamespace(nthreads=lambda: {"worker": 1})
    monkeypatch.setattr(mapped, "client_of", lambda *_, **__: nullcontext(client))
    monkeypatch.setattr(mapped, "compute_all", compute_all)
    return mapped.mapped(
        mapped.Engine(scheduler=None, workers=1),
        abs,
        lambda slots: iter(range(slots)),
        lambda task, result: None,
        command="study",
        packages=("rigctl",),
        size=lambda task: 1,
        parts=lambda task: [task],
        lost=lambda task, reason: task,
        done=0,
        total=2,
        tell=lambda done, total: None,
    )


def _ctrl_c(kept: Kept) -> None:
    signal.raise_signal(signal.SIGINT)


def _ctrl_c_that_is_dropped(kept: Kept) -> None:
    with suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    kept(1, 1)


def _lock_that_breaks(kept: Kept) -> None:
    raise RuntimeError("cannot release un-acquired lock")


def _lock_that_ctrl_c_breaks(kept: Kept) -> None:
    with suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    _lock_that_breaks(kept)


@pytest.mark.parametrize("happens", [_ctrl_c, _ctrl_c_that_is_dropped, _lock_that_ctrl_c_breaks])
def test_ctrl_c_stops_the_work_wherever_it_arrives(happens, monkeypatch):
    assert _outcome_of(happens, monkeypatch) == "stopped"
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_another_failure_of_a_lock_is_not_taken_for_ctrl_c(monkeypatch):
    with pytest.raises(RuntimeError, match="un-acquired"):
        _outcome_of(_lock_that_breaks, monkeypatch)
