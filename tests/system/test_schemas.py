"""Files of another schema are refused by its number, with the version that wrote them."""

import json
import shutil

import numpy as np
import pytest

from rigctl import cli
from rigctl.calibrations.flat import FlatFacts
from rigctl.calibrations.noise import NoiseParameters
from rigctl.calibrations.polarizer import PolarizerParameters
from rigctl.calibrations.radiometric import RadiometricResponse
from rigctl.calibrations.registration import ImageRegistration
from rigctl.errors import ConfigError, DataError
from rigctl.files.regions import load_regions
from rigctl.files.rig_file import load_rig
from rigctl.files.scene_file import load_scene
from rigctl.files.session_file import load_session
from rigctl.version import VERSION
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.made_runs import at, make_run

_LATER = {"schema_version": 7, "created_by": "rigctl 9.1.0", "sense": "of another kind"}


@pytest.mark.parametrize("kind", [NoiseParameters, PolarizerParameters, RadiometricResponse, ImageRegistration])
def test_a_later_calibration_is_refused_by_its_number(tmp_path, kind):
    file = tmp_path / "calibration.json"
    file.write_text(json.dumps(_LATER))
    with pytest.raises(DataError) as refused:
        kind.read(file)
    assert f"schema_version is 7, and rigctl {VERSION} reads " in str(refused.value)
    assert "rigctl 9.1.0 wrote it" in str(refused.value)


@pytest.mark.parametrize("kind", [NoiseParameters, PolarizerParameters])
def test_an_earlier_calibration_is_refused_by_its_number(tmp_path, kind):
    file = tmp_path / "calibration.json"
    file.write_text(json.dumps({"schema_version": 1, "created_by": "rigctl 0.0.9"}))
    with pytest.raises(DataError, match=r"schema_version is 1, and rigctl .* reads 2; rigctl 0.0.9 wrote it: use that"):
        kind.read(file)


def test_later_flats_are_refused_by_their_number(tmp_path):
    facts = np.frombuffer(json.dumps(_LATER).encode(), dtype=np.uint8)
    np.savez(tmp_path / "flat.npz", facts=facts, throughput=np.ones((1, 2, 2)))
    with pytest.raises(DataError, match=r"schema_version is 7, and rigctl .* reads 1; rigctl 9.1.0 wrote it"):
        FlatFacts.read(tmp_path / "flat.npz")


def test_an_earlier_or_later_run_is_refused_by_its_number(tmp_path, capsys):
    make_run(tmp_path / "run", [(at(0.0), np.zeros((4, 4)))])
    file = tmp_path / "run" / "session.json"
    content = json.loads(file.read_text())
    for version in (1, 7):
        file.write_text(json.dumps(content | {"schema_version": version}))
        assert cli.main(["status", "--contents", str(tmp_path / "run")]) == 4
        assert f"schema_version is {version}, and rigctl" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("example", "read"),
    [
        ("rig-sim.toml", load_rig),
        ("scene-panels.toml", load_scene),
        ("session.toml", load_session),
        ("regions.toml", load_regions),
    ],
)
def test_a_later_file_of_people_is_refused_by_its_number(tmp_path, example, read):
    file = tmp_path / example
    shutil.copy(EXAMPLES / example, file)
    text = "\n".join(line for line in file.read_text().splitlines() if not line.startswith("schema_version"))
    file.write_text(f"schema_version = 2\nof_later = true\n{text}")
    with pytest.raises(ConfigError, match=r"schema_version is 2, and rigctl .* reads 1; a later rigctl reads it"):
        read(file)
