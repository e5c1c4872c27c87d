"""What a page with hands may do: ask sessions, work the devices, write regions; each only where it is given."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, Protocol

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, with_config
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from drivers.errors import DeviceError
from rigctl.errors import ConfigError, DataError
from rigctl.files.regions import Region
from rigctl.numbers.number_range import LARGEST
from rigctl.runs.run_description import explain_invalid
from rigctl.web.access import MOST_BODY_BYTES
from rigctl.web.live_look import LiveLook, Task
from rigctl.web.live_rig import LiveRig
from rigctl.web.pictures import Picture

_MS_PER_S = 1e3
Question = Literal["hold", "resume", "stop"]


@dataclass(frozen=True, kw_only=True)
class Asked:
    """A request that acts: the run that it names, and its body."""

    run: str
    body: bytes


Act = Callable[[Asked], dict[str, str]]


class View(Protocol):
    """What a page draws: the devices' picture, or one that was there before."""

    def look(self) -> LiveLook:
        """Return what is seen, in numbers."""

    def newest_sequence(self, name: str) -> int | None:
        """Return the number of the newest picture of a name; None where there is none."""

    def picture(self, name: str, *, zebra: bool = True, dolp_top: float = 1.0) -> Picture | None:
        """Return the newest picture of a name; None where there is none."""


class Sessions(Protocol):
    """Session files, and the sessions that run."""

    def names(self) -> tuple[str, ...]:
        """Return the names of the session files."""

    def plan(self, name: str) -> str:
        """Return what a session file will take, in words."""

    def start(self, name: str) -> str:
        """Start the session of a file in a process of its own; return the name of its run."""

    def ask(self, name: str, what: Question) -> None:
        """Ask something of the session of a run, by the run's name."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Hands:
    """What a page may do; it shows no more than belongs to its acts.

    Attributes
    ----------
    view : View
        What it draws.
    acts : mapping of str to callable
        What it may do, by name: those of `camera_acts`, `stage_acts`, `session_acts` and `region_acts` together.
    title : str
        Heading of the page; empty where it heads the list of runs.
    session_names : callable
        Returns the names of the session files.
    drawn : tuple of Region
        Regions that are there already.
    regions_file : str
        Name of the file that regions are written to.
    is_once : bool
        The page ends as soon as regions are written.
    """

    view: View
    acts: Mapping[str, Act]
    title: str = ""
    session_names: Callable[[], tuple[str, ...]] = tuple
    drawn: tuple[Region, ...] = ()
    regions_file: str = "regions.toml"
    is_once: bool = False


@with_config(ConfigDict(extra="forbid", allow_inf_nan=False))
@dataclass(frozen=True, kw_only=True)
class _Wanted:
    """A task as a page asks for it."""

    kind: Literal["rest", "preview", "polarimetry"]
    exposure_ms: Annotated[float, Field(gt=0.0, le=600_000.0)] = 10.0
    gain_db: Annotated[float, Field(ge=-100.0, le=100.0)] = 0.0
    zoom: Annotated[int, Field(ge=1, le=64)] = 1
    angles_deg: Annotated[tuple[Annotated[float, Field(ge=-LARGEST, le=LARGEST)], ...], Field(max_length=64)] = (
        0.0,
        45.0,
        90.0,
        135.0,
    )


@with_config(ConfigDict(extra="forbid", allow_inf_nan=False))
@dataclass(frozen=True, kw_only=True)
class _Turn:
    angle_deg: Annotated[float, Field(ge=-360.0, le=360.0)]


@with_config(ConfigDict(extra="forbid"))
@dataclass(frozen=True, kw_only=True)
class _SessionName:
    session: Annotated[str, Field(max_length=200)]


_WANTED, _TURN, _SESSION = TypeAdapter(_Wanted), TypeAdapter(_Turn), TypeAdapter(_SessionName)


def camera_acts(rig: LiveRig) -> Mapping[str, Act]:
    """Return what is done with a camera: begin a task."""
    return {"task": lambda asked: _begin(rig, _WANTED.validate_json(asked.body))}


def stage_acts(rig: LiveRig) -> Mapping[str, Act]:
    """Return what is done with a polarizer that turns, and for its maps: turn it, take the dark level."""
    return {
        "turn": lambda asked: _turn(rig, _TURN.validate_json(asked.body)),
        "dark": lambda _: _take_dark(rig),
    }


def session_acts(sessions: Sessions, rig: LiveRig) -> Mapping[str, Act]:
    """Return what is done with sessions: ask them, show the plan of one, start one."""
    return {
        "hold": lambda asked: _ask(sessions, asked, "hold"),
        "resume": lambda asked: _ask(sessions, asked, "resume"),
        "stop": lambda asked: _ask(sessions, asked, "stop"),
        "plan": lambda asked: {"plan": sessions.plan(_SESSION.validate_json(asked.body).session)},
        "start": lambda asked: _start(sessions, rig, _SESSION.validate_json(asked.body).session),
    }


def region_acts(write: Callable[[bytes], str]) -> Mapping[str, Act]:
    """Return what is done with regions: `write` them, given as JSON, which returns the name of the file."""
    return {"regions": lambda asked: {"file": write(asked.body)}}


def hand_routes(hands: Hands) -> list[Route]:
    """Return the routes that act; `rigctl.web.access.Guard` lets only those with the right through."""
    return [Route(f"/api/{name}", _answering(act), methods=["POST"]) for name, act in hands.acts.items()]


def _ask(sessions: Sessions, asked: Asked, what: Question) -> dict[str, str]:
    sessions.ask(asked.run, what)
    return {"done": f"asked to {what}"}


def _begin(rig: LiveRig, wanted: _Wanted) -> dict[str, str]:
    rig.begin(
        Task(
            kind=wanted.kind,
            exposure_s=wanted.exposure_ms / _MS_PER_S,
            gain_db=wanted.gain_db,
            angles_deg=wanted.angles_deg,
            zoom=wanted.zoom,
        )
    )
    return {"done": wanted.kind}


def _turn(rig: LiveRig, wanted: _Turn) -> dict[str, str]:
    rig.turn(wanted.angle_deg)
    return {"done": "turning"}


def _take_dark(rig: LiveRig) -> dict[str, str]:
    rig.take_dark()
    return {"done": "dark level taken"}


def _start(sessions: Sessions, rig: LiveRig, name: str) -> dict[str, str]:
    """Start a session, once the devices are closed for it."""
    rig.begin(Task())
    return {"run": sessions.start(name)}


def _answering(act: Act) -> Callable[[Request], Awaitable[Response]]:
    """Return what does an act in a thread of its own and says what went wrong in words."""

    async def answer(request: Request) -> Response:
        body = await request.body()
        if len(body) > MOST_BODY_BYTES:
            return _problem(413, f"more than {MOST_BODY_BYTES} bytes")
        asked = Asked(run=request.query_params.get("run", ""), body=body)
        try:
            return JSONResponse(await asyncio.to_thread(act, asked))
        except ValidationError as error:
            return _problem(422, explain_invalid(error))
        except ConfigError as error:
            return _problem(422, str(error))
        except (DataError, DeviceError, OSError) as error:
            return _problem(409, str(error))

    return answer


def _problem(status: int, text: str) -> Response:
    return JSONResponse({"error": text}, status_code=status)
