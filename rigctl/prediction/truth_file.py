"""The light of a scene of materials written as plain radiances, for simulators without the model."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.base.durable import sha256_of, write_durably
from rigctl.errors import ConfigError
from rigctl.files.scene_file import SceneFile, SceneRegion, load_scene
from rigctl.scene.light import build_scenario, sun_text
from rigctl.scene.scene import scene_of_file, with_values

_NOT_OF_THE_TRUTH = {"sun", "geometry", "atmosphere", "field_of_view", "errors", "effects", "rig", "site"}


def write_truth(scene_path: Path, out: Path, *, changes: Mapping[str, float] | None = None) -> None:
    """Write a scene file in which every region states its radiance, for a simulated rig."""
    file = load_scene(scene_path)
    # Errors of the rig are not part of the light.
    scene = with_values(replace(scene_of_file(file), rig=None), changes or {})
    scenario = build_scenario(scene)
    regions = [
        _stated(region, np.asarray(light.stokes_radiance), light.aperture_moments().cov)
        for region, light in zip(file.regions, scenario.regions, strict=True)
    ]
    content = file.model_dump(mode="json", exclude_none=True, exclude=_NOT_OF_THE_TRUTH)
    content |= {"name": f"{file.name}-truth", "regions": regions}
    content["sensor"]["wavelength_nm"] = scene.sensor.model_dump(mode="json")["wavelength_nm"]
    SceneFile.model_validate(content)
    lines = (
        f"# Light of {file.name} by the model ({scene_path.name}, sha256 {sha256_of(scene_path)[:16]}).",
        "# (S0, S1, S2) at the aperture, in the band of the sensor [W m-2 sr-1]; covariance over a region's pixels.",
        *(() if scene.sun is None else (f"# Sun: {sun_text(scene)}; {_time(file)}.",)),
        *_toml(content),
        "",
    )
    try:
        write_durably(out, "\n".join(lines).encode())
    except OSError as error:
        raise ConfigError(f"--write-truth: {out} cannot be written: {error.strerror}") from error


def _time(file: SceneFile) -> str:
    if file.sun is None or file.sun.time is None:
        return "by the angles of the scene file"
    return f"{file.sun.time.isoformat()}, by time and place of the scene file"


def _stated(region: SceneRegion, mean: Any, cov: Any) -> dict[str, Any]:
    kept = region.model_dump(mode="json", exclude_none=True, include={"name", "rectangle", "polygon", "edge_px"})
    return kept | {"stokes_radiance": mean.tolist(), "texture_covariance": (0.5 * (cov + cov.T)).tolist()}


def _toml(content: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of a file: numbers first, then tables, then the regions."""
    for key, value in content.items():
        if key != "regions" and not isinstance(value, dict):
            yield f"{key} = {_value(value)}"
    for key, value in content.items():
        if isinstance(value, dict):
            yield from ("", f"[{key}]", *(f"{name} = {_value(one)}" for name, one in value.items()))
    for region in content["regions"]:
        yield from ("", "[[regions]]", *(f"{name} = {_value(one)}" for name, one in region.items()))


def _value(value: Any) -> str:
    if isinstance(value, dict):
        if set(value) == {"value", "std"} and value["std"] == 0.0:
            return _value(value["value"])
        return "{ " + ", ".join(f"{key} = {_value(one)}" for key, one in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    # Numbers, texts and truths are written alike in JSON.
    return json.dumps(value)
