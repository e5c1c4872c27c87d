"""The files of a study for people: how much each input matters."""

from collections.abc import Sequence
from pathlib import Path

from rigctl.console.json_text import Json
from rigctl.reports.figures.study_figures import morris_figure, sobol_figure
from rigctl.reports.tables.study_tables import morris_table, sobol_table
from rigctl.reports.writers.data_files import csv_rows, json_file, json_rows
from rigctl.reports.writers.output_folder import write_folder
from rigctl.study.sensitivity import MorrisEffect, SobolIndex

SCHEMA_VERSION = 1


def write_sensitivity(
    sobol: Sequence[SobolIndex], morris: Sequence[MorrisEffect], out: Path, *, created_by: str
) -> tuple[str, ...]:
    """Write sensitivity.csv, sensitivity.json and sensitivity.png of one kind of index; return their names.

    Parameters
    ----------
    sobol, morris : sequences
        One of them holds something.
    out : Path
        Folder.
    created_by : str
        Program and version.
    """
    table = sobol_table(sobol) if sobol else morris_table(morris)
    content: dict[str, Json] = {
        "schema_version": SCHEMA_VERSION,
        "created_by": created_by,
        "method": "sobol" if sobol else "morris",
        "rows": list(json_rows(table)),
    }
    files = {
        "sensitivity.csv": csv_rows(table),
        "sensitivity.json": json_file(content),
        "sensitivity.png": sobol_figure(sobol) if sobol else morris_figure(morris),
    }
    write_folder(out, files)
    return tuple(files)
