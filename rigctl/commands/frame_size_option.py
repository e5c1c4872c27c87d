"""How large a picture of others may be, on the command line."""

from typing import Annotated

import typer

_BYTES_PER_MB = 1_000_000
_MOST_MB = 100_000

MaxFrameMb = Annotated[
    int,
    typer.Option(
        metavar="MB", min=1, max=_MOST_MB, help="Refuse a picture of more MB of samples before memory is taken for it."
    ),
]


def frame_bytes(max_frame_mb: int) -> int:
    """Return the limit in bytes."""
    return max_frame_mb * _BYTES_PER_MB
