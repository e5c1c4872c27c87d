"""Scenes in which an effect matters, and scenes in which it does not."""

from dataclasses import replace

import numpy as np

from model.accuracy.chain import Settings
from model.atmosphere.air import AtmosphereState
from model.atmosphere.layers import AerosolKind
from model.atmosphere.sky import Fidelity, SolarBand, SolverSettings
from model.scene.field import FieldPart
from model.scene.panel import View
from model.scene.scene import Air, LitRegion, LitScene, Readout
from model.sensor import PERFECT, Sensor, SensorNoise
from model.surface.pbrdf import Surface, Tilt

COARSE = Settings(
    wavelengths=2,
    solver=SolverSettings(fine_layers=False, nodes=4, element_depth=0.2, tolerance=1e-3),
    sky_zeniths=8,
    sky_azimuths=8,
    hemisphere_tolerance=1e-2,
    tiles_per_side=2,
    negligible_spread=0.0,
    dolp_tolerance=1e-11,
)

NOISE = SensorNoise(gain_dn_per_e=0.25, read_noise_e=10.0, dark_current_e_per_s=20.0, black_level_dn=64.0)
SENSOR = Sensor(
    pixel_pitch_m=8e-6,
    f_number=2.0,
    optics_transmittance=0.9,
    quantum_efficiency=0.5,
    wavelength_m=550e-9,
    exposure_s=3e-5,
    bit_depth=12,
    tau_parallel=0.8,
    tau_perpendicular=0.0016,
    noise=NOISE,
)
READOUT = Readout(
    angles_rad=np.deg2rad([0.0, 45.0, 90.0, 135.0]),
    channel_names=("dn_0", "dn_45", "dn_90", "dn_135"),
    cycles=1,
    extinction_ratio=500.0,
)


def radiance_scene(*, radiance=(30.0, 9.0, 2.0), texture_rms=0.0, noise=None, sensor=None, readout=None, **errors):
    """A region whose radiance is given; `noise` and `sensor` change numbers, `errors` are those of the session."""
    region = LitRegion(name="panel", radiance=np.array(radiance), texture_rms=texture_rms, texture_cov=np.zeros((3, 3)))
    seen = replace(SENSOR, noise=replace(NOISE, **(noise or {})), **(sensor or {}))
    return LitScene(
        regions=(region,),
        sensor=seen,
        readout=replace(READOUT, **(readout or {})),
        imperfections=replace(PERFECT, **errors),
    )


def band(*, half_width_m):
    wavelength = np.linspace(550e-9 - half_width_m, 550e-9 + half_width_m, 21)
    return SolarBand(
        wavelength_m=wavelength, irradiance_w_per_m3=np.full(21, 40.0 / half_width_m), response=np.ones(21)
    )


def panel_scene(*, pressure_pa=1e5, aerosol=0.1, height_m=3000.0, half_width_m=100e-9, half_field_rad=0.0, **errors):
    """A panel in the mirror direction of a sun 45 deg high."""
    part = None
    if half_field_rad > 0.0:
        part = FieldPart(
            left_rad=-half_field_rad, right_rad=half_field_rad, bottom_rad=-half_field_rad, top_rad=half_field_rad
        )
    region = LitRegion(
        name="panel",
        surface=Surface(n=1.5, slope_rms=0.2, dhr=0.3),
        tilt=Tilt(tilt_rad=0.0),
        part=part,
        texture_cov=np.zeros((3, 3)),
    )
    air = Air(
        sun_zenith_rad=np.deg2rad(45.0),
        band=band(half_width_m=half_width_m),
        fidelity=Fidelity.FAST,
        aerosol=AerosolKind.DEPOLARIZING,
        state=AtmosphereState(aerosol_optical_depth=aerosol, surface_pressure_pa=pressure_pa),
        ground_albedo=0.1,
    )
    return LitScene(
        regions=(region,),
        air=air,
        view=View(zenith_rad=np.deg2rad(45.0), azimuth_rad=0.0, height_m=height_m),
        sun_azimuth_rad=np.pi,
        sensor=SENSOR,
        readout=READOUT,
        imperfections=replace(PERFECT, **errors),
    )


# Air as it is 60 km up: what it scatters is next to nothing.
THIN = {"pressure_pa": 20.0, "aerosol": 1e-6}
