"""The one table of a scene's parameters: a row each, with unit, range, meaning, and where it stands in the record.

A new parameter is a row here, a key of its file section, and what the model makes of it; those of [errors] state
their row beside their key.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import inf

from model.surface.pbrdf import SLOPE_RMS_MIN
from rigctl.files.effect_sections import error_numbers
from rigctl.files.light_sections import FIELD_MOST_DEG, HUMIDITY_MOST
from rigctl.files.scene_file import COVARIANCE_PAIRS
from rigctl.scene.scene_record import Scene

EXPOSURE = "acquisition.exposure_ms"
GAIN, NOISE_FACTOR = "noise.gain_dn_per_e", "noise.noise_factor"
EFFICIENCY, TRANSMITTANCE = "sensor.quantum_efficiency", "sensor.optics_transmittance"
SUN_ZENITH, SUN_AZIMUTH = "sun.zenith_deg", "sun.azimuth_deg"
OFFSET, EXPOSURE_RATIO = "rig.polarizer_offset_deg", "rig.exposure_ratio"
DRIFT = "errors.illumination_drift"
# What a parameter was called before.
OLD_KEYS = {"rig.light_drift": DRIFT}
# Before the name of each angle.
ANGLE = "rig.angle_deg."

# Just above the horizon; an index of refraction is not 0.
_LOWEST_DEG, _LEAST_INDEX = 89.0, 1e-3
_RADIANCE = "W m-2 sr-1"
_RADIANCE_2 = f"({_RADIANCE})^2"

Place = tuple[str | int, ...]


@dataclass(frozen=True, kw_only=True)
class Row:
    """One parameter.

    Attributes
    ----------
    key : str
        As in files, in --sweep and in reports; of a region, within that region.
    unit : str
        Of the file; empty for a pure number.
    meaning : str
        One line.
    least, most : float
        Between which numbers it has to stay; infinite where there is no limit.
    place : str
        Where it stands in the record, where that is not its key.
    """

    key: str
    unit: str
    meaning: str
    least: float = 0.0
    most: float = inf
    place: str = ""

    @cached_property
    def path(self) -> Place:
        """Steps from the record to the parameter: attributes, and places in a tuple."""
        return tuple(int(step) if step.isdigit() else step for step in (self.place or self.key).split("."))


def _row(key: str, unit: str, meaning: str, least: float = 0.0, most: float = inf, place: str = "") -> Row:
    return Row(key=key, unit=unit, meaning=meaning, least=least, most=most, place=place)


SCENE_ROWS = (
    _row("sensor.pixel_pitch_um", "um", "distance of the pixels' centres"),
    _row("sensor.f_number", "", "focal length over the diameter of the entrance pupil"),
    _row(TRANSMITTANCE, "", "transmittance of the optics", most=1.0),
    _row(EFFICIENCY, "", "electrons per photon at the effective wavelength", most=1.0),
    _row("sensor.wavelength_nm", "nm", "effective wavelength of the sensor's band"),
    _row("sensor.polarizer_transmittance", "", "transmittance of the polarizer along its axis", most=1.0),
    _row("sensor.extinction_ratio", "", "transmittance of the polarizer along its axis over that across", least=1.0),
    _row(GAIN, "DN/e", "counts per electron"),
    _row("noise.read_noise_e", "e", "deviation of the read noise"),
    _row("noise.dark_current_e_per_s", "e/s", "dark current"),
    _row("noise.black_level_dn", "DN", "counts without light at no exposure"),
    _row("noise.prnu", "", "photo response non-uniformity, relative deviation of the pixels"),
    _row("noise.dsnu_e", "e", "dark signal non-uniformity, deviation of the pixels"),
    _row(NOISE_FACTOR, "", "factor on the deviation of all temporal noise, Kn of [MK14] eq. (32)"),
    _row("sun.distance_factor", "", "sun's irradiance outside the atmosphere over that at the mean distance"),
    _row(SUN_ZENITH, "deg", "angle of the sun from the zenith", most=_LOWEST_DEG),
    _row(SUN_AZIMUTH, "deg", "azimuth of the sun, clockwise from north", least=-inf),
    _row("geometry.camera_zenith_deg", "deg", "angle of the camera from the target's zenith", most=_LOWEST_DEG),
    _row("geometry.camera_azimuth_deg", "deg", "azimuth of the camera as seen from the target", least=-inf),
    _row("geometry.phi_deg", "deg", "azimuth of the sun minus that of the camera", least=-inf),
    _row("geometry.camera_roll_deg", "deg", "roll of the camera, counter-clockwise as it sees the scene", least=-inf),
    _row("geometry.camera_height_m", "m", "height of the camera over the ground"),
    _row("atmosphere.visibility_km", "km", "visibility, which says how much aerosol there is"),
    _row("atmosphere.aerosol_optical_depth", "", "optical depth of the aerosol at 550 nm"),
    _row("atmosphere.angstrom_exponent", "", "Angstrom's exponent of the aerosol's optical depth", least=-inf),
    _row("atmosphere.relative_humidity", "", "relative humidity of the air with the aerosol", most=HUMIDITY_MOST),
    _row("atmosphere.ozone_du", "DU", "column of ozone"),
    _row("atmosphere.surface_pressure_hpa", "hPa", "pressure at the ground"),
    _row("atmosphere.ground_albedo", "", "albedo of the ground around", most=1.0),
    _row("atmosphere.dolp_max", "", "largest DoLP of the sky, of tier analytic", most=1.0),
    _row("atmosphere.measured_depths.0.optical_depth", "", "optical depth of the aerosol at the first wavelength"),
    _row("atmosphere.measured_depths.1.optical_depth", "", "optical depth of the aerosol at the second wavelength"),
    _row("atmosphere.alternative.share", "", "share of the light that is as of the other aerosol", most=1.0),
    _row("field_of_view.width_deg", "deg", "width of the field of view", most=FIELD_MOST_DEG),
    _row("field_of_view.height_deg", "deg", "height of the field of view", most=FIELD_MOST_DEG),
    _row("field_of_view.focal_length_mm", "mm", "focal length of the lens"),
    *(_row(f"errors.{key}", one.unit, one.meaning, most=one.most) for key, one in error_numbers().items()),
)

# Within "regions.NAME.".
REGION_ROWS = (
    *(
        _row(
            f"stokes_radiance.{k}",
            _RADIANCE,
            f"S{k} at the aperture, in band",
            -inf,
            place=f"given.stokes_radiance.{k}",
        )
        for k in range(3)
    ),
    _row("texture_rms", "", "relative deviation of the pixels' whole Stokes vector", place="given.texture_rms"),
    *(
        _row(
            f"texture_covariance.{i}.{j}",
            _RADIANCE_2,
            f"further covariance of the pixels' S{i} and S{j}",
            0.0 if i == j else -inf,
            place=f"given.texture_covariance.{i}.{j}",
        )
        for i, j in COVARIANCE_PAIRS
    ),
)

# Of a region that is given by its material.
MATERIAL_ROWS = (
    *(
        _row(f"texture_diagonal.{k}", "", f"deviation of the pixels' S{k} over S0", place=f"given.texture_diagonal.{k}")
        for k in range(3)
    ),
    _row("tilt_deg", "deg", "tilt of the surface from level", place="given.tilt_deg"),
    _row("tilt_azimuth_deg", "deg", "azimuth to which it is tilted", -inf, place="given.tilt_azimuth_deg"),
    _row("n", "", "index of refraction, real part", _LEAST_INDEX, place="material.n"),
    _row("k", "", "index of refraction, imaginary part", place="material.k"),
    _row("slope_rms", "", "deviation of the facets' slopes, per axis", SLOPE_RMS_MIN, place="material.slope_rms"),
    _row("dhr", "", "directional-hemispherical reflectance", most=1.0, place="material.dhr"),
    _row("specular_weight", "", "weight of the specular lobe", most=1.0, place="material.specular_weight"),
    _row("dhr_angle_deg", "deg", "zenith angle at which the dhr was measured", place="material.dhr_angle_rad"),
)

RIG_ROWS = (
    _row(OFFSET, "deg", "what would have to be added to every recorded angle of the polarizer", -inf),
    _row(EXPOSURE_RATIO, "", "true exposure over the recorded one"),
    _row(DRIFT, "", "change of the light through a cycle over its mean", least=-1.0, most=1.0),
)
_ANGLE_ROW = _row(ANGLE, "deg", "what one angle of the polarizer is off on its own", -inf)
# Its uncertainty is that of rig.exposure_ratio.
_EXPOSURE_ROW = _row(EXPOSURE, "ms", "exposure of a frame")


def placed_rows(scene: Scene) -> Iterator[tuple[str, Row, Place]]:
    """Yield key, row and place in the record of every parameter that a scene may have, in the order of the inputs."""
    for row in SCENE_ROWS:
        yield row.key, row, row.path
    for k, region in enumerate(scene.regions):
        rows = REGION_ROWS if region.material is None else (*REGION_ROWS, *MATERIAL_ROWS)
        for row in rows:
            yield f"regions.{region.name}.{row.key}", row, ("regions", k, *row.path)
    for row in RIG_ROWS:
        yield row.key, row, row.path
    for k, name in enumerate(() if scene.rig is None else scene.rig.angle_names):
        yield f"{ANGLE}{name}", _ANGLE_ROW, ("rig", "angle_deg", k)
    yield EXPOSURE, _EXPOSURE_ROW, _EXPOSURE_ROW.path


def all_rows() -> tuple[Row, ...]:
    """Return every row as a page on the parameters shows it: NAME stands for a region, ANGLE for an angle."""
    regions = tuple(_named(row, f"regions.NAME.{row.key}") for row in (*REGION_ROWS, *MATERIAL_ROWS))
    return (*SCENE_ROWS, *regions, *RIG_ROWS, _named(_ANGLE_ROW, f"{ANGLE}ANGLE"), _EXPOSURE_ROW)


def _named(row: Row, key: str) -> Row:
    return Row(key=key, unit=row.unit, meaning=row.meaning, least=row.least, most=row.most, place=row.place)
