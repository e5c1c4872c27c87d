import numpy as np
import pytest

from rigctl.errors import ConfigError
from rigctl.scene.light import read_sky_table

ARRAYS = {
    "sun_zenith_deg": np.array(50.0),
    "direct_irradiance": np.array(250.0),
    "zenith_deg": np.array([0.0, 45.0, 90.0]),
    "phi_deg": np.array([0.0, 90.0, 180.0]),
    "sky_stokes": np.tile([20.0, 1.0, 0.0], (3, 3, 1)),
    "height_m": np.array([0.0, 5000.0]),
    "path_transmittance": np.array([[1.0, 1.0, 1.0], [0.7, 0.6, 0.0]]),
    "path_stokes": np.zeros((2, 3, 3, 3)),
}


def table(tmp_path, **changes):
    path = tmp_path / "sky.npz"
    np.savez(path, **{name: array for name, array in (ARRAYS | changes).items() if array is not None})
    return path


def test_a_table_becomes_light(tmp_path):
    light = read_sky_table(table(tmp_path), sun_zenith_rad=np.radians(50.0))
    assert light.direct_irradiance == 250.0
    assert light.sky(zenith_rad=0.3, phi_rad=0.2)[0] == pytest.approx(20.0)
    assert float(light.transmittance(height_m=5000.0, zenith_rad=np.radians(45.0))) == pytest.approx(0.6)


def test_a_table_of_another_sun_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"50.0 deg from the zenith, the scene's stands at 40.00"):
        read_sky_table(table(tmp_path), sun_zenith_rad=np.radians(40.0))


def test_every_missing_array_is_named(tmp_path):
    path = table(tmp_path, height_m=None, path_stokes=None)
    with pytest.raises(ConfigError, match=r"(?s)height_m.*path_stokes"):
        read_sky_table(path, sun_zenith_rad=np.radians(50.0))


def test_shapes_that_do_not_fit_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="sky_stokes"):
        read_sky_table(table(tmp_path, sky_stokes=np.zeros((2, 3, 3))), sun_zenith_rad=np.radians(50.0))


def test_a_file_that_is_no_archive_is_refused(tmp_path):
    path = tmp_path / "sky.npz"
    path.write_text("zenith azimuth radiance")
    with pytest.raises(ConfigError, match="no numpy archive"):
        read_sky_table(path, sun_zenith_rad=np.radians(50.0))
