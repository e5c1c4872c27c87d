"""What is installed is what is here: the five packages and all folders of theirs, tests and benchmarks left out."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
OURS = ("calibration", "drivers", "model", "rigctl", "sim_devices")


def _project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_every_package_below_the_five_is_found():
    wanted = [pattern for name in OURS for pattern in (name, f"{name}.*")]
    assert _project()["tool"]["setuptools"]["packages"]["find"]["include"] == wanted


def test_every_folder_of_code_and_of_tests_is_a_package():
    folders = {file.parent for name in (*OURS, "tests") for file in (ROOT / name).rglob("*.py")}
    assert [str(folder) for folder in sorted(folders) if not (folder / "__init__.py").exists()] == []


def test_packages_hand_nothing_on():
    # The public Python interface is the one that does: lazy names only.
    filled = [file for name in OURS for file in (ROOT / name).rglob("__init__.py") if file.read_text().strip()]
    assert filled == [ROOT / "rigctl" / "__init__.py"]


def test_every_direct_dependency_has_a_tested_version():
    pinned = {line.partition("==")[0].lower() for line in (ROOT / "constraints.txt").read_text().splitlines()}
    wanted = {text.partition(">")[0].lower() for text in _project()["project"]["dependencies"]}
    assert wanted <= pinned


def test_the_conda_recipe_asks_for_the_same():
    names = {"matplotlib": "matplotlib-base", "opencv-contrib-python-headless": "py-opencv"}
    wanted = {
        f"{names.get(name, name)} >={least}"
        for name, _, least in (text.partition(">=") for text in _project()["project"]["dependencies"])
    }
    run = (ROOT / ".ci/conda/recipe.yaml").read_text().partition("  run:\n")[2].partition("\n\n")[0]
    assert {line.partition("#")[0].strip(" -") for line in run.splitlines()} == {"python >=3.11", *wanted}


def test_constraints_hold_names_and_versions_alone():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    assert all(line.count("==") == 1 and "/" not in line and "@" not in line for line in lines)


@pytest.mark.slow
def test_benchmarks_and_trials_use_names_that_exist():
    names = [
        ".".join(file.relative_to(ROOT).with_suffix("").parts)
        for file in (ROOT / "benchmarks").rglob("*.py")
        if file.stem not in ("__init__", "__main__", "pbrdf_peer")
    ]
    done = subprocess.run(
        [sys.executable, "-c", f"import importlib; [importlib.import_module(name) for name in {names}]"],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert done.returncode == 0, done.stderr
