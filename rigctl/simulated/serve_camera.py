"""The camera of a simulated rig on the network, for other programs."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path

from rigctl.errors import ConfigError
from rigctl.files.rig_file import load_rig
from rigctl.simulated.camera_address import SERVED, split_faults
from rigctl.simulated.simulation import simulate
from sim_devices.cameras.gige_server import serve_gige_camera

_EXAMPLE = "rig-sim.toml"


@contextmanager
def serve_rig_camera(address: str, *, rig_path: Path | None, lost_share: float) -> Iterator[str]:
    """Serve it until the context is left; give the port of the rig's stage, which turns the polarizer.

    Parameters
    ----------
    address : str
        IP address of this machine, and behind a "?" what goes wrong: see `rigctl.simulated.camera_address`.
    rig_path : Path or None
        A rig file with a [simulation]; None: the one of the examples.
    lost_share : float
        Share of packets that are not sent.

    Raises
    ------
    ConfigError
        The rig file is wrong, or describes no simulation; or a fault is none.
    NotConnectedError
        libaravis is not installed, or the address is not this machine's or in use.
    """
    place, _, options = address.partition("?")
    faults, rest = split_faults(options)
    if rest:
        raise ConfigError(f"{address}: {rest}: no fault that the simulated camera has; docs/cameras.md lists them")
    faults = replace(faults, lost_share=lost_share or faults.lost_share)
    with as_file(files("rigctl") / "data" / "examples") as examples:
        rig = load_rig(rig_path or examples / _EXAMPLE)
        camera_section = rig.camera.model_copy(update={"address": SERVED})  # not twice on the network
        rig = rig.model_copy(update={"camera": camera_section})
        with simulate(rig, session_name="served") as simulation:
            serial_number = simulation.camera.identify().serial_number
            with serve_gige_camera(simulation.camera, address=place, serial_number=serial_number, faults=faults):
                yield simulation.stage_port
