"""The table [interlocks] of a session file: what is watched, and what is done about it."""

from typing import Annotated, Literal

from pydantic import Field

from rigctl.config import Section

# retry: take the frame again, and stop if that does not help; hold: wait until it is well again or somebody says
# so; stop: end the session; note: write it down; off: do not look.
Action = Literal["retry", "hold", "stop", "note", "off"]
Watched = Literal["hold", "stop", "note", "off"]


class InterlockSection(Section):
    """What is done when something is not as it must be. Every trip is an event of the run."""

    angle: Action = "retry"
    button: Action = "retry"
    settings: Action = "stop"
    identical: Action = "retry"
    black: Action = "retry"
    saturated: Action = "note"
    sum_rule: Watched = "note"
    disk: Watched = "hold"
    clock: Watched = "note"
    queue: Literal["note", "off"] = "note"
    gone: Literal["retry", "stop"] = "retry"

    retries: Annotated[int, Field(ge=1, le=100)] = 2
    saturated_fraction: Annotated[float, Field(ge=0, le=1)] = 0.01
    sum_rule_tolerance: Annotated[float, Field(gt=0, le=1)] = 0.02
    disk_free_mb: Annotated[float, Field(ge=0)] = 200.0
    clock_jump_s: Annotated[float, Field(gt=0)] = 1.0
    reconnect_s: Annotated[float, Field(gt=0)] = 60.0
