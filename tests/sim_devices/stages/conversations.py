"""Conversations with simulated stages as texts: what a host sends, what it hears, and where the ring then stands.

The bytes are written out from the makers' manuals and from replies of true stages. A block begins with its title, and
then has lines with a time [s] and

    >  what the host sends, and behind a ``<`` each what the stage answers at once
    <  what the stage says by itself then; all that it says has to be there; ``*`` is any text
    @  the angle of the ring in its housing [deg]

and, before these, ``?`` with faults of the stage. The next block begins behind an empty line.
"""

from collections.abc import Callable
from fnmatch import fnmatchcase

import numpy as np
import pytest

from sim_devices.stages.catalogue import parse_stage_address
from sim_devices.stages.drive import Drive
from sim_devices.stages.options import StageOptions
from sim_devices.stages.stage import Language

NEAR_S = 1e-3  # times are given to this


def blocks(text: str) -> list[list[str]]:
    return [block.splitlines() for block in text.strip().split("\n\n")]


def hold(
    lines: list[str],
    *,
    address: str,
    make: Callable[[StageOptions, Drive], Language],
    encode: Callable[[str], bytes],
    decode: Callable[[bytes], str],
) -> None:
    """Hold one conversation with a stage of its own."""
    faults = lines.pop(0).removeprefix("?").strip() if lines[0].startswith("?") else ""
    options = parse_stage_address(f"{address}&{faults}")
    drive = Drive(options, generator=np.random.default_rng(0))
    language, said, time_s = make(options, drive), [], 0.0
    for line in lines:
        stamp, mark, text = (line + " ").split(" ", 2)
        time_s = float(stamp)
        sent, *answers = text.split(" < ") if mark == ">" else ["", text] if mark == "<" else [""]
        if mark == ">":
            assert said == [], f"before {line!r}"
            said += language.receive(time_s, encode(sent.rstrip()))
        else:
            said += language.advance(time_s + (NEAR_S if mark == "<" else 0.0))
        if mark == "@":
            assert drive.ring.angle_deg(time_s) == pytest.approx(float(text), rel=1e-5, abs=1e-5), line
        for answer in answers:
            assert said, line
            said_s, reply = said.pop(0)
            assert fnmatchcase(decode(reply), answer.rstrip()), (line, decode(reply))
            assert said_s == pytest.approx(time_s, abs=2.0 * NEAR_S), line
    assert said + language.advance(time_s) == []
