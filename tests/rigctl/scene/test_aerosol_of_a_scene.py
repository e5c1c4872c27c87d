import importlib.util

import numpy as np
import pytest

from model.processing.agreement import propagate_inputs
from rigctl.cli import main
from rigctl.errors import ConfigError
from rigctl.files.scene_file import load_scene
from rigctl.prediction.predict import ScenePredictor
from rigctl.scene.light import SceneLight, SkyStore
from rigctl.scene.reading import scene_of_file
from rigctl.scene.scene import get
from tests.rigctl.scene_texts import SCENE, written

AIR = 'tier = "fast"\nvisibility_km = 23.0\nwavelengths = 2\n'
OWN = """
[atmosphere.own_aerosol]
name = "haze"
[[atmosphere.own_aerosol.modes]]
number_median_radius_um = 0.1
ln_sigma = 0.4
n = 1.45
k = 0.01
"""
ALTERNATIVE = """
[atmosphere.alternative]
aerosol = "polarizing"
aerosol_type = "tropospheric"
share = { value = %s, std = %s }
"""


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return SkyStore(tmp_path_factory.mktemp("skies"))


def predictor(tmp_path, store, air, **engine):
    text = SCENE.replace(AIR, air)
    assert text != SCENE or air == AIR
    return ScenePredictor(load_scene(written(tmp_path, text)), None, light=SceneLight(store, **engine))


def paint(found, changed=None):
    return found.predictions(changed)["paint"].stokes_dn.mean


def dolp_std(found):
    """Standard uncertainty of the predicted DoLP of the paint that uncertain inputs bring."""

    def dolp_at(values):
        s0, s1, s2 = paint(found, dict(zip(found.inputs.names, values, strict=True)))
        return np.array([np.hypot(s1, s2) / s0])

    inputs = found.inputs
    of_air = np.array([name.startswith("atmosphere.") for name in inputs.names])
    cov = inputs.cov * np.outer(of_air, of_air)
    return float(np.sqrt(propagate_inputs(dolp_at, inputs.values, cov, least=tuple(inputs.least))[0, 0]))


def test_uncertain_depth_of_the_aerosol_makes_dolp_uncertain(tmp_path, store):
    air = 'tier = "fast"\naerosol_optical_depth = { value = 0.3, std = %s }\nwavelengths = 2\n'
    sure, unsure, twice = (dolp_std(predictor(tmp_path, store, air % std)) for std in (0.0, 0.01, 0.02))
    assert sure == 0.0
    assert unsure > 1e-4
    assert twice == pytest.approx(2.0 * unsure, rel=1e-2)  # linear in so small a step


def test_depths_measured_at_two_wavelengths_say_the_same_as_depth_and_exponent(tmp_path, store):
    exponent, depth = 1.2, 0.25
    at = {nm: depth * (nm / 550.0) ** -exponent for nm in (440, 870)}
    depths = ", ".join(f"{{ wavelength_nm = {nm}, optical_depth = {value!r} }}" for nm, value in at.items())
    measured = f'tier = "fast"\nmeasured_depths = [{depths}]\nwavelengths = 2\n'
    stated = f'tier = "fast"\naerosol_optical_depth = {depth}\nangstrom_exponent = {exponent}\nwavelengths = 2\n'
    one, other = (paint(predictor(tmp_path, store, air)) for air in (measured, stated))
    np.testing.assert_allclose(one, other, rtol=1e-9)


def test_a_measured_depth_is_a_number_of_the_scene(tmp_path, store):
    depths = "{ wavelength_nm = 440, optical_depth = { value = 0.3, std = 0.02 } }, "
    depths += "{ wavelength_nm = 870, optical_depth = 0.1 }"
    found = predictor(tmp_path, store, f'tier = "fast"\nmeasured_depths = [{depths}]\nwavelengths = 2\n')
    assert get(found.scene, "atmosphere.measured_depths.0.optical_depth").value == 0.3
    assert dolp_std(found) > 1e-4


def test_an_aerosol_of_ones_own_is_another_sky(tmp_path, store):
    own, rural = (paint(predictor(tmp_path, store, air)) for air in (AIR + OWN, AIR))
    assert abs(own[0] / rural[0] - 1.0) > 1e-3


def test_light_is_linear_in_the_share_of_the_alternative(tmp_path, store):
    found = predictor(tmp_path, store, AIR + ALTERNATIVE % (0.0, 0.2))
    none, half, whole = (paint(found, {"atmosphere.alternative.share": share}) for share in (0.0, 0.5, 1.0))
    # The integral over the hemisphere is taken to 1e-4 of each sky.
    np.testing.assert_allclose(half, 0.5 * (none + whole), rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(none, paint(predictor(tmp_path, store, AIR)), rtol=1e-4, atol=1e-9)
    pure = AIR + 'aerosol = "polarizing"\naerosol_type = "tropospheric"\n'
    np.testing.assert_allclose(whole, paint(predictor(tmp_path, store, pure)), rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_doubt_about_the_kind_is_carried_to_dolp(tmp_path, store, value):
    found = predictor(tmp_path, store, AIR + ALTERNATIVE % (value, 0.2))
    none, whole = (paint(found, {"atmosphere.alternative.share": share}) for share in (0.0, 1.0))
    dolp = [np.hypot(*stokes[1:]) / stokes[0] for stokes in (none, whole)]
    # DoLP bends little over a fifth of the way between two skies.
    assert dolp_std(found) == pytest.approx(0.2 * abs(dolp[1] - dolp[0]), rel=0.05)


def test_the_remarks_name_the_doubt(tmp_path, store):
    text = SCENE.replace(AIR, AIR + ALTERNATIVE % (0.1, 0.2))
    scene = load_scene(written(tmp_path, text))
    remarks = " ".join(SceneLight(store).remarks(scene_of_file(scene)))
    assert "with a share of 0.1 +- 0.2 of the light as if it were polarizing tropospheric" in remarks


def test_what_an_alternative_leaves_out_is_as_it_was(tmp_path, store):
    alternative = '[atmosphere.alternative]\naerosol = "polarizing"\nshare = 1.0\n'
    whole = paint(predictor(tmp_path, store, AIR + OWN + alternative))
    pure = paint(predictor(tmp_path, store, AIR + 'aerosol = "polarizing"\n' + OWN))
    np.testing.assert_allclose(whole, pure, rtol=1e-4, atol=1e-9)


def test_an_alternative_that_is_none_is_refused(tmp_path, store):
    with pytest.raises(ConfigError, match="needs what is another"):
        predictor(tmp_path, store, AIR + "[atmosphere.alternative]\nshare = 0.5\n")


def test_an_engine_that_is_not_installed_says_how_to_get_it(store, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"--engine sasktran2: is not installed; run pip install"):
        SceneLight(store, engine="sasktran2")


@pytest.mark.parametrize("verb", ["sky", "predict"])
def test_an_engine_has_nothing_to_do_where_nothing_is_solved(tmp_path, capsys, verb):
    scene = written(tmp_path, SCENE.replace('"fast"', '"single"'))
    assert main([verb, str(scene), "--engine", "sasktran2"]) == 2
    assert "tier 'single' calls no solver" in capsys.readouterr().err


def test_the_other_engine_lights_the_same_scene(tmp_path, store):
    pytest.importorskip("sasktran2", reason="pip install sasktran2")
    air = AIR.replace("wavelengths = 2", "wavelengths = 1")
    own, theirs = (paint(predictor(tmp_path, store, air, **engine)) for engine in ({}, {"engine": "sasktran2"}))
    # What the fast tier states of the sky's radiance, 0.7 % at most; it is not the whole of the light.
    np.testing.assert_allclose(theirs, own, atol=7e-3 * own[0])
    assert not np.array_equal(theirs, own)  # it was not taken from the store
