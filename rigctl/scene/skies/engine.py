"""The program that solves the light of the air: our own, or an independent one."""

import importlib.util

from model.atmosphere.sky import FIDELITY_LEVELS, Fidelity
from rigctl.errors import ConfigError
from rigctl.files.choices import Engine


def require_engine(engine: Engine, *, tier: Fidelity | None = None) -> None:
    """Refuse a program that is not installed, or for which a tier has no work.

    Raises
    ------
    ConfigError
        It is so.
    """
    if engine == "own":
        return
    if tier is not None and FIDELITY_LEVELS[tier].settings is None:
        raise ConfigError(f"--engine {engine}: solves the tiers fast and standard; tier '{tier}' calls no solver")
    if importlib.util.find_spec("sasktran2") is None:
        raise ConfigError(
            "--engine sasktran2: is not installed; run pip install 'rigctl[check]', or leave --engine out"
        )
