"""Run the tests that an earlier run skipped, and fail if they are skipped again.

Every run with pytest's cache keeps the ids of the tests that it skipped. After what they need has been installed,
`pytest --skipped-before tests` runs exactly these tests.
"""

import re
from pathlib import Path

import pytest

_KEY = "rigctl/skipped"


def add_options(parser: pytest.Parser) -> None:
    """Add the options of this plug-in."""
    group = parser.getgroup("skipped before")
    group.addoption(
        "--skipped-before",
        action="store_true",
        help="run only the tests that the last run without this option skipped; fail if one is skipped again",
    )
    group.addoption(
        "--may-skip",
        metavar="REGEX",
        default="(?!)",
        help="with --skipped-before: reasons for which a test may be skipped again",
    )


def _names_of(node: str) -> set[str]:
    """Return the ids under which a test may have been skipped: its own, its file's, that of an empty parameter set."""
    return {node, node.partition("::")[0], f"{node.partition('[')[0]}[NOTSET]"}


class SkippedTests:
    """Keep the ids of skipped tests, or select them and judge what became of them."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._cache: pytest.Cache | None = getattr(config, "cache", None)  # none with -p no:cacheprovider
        self._is_worker = hasattr(config, "workerinput")
        self._selects = bool(config.getoption("skipped_before"))
        self._may_skip = re.compile(config.getoption("may_skip"))
        self._wanted: set[str] = set()
        if self._selects:
            if self._cache is None or (kept := self._cache.get(_KEY, None)) is None:
                raise pytest.UsageError("--skipped-before: no earlier run is known; run the tests without it first")
            self._wanted = set(kept)
        self._files = {name.partition("::")[0] for name in self._wanted}
        self._skipped: dict[str, str] = {}
        self._run: set[str] = set()

    def pytest_ignore_collect(self, collection_path: Path) -> bool | None:
        if self._selects and collection_path.is_file():
            name = collection_path.relative_to(self._config.rootpath).as_posix()
            return True if name not in self._files else None
        return None

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        if self._selects:
            items[:] = [item for item in items if _names_of(item.nodeid) & self._wanted]

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        self._note(report)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._run |= _names_of(report.nodeid)
        self._note(report)

    def _note(self, report: pytest.CollectReport | pytest.TestReport) -> None:
        if report.skipped and not hasattr(report, "wasxfail"):
            self._skipped[report.nodeid] = report.longrepr[2] if isinstance(report.longrepr, tuple) else ""

    def _problems(self) -> list[str]:
        again = [f"{name}: {why}" for name, why in self._skipped.items() if not self._may_skip.search(why)]
        missing = self._wanted - self._run - set(self._skipped)
        return sorted([*again, *(f"{name}: not found any more" for name in missing)])

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        if self._is_worker:
            return
        if not self._selects:
            if self._cache is not None:
                self._cache.set(_KEY, sorted(self._skipped))
        elif exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED if self._problems() else pytest.ExitCode.OK

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self._selects and (problems := self._problems()):
            terminalreporter.section("skipped again, or not found")
            for line in problems:
                terminalreporter.line(line)
