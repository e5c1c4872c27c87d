"""Work items done on dask: Ctrl-C keeps what was done."""

from contextlib import nullcontext
from types import SimpleNamespace

import pytest

from rigctl import mapped


def _outcome_after(failure: BaseException, monkeypatch: pytest.MonkeyPatch) -> mapped.Outcome:
    def compute_all(*_: object, **__: object) -> None:
        raise failure

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
        total=1,
        tell=lambda done, total: None,
    )


def _broken_lock(cause: BaseException) -> RuntimeError:
    """Return the failure of a lock that appeared while something else was handled."""
    error = RuntimeError("cannot release un-acquired lock")
    error.__context__ = cause
    return error


@pytest.mark.parametrize("failure", [KeyboardInterrupt(), _broken_lock(KeyboardInterrupt())])
def test_ctrl_c_stops_the_work_wherever_dask_is_waiting(failure, monkeypatch):
    assert _outcome_after(failure, monkeypatch) == "stopped"


def test_another_failure_of_a_lock_is_not_taken_for_ctrl_c(monkeypatch):
    with pytest.raises(RuntimeError, match="un-acquired"):
        _outcome_after(_broken_lock(ValueError()), monkeypatch)
