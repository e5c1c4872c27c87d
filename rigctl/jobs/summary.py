"""A page on how a session went: its run folder in, the page out."""

from pathlib import Path

from rigctl.live.session_history import SessionHistory, session_history
from rigctl.reports.pages.run_page import run_report
from rigctl.reports.writers.output_folder import report_file
from rigctl.runs.wholeness import used_run
from rigctl.storage.durable_file import write_durably


def summarise_session(run: Path, page: Path) -> SessionHistory:
    """Return how a session went, and write its page.

    Raises
    ------
    RunFolderError
        This is no run, a frame is damaged, or the events cannot be read.
    """
    history = session_history(used_run(run))
    write_durably(page, report_file(run_report(history), page))
    return history
