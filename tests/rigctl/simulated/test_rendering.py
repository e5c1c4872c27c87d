import tomllib

import pytest
from pydantic import TypeAdapter

from rigctl.errors import ConfigError
from rigctl.files.rig_file import RenderingSection, RigFile
from rigctl.files.toml import load
from rigctl.rig.simulated_parts import rendering_effect
from sim_devices.exposure import Detector, Lens
from tests.rigctl.example_files import EXAMPLES

TABLES = """
effects = [
  { effect = "point-spread", sigma_px = 0.8 },
  { effect = "vignetting" },
  { effect = "fixed-pattern", column_offset_e = 2.0 },
  { effect = "drift", rate_per_frame = 1e-4, flicker_std = 1e-3 },
  { effect = "beam-wander", radius_px = 0.3 },
  { effect = "smear", row_transfer_us = 0.1 },
  { effect = "cosmic-hits", rate_per_s = 1.0, mean_e = 500.0 },
]
"""


def rig_with(tmp_path, effects):
    text = (EXAMPLES / "rig-sim.toml").read_text(encoding="utf-8")
    path = tmp_path / "rig.toml"
    path.write_text(text.replace("flat_radiance = 60.0", f"flat_radiance = 60.0\n{effects}\n#"), encoding="utf-8")
    return path


@pytest.mark.parametrize("index", range(7))
def test_each_table_makes_the_effect_of_its_name(index):
    table = tomllib.loads(TABLES)["effects"][index]
    section = TypeAdapter(RenderingSection).validate_python(table)
    detector = Detector(width=8, height=6)
    assert rendering_effect(section, lens=Lens(), detector=detector, pattern_seed=1).name == table["effect"]


def test_rig_file_without_effects_names_none(tmp_path):
    assert load(rig_with(tmp_path, ""), RigFile).simulation.effects == []


def test_rig_file_names_its_effects_in_order(tmp_path):
    rig = load(rig_with(tmp_path, TABLES), RigFile)
    assert [section.effect for section in rig.simulation.effects][:3] == ["point-spread", "vignetting", "fixed-pattern"]


def test_effect_named_twice_is_refused(tmp_path):
    path = rig_with(tmp_path, 'effects = [{ effect = "vignetting" }, { effect = "vignetting" }]')
    with pytest.raises(ConfigError, match="names vignetting more than once"):
        load(path, RigFile)


def test_unknown_effect_is_refused_with_those_there_are(tmp_path):
    with pytest.raises(ConfigError, match="point-spread"):
        load(rig_with(tmp_path, 'effects = [{ effect = "coma" }]'), RigFile)
