"""From the numbers of a scene file, in its units, to the records of the model."""

from collections.abc import Mapping

import numpy as np

from model.atmosphere.aerosol.angstrom import angstrom_law
from model.atmosphere.aerosol.choice import AerosolChoice
from model.atmosphere.lighting.fidelity import Tier
from model.atmosphere.profile import AtmosphereState
from model.scene.field_of_view import FieldPart, part_of_picture, whole_field
from model.scene.view import View
from model.surface.pbrdf import Surface
from model.surface.tilt import Tilt
from rigctl.errors import ConfigError
from rigctl.files.light_sections import AtmosphereSection, FieldSection
from rigctl.files.scene_file import SceneFile, SceneRegion
from rigctl.scene.skies.alternative_air import AlternativeAir
from rigctl.scene.skies.sky_request import SkyRequest

# Name, as `rigctl.scene.scene_inputs.gather` has it, to number.
Values = Mapping[str, float]

# South: the sun's azimuth where the scene file states phi alone, and nothing depends on it.
_ANY_AZIMUTH_DEG = 180.0
_M_PER_DU, _PA_PER_HPA = 1e-5, 100.0


def sky_request(scene: SceneFile, values: Values) -> SkyRequest:
    """Return what the sky of a scene depends on.

    Raises
    ------
    ConfigError
        The scene file lacks [sun], [atmosphere], or the sensor's band.
    """
    air = scene.atmosphere
    if air is None or scene.sun is None or not scene.sensor.has_band:
        raise ConfigError(f"scene {scene.name}: needs [sun], [atmosphere] and the sensor's band to compute a sky")
    return SkyRequest(
        sun_zenith_rad=np.deg2rad(values["sun.zenith_deg"]).item(),
        distance_factor=values["sun.distance_factor"],
        response=band_points(scene),
        tier=air.tier,
        aerosol=air.aerosol,
        state=None if air.tier is Tier.TABLE else _state(air, values, lower=air.lower, upper=air.upper),
        alternative=_alternative(air, values),
        ground_albedo=values["atmosphere.ground_albedo"],
        wavelengths=air.wavelengths,
        dolp_max=values["atmosphere.dolp_max"],
        table=air.table,
    )


def band_points(scene: SceneFile) -> tuple[tuple[float, float], ...]:
    """Return wavelengths [nm] and relative response of a scene's sensor.

    Raises
    ------
    ConfigError
        The scene file does not say.
    """
    if scene.sensor.response is not None:
        return tuple(zip(scene.sensor.response.wavelength_nm, scene.sensor.response.response, strict=True))
    if scene.sensor.band_nm is None:
        raise ConfigError(f"scene {scene.name}: the sensor needs band_nm or response")
    return tuple((wavelength_nm, 1.0) for wavelength_nm in scene.sensor.band_nm)


def camera_view(scene: SceneFile, values: Values) -> View:
    """Return where the camera stands.

    Raises
    ------
    ConfigError
        The scene file lacks [geometry].
    ValueError
        An angle is outside its range.
    """
    if scene.geometry is None:
        raise ConfigError(f"scene {scene.name}: needs [geometry]")
    if "geometry.phi_deg" in values:
        azimuth_rad = sun_azimuth_rad(values) - np.deg2rad(values["geometry.phi_deg"]).item()
    else:
        azimuth_rad = np.deg2rad(values["geometry.camera_azimuth_deg"]).item()
    return View(
        zenith_rad=np.deg2rad(values["geometry.camera_zenith_deg"]).item(),
        azimuth_rad=azimuth_rad,
        roll_rad=np.deg2rad(values["geometry.camera_roll_deg"]).item(),
        height_m=values["geometry.camera_height_m"],
    )


def sun_azimuth_rad(values: Values) -> float:
    """Return the azimuth of the sun [rad]; south where the scene file states none."""
    return float(np.deg2rad(values.get("sun.azimuth_deg", _ANY_AZIMUTH_DEG)))


def _alternative(air: AtmosphereSection, values: Values) -> AlternativeAir | None:
    other = air.alternative
    if other is None:
        return None
    return AlternativeAir(
        aerosol=other.aerosol or air.aerosol,
        state=_state(air, values, lower=other.lower or air.lower, upper=other.upper or air.upper),
        share=values["atmosphere.alternative.share"],
    )


def _state(air: AtmosphereSection, values: Values, *, lower: AerosolChoice, upper: AerosolChoice) -> AtmosphereState:
    visibility_km = values.get("atmosphere.visibility_km")
    exponent, depth = _spectrum(air, values)
    return AtmosphereState(
        visibility_m=None if visibility_km is None else visibility_km * 1e3,
        aerosol_optical_depth=depth,
        boundary_aerosol=lower,
        upper_aerosol=upper,
        angstrom_exponent=exponent,
        relative_humidity=values["atmosphere.relative_humidity"],
        ozone_m=values["atmosphere.ozone_du"] * _M_PER_DU,
        surface_pressure_pa=values["atmosphere.surface_pressure_hpa"] * _PA_PER_HPA,
    )


def _spectrum(air: AtmosphereSection, values: Values) -> tuple[float | None, float | None]:
    """Angstrom's exponent and optical depth at 550 nm, as stated or as measured at two wavelengths."""
    if air.measured_depths is None:
        return values.get("atmosphere.angstrom_exponent"), values.get("atmosphere.aerosol_optical_depth")
    (first_m, second_m) = (one.wavelength_nm * 1e-9 for one in air.measured_depths)
    (first, second) = (values[f"atmosphere.measured_depths.{k}.optical_depth"] for k in range(2))
    return angstrom_law(first_m=first_m, first_depth=first, second_m=second_m, second_depth=second)


def region_surface(region: SceneRegion, values: Values) -> Surface:
    """Return what a region is made of.

    Raises
    ------
    ValueError
        The numbers form no possible surface.
    """
    prefix = f"regions.{region.name}"
    return Surface(
        n=values[f"{prefix}.n"],
        k=values[f"{prefix}.k"],
        slope_rms=values[f"{prefix}.slope_rms"],
        dhr=values.get(f"{prefix}.dhr"),
        dhr_angle_rad=np.deg2rad(values[f"{prefix}.dhr_angle_deg"]).item(),
        shadowing=region.shadowing,
        diffuse=region.diffuse,
        specular_weight=values[f"{prefix}.specular_weight"],
    )


def region_tilt(region: SceneRegion, values: Values) -> Tilt:
    """Return how a region stands.

    Raises
    ------
    ValueError
        The tilt is not 0 to 180 deg.
    """
    prefix = f"regions.{region.name}"
    return Tilt(
        tilt_rad=np.deg2rad(values[f"{prefix}.tilt_deg"]).item(),
        azimuth_rad=np.deg2rad(values[f"{prefix}.tilt_azimuth_deg"]).item(),
    )


def field_part(scene: SceneFile, region: SceneRegion, values: Values) -> FieldPart | None:
    """Return the part of the field of view that a region fills; None for a point on the axis.

    Raises
    ------
    ConfigError
        The scene file does not say where in the field the region is.
    ValueError
        An angle is outside its range.
    """
    field = scene.field_of_view
    if region.extent == "point" or field is None:
        return None
    picture = (field.focal_length_mm, field.width_pixels, field.height_pixels)
    if region.extent == "field" and None in picture:
        return whole_field(
            width_rad=np.deg2rad(values["field_of_view.width_deg"]).item(),
            height_rad=np.deg2rad(values["field_of_view.height_deg"]).item(),
        )
    return _picture_part(scene, region, field, values)


def _picture_part(scene: SceneFile, region: SceneRegion, field: FieldSection, values: Values) -> FieldPart:
    if field.focal_length_mm is None or field.width_pixels is None or field.height_pixels is None:
        raise ConfigError(
            f'scene {scene.name}, region {region.name}: extent = "rectangle" needs [field_of_view] by '
            "focal_length_mm, width_pixels and height_pixels"
        )
    columns, rows = field.width_pixels, field.height_pixels
    x, y = (-0.5, columns - 0.5), (-0.5, rows - 0.5)
    if region.extent == "rectangle":
        corners_x, corners_y = zip(*region.outline(), strict=True)
        x, y = (min(corners_x), max(corners_x)), (min(corners_y), max(corners_y))
    return part_of_picture(
        left_pixel=x[0],
        right_pixel=x[1],
        top_pixel=y[0],
        bottom_pixel=y[1],
        picture=(columns, rows),
        pixel_pitch_m=values["sensor.pixel_pitch_um"] * 1e-6,
        focal_length_m=values["field_of_view.focal_length_mm"] * 1e-3,
    )
