"""Whom a session tells of its end and of trouble: the section ``[notify]`` of a rig file."""

from typing import Annotated, Literal, get_args

from pydantic import Field, model_validator

from rigctl.files.config import Section

NoticeKind = Literal["finished", "stopped", "failed", "hold", "interlock", "disk is short"]
NOTICE_KINDS: tuple[NoticeKind, ...] = get_args(NoticeKind)


class NotifySection(Section):
    """Address that gets a notice as JSON by HTTP POST, command that gets it on its standard input, or both.

    `events` says of what. A notice that cannot be delivered within `timeout_s` is dropped: no session waits for one.
    """

    webhook: Annotated[str, Field(pattern=r"^https?://[^\s]+$", max_length=2000)] | None = None
    """Address that gets each notice as JSON by HTTP POST. Example: `"https://example.org/rig"`."""
    command: Annotated[list[str], Field(min_length=1, max_length=100)] | None = None
    """Program, with its arguments, that gets each notice on its standard input. Example: `["notify-send", "rig"]`."""
    events: list[NoticeKind] = Field(default_factory=lambda: list(NOTICE_KINDS))
    """Which events are told; all without. Example: `["finished", "failed"]`."""
    timeout_s: Annotated[float, Field(gt=0, le=60)] = 5.0
    """After which a notice is dropped. Example: `5.0`."""

    @model_validator(mode="after")
    def _somebody_is_told(self) -> "NotifySection":
        if self.webhook is None and self.command is None:
            raise ValueError('names nobody: give webhook = "https://..." or command = ["program", "argument"]')
        return self
