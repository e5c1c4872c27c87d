"""The file ``annotations.jsonl`` of a run folder: what people note of it, and which frames they leave out, and why.

It only grows, each line on the disk before the next, and is chained as the other journals are; frames never change.
"""

import json
from dataclasses import asdict, replace
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from rigctl.errors import DataError, RunFolderError
from rigctl.runs.annotation_record import Annotation, excluded_frames, exclusions_text
from rigctl.runs.journal import Journal
from rigctl.runs.run_description import SESSION_FILE, explain_invalid, first_link, read_description
from rigctl.runs.run_folder import ANNOTATIONS_FILE, Run
from rigctl.runs.run_lock import locked_file
from rigctl.runs.sealed_lines import Lines, journal_bytes, read_lines
from rigctl.storage.durable_file import flush_folder

# Of runs whose own journals have no seals; this file has them always.
_LINK_OF_OLD = "annotations"


_ANNOTATION = TypeAdapter(Annotation)


def annotated(run: Run, *, ignore_exclusions: bool = False) -> Run:
    """Return a run with what is noted of it, and without the frames that are excluded.

    Parameters
    ----------
    run : Run
        As `read_run` returns it.
    ignore_exclusions : bool
        Keep excluded frames, also where the annotations are damaged.

    Raises
    ------
    RunFolderError
        The annotations are damaged, so that nobody knows which frames are excluded.
    """
    if not (run.path / ANNOTATIONS_FILE).exists():
        return run
    journal = read_annotation_lines(run.path)
    problems = annotation_problems(journal)
    if problems and not ignore_exclusions:
        raise RunFolderError(
            f"{run.path / ANNOTATIONS_FILE}: {'; '.join(problems)}: which frames are excluded is not known; "
            "--ignore-exclusions reads the run with all of them"
        )
    annotations = sound_annotations(journal)
    excluded = {} if ignore_exclusions else excluded_frames(annotations)
    return replace(
        run,
        frames=tuple(record for record in run.frames if record.sequence not in excluded),
        excluded=tuple(record for record in run.frames if record.sequence in excluded),
        annotations=annotations,
    )


def exclusion_remark(run: Run) -> str | None:
    """Return which frames of an annotated run people have excluded, and whether they are left out; None where none."""
    stated = exclusions_text(excluded_frames(run.annotations))
    said = "are left out" if run.excluded else "are taken all the same"
    return f"{run.path}: excluded frames {said}: {stated}" if stated else None


def read_annotations(path: Path) -> tuple[Annotation, ...]:
    """Return what is noted of a run; empty where nothing is.

    Raises
    ------
    RunFolderError
        A line is damaged, or the file cannot be read.
    """
    journal = read_annotation_lines(path)
    problems = annotation_problems(journal)
    if problems:
        raise RunFolderError(f"{path / ANNOTATIONS_FILE}: {'; '.join(problems)}")
    return sound_annotations(journal)


def read_annotation_lines(path: Path) -> Lines:
    """Return the lines of a run's annotations, each held against its seal; none where there is no such file.

    Raises
    ------
    RunFolderError
        The file cannot be read.
    """
    return read_lines(journal_bytes(path / ANNOTATIONS_FILE), _link(path))


def annotation_problems(journal: Lines) -> list[str]:
    """Return what is wrong with annotations, line by line."""
    found = []
    for number, line in enumerate(journal.lines, start=1):
        if line.problem:
            found.append(f"line {number}: {line.problem}")
        elif isinstance(read := _read_line(line.content), str):
            found.append(f"line {number} is no annotation: {read}")
    return found


def sound_annotations(journal: Lines) -> tuple[Annotation, ...]:
    """Return what the sound lines say."""
    read = (_read_line(line.content) for line in journal.lines if line.content)
    return tuple(one for one in read if isinstance(one, Annotation))


def _read_line(content: bytes) -> Annotation | str:
    """Return what a line says, or what is wrong with it."""
    try:
        return _ANNOTATION.validate_json(content)
    except ValidationError as error:
        return explain_invalid(error)


def annotate(path: Path, annotation: Annotation) -> None:
    """Return once an annotation is on the disk, at the end of the run's annotations.

    Raises
    ------
    RunFolderError
        The annotations that are there are damaged: nothing is put behind them.
    OSError
        It could not be written; the file is as it was.
    """
    is_new = not (path / ANNOTATIONS_FILE).exists()
    with locked_file(path / ANNOTATIONS_FILE):
        read_annotations(path)
        journal = Journal(path / ANNOTATIONS_FILE, first_link=_link(path))
        try:
            journal.append([json.dumps(asdict(annotation), allow_nan=False).encode("ascii")])
        finally:
            journal.close()
    if is_new:
        flush_folder(path)


def _link(path: Path) -> str:
    """Return what the chain of a run's annotations begins with."""
    try:
        return first_link(read_description(path / SESSION_FILE)) or _LINK_OF_OLD
    except DataError:
        return _LINK_OF_OLD
