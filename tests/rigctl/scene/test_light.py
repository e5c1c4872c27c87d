"""From the scene to its light: geometry, aerosol, tables of the sky, and what of the air is independent of us."""

import hashlib
import importlib.util

import numpy as np
import pytest
from pvlib import spectrum

from model.accuracy.chain import LightStore, settings_of_fidelity
from model.atmosphere.air import AtmosphereState, column
from model.atmosphere.layers import AerosolKind, Layer
from model.atmosphere.sky import Fidelity
from model.atmosphere.solver import solve
from model.processing.agreement import input_jacobian
from model.scene.scene import Air
from model.stokes import aolp_rad
from rigctl.cli import main
from rigctl.errors import ConfigError
from rigctl.files.scene_file import load_scene
from rigctl.prediction.predict import ScenePredictor
from rigctl.scene.light import (
    SceneLight,
    SkyStore,
    camera_view,
    read_sky_table,
    solver_sources,
    user_cache_folder,
)
from rigctl.scene.scene import get, scene_of_file, with_value, with_values
from rigctl.scene.sun import response_band
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.scene_texts import SCENE, scene_of, written


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return SkyStore(tmp_path_factory.mktemp("skies"))


@pytest.fixture(scope="module")
def light(store):
    return SceneLight(store)


def region_light(light, tmp_path, text=SCENE, *, region=0, **changes):
    scene = with_values(scene_of(tmp_path, text), changes)
    return light.region(scene, scene.regions[region])


# A facet that mirrors a sun at 43 deg into a camera at 53 deg across, phi = +90 deg: sun in the west, camera south.
SIDE = (
    SCENE.replace("zenith_deg = 50.0\nazimuth_deg = 180.0", "zenith_deg = 43.0\nazimuth_deg = 270.0")
    .replace(
        "camera_zenith_deg = 50.0\ncamera_azimuth_deg = 0.0", "camera_zenith_deg = 53.0\ncamera_azimuth_deg = 180.0"
    )
    .replace('"black-paint"', '"mirror.toml"')
)


def test_sign_of_s2_through_the_whole_chain_by_compass_azimuths(light, tmp_path):
    (tmp_path / "mirror.toml").write_text('name = "facets"\nn = 1.5\nslope_rms = 0.3\n')
    sun = region_light(light, tmp_path, SIDE).mean("reflected_sun")
    assert sun[2] / sun[0] == pytest.approx(0.440, abs=5e-4)


def test_phi_says_the_same_as_two_azimuths(light, tmp_path):
    (tmp_path / "mirror.toml").write_text('name = "facets"\nn = 1.5\nslope_rms = 0.3\n')
    by_phi = SIDE.replace("azimuth_deg = 270.0\n", "", 1).replace("camera_azimuth_deg = 180.0", "phi_deg = 90.0")
    np.testing.assert_allclose(
        region_light(light, tmp_path, by_phi).mean(), region_light(light, tmp_path, SIDE).mean(), rtol=1e-9
    )


def test_a_camera_that_rolls_sees_a_lower_angle(light, tmp_path):
    straight, rolled = (
        region_light(light, tmp_path, **{"geometry.camera_roll_deg": roll}).mean() for roll in (0.0, 10.0)
    )
    lowered = np.degrees(aolp_rad(straight) - aolp_rad(rolled)) % 180.0
    assert lowered == pytest.approx(10.0)


def test_a_field_of_view_is_cut_into_tiles(light, tmp_path):
    field = "[field_of_view]\nwidth_deg = 15\nheight_deg = 15\ntiles_per_side = 3\n"
    text = SCENE.replace("texture_rms = 0.02", 'extent = "field"') + field
    assert len(region_light(light, tmp_path, text, region=0).lights) == 1
    assert len(region_light(light, tmp_path, text, region=1).lights) == 9


def test_a_rectangle_of_the_picture_has_its_own_place_in_the_field(light, tmp_path):
    field = "[field_of_view]\nfocal_length_mm = 3\nwidth_pixels = 96\nheight_pixels = 48\ntiles_per_side = 3\n"
    whole = SCENE.replace("texture_rms = 0.02", 'extent = "field"') + field
    part = whole.replace('"field"', '"rectangle"')
    # 96 pixels of 8.3 um behind 3 mm are 15 deg; the rectangle is 40 of them, right of the middle.
    assert region_light(light, tmp_path, whole, region=1).spread > region_light(light, tmp_path, part, region=1).spread


FIELD = "[field_of_view]\nwidth_deg = 15\nheight_deg = 15\n"


@pytest.mark.parametrize(
    ("region", "text", "changes", "said"),
    [
        (
            1,
            SCENE.replace("texture_rms = 0.02", 'extent = "rectangle"') + FIELD,
            {},
            "road: extent = .rectangle. needs",
        ),
        (
            1,
            SCENE.replace("texture_rms = 0.02", 'extent = "field"').replace(
                "camera_zenith_deg = 50.0", "camera_zenith_deg = 85.0"
            )
            + FIELD,
            {},
            "region road: field of view: it reaches above the horizon",
        ),
        (0, SCENE, {"sun.zenith_deg": 86.0}, "scene made: solar zenith = 86.00 deg, allowed is 0 to 85 deg"),
        (0, SCENE, {"regions.paint.dhr": 0.01}, "region paint: dhr = 0.01 is inconsistent"),
    ],
)
def test_what_the_model_cannot_do_is_refused_by_name(light, tmp_path, region, text, changes, said):
    with pytest.raises(ConfigError, match=said):
        region_light(light, tmp_path, text, region=region, **changes)


def test_the_remarks_name_depth_tier_and_the_largest_uncertainty(light, tmp_path):
    text = " ".join(light.remarks(scene_of(tmp_path)))
    assert "optical depth at 550 nm 0.421" in text
    assert "tier fast (radiance 0.3 %" in text
    assert "kind of aerosol is the largest uncertainty" in text


def test_a_camera_that_keeps_its_azimuth_from_noon_sees_another_phi():
    scene = scene_of_file(load_scene(EXAMPLES / "scene-rooftop-morning-by-time.toml"))
    assert scene.sun.zenith_deg.value == pytest.approx(43.0, abs=0.03)
    azimuth_deg = scene.sun.azimuth_deg.value
    turned = np.degrees(np.radians(azimuth_deg) - camera_view(scene).azimuth_rad)
    assert turned == pytest.approx(90.0, abs=0.05)
    kept = camera_view(with_value(scene, "geometry.camera_azimuth_deg", 0.0))
    assert azimuth_deg - np.degrees(kept.azimuth_rad) == pytest.approx(106.45, abs=0.05)


def test_time_and_place_are_as_good_as_angles(light):
    found = []
    for name in ("scene-rooftop-noon", "scene-rooftop-noon-by-time"):
        scene = load_scene(EXAMPLES / f"{name}.toml")
        fast = scene.model_copy(update={"atmosphere": scene.atmosphere.model_copy(update={"tier": "fast"})})
        record = scene_of_file(fast)
        found.append(light.region(record, record.regions[0]).mean())
    # The sun stands 0.067 deg lower than 22: the lobe of the paint, some 15 deg wide, is brighter by 0.7 %.
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=0.01 * found[0][0])


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
    slopes = input_jacobian(dolp_at, inputs.values, np.sqrt(np.diag(cov)), least=tuple(inputs.least))
    return float(np.sqrt((slopes @ cov @ slopes.T)[0, 0]))


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
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12 * one[0])  # S2 is 0 but for rounding


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
    scene = scene_of(tmp_path, SCENE.replace(AIR, AIR + ALTERNATIVE % (0.1, 0.2)))
    remarks = " ".join(SceneLight(store).remarks(scene))
    assert "with a share of 0.1 +- 0.2 of the light of polarizing tropospheric" in remarks


def test_what_an_alternative_leaves_out_is_as_it_was(tmp_path, store):
    alternative = '[atmosphere.alternative]\naerosol = "polarizing"\nshare = 1.0\n'
    whole = paint(predictor(tmp_path, store, AIR + OWN + alternative))
    pure = paint(predictor(tmp_path, store, AIR + 'aerosol = "polarizing"\n' + OWN))
    np.testing.assert_allclose(whole, pure, rtol=1e-4, atol=1e-9)


def test_an_alternative_that_is_none_is_refused(tmp_path, store):
    with pytest.raises(ConfigError, match="needs one of aerosol, aerosol_type"):
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


STATE = AtmosphereState(visibility_m=23e3)
# By the NREL algorithm on day 145.
DISTANCE_FACTOR = 0.9748


def air(sun_zenith_deg, **changes):
    known = {
        "sun_zenith_rad": np.radians(sun_zenith_deg).item(),
        "band": response_band(
            wavelength_nm=np.array([400.0, 700.0]), response=np.ones(2), distance_factor=DISTANCE_FACTOR
        ),
        "fidelity": Fidelity.FAST,
        "aerosol": AerosolKind.DEPOLARIZING,
        "state": STATE,
        "ground_albedo": 0.2,
    }
    return Air(**(known | changes))


def lit(wanted, *, store=None, sun_azimuth_rad=0.0):
    store = LightStore() if store is None else store
    settings = settings_of_fidelity(wanted.fidelity, wavelengths=4)
    return store.illumination(wanted, settings, sun_azimuth_rad=sun_azimuth_rad)


def spectrl2(sun_zenith_deg):
    """Direct normal and diffuse horizontal irradiance, 400 to 700 nm, with ozone and hardly any water."""
    zenith = np.array([sun_zenith_deg])
    cosine = np.cos(np.radians(zenith))
    air_mass = 1.0 / (cosine + 0.15 * (93.885 - zenith) ** -1.253)
    found = spectrum.spectrl2(
        apparent_zenith=zenith,
        aoi=zenith,
        surface_tilt=np.zeros(1),
        ground_albedo=0.2,
        surface_pressure=101325.0,
        relative_airmass=air_mass,
        precipitable_water=1.4,
        ozone=0.344,
        aerosol_turbidity_500nm=float(column(STATE, wavelength_m=500e-9).tau_aerosol),
        dayofyear=145,
    )
    nm = found["wavelength"]
    grid = np.linspace(400.0, 700.0, 601)
    return tuple(float(np.trapezoid(np.interp(grid, nm, np.ravel(found[name])), grid)) for name in ("dni", "dhi"))


@pytest.mark.parametrize("sun_zenith_deg", [25.0, 50.0])
def test_irradiance_agrees_with_spectrl2(sun_zenith_deg):
    made = lit(air(sun_zenith_deg))
    direct, diffuse = spectrl2(sun_zenith_deg)
    # A model with an older solar spectrum and its own law of turbidity: 5 % in the beam, 8 % in the sky were seen.
    assert made.lighting.direct_irradiance == pytest.approx(direct, rel=0.10)
    assert made.sky_irradiance == pytest.approx(diffuse, rel=0.10)


def test_the_beam_without_ozone_is_known():
    # 320.8 W m-2 at the mean distance, from 61 wavelengths of the same atmosphere, sun 25 deg from the zenith.
    dry = air(25.0, state=AtmosphereState(visibility_m=23e3, ozone_m=0.0))
    made = lit(dry)
    assert made.lighting.direct_irradiance == pytest.approx(320.8 * DISTANCE_FACTOR, rel=2e-3)
    assert made.sky_irradiance == pytest.approx(140.8, rel=1e-2)  # over a ground of albedo 0.2; fast tier


def test_a_sky_is_solved_once_for_all_azimuths_of_the_sun():
    calls = []

    def counted(*arguments, **settings):
        calls.append(1)
        return solve(*arguments, **settings)

    store = LightStore(solver=counted)
    lit(air(40.0), store=store)
    lit(air(40.0), store=store, sun_azimuth_rad=1.0)
    assert len(calls) == 4  # wavelengths
    lit(air(41.0), store=store)
    assert len(calls) == 8


def test_the_sampled_sky_is_that_of_the_atmosphere():
    made = lit(air(40.0))
    exact = made.lighting.sky(zenith_rad=[0.3, 1.2], phi_rad=[0.4, 2.0])
    sampled = made.diffuse_radiance.sky(zenith_rad=[0.3, 1.2], phi_rad=[0.4, 2.0])
    assert np.max(np.abs(sampled - exact)) < 3.0 * made.diffuse_radiance.relative_error * exact[0, 0]


TABLE_ARRAYS = {
    "sun_zenith_deg": np.array(50.0),
    "direct_irradiance": np.array(250.0),
    "zenith_deg": np.array([0.0, 45.0, 90.0]),
    "phi_deg": np.array([0.0, 90.0, 180.0]),
    "sky_stokes": np.tile([20.0, 1.0, 0.0], (3, 3, 1)),
    "height_m": np.array([0.0, 5000.0]),
    "path_transmittance": np.array([[1.0, 1.0, 1.0], [0.7, 0.6, 0.0]]),
    "path_stokes": np.zeros((2, 3, 3, 3)),
}


def sky_table(tmp_path, **changes):
    path = tmp_path / "sky.npz"
    np.savez(path, **{name: array for name, array in (TABLE_ARRAYS | changes).items() if array is not None})
    return path


def test_a_table_becomes_light(tmp_path):
    light = read_sky_table(sky_table(tmp_path), sun_zenith_rad=np.radians(50.0))
    assert light.direct_irradiance == 250.0
    assert light.sky(zenith_rad=0.3, phi_rad=0.2)[0] == pytest.approx(20.0)
    assert float(light.transmittance(height_m=5000.0, zenith_rad=np.radians(45.0))) == pytest.approx(0.6)


def test_a_file_that_is_no_archive_is_refused(tmp_path):
    path = tmp_path / "sky.npz"
    path.write_text("zenith azimuth radiance")
    with pytest.raises(ConfigError, match="not a readable numpy archive"):
        read_sky_table(path, sun_zenith_rad=np.radians(50.0))


@pytest.mark.parametrize(
    ("changes", "sun_deg", "said"),
    [
        ({}, 40.0, r"50.0 deg from the zenith, the scene's is at 40.00"),
        ({"height_m": None, "path_stokes": None}, 50.0, r"(?s)height_m.*path_stokes"),
        ({"sky_stokes": np.zeros((2, 3, 3))}, 50.0, "sky_stokes"),
    ],
)
def test_a_table_that_does_not_fit_is_refused(tmp_path, changes, sun_deg, said):
    with pytest.raises(ConfigError, match=said):
        read_sky_table(sky_table(tmp_path, **changes), sun_zenith_rad=np.radians(sun_deg))


LAYERS = (Layer(tau_rayleigh=0.05, tau_aerosol=0.1, ssa_aerosol=0.9, g_aerosol=0.6, delta=0.96),)
SETTINGS = {"mu0": 0.7, "albedo": 0.1, "nodes": 4, "element_depth": 0.1, "tolerance": 1e-3}


class Counted:
    """The solver, counting its calls."""

    def __init__(self):
        self.calls = 0

    def __call__(self, layers, **settings):
        self.calls += 1
        return solve(layers, **settings)


@pytest.fixture
def solver():
    return Counted()


def of_sky(solution):
    return solution.stokes(solution.depth, [0.2, 0.8], [0.3, 2.0], looking="up")


def matrices():
    column_of_air = column(AtmosphereState(visibility_m=23e3), wavelength_m=550e-9)
    return column_of_air.layers(fine=False, aerosol=AerosolKind.SPHERES)


@pytest.mark.parametrize(
    ("layers", "settings"),
    [(lambda: LAYERS, SETTINGS), (matrices, SETTINGS | {"aerosol": AerosolKind.SPHERES})],
    ids=["plain", "scattering matrices"],
)
def test_a_second_run_takes_what_the_first_computed(tmp_path, solver, layers, settings):
    first = SkyStore(tmp_path, solver=solver)(layers(), **settings)
    again = SkyStore(tmp_path, solver=solver)
    np.testing.assert_array_equal(of_sky(again(layers(), **settings)), of_sky(first))
    assert (solver.calls, again.remarks) == (1, [])


@pytest.mark.parametrize(
    "change", [{"mu0": np.nextafter(0.7, 1.0)}, {"albedo": 0.2}, {"aerosol": "polarizing"}, {"nodes": 5}]
)
def test_other_inputs_are_another_sky(tmp_path, solver, change):
    store = SkyStore(tmp_path, solver=solver)
    store(LAYERS, **SETTINGS)
    store(LAYERS, **(SETTINGS | change))
    assert solver.calls == 2


def _flip_a_bit(data):
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


def _no_sky(data):
    body = b"no archive"
    return b"rigctl sky 2 sha256 " + hashlib.sha256(body).hexdigest().encode() + b"\n" + body


@pytest.mark.parametrize(
    "spoil",
    [_flip_a_bit, lambda data: data[:-10], lambda data: b"", lambda data: data.replace(b"sky 2", b"sky 1", 1), _no_sky],
)
def test_a_damaged_entry_is_computed_anew_and_replaced(tmp_path, solver, spoil):
    right = of_sky(SkyStore(tmp_path, solver=solver)(LAYERS, **SETTINGS))
    (entry,) = tmp_path.iterdir()
    whole = entry.read_bytes()
    entry.write_bytes(spoil(whole))
    store = SkyStore(tmp_path, solver=solver)
    np.testing.assert_array_equal(of_sky(store(LAYERS, **SETTINGS)), right)
    assert solver.calls == 2
    assert any("damaged" in remark for remark in store.remarks)
    assert entry.read_bytes() == whole


def test_a_folder_that_cannot_be_written_costs_time_only(tmp_path, solver):
    blocked = tmp_path / "file"
    blocked.write_text("here stands a file")
    store = SkyStore(blocked / "skies", solver=solver)
    store(LAYERS, **SETTINGS)
    assert solver.calls == 1
    assert any("cannot be" in remark for remark in store.remarks)


def test_a_full_folder_loses_what_was_not_used_for_longest(tmp_path, solver):
    SkyStore(tmp_path, solver=solver)(LAYERS, **SETTINGS)
    (entry,) = tmp_path.iterdir()
    size = entry.stat().st_size
    store = SkyStore(tmp_path, solver=solver, limit_bytes=int(2.5 * size))
    for albedo in (0.2, 0.3, 0.4):
        store(LAYERS, **(SETTINGS | {"albedo": albedo}))
    assert sum(entry.stat().st_size for entry in tmp_path.iterdir()) <= 2.5 * size
    calls = solver.calls
    store(LAYERS, **(SETTINGS | {"albedo": 0.4}))
    assert solver.calls == calls


def test_the_users_cache_folder_follows_the_convention(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_cache_folder() == tmp_path / "rigctl" / "skies"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert user_cache_folder() == tmp_path / ".cache" / "rigctl" / "skies"


def test_an_entry_depends_on_all_sources_of_the_solver():
    assert {"solver.py", "layers.py", "mie.py"} <= set(solver_sources())
