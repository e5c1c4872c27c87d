"""A scene given by materials, as text, for tests: the fast tier, two regions."""

from rigctl.files.scene_file import load_scene
from rigctl.scene.scene import scene_of_file

SENSOR = """
[sensor]
pixel_pitch_um = 8.3
f_number = 2.0
optics_transmittance = 0.9
quantum_efficiency = 0.45
band_nm = [400, 700]
bit_depth = 12
polarizer_transmittance = 0.8
extinction_ratio = 500
[noise]
gain_dn_per_e = 0.24
read_noise_e = 10.0
dark_current_e_per_s = 20.0
black_level_dn = 64.0
prnu = 0.005
dsnu_e = 1.0
[acquisition]
exposure_ms = 0.03
"""

LIGHT = """
[sun]
zenith_deg = 50.0
azimuth_deg = 180.0
day_of_year = 145
[geometry]
camera_zenith_deg = 50.0
camera_azimuth_deg = 0.0
camera_height_m = 3000.0
[atmosphere]
tier = "fast"
visibility_km = 23.0
wavelengths = 2
"""

REGIONS = """
[[regions]]
name = "paint"
rectangle = { x = 4, y = 4, width = 40, height = 40 }
material = "black-paint"
[[regions]]
name = "road"
rectangle = { x = 52, y = 4, width = 40, height = 40 }
material = "asphalt"
texture_rms = 0.02
"""

SCENE = 'name = "made"\n' + SENSOR + LIGHT + REGIONS


def written(folder, text=SCENE, *, name="scene.toml"):
    """Return the path of a scene file with this text."""
    path = folder / name
    path.write_text(text)
    return path


def scene_of(folder, text=SCENE):
    """Return the scene of a file with this text."""
    return scene_of_file(load_scene(written(folder, text)))
