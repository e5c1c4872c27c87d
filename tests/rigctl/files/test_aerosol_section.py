import numpy as np
import pytest

from model.atmosphere.mie import aerosol_scattering, number_of_volume
from rigctl.errors import ConfigError
from rigctl.files.scene_file import load_scene
from tests.rigctl.scene_texts import SCENE, written

ATMOSPHERE = "wavelengths = 2\n"
FINE = "number_median_radius_um = 0.03\nlog10_sigma = 0.35\nn = 1.53\nk = 0.0066\n"
COARSE = "number_median_radius_um = 0.5\nlog10_sigma = 0.4\nn = 1.53\nk = 0.0066\n"


def modes(*texts, head=""):
    body = "".join(f"[[atmosphere.own_aerosol.modes]]\n{text}" for text in texts)
    return SCENE.replace(ATMOSPHERE, f"{ATMOSPHERE}{head}[atmosphere.own_aerosol]\n{body}")


def loaded(tmp_path, text):
    return load_scene(written(tmp_path, text)).atmosphere


def test_the_dry_rural_aerosol_written_out_has_its_albedo_and_asymmetry(tmp_path):
    air = loaded(tmp_path, modes("number_share = 0.999875\n" + FINE, "number_share = 0.000125\n" + COARSE))
    scattering = aerosol_scattering(air.lower, wavelength_m=550e-9, tolerance=1e-2)
    # The published values have three digits: 0.940 and 0.655.
    assert scattering.ssa == pytest.approx(0.940, abs=1e-3)
    assert scattering.matrix.g == pytest.approx(0.655, abs=1e-3)


def test_a_share_of_volume_is_that_of_as_many_particles(tmp_path):
    sigma, number = 0.5, np.array([0.9, 0.1])
    volume_radius_um = np.array([0.2, 2.0])
    volume = number * volume_radius_um**3 * np.exp(-4.5 * sigma**2)
    texts = [f"volume_median_radius_um = {r}\nln_sigma = {sigma}\nn = 1.5\nk = 0.01\n" for r in volume_radius_um]
    by_number, by_volume = (
        loaded(tmp_path, modes(*(f"{key} = {share}\n{text}" for share, text in zip(shares, texts, strict=True))))
        for key, shares in (("number_share", number), ("volume_share", volume))
    )
    one, other = ([mode.number_share for mode in air.lower.modes] for air in (by_number, by_volume))
    assert other[1] / other[0] == pytest.approx(one[1] / one[0])


def test_number_of_volume_is_that_of_the_integral():
    sigma, median = 0.6, 0.3
    ln_radius = np.linspace(np.log(median) - 8.0, np.log(median) + 8.0, 4001)
    number_median = median * np.exp(-3.0 * sigma**2)
    density = np.exp(-0.5 * ((ln_radius - np.log(number_median)) / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi))
    volume = np.trapezoid(density * 4.0 / 3.0 * np.pi * np.exp(3.0 * ln_radius), ln_radius)
    assert number_of_volume(volume=volume, volume_median_radius_m=median, ln_sigma=sigma) == pytest.approx(1.0)


@pytest.mark.parametrize("change", [{"volume": 0.0}, {"volume_median_radius_m": -1.0}, {"ln_sigma": 3.0}])
def test_impossible_volumes_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        number_of_volume(**({"volume": 1.0, "volume_median_radius_m": 1e-7, "ln_sigma": 0.5} | change))


def test_sizes_and_indices_as_tables(tmp_path):
    text = (
        "radius_um = [0.1, 0.2, 0.4]\nnumber_per_log_radius = [0.0, 1.0, 0.0]\n"
        "wavelength_nm = [400, 700]\nn = [1.5, 1.4]\nk = [0.01, 0.0]\n"
    )
    (mode,) = loaded(tmp_path, modes(text)).lower.modes
    assert mode.index.at(550e-9) == pytest.approx(1.45 + 0.005j)
    assert mode.sizes.breaks_m == pytest.approx((1e-7, 2e-7, 4e-7))


@pytest.mark.parametrize(
    ("mode", "problem"),
    [
        ("n = 1.5\nk = 0\nln_sigma = 0.5\n", "needs exactly one of number_median_radius_um"),
        ("n = 1.5\nk = 0\nnumber_median_radius_um = 0.1\n", "needs exactly one of ln_sigma"),
        ("volume_share = 1.0\n" + FINE, "volume_share needs volume_median_radius_um"),
        ("volume_share = 1.0\nnumber_share = 1.0\n" + FINE, "one of number_share and volume_share, not both"),
        ("radius_um = [0.1, 0.2]\n" + FINE, "a table of sizes needs radius_um and number_per_log_radius"),
        (FINE.replace("k = 0.0066", "k = -1"), "k = .* 0 or more"),
        (FINE.replace("log10_sigma = 0.35", "ln_sigma = 9"), "ln_sigma = 9"),
        (FINE + "colour = 3\n", "colour: is no known key"),
    ],
)
def test_problems_of_a_mode_are_named(tmp_path, mode, problem):
    with pytest.raises(ConfigError, match=rf"atmosphere.own_aerosol.modes.*{problem}"):
        loaded(tmp_path, modes(mode))


def test_several_modes_need_shares_of_one_kind(tmp_path):
    with pytest.raises(ConfigError, match="several need number_share or volume_share"):
        loaded(tmp_path, modes(FINE, COARSE))
    with pytest.raises(ConfigError, match="all need number_share, or all volume_share"):
        loaded(tmp_path, modes("number_share = 1.0\n" + FINE, COARSE))


@pytest.mark.parametrize(
    ("lines", "problem"),
    [
        ("aerosol_optical_depth = 0.2\n", "needs exactly one of visibility_km, aerosol_optical_depth"),
        ("angstrom_exponent = 5.0\n", None),
    ],
)
def test_one_source_of_depth(tmp_path, lines, problem):
    text = SCENE.replace(ATMOSPHERE, ATMOSPHERE + lines)
    if problem is None:
        assert loaded(tmp_path, text).angstrom_exponent.value == 5.0
        return
    with pytest.raises(ConfigError, match=problem):
        loaded(tmp_path, text)


DEPTHS = (
    "measured_depths = [{ wavelength_nm = 440, optical_depth = 0.3 }, { wavelength_nm = %s, optical_depth = 0.1 }]\n"
)


@pytest.mark.parametrize(
    ("lines", "problem"),
    [
        (DEPTHS % 870 + "angstrom_exponent = 1.3\n", "say the angstrom_exponent too"),
        (DEPTHS % 440, "two different wavelengths"),
    ],
)
def test_measured_depths_stand_alone(tmp_path, lines, problem):
    with pytest.raises(ConfigError, match=problem):
        loaded(tmp_path, SCENE.replace("visibility_km = 23.0\n", lines))


def test_a_table_has_its_own_aerosol(tmp_path):
    text = modes(FINE).replace('tier = "fast"', 'tier = "table"').replace("visibility_km = 23.0", 'table = "sky.npz"')
    with pytest.raises(ConfigError, match="tier 'table' has its own aerosol"):
        loaded(tmp_path, text)
