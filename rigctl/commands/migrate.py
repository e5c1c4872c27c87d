"""``rigctl migrate``: copies of old runs and calibrations in the schemas of today."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.terminal import print_json, results


def command(
    paths: Annotated[list[Path], typer.Argument(metavar="PATH...", help="Run folders and calibration files.")],
    *,
    write: Annotated[bool, typer.Option("--write", help="Write the copies; else only say what they would be.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Say which schema old runs and calibrations have; with --write copy them, in the newest one, beside the old.

    Nobody has to: all that rigctl ever wrote is read as it is. A run of the newest layout has checksums of its lines,
    so that verify finds more. Old files are never changed; a copy's place that is taken is refused.

    Example: rigctl migrate runs/2024-05-04 noise-2024.json --write
    """
    from rigctl.jobs.migrate import migrate

    found = [migrate(path, write=write) for path in paths]
    if as_json:
        rows = [
            {
                "path": str(one.path),
                "kind": one.kind,
                "schema": one.schema,
                "newest": one.newest,
                "copy": None if one.copy is None else str(one.copy),
                "is_written": one.is_written,
            }
            for one in found
        ]
        print_json({"migrations": rows})
        return
    for one in found:
        results().print(one.line, markup=False)
