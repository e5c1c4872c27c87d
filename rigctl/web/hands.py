"""What a page with hands may do: ask a session, start one, work the devices, write regions. Each only where asked."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, with_config
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from drivers.errors import DeviceError
from rigctl.errors import ConfigError, DataError
from rigctl.numbers.number_range import LARGEST
from rigctl.runs.run_description import explain_invalid
from rigctl.web.access import MOST_BODY_BYTES
from rigctl.web.live_look import Task
from rigctl.web.live_rig import LiveRig

_MS_PER_S = 1e3
Asked = Literal["hold", "resume", "stop"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Hands:
    """What a page may do.

    Attributes
    ----------
    ask : callable
        Asks something of the session of a run, by the run's name: "hold", "resume" or "stop".
    rig : LiveRig
        The devices, while no session has them.
    sessions : callable
        Returns the names of the session files.
    plan : callable
        Returns what a session file will take, in words.
    start : callable
        Starts the session of a file in a process of its own; returns the name of its run.
    write_regions : callable
        Writes regions, given as JSON; returns the name of the file.
    """

    ask: Callable[[str, Asked], None]
    rig: LiveRig
    sessions: Callable[[], tuple[str, ...]]
    plan: Callable[[str], str]
    start: Callable[[str], str]
    write_regions: Callable[[bytes], str]


@with_config(ConfigDict(extra="forbid", allow_inf_nan=False))
@dataclass(frozen=True, kw_only=True)
class _Wanted:
    """A task as a page asks for it."""

    kind: Literal["rest", "preview", "polarimetry"]
    exposure_ms: Annotated[float, Field(gt=0.0, le=600_000.0)] = 10.0
    gain_db: Annotated[float, Field(ge=-100.0, le=100.0)] = 0.0
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


@dataclass(frozen=True, kw_only=True)
class _Asked:
    """A request that acts: the run that it names, and its body."""

    run: str
    body: bytes


_WANTED, _TURN, _SESSION = TypeAdapter(_Wanted), TypeAdapter(_Turn), TypeAdapter(_SessionName)
_Act = Callable[[_Asked], dict[str, str]]


def hand_routes(hands: Hands) -> list[Route]:
    """Return the routes that act; `rigctl.web.access.Guard` lets only those with the right through."""
    acts: Mapping[str, _Act] = {
        "hold": lambda asked: _ask(hands, asked, "hold"),
        "resume": lambda asked: _ask(hands, asked, "resume"),
        "stop": lambda asked: _ask(hands, asked, "stop"),
        "task": lambda asked: _begin(hands.rig, _WANTED.validate_json(asked.body)),
        "turn": lambda asked: _turn(hands.rig, _TURN.validate_json(asked.body)),
        "dark": lambda _: _take_dark(hands.rig),
        "plan": lambda asked: {"plan": hands.plan(_SESSION.validate_json(asked.body).session)},
        "start": lambda asked: _start(hands, _SESSION.validate_json(asked.body).session),
        "regions": lambda asked: {"file": hands.write_regions(asked.body)},
    }
    return [Route(f"/api/{name}", _answering(act), methods=["POST"]) for name, act in acts.items()]


def _ask(hands: Hands, asked: _Asked, what: Asked) -> dict[str, str]:
    hands.ask(asked.run, what)
    return {"done": f"asked to {what}"}


def _begin(rig: LiveRig, wanted: _Wanted) -> dict[str, str]:
    exposure_s = wanted.exposure_ms / _MS_PER_S
    rig.begin(Task(kind=wanted.kind, exposure_s=exposure_s, gain_db=wanted.gain_db, angles_deg=wanted.angles_deg))
    return {"done": wanted.kind}


def _turn(rig: LiveRig, wanted: _Turn) -> dict[str, str]:
    rig.turn(wanted.angle_deg)
    return {"done": "turning"}


def _take_dark(rig: LiveRig) -> dict[str, str]:
    rig.take_dark()
    return {"done": "dark level taken"}


def _start(hands: Hands, session: str) -> dict[str, str]:
    """Start a session, once the devices are closed for it."""
    hands.rig.begin(Task())
    return {"run": hands.start(session)}


def _answering(act: _Act) -> Callable[[Request], Awaitable[Response]]:
    """Return what does an act in a thread of its own and says what went wrong in words."""

    async def answer(request: Request) -> Response:
        body = await request.body()
        if len(body) > MOST_BODY_BYTES:
            return _problem(413, f"more than {MOST_BODY_BYTES} bytes")
        asked = _Asked(run=request.query_params.get("run", ""), body=body)
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
