"""Numbers of the Python functions whose names stay."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from model.atmosphere.solver import Layer, solve
from model.processing.detection import rx_p_detection, rx_p_miss, rx_roc, rx_threshold
from model.processing.dolp import cdf, moments, pdf, quantile
from model.processing.maps import polarization_maps
from model.processing.reconstruction import design
from model.surface.pbrdf import Surface, mueller
from tests.golden.digest import digest_value

_ESTIMATES = (
    "gain_dn_per_e", "read_noise_e", "dark_current_e_per_s", "black_level_dn", "saturation_e", "prnu", "dsnu_e",
)  # fmt: skip
_WRONG_SETS = (
    "wrong_photons", "mislabelled_stack", "one_other_gain", "averaged_frames", "lit_dark", "gain_changed",
    "clipped_black", "left_justified", "compressed", "leak", "hardly_clipped", "warming", "coarse", "good_lamp",
)  # fmt: skip
_MEAN = np.array([[100.0, 20.0, 5.0], [100.0, 1.0, 0.5], [20.0, 6.0, -8.0], [5.0, 0.0, 0.0]])
_COVARIANCE = np.diag([4.0, 6.0, 5.0]) + 0.5
_BACKGROUND = np.array([90.0, 10.0, 4.0])
_ANGLES = np.radians([10.0, 50.0, 95.0, 140.0])


def values() -> dict[str, Any]:
    """Return the numbers, each kept in full."""
    found = _dolp() | _detection() | _maps() | _surface() | _atmosphere()
    return {
        name: {str(i): _plain(one) for i, one in enumerate(np.ravel(numbers).tolist())}
        for name, numbers in found.items()
    }


def noise_sets() -> dict[str, Any]:
    """Return parameters, influence of the levels and flags of 93 simulated noise sets."""
    from tests.calibration.sensor import drawn_sets, noise_sets

    makers = [*noise_sets.GOOD, *(getattr(noise_sets, name) for name in _WRONG_SETS)]
    makers += [*drawn_sets.DRAWN_GOOD, *drawn_sets.DRAWN_WRONG, drawn_sets.drawn_ten_errors]
    return {
        f"{number}-{maker.__name__}-{seed}": _noise_set(maker(seed))
        for number, maker in enumerate(makers)
        for seed in (3, 4, 11)
    }


def _noise_set(levels: Any) -> dict[str, Any]:
    from tests.calibration.sensor.noise_sets import calibrated

    try:
        found = calibrated(levels)
    except Exception as error:
        if not hasattr(error, "flags"):
            raise
        return {"refused": True, "flags": _flags(error.flags)}
    estimates = {name: getattr(found, name) for name in _ESTIMATES}
    influence = digest_value([asdict(level) for level in found.influence], Path("/nowhere"))
    return {
        "estimates": {
            name: None if one is None else {"value": one.value, "std_error": _plain(one.std_error)}
            for name, one in estimates.items()
        },
        "influence": influence,
        "flags": _flags(found.flags),
    }


def _flags(flags: Any) -> list[list[str]]:
    return sorted([flag.name, flag.level or "", flag.message] for flag in flags)


def _plain(value: Any) -> Any:
    """Return a number that JSON has; others as text."""
    return value if not isinstance(value, float) or math.isfinite(value) else str(value)


def _dolp() -> dict[str, Any]:
    at, p = np.linspace(0.02, 0.6, 7)[:, None], np.array([1e-6, 0.01, 0.5, 0.99])[:, None]
    found = moments(_MEAN, _COVARIANCE)
    return {
        "dolp-mean": found.mean,
        "dolp-std": found.std,
        "dolp-method": found.method,
        "dolp-cdf": cdf(at, _MEAN, _COVARIANCE),
        "dolp-pdf": pdf(at, _MEAN, _COVARIANCE),
        "dolp-quantile": quantile(p, _MEAN, _COVARIANCE),
    }


def _detection() -> dict[str, Any]:
    false_alarm = np.array([1e-6, 1e-3, 0.1, 0.5])
    target = (_MEAN[0], 2.0 * _COVARIANCE, _BACKGROUND, _COVARIANCE)
    roc = rx_roc(false_alarm, *target)
    return {
        "rx-threshold": rx_threshold(false_alarm),
        "rx-detection": rx_p_detection(false_alarm, *target),
        "rx-miss": rx_p_miss(false_alarm, *target),
        "rx-roc": np.concatenate([roc.threshold, roc.p_detection, roc.p_miss, [roc.auc]]),
    }


def _maps() -> dict[str, Any]:
    plan = design(_ANGLES, 500.0, tau_parallel=0.8)
    counts = np.random.default_rng(1).integers(200, 3000, (4, 3, 4)).astype(np.uint16)
    maps = polarization_maps(counts, plan, dark_dn=64.0, deviations=np.full(4, 12.0))
    return {
        "design": plan.inverse,
        "maps-stokes": maps.stokes,
        "maps-dolp": maps.dolp,
        "maps-aolp": maps.aolp_rad,
        "maps-dolp-std": maps.dolp_std,
    }


def _surface() -> dict[str, Any]:
    incident, reflected, azimuth = np.radians([[10.0, 45.0, 70.0], [10.0, 50.0, 60.0], [0.0, 180.0, 120.0]])
    return {
        f"pbrdf-{shadowing}-{diffuse}": mueller(
            incident, reflected, azimuth,
            surface=Surface(n=1.5, k=0.1, slope_rms=0.2, dhr=0.2, shadowing=shadowing, diffuse=diffuse),
        )
        for shadowing, diffuse in (("v-cavity", "coupled"), ("smith", "lambert"), ("none", "polarised"))
    }  # fmt: skip


def _atmosphere() -> dict[str, Any]:
    layers = [
        Layer(tau_rayleigh=0.05, tau_aerosol=0.0, ssa_aerosol=0.0, g_aerosol=0.0, delta=0.958),
        Layer(tau_rayleigh=0.05, tau_aerosol=0.2, ssa_aerosol=0.9, g_aerosol=0.65, delta=0.958),
    ]
    solution = solve(layers, mu0=0.7, albedo=0.1)
    mu, azimuth = np.array([0.2, 0.6, 1.0]), np.radians([[0.0], [90.0], [170.0]])
    return {
        "sky-up": solution.stokes(0.3, mu, azimuth, looking="up"),
        "sky-down": solution.stokes(0.0, mu, azimuth, looking="down"),
        "sky-irradiance": [solution.ground_radiance, solution.diffuse_irradiance],
    }
