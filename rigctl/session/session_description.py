"""All that a reader of a run must know of how it came about, as the run's description holds it."""

import hashlib
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

from pydantic import JsonValue

from drivers.interfaces import Camera, ReportingCamera
from rigctl.devices.rig import Rig
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import SessionFile

# What decides the numbers in a run; their versions go into it.
_PACKAGES = ("rigctl", "numpy", "pyserial")


def describe_session(
    rig: Rig, rig_file: RigFile, session: SessionFile, files: dict[str, Path], inputs: dict[str, bytes]
) -> dict[str, JsonValue]:
    """Return all that a reader of the run must know of how it came about, as JSON can hold it.

    Parameters
    ----------
    rig, rig_file, session
        What is taken, and with which devices.
    files : mapping
        Where the inputs come from, by what they are.
    inputs : mapping
        What the run keeps of them; their hashes go into the description.
    """
    scene = {} if rig_file.simulation is None else {"scene": rig_file.simulation.scene}
    names = {what: path.name for what, path in (files | scene).items()}
    stage = {} if rig.stage_identity is None else {"stage": vars(rig.stage_identity)}
    # Where the rig file stands, its store of calibrations beside it; the key says that it is no business of others.
    place = {"host_folder": str(files["rig"].absolute().parent)} if "rig" in files else {}
    light = {} if rig.light is None else {"simulated_light": asdict(rig.light)}
    return {
        "origin": rig.origin,
        "rig": rig_file.model_dump(mode="json"),
        "session": session.model_dump(mode="json"),
        "files": {
            what: {"name": names[what], "sha256": hashlib.sha256(content).hexdigest()}
            for what, content in inputs.items()
        },
        **stage,
        "camera": vars(rig.camera_identity),
        "camera_facts": _facts_of(rig.camera),
        "versions": {package: version(package) for package in _PACKAGES},
        **light,
        **place,
    }


def _facts_of(camera: Camera) -> dict[str, JsonValue] | None:
    """Return how a camera's counts come about, and its features by its own names; None for one that does not tell.

    Raises
    ------
    DeviceError
        It does not answer.
    """
    if not isinstance(camera, ReportingCamera):
        return None
    facts = camera.facts()
    return {
        "sample_format": facts.sample_format,
        "justified": facts.justified,
        "linear": facts.linear,
        "features": dict(camera.features()),
    }
