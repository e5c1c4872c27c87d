"""Help is at hand at once: no verb's help imports a library of numbers, pictures or plots."""

import json
import subprocess
import sys

import pytest

from rigctl.cli import VERBS

HEAVY = ("numpy", "scipy", "matplotlib", "astropy", "cv2")

_PROGRAM = """
import contextlib, io, json, sys
from rigctl import cli
with contextlib.redirect_stdout(io.StringIO()):
    code = cli.main(sys.argv[1:])
group = cli.LazyGroup().get_command(None, sys.argv[1])
print(json.dumps({"code": code, "modules": list(sys.modules), "verbs": list(getattr(group, "commands", {}))}))
"""


def help_of(*words):
    """Return exit code, heavy modules and the verbs below, of ``rigctl ... --help`` in an interpreter of its own."""
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM, *words, "--help"], capture_output=True, text=True, check=True
    )
    found = json.loads(done.stdout)
    return found["code"], [name for name in HEAVY if name in found["modules"]], found["verbs"]


@pytest.mark.parametrize("verb", VERBS)
def test_help_of_a_verb_imports_nothing_heavy(verb):
    code, heavy, inner = help_of(verb)
    assert (code, heavy) == (0, [])
    assert {word: help_of(verb, word)[:2] for word in inner} == dict.fromkeys(inner, (0, []))
