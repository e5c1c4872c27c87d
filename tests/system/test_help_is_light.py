"""Starts: no verb's help imports a library of numbers, pictures or plots; jobs import what they use, and no more."""

import json
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest

from rigctl.cli import VERBS
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.made_runs import at, make_run
from tests.rigctl.run_samples import noisy_counts

HEAVY = ("numpy", "scipy", "matplotlib", "astropy", "cv2")

_PROGRAM = """
import contextlib, io, json, sys
from rigctl import cli
found = {}
def help_of(*words):
    with contextlib.redirect_stdout(io.StringIO()):
        code = cli.main([*words, "--help"])
    found[" ".join(words)] = [code, [name for name in sys.argv[1:] if name in sys.modules]]
from rigctl.cli import VERBS
for verb in VERBS:
    help_of(*verb.split())
print(json.dumps(found))
"""


def modules_after(*words):
    """Return exit code and modules after a command in an interpreter of its own."""
    program = """
import contextlib, io, json, sys
from rigctl import cli
with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
    code = cli.main(sys.argv[1:])
print(json.dumps([code, list(sys.modules)]))
"""
    done = subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True, check=True)
    code, modules = json.loads(done.stdout)
    return code, set(modules)


def test_help_of_a_verb_imports_nothing_heavy():
    # In one interpreter, where the first help with a heavy module is the one that imports it.
    done = subprocess.run([sys.executable, "-c", _PROGRAM, *HEAVY], capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert set(VERBS) <= set(found)
    assert found == {words: [0, []] for words in found}


# The most modules that a job may bring, a tenth above what they are: time depends on the machine, this does not.
STARTS = {"stokes": 700, "predict": 560, "acquire": 780, "compare": 1240}
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
# Before its first need: what a sky is solved by, special functions, calibrations, a diagnosis, figures and pictures.
_SKY = ("model.accuracy.errors", "model.accuracy.predict", "rigctl.rig.roof")
_DRAWN = ("matplotlib", "reportlab", "jinja2")
LATER = {
    "stokes": (*_SKY, *_DRAWN, "scipy.special", "rigctl.files.scene_file", "rigctl.comparison.detect"),
    "predict": (*_SKY, *_DRAWN, "scipy", "cv2", "rigctl.runs.folder", "rigctl.measure.measure"),
    "acquire": (*_SKY, *_DRAWN, "scipy", "cv2", "urllib.request", "model.processing.diagnosis"),
    "compare": ("scipy.special", "numpy.f2py", "calibration.sensor.noise"),
}


@pytest.mark.parametrize("job", STARTS)
def test_a_job_starts_with_the_modules_that_it_uses(job):
    verbs = {
        "stokes": "rigctl.verbs.stokes",
        "compare": "rigctl.verbs.compare",
        "predict": "rigctl.verbs.predict",
        "acquire": "rigctl.session.preparation",
    }
    module = verbs.get(job, f"rigctl.jobs.{job}")
    program = f"import json, sys, {module}; print(json.dumps(list(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    modules = json.loads(done.stdout)
    assert [name for name in (*UNUSED, *LATER[job]) if name in modules] == []
    assert len(modules) <= STARTS[job]


def test_a_prediction_of_stated_light_solves_no_sky_and_opens_no_picture():
    code, modules = modules_after("predict", "examples/scene-panels.toml")
    later = {*UNUSED, *_SKY, *_DRAWN, "cv2", "rigctl.runs.folder", "rigctl.measure.measure"}
    # Of special functions the compiled module alone.
    later |= {
        "scipy.special",
        "numpy.f2py",
        "numpy.testing",
        "rigctl.runs.records",
    }
    # From 1.18 on scipy's compiled functions import its linear algebra themselves.
    if tuple(map(int, version("scipy").split(".")[:2])) >= (1, 18):
        later -= {"scipy.linalg", "numpy.f2py", "numpy.testing"}
    assert (code, sorted(later & modules)) == (0, [])


def test_a_prediction_under_a_sky_and_the_pixels_of_a_run_need_no_fits_and_splines_of_scipy(tmp_path):
    code, modules = modules_after("predict", "examples/scene-airborne.toml", "--tolerance", "0.05")
    assert (code, sorted({*UNUSED, "scipy.fft", *_DRAWN} & modules)) == (0, [])
    frames = [
        (at(angle, cycle=cycle, exposure_s=0.01), noisy_counts(cycle)) for cycle in (0, 1) for angle in (0, 60, 120)
    ]
    run = make_run(tmp_path / "run", frames)
    code, modules = modules_after("stokes", str(run.path), "--out", str(tmp_path / "out"))
    assert code in (0, 4)
    assert (tmp_path / "out" / "stokes.fits").is_file()
    assert sorted({*UNUSED, "scipy.fft", "matplotlib", "rigctl.prediction.predict"} & modules) == []


def test_special_functions_are_those_of_scipy_whose_package_can_be_imported_afterwards():
    program = """
import sys
from model import numerics as ours
ours.ndtr(1.0), ours.erfcx(1.0)
print("scipy.special" in sys.modules)
import scipy.special as theirs, scipy.stats
names = [name for name, value in vars(ours).items() if isinstance(value, ours.SpecialFunction)]
print(all(getattr(ours, name)._function is getattr(theirs, name) for name in names), len(names) > 10)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True", "True"]


ROOT = Path(__file__).parents[2]
# Without these, as if they were not installed, some command lines: their exit codes and what they say of failures.
_WITHOUT = """
import contextlib, io, json, sys
left_out, lines = json.loads(sys.argv[1])
class LeftOut:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in left_out:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name.partition(".")[0])
sys.meta_path.insert(0, LeftOut())
from rigctl import cli
found = []
for line in lines:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as said:
        found.append((cli.main(line), said.getvalue()))
print(json.dumps(found))
"""


def _left_out() -> list[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    group = project["dependency-groups"]["acquisition"]
    assert set(group) <= set(project["project"]["dependencies"])
    return sorted(line.split(">=")[0] for line in set(project["project"]["dependencies"]) - set(group))


@pytest.mark.slow
def test_a_session_imports_no_modules_of_reports(tmp_path: Path) -> None:
    rig, session, run = str(EXAMPLES / "rig-sim.toml"), str(EXAMPLES / "session.toml"), str(tmp_path / "run")
    lines = [
        ["doctor", "--help"],
        ["plan", rig, session],
        ["acquire", rig, session, "--out", run],
        ["verify", run],
        ["status", run],
        ["status", run, "--log"],
        ["predict", str(EXAMPLES / "scene-panels.toml")],
        ["status", run, "--page", str(tmp_path / "page.html")],
    ]
    program = [sys.executable, "-c", _WITHOUT, json.dumps([_left_out(), lines])]
    done = subprocess.run(program, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert [code for code, _ in found] == [0] * (len(lines) - 1) + [2]
    assert "needs matplotlib" in found[-1][1]
    assert f"pip install {' '.join(_left_out())}" in found[-1][1]
