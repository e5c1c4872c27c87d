"""Which program solves the light of the air."""

import importlib.util
from typing import Literal

from rigctl.errors import ConfigError

# The project's own solver, or an independent one beside it as a check.
Engine = Literal["own", "sasktran2"]


def require_engine(engine: Engine) -> None:
    """Refuse a program that is not installed.

    Raises
    ------
    ConfigError
        It is not.
    """
    if engine == "sasktran2" and importlib.util.find_spec("sasktran2") is None:
        raise ConfigError(
            "--engine sasktran2: is not installed; run pip install 'rigctl[check]', or leave --engine out"
        )
