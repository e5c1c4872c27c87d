"""The table [interlocks] of a session file: what is watched, and what is done about it."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from rigctl.files.config import Section

# retry: take the frame again, and stop if that does not help; hold: wait until it is well again or somebody says
# so; stop: end the session; note: write it down; off: do not look.
Action = Literal["retry", "hold", "stop", "note", "off"]
Watched = Literal["hold", "stop", "note", "off"]


class InterlockSection(Section):
    """Reaction to what is not as it must be. Every violation is an event of the run."""

    angle: Action = "retry"
    button: Action = "retry"
    fault: Literal["retry", "hold", "stop"] = "stop"
    homed: Watched = "stop"
    settings: Action = "stop"
    counter: Action = "note"
    identical: Action = "retry"
    black: Action = "retry"
    saturated: Action = "note"
    low_signal: Action = "note"
    temperature: Watched = "note"
    sum_rule: Watched = "note"
    drift: Watched = "note"
    disk: Watched = "hold"
    clock: Watched = "note"
    synchronised: Watched = "note"
    queue: Literal["note", "off"] = "note"
    gone: Literal["retry", "hold", "stop"] = "retry"

    retries: Annotated[int, Field(ge=1, le=100)] = 2
    saturated_fraction: Annotated[float, Field(ge=0, le=1)] = 0.01
    low_signal_fraction: Annotated[float, Field(ge=0, le=1)] = 0.5
    low_signal_level: Annotated[float, Field(gt=0, lt=1)] = 0.02
    temperature_least_c: float = -20.0
    temperature_most_c: float = 60.0
    sum_rule_tolerance: Annotated[float, Field(gt=0, le=1)] = 0.02
    drift_tolerance: Annotated[float, Field(gt=0, le=1)] = 0.02
    disk_free_mb: Annotated[float, Field(ge=0)] = 200.0
    clock_jump_s: Annotated[float, Field(gt=0)] = 1.0
    reconnect_s: Annotated[float, Field(gt=0)] = 60.0

    @model_validator(mode="after")
    def _temperatures_in_order(self) -> "InterlockSection":
        if self.temperature_least_c >= self.temperature_most_c:
            raise ValueError(
                f"temperature_least_c ({self.temperature_least_c:g}) must lie below temperature_most_c "
                f"({self.temperature_most_c:g})"
            )
        return self
