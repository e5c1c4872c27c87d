"""The option ``truth=FILE`` of a simulated camera's address: where the simulation notes what it truly did."""

from pathlib import Path

from rigctl.errors import ConfigError
from sim_devices.truth_log import TruthLog

_TRUTH = "truth="


def split_truth(address: str) -> tuple[str, TruthLog | None]:
    """Return an address without its truth option, and the log that the option asks for.

    Parameters
    ----------
    address : str
        A simulated camera's, such as ``sim:gc780?truth=/tmp/truth.jsonl``. A relative file lies where the program
        runs: give an absolute one if the session is to be resumed from elsewhere.

    Raises
    ------
    ConfigError
        There are several files, an empty name, or the file cannot be written.
    """
    scheme, _, tail = address.partition("?")
    options = [option for option in tail.split("&") if option]
    files = [option.removeprefix(_TRUTH) for option in options if option.startswith(_TRUTH)]
    rest = "&".join(option for option in options if not option.startswith(_TRUTH))
    plain = f"{scheme}?{rest}" if rest else scheme
    if not files:
        return plain, None
    if len(files) > 1 or not files[0]:
        raise ConfigError(f"camera.address: truth={','.join(files)}: must be one file, such as truth=/tmp/truth.jsonl")
    try:
        return plain, TruthLog(Path(files[0]))
    except OSError as error:
        raise ConfigError(f"camera.address: truth={files[0]}: cannot be written: {error.strerror}") from error
