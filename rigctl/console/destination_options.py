"""Destinations of every command, in one table; each is tried before the command begins."""

import functools
import inspect
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from rigctl.base.destination import (
    Destination,
    Kind,
    edited_before,
    keep_old,
    origin_of,
    remember_written,
    require_free,
    results_of,
    snapshot,
)
from rigctl.console.anonymity import anonymous
from rigctl.console.options import options_of

_FORCE, _ANONYMOUS = "force", "anonymous"
# They decide how a result is told, and not what is in it.
_TELLING = ("as_json", _FORCE)


@dataclass(frozen=True, kw_only=True)
class _Place:
    """One option of a command that names a destination, or its argument where `label` says so."""

    kind: Kind = "file"
    names: tuple[str, ...] = ()
    label: str | None = None


_FILE = _Place()


def _folder(*names: str) -> _Place:
    return _Place(kind="folder", names=names)


DESTINATIONS: dict[str, dict[str, _Place]] = {}


def with_tried_destinations(verb: str, command: Any) -> Any:
    """Return a command that tries its destinations before it begins; commands of a group likewise."""
    if isinstance(command, TyperGroup):
        for name, one in command.commands.items():
            with_tried_destinations(f"{verb} {name}", one)
        return command
    places = DESTINATIONS.get(verb)
    body = command.callback
    if places is None or body is None:
        return command
    if any(place.kind in ("file", "folder") for place in places.values()):
        known = {one.name for one in command.params}
        command.params += [option for option in options_of(_shared) if option.name not in known]
    has_own_anonymous = _ANONYMOUS in inspect.signature(body).parameters

    @functools.wraps(body)
    def tried(**values: Any) -> Any:
        force = bool(values.pop(_FORCE, False))
        is_anonymous = bool(values.get(_ANONYMOUS) if has_own_anonymous else values.pop(_ANONYMOUS, False))
        destinations = _destinations(places, values)
        if not destinations or values.get("dry_run"):
            return body(**values)
        inputs = _inputs(values, places)
        options = {key: value for key, value in values.items() if key not in (*_TELLING, *places)}
        origin = origin_of(verb, options | {_ANONYMOUS: is_anonymous}, inputs)
        require_free(destinations, origin, inputs=inputs, force=force)
        edited, before = edited_before(destinations), snapshot(destinations)
        try:
            told = (*inputs, *(one.path for one in destinations))
            with results_of(origin, force=force), anonymous(told) if is_anonymous else nullcontext():
                return body(**values)
        finally:
            keep_old(edited)
            remember_written(destinations, before, origin)

    command.callback = tried
    return command


def _shared(
    force: Annotated[
        bool, typer.Option("--force", help="Replace results of rigctl, of another command or of other inputs too.")
    ] = False,
    anonymous: Annotated[
        bool,
        typer.Option("--anonymous", help="Leave serial numbers, ports, site, folders and machine out of results."),
    ] = False,
) -> None:
    """Have the options of all commands that write results."""


def _destinations(places: Mapping[str, _Place], values: Mapping[str, Any]) -> list[Destination]:
    found = []
    for option, place in places.items():
        path = values.get(option)
        if path is not None:
            name = place.label or f"--{option.replace('_', '-')}"
            found.append(Destination(option=name, path=Path(path), kind=place.kind, names=place.names))
    return found


def _inputs(values: Mapping[str, Any], places: Mapping[str, _Place]) -> list[Path]:
    found: list[Path] = []
    for key, value in values.items():
        # A rig file that is written into is no input of the calibration; an archive grows, and its rows with it.
        if key in places or key in ("write", "root"):
            continue
        many = value if isinstance(value, (list, tuple)) else (value,)
        found += [one for one in many if isinstance(one, Path)]
    return found
