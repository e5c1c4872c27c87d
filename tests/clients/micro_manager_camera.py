"""Takes a sweep of flats and darks with the demonstration camera of Micro-Manager, and writes them as arrays.

    python micro_manager_camera.py FOLDER SETTINGS.json

Runs in an environment of its own, with pymmcore and mm-test-adapters. SETTINGS.json has the properties of the camera,
and the groups to take: name, exposure_ms, photon_flux and how many frames.
"""

import json
import sys
from pathlib import Path

import mm_test_adapters
import numpy as np
import pymmcore

CAMERA = "Camera"


def opened(properties: dict[str, str]) -> "pymmcore.CMMCore":
    """The camera with its properties set, in their order."""
    core = pymmcore.CMMCore()
    core.setDeviceAdapterSearchPaths([str(mm_test_adapters.device_adapter_path())])
    core.loadDevice(CAMERA, "DemoCamera", "DCam")
    core.initializeAllDevices()
    core.setCameraDevice(CAMERA)
    for name, value in properties.items():
        core.setProperty(CAMERA, name, value)
    return core


def main(folder: Path, settings: dict) -> None:
    """Take all groups."""
    core = opened(settings["properties"])
    for group in settings["groups"]:
        core.setProperty(CAMERA, "Photon Flux", str(group["photon_flux"]))
        core.setExposure(group["exposure_ms"])
        frames = []
        for _ in range(group["frames"]):
            core.snapImage()
            frames.append(np.array(core.getImage(), dtype=np.uint16))
        np.save(folder / f"{group['name']}.npy", np.array(frames))


if __name__ == "__main__":
    main(Path(sys.argv[1]), json.loads(Path(sys.argv[2]).read_text(encoding="utf-8")))
