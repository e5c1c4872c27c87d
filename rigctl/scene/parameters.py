"""Every number of a scene by its key: what there is, what it is, and the scene with another in its place."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any

import numpy as np
from pydantic import BaseModel

from model.surface.materials import Property
from rigctl.errors import ConfigError
from rigctl.files.config import Uncertain
from rigctl.scene.parameter_table import OLD_KEYS, Place, Row, all_rows, placed_rows
from rigctl.scene.scene_record import Scene

_SUGGESTED = 4


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One number of a scene.

    Attributes
    ----------
    key : str
        As in files, such as "regions.black_panel.stokes_radiance.0".
    value, std : float
        It, and its standard uncertainty, in `unit`.
    unit : str
        Of the file; empty for a pure number.
    least, most : float
        Between which numbers it has to stay.
    meaning : str
        One line.
    """

    key: str
    value: float
    std: float
    unit: str
    least: float
    most: float
    meaning: str


def parameters(scene: Scene) -> tuple[Parameter, ...]:
    """Return every number of a scene that may be changed, in the order of the file's tables."""
    return tuple(_parameter(key, row, place, leaf) for key, row, place, leaf in _found(scene))


def get(scene: Scene, key: str) -> Parameter:
    """Return one number of a scene.

    Raises
    ------
    ConfigError
        The scene has no such number.
    """
    wanted = OLD_KEYS.get(key, key)
    for found, row, place, leaf in _found(scene):
        if found == wanted:
            return _parameter(key, row, place, leaf)
    raise ConfigError(unknown(scene, key))


def with_value(scene: Scene, key: str, value: float) -> Scene:
    """Return the scene with another number in the place of one; its standard uncertainty stays.

    Raises
    ------
    ConfigError
        The scene has no such number.
    """
    return with_values(scene, {key: value})


def with_values(scene: Scene, values: Mapping[str, float]) -> Scene:
    """Return the scene with other numbers, by their keys; standard uncertainties stay.

    Raises
    ------
    ConfigError
        The scene has no such number.

    Notes
    -----
    What the model cannot compute is refused there, by name and range.
    """
    found = {key: (place, leaf) for key, _, place, leaf in _found(scene)} if values else {}
    changed = scene
    for key, value in values.items():
        place, leaf = found.get(OLD_KEYS.get(key, key), ((), None))
        if leaf is None:
            raise ConfigError(unknown(scene, key))
        if _number(place, leaf)[0] != value:
            changed = _with(changed, place, value)
    return changed


def require_within(scene: Scene, values: Mapping[str, float], *, option: str) -> None:
    """Refuse numbers that are outside of their ranges.

    Parameters
    ----------
    scene : Scene
        Whose numbers they are.
    values : mapping
        Key to value, in the unit of the file.
    option : str
        Where they come from, for the message.

    Raises
    ------
    ConfigError
        One is outside, or the scene has no such number.
    """
    for key, value in values.items():
        one = get(scene, key)
        if not one.least <= value <= one.most:
            limits = f"from {one.least:g}" if math.isinf(one.most) else f"{one.least:g} to {one.most:g}"
            raise ConfigError(f"{option}: {key} = {value:g} {one.unit}".rstrip() + f", allowed is {limits}")


def parse_changes(requests: Iterable[str], *, option: str = "--set") -> dict[str, float]:
    """Return numbers by their keys from requests ``KEY=VALUE``.

    Raises
    ------
    ConfigError
        One cannot be read, or two are of one number.
    """
    found: dict[str, float] = {}
    for request in requests:
        key, _, text = request.partition("=")
        name = OLD_KEYS.get(key.strip(), key.strip())
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not name or not math.isfinite(value):
            raise ConfigError(f"{option}: is {request!r}, must be KEY=VALUE, for instance sun.zenith_deg=35")
        if name in found:
            raise ConfigError(f"{option}: {name} is given twice; a number has one value")
        found[name] = value
    return found


def describe() -> tuple[Row, ...]:
    """Return every parameter that a scene may have: key, unit, range and meaning."""
    return all_rows()


def unknown(scene: Scene, key: str) -> str:
    """Return in words that a scene has no such number, and which to try."""
    keys = [parameter.key for parameter in parameters(scene)]
    if key in {row.key for row in all_rows()}:
        return f"the scene does not state the number {key!r}; there are {', '.join(keys)}"
    close = get_close_matches(key, keys, n=_SUGGESTED, cutoff=0.6)
    alike = f"did you mean {', '.join(close)}?" if close else f"there are {', '.join(keys)}"
    return f"the scene has no number {key!r}; {alike}"


def _found(scene: Scene) -> Iterator[tuple[str, Row, Place, Any]]:
    """Yield the parameters that the scene has, each with what stands at its place."""
    for key, row, place in placed_rows(scene):
        leaf = _at(scene, place)
        if leaf is not None:
            yield key, row, place, leaf


def _parameter(key: str, row: Row, place: Place, leaf: Any) -> Parameter:
    value, std = _number(place, leaf)
    return Parameter(key=key, value=value, std=std, unit=row.unit, least=row.least, most=row.most, meaning=row.meaning)


def _number(place: Place, leaf: Any) -> tuple[float, float]:
    if isinstance(leaf, Uncertain):
        return leaf.value, leaf.std
    if isinstance(leaf, Property):
        return leaf.values[0], leaf.standard_uncertainty
    return (math.degrees(leaf) if _is_angle(place) else float(leaf)), 0.0


def _at(record: Any, place: Place) -> Any:
    for step in place:
        if record is None:
            return None
        record = record[step] if isinstance(step, int) else getattr(record, step)
    return record


def _with(record: Any, place: Place, value: float) -> Any:
    """Return a record with a number at a place; every record on the way there is made anew."""
    step, rest = place[0], place[1:]
    leaf = _at(record, (step,))
    changed = _with(leaf, rest, value) if rest else _leaf(place, leaf, value)
    if isinstance(step, int):
        return (*record[:step], changed, *record[step + 1 :])
    if isinstance(record, BaseModel):
        return record.model_copy(update={step: changed})
    return replace(record, **{step: changed})


def _leaf(place: Place, leaf: Any, value: float) -> Any:
    if isinstance(leaf, Uncertain):
        return leaf.model_copy(update={"value": value})
    if isinstance(leaf, Property):
        return replace(leaf, values=(value,))
    return np.deg2rad(value).item() if _is_angle(place) else value


def _is_angle(place: Place) -> bool:
    """Return True if a plain number of a model's record is an angle, which files have in degrees."""
    return str(place[-1]).endswith("_rad")
