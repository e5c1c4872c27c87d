"""A run as TIFF files, one a frame."""

import json
from dataclasses import asdict
from pathlib import Path

from rigctl.errors import ConfigError
from rigctl.runs.run_folder import Run


def export_tiff(run: Run, out: Path) -> None:
    """Write a run into a folder of TIFF files of 16 bits; what is known of a frame stands as JSON in its description.

    Raises
    ------
    ConfigError
        tifffile is not installed.
    RunFolderError
        A frame is damaged.
    """
    try:
        import tifffile
    except ImportError as error:
        raise ConfigError("--to tiff needs tifffile: pip install 'rigctl[export]'") from error
    out.mkdir(parents=True)
    for record in run.frames:
        name = Path(record.file).with_suffix(".tif").name
        # ASCII, as the format wants it: JSON escapes the rest.
        tifffile.imwrite(
            out / name, run.counts(record), photometric="minisblack", description=json.dumps(asdict(record))
        )
    (out / "session.json").write_text(json.dumps(run.session_json, indent=2), encoding="ascii")
