"""A page on how a session went: its run folder in, the page out."""

from dataclasses import dataclass
from pathlib import Path

from rigctl.console.exclusion_option import are_exclusions_ignored
from rigctl.files.rig_file import unset_polarizer
from rigctl.live.session_history import SessionHistory, session_history
from rigctl.measurement.run_diagnosis import RunDiagnosis, quick_diagnosis
from rigctl.reports.pages.run_page import run_report
from rigctl.reports.writers.output_folder import report_file
from rigctl.runs.wholeness import used_run
from rigctl.storage.durable_file import write_durably

# Of one frame: larger pictures are diagnosed from squares of pixels.
_MOST_PIXELS = 1_500_000


@dataclass(frozen=True, kw_only=True, eq=False)
class SummarisedSession:
    """How a session went, and what its frames say of their faults."""

    history: SessionHistory
    diagnosis: RunDiagnosis
    doubts: tuple[str, ...]


def summarise_session(run: Path, page: Path) -> SummarisedSession:
    """Return how a session went, and write its page.

    Raises
    ------
    RunFolderError
        This is no run, a frame is damaged, or the events cannot be read.
    """
    history = session_history(used_run(run, ignore_exclusions=are_exclusions_ignored()))
    diagnosis = quick_diagnosis(history.run, most_pixels=_MOST_PIXELS)
    write_durably(page, report_file(run_report(history, diagnosis), page))
    doubts = unset_polarizer(run, placeholder=history.run.session.polarizer.placeholder)
    return SummarisedSession(history=history, diagnosis=diagnosis, doubts=doubts)
