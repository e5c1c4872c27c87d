"""The air, camera and surfaces of a scene: from its record, in the units of the file, to the records of the model."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import Settings, settings_of_fidelity
from model.atmosphere.aerosols import angstrom_law
from model.atmosphere.air import AtmosphereState
from model.atmosphere.sky import Fidelity
from model.scene.field import FieldPart, part_of_picture, whole_field
from model.scene.panel import View
from model.scene.scene import Air, LitRegion
from model.surface.materials import Material, properties
from model.surface.pbrdf import Surface, Tilt
from rigctl.errors import ConfigError
from rigctl.files.config import Uncertain
from rigctl.files.scene_file import COVARIANCE_PAIRS, SceneRegion
from rigctl.scene.scene_reading import band_points
from rigctl.scene.skies.sky_table import read_sky_table
from rigctl.scene.skies.solar_band import response_band

if TYPE_CHECKING:
    from model.atmosphere.aerosols import AerosolChoice
    from model.atmosphere.sky import Lighting
    from rigctl.files.light_sections import AtmosphereSection, FieldSection
    from rigctl.scene.scene_record import Scene, SceneRegionRecord

# South: the sun's azimuth where the scene file states phi alone, and nothing depends on it.
_ANY_AZIMUTH_DEG = 180.0
_M_PER_DU, _PA_PER_HPA = 1e-5, 100.0


def wavelength_m(scene: "Scene") -> float:
    """Return the effective wavelength of a scene's sensor [m]."""
    if scene.sensor.wavelength_nm is None:
        raise ConfigError(f"scene {scene.name}: the sensor needs wavelength_nm or a band")
    return scene.sensor.wavelength_nm.value * 1e-9


def air_of(scene: "Scene") -> Air:
    """Return what the light of sun and sky depends on.

    Raises
    ------
    ConfigError
        The scene file lacks [sun], [atmosphere], or the sensor's band; or the table of a sky cannot be read, or is of
        another sun.
    """
    given, sun = scene.atmosphere, scene.sun
    if given is None or sun is None or not scene.sensor.has_band:
        raise ConfigError(f"scene {scene.name}: needs [sun], [atmosphere] and the sensor's band to compute a sky")
    nm, response = np.array(band_points(scene.sensor, scene.name)).T
    zenith_rad = radians(sun.zenith_deg)
    air = Air(
        sun_zenith_rad=zenith_rad,
        band=response_band(wavelength_nm=nm, response=response, distance_factor=sun.distance_factor.value),
        fidelity=given.tier,
        aerosol=given.aerosol,
        state=state_of(given),
        ground_albedo=given.ground_albedo.value,
        dolp_max=given.dolp_max.value,
        table=_table(given, zenith_rad),
    )
    other = given.alternative
    if other is None:
        return air
    state = _state(given, lower=other.lower or given.lower, upper=other.upper or given.upper)
    alternative = replace(air, aerosol=other.aerosol or given.aerosol, state=state)
    return replace(air, alternative=alternative, share=other.share.value)


def state_of(air: "AtmosphereSection") -> AtmosphereState | None:
    """Return the state of the air; None for a table of somebody's own."""
    return None if air.tier is Fidelity.TABLE else _state(air, lower=air.lower, upper=air.upper)


def camera_view(scene: "Scene") -> View:
    """Return where the camera stands.

    Raises
    ------
    ConfigError
        The scene file lacks [geometry].
    ValueError
        An angle is outside its range.
    """
    given = scene.geometry
    if given is None:
        raise ConfigError(f"scene {scene.name}: needs [geometry]")
    if given.phi_deg is not None:
        azimuth_rad = sun_azimuth_rad(scene) - radians(given.phi_deg)
    else:
        azimuth_rad = radians(given.camera_azimuth_deg)
    return View(
        zenith_rad=radians(given.camera_zenith_deg),
        azimuth_rad=azimuth_rad,
        roll_rad=radians(given.camera_roll_deg),
        height_m=given.camera_height_m.value,
    )


def sun_azimuth_rad(scene: "Scene") -> float:
    """Return the azimuth of the sun [rad]; south where the scene file states none."""
    stated = None if scene.sun is None else scene.sun.azimuth_deg
    return float(np.deg2rad(_ANY_AZIMUTH_DEG if stated is None else stated.value))


def settings_of(scene: "Scene") -> Settings:
    """Return the numerical settings that a scene file states, without a tolerance."""
    air, field = scene.atmosphere, scene.field_of_view
    settings = settings_of_fidelity(
        Fidelity.STANDARD if air is None else air.tier, wavelengths=4 if air is None else air.wavelengths
    )
    if field is None:
        return settings
    return replace(settings, tiles_per_side=field.tiles_per_side, tile_rule=field.rule)


def lit_region(scene: "Scene", region: "SceneRegionRecord") -> LitRegion:
    """Return one region of a scene.

    Raises
    ------
    ConfigError
        A number is outside its range.
    """
    given = region.given
    covariance, texture_rms = _texture_covariance(region), given.texture_rms.value
    if given.stokes_radiance is not None:
        radiance = np.array([component.value for component in given.stokes_radiance])
        return LitRegion(name=region.name, radiance=radiance, texture_rms=texture_rms, texture_cov=covariance)
    if region.material is None:
        raise ConfigError(f"scene {scene.name}, region {region.name}: needs stokes_radiance or a material")
    r0, r1, r2 = (number.value for number in given.texture_diagonal or (Uncertain(value=0.0),) * 3)
    try:
        return LitRegion(
            name=region.name,
            surface=_surface(region.material, given),
            tilt=Tilt(tilt_rad=radians(given.tilt_deg), azimuth_rad=radians(given.tilt_azimuth_deg)),
            part=field_part(scene, region),
            texture_rms=texture_rms,
            texture_diagonal=(r0, r1, r2),
            texture_cov=covariance,
        )
    except ValueError as error:
        raise ConfigError(f"scene {scene.name}, region {region.name}: {error}") from error


def field_part(scene: "Scene", region: "SceneRegionRecord") -> FieldPart | None:
    """Return the part of the field of view that a region fills; None for a point on the axis.

    Raises
    ------
    ConfigError
        The scene file does not say where in the field the region is.
    ValueError
        An angle is outside its range.
    """
    field, extent = scene.field_of_view, region.given.extent
    if extent == "point" or field is None:
        return None
    picture = (field.focal_length_mm, field.width_pixels, field.height_pixels)
    if extent == "field" and None in picture:
        return whole_field(width_rad=radians(field.width_deg), height_rad=radians(field.height_deg))
    return _picture_part(scene, region, field)


def _picture_part(scene: "Scene", region: "SceneRegionRecord", field: "FieldSection") -> FieldPart:
    if field.focal_length_mm is None or field.width_pixels is None or field.height_pixels is None:
        raise ConfigError(
            f'scene {scene.name}, region {region.name}: extent = "rectangle" needs [field_of_view] by '
            "focal_length_mm, width_pixels and height_pixels"
        )
    columns, rows = field.width_pixels, field.height_pixels
    x, y = (-0.5, columns - 0.5), (-0.5, rows - 0.5)
    if region.given.extent == "rectangle":
        corners_x, corners_y = zip(*region.given.outline(), strict=True)
        x, y = (min(corners_x), max(corners_x)), (min(corners_y), max(corners_y))
    return part_of_picture(
        left_pixel=x[0],
        right_pixel=x[1],
        top_pixel=y[0],
        bottom_pixel=y[1],
        picture=(columns, rows),
        pixel_pitch_m=scene.sensor.pixel_pitch_um.value * 1e-6,
        focal_length_m=field.focal_length_mm.value * 1e-3,
    )


def _surface(material: Material, given: SceneRegion) -> Surface:
    """Return what a region is made of; its properties are those at the sensor's wavelength already."""
    values: dict[str, Any] = {name: found.values[0] for name, found in properties(material).items()}
    return Surface(**values, dhr_angle_rad=material.dhr_angle_rad, shadowing=given.shadowing, diffuse=given.diffuse)


def _texture_covariance(region: "SceneRegionRecord") -> NDArray[np.float64]:
    found = np.zeros((3, 3))
    rows = region.given.texture_covariance
    if rows is not None:
        for i, j in COVARIANCE_PAIRS:
            found[i, j] = found[j, i] = rows[i][j].value
    return found


def _table(air: "AtmosphereSection", sun_zenith_rad: float) -> "Lighting | None":
    if air.tier is not Fidelity.TABLE:
        return None
    if air.table is None:
        raise ConfigError("atmosphere: tier 'table' needs table = \"FILE.npz\"")
    return read_sky_table(air.table, sun_zenith_rad=sun_zenith_rad)


def _state(air: "AtmosphereSection", *, lower: "AerosolChoice", upper: "AerosolChoice") -> AtmosphereState:
    exponent, depth = _spectrum(air)
    return AtmosphereState(
        visibility_m=None if air.visibility_km is None else air.visibility_km.value * 1e3,
        aerosol_optical_depth=depth,
        boundary_aerosol=lower,
        upper_aerosol=upper,
        angstrom_exponent=exponent,
        relative_humidity=air.relative_humidity.value,
        ozone_m=air.ozone_du.value * _M_PER_DU,
        surface_pressure_pa=air.surface_pressure_hpa.value * _PA_PER_HPA,
    )


def _spectrum(air: "AtmosphereSection") -> tuple[float | None, float | None]:
    """Angstrom's exponent and optical depth at 550 nm, as stated or as measured at two wavelengths."""
    if air.measured_depths is None:
        return _value(air.angstrom_exponent), _value(air.aerosol_optical_depth)
    first, second = air.measured_depths
    return angstrom_law(
        first_m=first.wavelength_nm * 1e-9,
        first_depth=first.optical_depth.value,
        second_m=second.wavelength_nm * 1e-9,
        second_depth=second.optical_depth.value,
    )


def _value(number: Uncertain | None) -> float | None:
    return None if number is None else number.value


def radians(number: Uncertain | None) -> float:
    """Return an angle of a file in radians; 0 where there is none."""
    return 0.0 if number is None else np.deg2rad(number.value).item()
