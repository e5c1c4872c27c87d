"""Unpacking against a camera maker's own converter (Allied Vision's vmbpy, 3 MB), in an environment of its own."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from drivers.cameras.samples import GENICAM, needed_bytes, unpack
from tests.clients.make_venvs import default_folder, make, python_of

VMBPY = "vmbpy==1.2.3"
WIDTH, HEIGHT = 782, 582
PLAIN = {10: 0x01100003, 12: 0x01100005}
CODES = (0x010C0006, 0x010C0047, 0x010A0046)  # Mono12Packed, Mono12p, Mono10p


def unpacked_by_vimba(python, data, code):
    script = Path(__file__).with_name("vimba_unpack.py")
    arguments = [hex(code), hex(PLAIN[GENICAM[code].bit_depth]), str(WIDTH), str(HEIGHT)]
    done = subprocess.run([python, script, *arguments], input=data, stdout=subprocess.PIPE, check=True)
    return np.frombuffer(done.stdout, "<u2")


def test_random_bytes_become_the_counts_that_a_makers_converter_finds():
    # One test for all formats: tests that run at the same time must not both make the environment.
    if os.environ.get("RIGCTL_CLIENTS") != "1":
        pytest.skip(f"set RIGCTL_CLIENTS=1, which lets this test install {VMBPY} into an environment of its own")
    make(VMBPY, default_folder())
    python = python_of(VMBPY, default_folder())
    for code in CODES:
        data = np.random.default_rng(5).bytes(needed_bytes(GENICAM[code], samples=WIDTH * HEIGHT))
        ours = unpack(data, pixel_format=GENICAM[code], width=WIDTH, height=HEIGHT)
        np.testing.assert_array_equal(ours.ravel(), unpacked_by_vimba(python, data, code), GENICAM[code].name)
