"""Starts: no verb's help imports a library of numbers, pictures or plots; jobs import what they use, and no more."""

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


# The most modules that a job may bring, a tenth above what they are: time depends on the machine, this does not.
STARTS = {"stokes": 1100, "predict": 1100, "acquire": 1150, "compare": 1500}
# Each takes a tenth to half a second, and is imported where it is used.
UNUSED = (
    "astropy",
    "scipy.optimize",
    "scipy.interpolate",
    "scipy.linalg",
    "scipy.ndimage",
    "scipy.stats",
    "pandas",
    "pvlib",
)


@pytest.mark.parametrize("job", STARTS)
def test_a_job_starts_with_the_modules_that_it_uses(job):
    program = f"import json, sys, rigctl.jobs.{job}; print(json.dumps(list(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    modules = json.loads(done.stdout)
    draws = job in ("stokes", "compare")
    assert [name for name in (*UNUSED, *(() if draws else ("matplotlib",))) if name in modules] == []
    assert len(modules) <= STARTS[job]
