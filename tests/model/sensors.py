"""A sensor for tests: 8.3 um pixels at f/2, the scale of the published example."""

from dataclasses import replace

from model.sensor import Sensor, SensorNoise


def sensor(**changes):
    """Return the example sensor with fields changed; those of the noise as well."""
    noise = SensorNoise(gain_dn_per_e=0.1, read_noise_e=20.0, dark_current_e_per_s=0.0, black_level_dn=50.0)
    fields = noise.__dataclass_fields__
    noise = replace(noise, **{name: changes.pop(name) for name in list(changes) if name in fields})
    example = Sensor(
        pixel_pitch_m=8.3e-6,
        f_number=2.0,
        optics_transmittance=0.9,
        quantum_efficiency=0.45,
        wavelength_m=550e-9,
        exposure_s=30e-6,
        bit_depth=12,
        tau_parallel=1.0,
        tau_perpendicular=0.0,
        noise=noise,
    )
    return replace(example, **changes)
