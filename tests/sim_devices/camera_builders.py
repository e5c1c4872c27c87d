"""Small simulated cameras with a lens whose arithmetic can be done on paper.

Focal length 10 mm and diameter 20 mm: tan = 1, sin^2 = 1/2, projected solid angle pi/2 sr. A pixel of 10 um,
transmittance 0.5, quantum efficiency 0.5 and 500 nm (3.97289171429786e-19 J a photon) make
pi/2 * 1e-10 * 0.5 * 0.5 / 3.97289171429786e-19 = 98844647.6619 electrons a second from 1 W m^-2 sr^-1.
The flat shows 0.04 W m^-2 sr^-1, of which a perfect polarizer passes 0.02: 1976.893 electrons in 1 ms.
"""

from dataclasses import replace

import numpy as np

from sim_devices.camera import SimCamera
from sim_devices.exposure import Detector, Lens
from sim_devices.micro_polarizers import MicroPolarizers, crosstalk
from sim_devices.world import Polarizer, World

ELECTRONS_OF_FLAT_IN_1_MS = 1976.893

LENS = Lens(focal_length_m=0.01, aperture_diameter_m=0.02, transmittance=0.5)
PERFECT_POLARIZER = Polarizer(transmittance_along=1.0, transmittance_across=0.0, offset_deg=0.0, sense=1)
# Neither noise nor pattern but that of light.
SILENT = Detector(
    width=400,
    height=400,
    pixel_pitch_m=10e-6,
    effective_wavelength_m=500e-9,
    quantum_efficiency=0.5,
    gain_dn_per_e=2.0,
    read_noise_e=0.0,
    dark_current_e_per_s=0.0,
    black_level_dn=100.0,
    prnu=0.0,
    dsnu_e=0.0,
    full_well_e=1e6,
    bit_depth=16,
)
# Half way up its 12 bits when the flat is seen for 10 ms, which is the exposure at power-on.
SMALL = replace(SILENT, width=20, height=10, gain_dn_per_e=0.1, read_noise_e=5.0, bit_depth=12)


class FixedClock:
    """Stands still until it is set."""

    def __init__(self) -> None:
        self.now_ns = 5_000

    def utc_ns(self) -> int:
        return 1_000_000_000 + self.now_ns

    def monotonic_ns(self) -> int:
        return self.now_ns


class Turntable:
    """A stage that stands where it is put."""

    def __init__(self) -> None:
        self.angle_deg = 0.0

    def __call__(self) -> float:
        return self.angle_deg


def uniform_world(
    *,
    stokes=(0.04, 0.0, 0.0),
    width=400,
    height=400,
    polarizer=PERFECT_POLARIZER,
    stage=None,
    flat_radiance=0.04,
) -> World:
    radiance = np.ones((3, height, width)) * np.array(stokes)[:, np.newaxis, np.newaxis]
    return World(
        radiance=radiance,
        polarizer=polarizer,
        stage_angle_deg=stage or Turntable(),
        flat_radiance=flat_radiance,
    )


def camera_on(world: World, detector: Detector, **options) -> SimCamera:
    choices = {"pattern_seed": 3, "noise_seed": 7, **options}
    return SimCamera(world=world, lens=LENS, detector=detector, **choices)


def small_camera(**options) -> SimCamera:
    return camera_on(uniform_world(width=20, height=10), SMALL, **options)


def mosaic_camera(**options) -> SimCamera:
    """Return a small camera with polarizers on its pixels."""
    polarizers = MicroPolarizers(place_error_deg=0.5, pixel_error_deg=0.2, crosstalk=0.01)
    world = World(
        radiance=np.ones((3, 10, 20)) * np.array([0.04, 0.01, 0.0])[:, np.newaxis, np.newaxis],
        polarizer=PERFECT_POLARIZER,
        stage_angle_deg=Turntable(),
        flat_radiance=0.04,
        pixel_axes_deg=polarizers.axes_deg((10, 20), generator=np.random.default_rng(3)),
    )
    return camera_on(world, SMALL, rendering=[crosstalk(polarizers.crosstalk)], **options)
