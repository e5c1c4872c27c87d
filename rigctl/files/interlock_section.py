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
    """A readback beyond the stage's tolerance. Example: `"retry"`."""
    button: Action = "retry"
    """The stage reports something during a move, such as its button. Example: `"retry"`."""
    cell: Watched = "stop"
    """The light contradicts the cell of polarizers on the camera's pixels. Example: `"stop"`."""
    fault: Literal["retry", "hold", "stop"] = "stop"
    """The stage reports a fault, such as a stall. Example: `"stop"`."""
    homed: Watched = "stop"
    """The stage does not say that it found its reference mark. Example: `"stop"`."""
    settings: Action = "stop"
    """Camera settings that differ from those asked for. Example: `"stop"`."""
    counter: Action = "note"
    """The camera's frame counter stands still, goes back, or has a gap. Example: `"note"`."""
    identical: Action = "retry"
    """A picture has the very noise of the one before. Example: `"retry"`."""
    black: Action = "retry"
    """A picture has one value everywhere. Example: `"retry"`."""
    saturated: Action = "note"
    """More than `saturated_fraction` of a scene frame is saturated. Example: `"note"`."""
    low_signal: Action = "note"
    """More than `low_signal_fraction` of a scene frame is below `low_signal_level`. Example: `"note"`."""
    temperature: Watched = "note"
    """The camera is colder or warmer than allowed. Example: `"note"`."""
    sum_rule: Watched = "note"
    """I0 + I90 and I45 + I135 of a cycle differ. Example: `"note"`."""
    drift: Watched = "note"
    """The light changed from cycle to cycle, or within one. Example: `"note"`."""
    disk: Watched = "hold"
    """Less than `disk_free_mb` free. Example: `"hold"`."""
    clock: Watched = "note"
    """The host's clock was set. Example: `"note"`."""
    synchronised: Watched = "note"
    """The host's clock follows no time server. Example: `"note"`."""
    queue: Literal["note", "off"] = "note"
    """Frames wait for the disk. Example: `"note"`."""
    gone: Literal["retry", "hold", "stop"] = "retry"
    """A device is silent or unplugged. Example: `"retry"`."""

    retries: Annotated[int, Field(ge=1, le=100)] = 2
    """How often a frame is taken again before the session stops. Example: `2`."""
    saturated_fraction: Annotated[float, Field(ge=0, le=1)] = 0.01
    """Share of saturated pixels that trips saturated. Example: `0.01`."""
    low_signal_fraction: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Share of dark pixels that trips low_signal. Example: `0.5`."""
    low_signal_level: Annotated[float, Field(gt=0, lt=1)] = 0.02
    """Share of the range below which a pixel counts as dark. Example: `0.02`."""
    temperature_least_c: float = -20.0
    """Coldest that the camera may be. Example: `-20.0`."""
    temperature_most_c: float = 60.0
    """Warmest that the camera may be. Example: `60.0`."""
    sum_rule_tolerance: Annotated[float, Field(gt=0, le=1)] = 0.02
    """Difference of the two sums over their mean that trips sum_rule. Example: `0.02`."""
    drift_tolerance: Annotated[float, Field(gt=0, le=1)] = 0.02
    """Relative change of the light that trips drift. Example: `0.02`."""
    disk_free_mb: Annotated[float, Field(ge=0)] = 200.0
    """Free space below which disk trips. Example: `200.0`."""
    clock_jump_s: Annotated[float, Field(gt=0)] = 1.0
    """Step of the host's clock that trips clock. Example: `1.0`."""
    reconnect_s: Annotated[float, Field(gt=0)] = 60.0
    """How long a device that is gone is opened again. Example: `60.0`."""

    @model_validator(mode="after")
    def _temperatures_in_order(self) -> "InterlockSection":
        if self.temperature_least_c >= self.temperature_most_c:
            raise ValueError(
                f"temperature_least_c ({self.temperature_least_c:g}) must lie below temperature_most_c "
                f"({self.temperature_most_c:g})"
            )
        return self
