"""Random scenes over wide and hostile ranges, each by its seed."""

from dataclasses import replace

import numpy as np

from model.atmosphere.aerosols import AerosolType
from model.atmosphere.air import AtmosphereState
from model.atmosphere.layers import AerosolKind
from model.atmosphere.sky import Fidelity
from model.scene.field import whole_field
from model.scene.panel import View
from model.scene.scene import Air, LitRegion, LitScene, Readout
from model.sensor import Imperfections, Sensor, SensorNoise
from model.stokes import angle_between_rad, direction
from model.surface.facets import SHADOWING
from model.surface.pbrdf import DIFFUSE, Surface, Tilt
from rigctl.scene.sun import response_band

_LARGEST_FIELD_RAD = np.radians(30.0)


def random_scene(seed: int) -> LitScene:
    """One target on a background that may fill the field; sun to 75 deg, optical depth to 0.8, slopes from 0.03."""
    draw = np.random.default_rng(seed)
    sensor = random_sensor(draw)
    view = View(
        zenith_rad=np.radians(draw.uniform(0.0, 65.0)),
        azimuth_rad=draw.uniform(0.0, 2.0 * np.pi),
        roll_rad=draw.choice([0.0, draw.uniform(-0.5, 0.5)]),
        height_m=draw.choice([0.0, 30.0, 3000.0, 9000.0]),
    )
    return LitScene(
        air=random_air(draw),
        view=view,
        sun_azimuth_rad=draw.uniform(0.0, 2.0 * np.pi),
        regions=(random_region(draw, "target", view), random_region(draw, "background", view)),
        sensor=sensor,
        readout=Readout(
            angles_rad=np.radians([0.0, 45.0, 90.0, 135.0]),
            channel_names=("dn_0", "dn_45", "dn_90", "dn_135"),
            cycles=int(draw.integers(1, 20)),
            extinction_ratio=sensor.tau_parallel / sensor.tau_perpendicular,
        ),
        pairs=(("target", "background"),),
    )


def hostile_scene(seed: int) -> LitScene:
    """A random scene with what that one leaves out: tilted panels, other tiers, laws, sources, airs, surroundings."""
    scene, draw = random_scene(seed), np.random.default_rng((seed, 1))
    view = replace(
        scene.view, zenith_rad=np.radians(draw.uniform(0.0, 75.0)), height_m=draw.choice([0.0, 2.0, 500.0, 20e3])
    )
    return replace(
        scene,
        air=_hostile_air(draw, scene.air),
        view=view,
        regions=tuple(_hostile_region(draw, region, view) for region in scene.regions),
        source=draw.choice(["total", "total", "total", "reflected", "reflected_sun", "reflected_sky"]),
        pairs=(("target", "background"), ("background", "target")),
        imperfections=Imperfections(
            surround_albedo=_maybe(draw, draw.uniform(0.0, 1.0)), off_axis_falloff=bool(draw.integers(2))
        ),
    )


def _hostile_air(draw: np.random.Generator, air: Air) -> Air:
    state = AtmosphereState(
        aerosol_optical_depth=draw.choice([0.0, draw.uniform(0.0, 1.5)]),
        surface_pressure_pa=draw.uniform(5e4, 1.03e5),
        ozone_m=draw.uniform(0.0, 5e-3),
        angstrom_exponent=_maybe(draw, draw.uniform(-0.2, 2.0)),
        boundary_aerosol=draw.choice([AerosolType.RURAL, AerosolType.SOOT, AerosolType.WATER_SOLUBLE]),
    )
    other = replace(
        air,
        fidelity=draw.choice(
            [
                Fidelity.STANDARD,
                Fidelity.STANDARD,
                Fidelity.STANDARD,
                Fidelity.SINGLE,
                Fidelity.ANALYTIC,
            ]
        ),
        sun_zenith_rad=np.radians(draw.uniform(0.0, 82.0)),
        state=state,
    )
    if draw.random() < 0.15:
        opposite = {AerosolKind.POLARIZING: AerosolKind.DEPOLARIZING, AerosolKind.DEPOLARIZING: AerosolKind.POLARIZING}
        return replace(other, alternative=replace(other, aerosol=opposite[air.aerosol]), share=draw.uniform(0.1, 0.9))
    return other


def _hostile_region(draw: np.random.Generator, region: LitRegion, view: View) -> LitRegion:
    surface = replace(region.surface, shadowing=draw.choice(SHADOWING), diffuse=draw.choice(DIFFUSE))
    camera = direction(zenith_rad=view.zenith_rad, azimuth_rad=view.azimuth_rad)
    tilt = Tilt(tilt_rad=np.radians(draw.choice([0.0, draw.uniform(0.0, 75.0)])), azimuth_rad=draw.uniform(0.0, 6.28))
    # The edge of a field is up to 21 deg from its middle.
    seen = float(angle_between_rad(tilt.normal, camera)) < np.radians(65.0)
    level = Tilt(tilt_rad=0.0, azimuth_rad=0.0)
    part = region.part if view.zenith_rad < np.radians(60.0) else None
    return replace(region, surface=surface, tilt=tilt if seen else level, part=part)


def random_air(draw: np.random.Generator) -> Air:
    """A clear or hazy sky in a wide or narrow band."""
    short_nm = draw.uniform(400.0, 650.0)
    long_nm = short_nm + draw.choice([20.0, 100.0, 300.0])
    return Air(
        sun_zenith_rad=np.radians(draw.uniform(0.0, 75.0)),
        band=response_band(wavelength_nm=np.array([short_nm, long_nm]), response=np.ones(2), distance_factor=1.0),
        fidelity=Fidelity.STANDARD,
        aerosol=AerosolKind(draw.choice(["depolarizing", "polarizing"])),
        state=AtmosphereState(aerosol_optical_depth=draw.choice([0.0, draw.uniform(0.02, 0.8)])),
        ground_albedo=draw.choice([0.0, draw.uniform(0.0, 0.8)]),
    )


def random_region(draw: np.random.Generator, name: str, view: View) -> LitRegion:
    """A glossy or rough material, level, as a point or over a part of the field."""
    metal = draw.random() < 0.3
    surface = Surface(
        n=draw.uniform(1.2, 2.5) if metal else draw.uniform(1.3, 1.7),
        k=draw.uniform(0.5, 3.0) if metal else 0.0,
        slope_rms=draw.uniform(0.03, 0.4),
        dhr=None if metal else _maybe(draw, draw.uniform(0.2, 0.8)),
    )
    fills = draw.random() < 0.3 and view.zenith_rad < np.radians(60.0)
    width_rad, height_rad = draw.uniform(0.02, _LARGEST_FIELD_RAD, 2)
    return LitRegion(
        name=name,
        surface=surface,
        tilt=Tilt(tilt_rad=0.0, azimuth_rad=0.0),
        part=whole_field(width_rad=width_rad, height_rad=height_rad) if fills else None,
        texture_rms=draw.choice([0.0, 0.02, 0.1]),
        texture_cov=np.zeros((3, 3)),
    )


def _maybe(draw: np.random.Generator, number: float) -> float | None:
    return number if draw.integers(2) else None


def random_sensor(draw: np.random.Generator) -> Sensor:
    """From starved to nearly full pixels."""
    along = draw.uniform(0.3, 0.9)
    return Sensor(
        pixel_pitch_m=draw.uniform(2e-6, 10e-6),
        f_number=draw.uniform(1.4, 8.0),
        optics_transmittance=0.9,
        quantum_efficiency=draw.uniform(0.2, 0.8),
        wavelength_m=550e-9,
        exposure_s=10.0 ** draw.uniform(-5.0, -3.0),
        bit_depth=16,
        tau_parallel=along,
        tau_perpendicular=along / 10.0 ** draw.uniform(1.0, 4.0),
        noise=SensorNoise(
            gain_dn_per_e=draw.uniform(0.1, 2.0),
            read_noise_e=draw.uniform(1.0, 15.0),
            dark_current_e_per_s=draw.uniform(0.0, 50.0),
            black_level_dn=64.0,
            prnu=draw.choice([0.0, 0.005]),
            dsnu_e=draw.choice([0.0, 1.0]),
        ),
    )
