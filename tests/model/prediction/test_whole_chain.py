"""The whole chain, aperture to DoLP and detection, against a million pixels drawn at random."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from model.moments import Moments
from model.prediction import predict
from model.processing import dolp
from model.processing.detection import rx_p_detection, rx_threshold
from model.scene.scene import Readout, RegionLight, Scenario
from model.sensor import Sensor, SensorNoise, electrons_per_radiance

DRAWS = 1_000_000
# Largest of some 180 scores: 5 standard errors leave one false alarm in ten thousand runs.
LIMIT = 5.0

NOISE = SensorNoise(gain_dn_per_e=0.25, read_noise_e=10.0, dark_current_e_per_s=50.0, black_level_dn=64.0)
SENSOR = Sensor(
    pixel_pitch_m=8.3e-6, f_number=2.0, optics_transmittance=0.9, quantum_efficiency=0.45, wavelength_m=550e-9,
    exposure_s=30e-6, bit_depth=14, tau_parallel=0.8, tau_perpendicular=0.8 / 300, noise=NOISE,
)  # fmt: skip
READOUT = Readout(
    angles_rad=np.deg2rad([0.0, 45.0, 90.0, 135.0]),
    channel_names=("dn_0", "dn_45", "dn_90", "dn_135"),
    cycles=1,
    extinction_ratio=300.0,
)


def _light(stokes, *, rms=0.0, cov=None):
    return RegionLight(
        name="target", stokes_radiance=np.array(stokes, dtype=float), texture_rms=rms,
        texture_cov=np.zeros((3, 3)) if cov is None else np.array(cov, dtype=float),
    )  # fmt: skip


def _at(*degrees):
    return replace(
        READOUT, angles_rad=np.deg2rad(degrees), channel_names=tuple(f"dn_{k}" for k, _ in enumerate(degrees))
    )


@dataclass(frozen=True)
class Scene:
    """A target, how it is read out, and whether its counts are drawn as Poisson (many electrons) or as normal."""

    light: RegionLight
    sensor: Sensor = SENSOR
    readout: Readout = READOUT
    poisson: bool = True


SCENES = {
    "black paint, textured": Scene(_light((60.0, 22.0, 9.0), rms=0.02)),
    "white paint, DoLP 0.01": Scene(_light((90.0, -0.8, 0.4), rms=0.01)),
    "unpolarised": Scene(_light((70.0, 0.0, 0.0), rms=0.01)),
    "fully polarised": Scene(_light((60.0, 45.0, np.sqrt(60.0**2 - 45.0**2)))),
    "diagonal texture": Scene(_light((70.0, 10.0, -15.0), cov=np.diag([4.0, 1.0, 1.0]))),
    # Shot noise grows with the texture, so their sum is a little skew, which the Gaussian law is not: at 2 % texture a
    # million pixels show it in the far tail of three correlated channels (5 standard errors in P_D at 1e-4).
    "Pickering's three angles": Scene(
        _light((70.0, 10.0, -15.0), rms=0.005), readout=_at(0.0, 45.0, 90.0), poisson=False
    ),
    "crowded angles": Scene(_light((80.0, 20.0, 10.0)), readout=_at(0.0, 20.0, 40.0, 70.0)),
    "fixed pattern": Scene(
        _light((70.0, 20.0, 5.0), rms=0.01), replace(SENSOR, noise=replace(NOISE, prnu=0.02, dsnu_e=60.0))
    ),
    "dark current, six angles": Scene(
        _light((70.0, 20.0, 5.0), rms=0.005),
        replace(SENSOR, noise=replace(NOISE, dark_current_e_per_s=1e8)),
        _at(0.0, 30.0, 60.0, 90.0, 120.0, 150.0),
    ),
    "read noise of 30 electrons": Scene(
        _light((20.0, 5.0, 3.0)), replace(SENSOR, noise=replace(NOISE, read_noise_e=30.0))
    ),
    "dim: SNR of S0 near 10": Scene(_light((0.5, 0.14, 0.06)), poisson=False),
    "noise factor 3, leaky polarizer": Scene(
        _light((40.0, 12.0, -6.0), rms=0.02),
        replace(SENSOR, tau_perpendicular=0.1, noise=replace(NOISE, noise_factor=3.0)),
        replace(READOUT, extinction_ratio=8.0),
        poisson=False,
    ),
}


def _drawn_stokes(scene, rng):
    """Stokes parameters of a million pixels, written down from the physics: light, polarizer, electrons, counts."""
    sensor, noise, angles = scene.sensor, scene.sensor.noise, scene.readout.angles_rad
    light = scene.light.stokes_radiance[:, None] * (1 + scene.light.texture_rms * rng.normal(size=DRAWS))
    light = light + np.sqrt(np.diag(scene.light.texture_cov))[:, None] * rng.normal(size=(3, DRAWS))
    response = 1 + noise.prnu * rng.normal(size=DRAWS)
    offset_e = noise.dsnu_e * rng.normal(size=DRAWS)
    dark_e = noise.dark_current_e_per_s * sensor.exposure_s
    counts = []
    for angle in angles:
        along = 0.5 * (light[0] + np.cos(2 * angle) * light[1] + np.sin(2 * angle) * light[2])
        passed = sensor.tau_parallel * along + sensor.tau_perpendicular * (light[0] - along)
        mean_e = electrons_per_radiance(sensor) * passed * response + dark_e
        if scene.poisson:
            electrons = rng.poisson(np.maximum(mean_e, 0.0)) + noise.read_noise_e * rng.normal(size=DRAWS)
            dn = np.round(noise.gain_dn_per_e * (electrons + offset_e) + noise.black_level_dn)
        else:
            spread_e = noise.noise_factor * np.sqrt(np.maximum(mean_e, 0.0) + noise.read_noise_e**2)
            rounding = noise.noise_factor * rng.normal(scale=np.sqrt(1 / 12), size=DRAWS)
            electrons = mean_e + spread_e * rng.normal(size=DRAWS)
            dn = noise.gain_dn_per_e * (electrons + offset_e) + noise.black_level_dn + rounding
        counts.append(dn - noise.black_level_dn - noise.gain_dn_per_e * dark_e)
    leak = 1 / scene.readout.extinction_ratio
    m = 0.5 * np.stack([(1 + leak) + 0 * angles, (1 - leak) * np.cos(2 * angles), (1 - leak) * np.sin(2 * angles)], 1)
    return np.linalg.pinv(m) @ np.array(counts), np.array(counts)


def _score_of_mean(values, expected):
    return (values.mean() - expected) / (values.std() / np.sqrt(values.size))


def _score_of_deviation(values, expected):
    centred = (values - values.mean()) ** 2
    error = centred.std() / np.sqrt(values.size) / (2 * np.sqrt(centred.mean()))
    return (np.sqrt(centred.mean()) - expected) / error


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_means_deviations_and_detection_agree_with_a_million_drawn_pixels(name):
    scene = SCENES[name]
    rng = np.random.default_rng(sorted(SCENES).index(name))
    stokes, counts = _drawn_stokes(scene, rng)
    predicted = predict(Scenario(regions=(scene.light,), sensor=scene.sensor, readout=scene.readout))["target"]
    quantities = predicted.quantities
    scores = {}
    for key, values in zip((*scene.readout.channel_names, "s0", "s1", "s2"), (*counts, *stokes), strict=True):
        scores[key, "mean"] = _score_of_mean(values, quantities[key]["mean"])
        scores[key, "std"] = _score_of_deviation(values, quantities[key]["std"])
    degree = np.hypot(stokes[1], stokes[2]) / stokes[0]
    scores["dolp", "mean"] = _score_of_mean(degree, quantities["dolp_pixels"]["mean"])
    scores["dolp", "std"] = _score_of_deviation(degree, quantities["dolp_pixels"]["std"])
    for share in (0.25, 0.5, 0.75):
        quantile = dolp.quantile(share, predicted.stokes_dn.mean, predicted.stokes_dn.cov)
        scores["dolp below quantile", share] = _score_of_share(np.mean(degree <= quantile), share)
    for p_false_alarm in (1e-4, 1e-2):
        scores["P_D", p_false_alarm] = _score_of_detection(stokes, predicted.stokes_dn, p_false_alarm)
    assert {key: z for key, z in scores.items() if abs(z) > LIMIT} == {}


def _score_of_detection(stokes, target, p_false_alarm):
    """Share of drawn pixels beyond the threshold of a background a little off, against the exact probability."""
    shift = np.sqrt(np.diag(target.cov)) * (1.5, -1.0, 0.7)
    background = Moments(mean=target.mean + shift, cov=1.3 * target.cov)
    off = stokes - background.mean[:, None]
    statistic = np.einsum("ip,ip->p", off, np.linalg.solve(background.cov, off))
    share = np.mean(statistic > rx_threshold(p_false_alarm))
    expected = rx_p_detection(p_false_alarm, target.mean, target.cov, background.mean, background.cov)
    return _score_of_share(share, expected)


def _score_of_share(share, expected):
    return (share - expected) / np.sqrt(expected * (1 - expected) / DRAWS)
