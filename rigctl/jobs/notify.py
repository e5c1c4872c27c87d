"""Trying the notices of a rig file before they are needed."""

import time
from pathlib import Path

from rigctl.errors import ConfigError
from rigctl.files.rig_file import load_rig
from rigctl.numbers.utc_time import utc_text
from rigctl.session.notices import Notice, send


def send_test(rig: Path) -> tuple[str, ...]:
    """Send a notice as the rig file says; return what went wrong, nothing where all went well.

    Parameters
    ----------
    rig : Path
        Rig file with a section ``[notify]``.

    Raises
    ------
    ConfigError
        The file is wrong, or nobody is named in it.
    """
    section = load_rig(rig).notify
    if section is None:
        raise ConfigError(f'{rig}: has no [notify]; write one with webhook = "https://..." or command = ["program"]')
    return send(section, Notice(run="none", event="test", text="rigctl notify test", utc=utc_text(time.time_ns())))
