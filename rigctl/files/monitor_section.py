"""Sensors that are read beside the frames: the tables ``[[monitors]]`` of a rig file."""

from typing import Annotated

from pydantic import Field

from rigctl.files.config import Section
from rigctl.files.regions import Name


class MonitorSection(Section):
    """A sensor that is read once an exposure: temperature, humidity, irradiance. It delays no frame and loses none.

    `options` are what its driver takes: see docs/plug-ins.md. A reading that `follows_light`, such as an irradiance,
    is what the drift of the light is held against.
    """

    name: Name
    """Its name in the run. Example: `"air"`."""
    driver: str
    """What reads it: file, command, serial, or a plug-in's. Example: `"file"`."""
    deadline_s: Annotated[float, Field(gt=0, le=60)] = 1.0
    """A reading that takes longer is none. Example: `1.0`."""
    follows_light: bool = False
    """It grows with the light that the rig sees, as an irradiance does. Example: `true`."""
    options: dict[str, bool | int | float | str | list[str]] = Field(default_factory=dict)
    """What the driver takes. Example: `{ path = "/run/air.txt", unit = "deg C" }`."""
