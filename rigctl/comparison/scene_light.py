"""The light of a scene's regions, computed from sun, atmosphere and materials with given numbers."""

from collections import OrderedDict
from collections.abc import Iterable

from model.atmosphere.lighting.tiers import TIERS
from model.atmosphere.profile import column
from model.atmosphere.transfer.phase import AerosolKind
from model.field_light import FieldLight, light_over_field
from model.field_of_view import FieldPart
from model.hemisphere import Rules
from model.illumination import Illumination
from model.scene import ApertureLight, aperture_lights
from model.surface.pbrdf import Surface
from model.surface.tilt import Tilt
from model.view import View
from rigctl.comparison.scene_records import (
    Values,
    camera_view,
    field_part,
    region_surface,
    region_tilt,
    sky_request,
    sun_azimuth_rad,
)
from rigctl.errors import ConfigError
from rigctl.files.light_sections import AtmosphereSection
from rigctl.files.scene_file import SceneFile, SceneRegion
from rigctl.skies.lit_scene import Skies, SkyRequest
from rigctl.skies.sky_store import SkyStore, user_cache_folder

# Lights of regions that are kept: those of a sweep, and those about which a derivative is taken.
_KEPT = 512
_REFERENCE_M = 550e-9


class SceneLight:
    """Computes the light of regions, and keeps what it computed."""

    def __init__(self, store: SkyStore | None = None) -> None:
        self._store = SkyStore(user_cache_folder()) if store is None else store
        self._skies = Skies(solver=self._store)
        self._kept: OrderedDict[object, FieldLight] = OrderedDict()

    def illumination(self, scene: SceneFile, values: Values) -> Illumination:
        """Return sun, sky and air of a scene with given numbers.

        Raises
        ------
        ConfigError
            A number is outside its range, such as a sun too low.
        """
        try:
            return self._skies.illumination(sky_request(scene, values), sun_azimuth_rad=sun_azimuth_rad(values))
        except ValueError as error:
            raise ConfigError(f"scene {scene.name}: {error}") from error

    def region(self, scene: SceneFile, region: SceneRegion, values: Values) -> FieldLight:
        """Return the light of a region that is given by its material.

        Raises
        ------
        ConfigError
            A number is outside its range.
        """
        try:
            view, surface, tilt = (
                camera_view(scene, values),
                region_surface(region, values),
                region_tilt(region, values),
            )
            part = field_part(scene, region, values)
            key = (sky_request(scene, values), sun_azimuth_rad(values), view, surface, tilt, part)
        except ValueError as error:
            raise ConfigError(f"scene {scene.name}, region {region.name}: {error}") from error
        if key not in self._kept:
            illumination = self.illumination(scene, values)
            self._keep(key, _over_field(scene, region, illumination, view, surface, tilt, part))
        return self._kept[key]

    def remarks(self, scene: SceneFile, values: Values) -> tuple[str, ...]:
        """Return what is to be said of the atmosphere: its depth, its effort, and what is least known of it."""
        if scene.atmosphere is None or scene.sun is None or not scene.sensor.has_band:
            return ()
        return (*_of_atmosphere(scene.atmosphere, sky_request(scene, values)), *self._store.remarks)

    def _keep(self, key: object, light: FieldLight) -> None:
        self._kept[key] = light
        if len(self._kept) > _KEPT:
            self._kept.popitem(last=False)


def _over_field(
    scene: SceneFile,
    region: SceneRegion,
    illumination: Illumination,
    view: View,
    surface: Surface,
    tilt: Tilt,
    part: FieldPart | None,
) -> FieldLight:
    def lights_at(views: tuple[View, ...], rules: Rules | None) -> tuple[ApertureLight, ...]:
        return aperture_lights(illumination, surface=surface, tilt=tilt, views=views, rules=rules)

    field = scene.field_of_view
    try:
        if part is None or field is None:
            return light_over_field(lights_at, view=view, part=None, per_side=1)
        return light_over_field(lights_at, view=view, part=part, per_side=field.tiles_per_side, rule=field.rule)
    except ValueError as error:
        raise ConfigError(f"scene {scene.name}, region {region.name}: {error}") from error


def _of_atmosphere(air: AtmosphereSection, request: SkyRequest) -> Iterable[str]:
    facts = TIERS[air.tier]
    if request.state is None:
        yield f"atmosphere: tier table ({facts.accuracy}), from {air.table}; its optical depth is the table's own"
        return
    at_550 = column(request.state, wavelength_m=_REFERENCE_M)
    yield (
        f"atmosphere: optical depth at 550 nm {at_550.depth:.3f}, of it aerosol {at_550.tau_aerosol:.3f} and molecules "
        f"{at_550.tau_rayleigh:.3f}; tier {air.tier} ({facts.accuracy})"
    )
    yield (
        f"atmosphere: aerosol taken as {air.aerosol} (of {', '.join(AerosolKind)}). The kind of aerosol is the largest "
        "uncertainty of the sky: at the same optical depth its largest degree of polarization is 0.18 with a "
        "depolarizing aerosol, 0.23 with a polarizing one and 0.43 with spheres (23 km, sun 25 deg from the zenith)"
    )
