"""What planes of air miss of a round earth: Chapman's function, and sasktran2 over a sphere beside over planes."""

from collections.abc import Iterator, Sequence
from importlib import import_module
from math import pi
from typing import Any

import numpy as np

from model.atmosphere.air import AtmosphereState, Column, column, face_heights_m
from model.atmosphere.layers import AerosolKind, Layer, expansion_coefficients
from model.stokes import dolp

_EARTH_M, _FLAT_M = 6.371e6, 1e9
_ZENITHS_DEG = (60.0, 70.0, 75.0, 80.0, 82.0, 84.0, 85.0, 87.0, 89.0, 89.9)
_SUNS_DEG, _VIEWS_DEG = (30.0, 60.0, 75.0, 80.0, 85.0), (30.0, 60.0, 75.0, 80.0, 85.0, 87.0)
_SUN_OF_VIEWS_DEG, _ACROSS_RAD = 50.0, 0.5 * pi
_WAVELENGTHS_M, _STREAMS, _MOMENTS = (450e-9, 550e-9), 16, 128
_CAMERA_M = 100e3
_STEPS = 20001

_HEAD = """**The round earth.** The atmosphere is plane-parallel, without correction. The first table gives its error in
the amount of air along a slant path: the excess, in per cent, over the same path through spherical shells (Chapman's
function, without refraction).
"""
_BY_SOLVER = """
The next tables give the error in the light: sasktran2 with plane layers compared with a sphere of 6371 km, all else
equal (visibility 23 km, ground of albedo 0.1). They show the excess of S0 of the plane layers in per cent, and their
DoLP minus that of the sphere.
"""
_TAIL = """
If the sun or the view is 75 deg or more from the zenith, this is not small compared with a tolerance of 0.01. No
estimate includes this error, because it is an error of the model, not of its numbers. A sun more than 85 deg from the
zenith is refused. For a view beyond 85 deg, a remark states by how much the path is too long.
"""


def round_earth_lines() -> Iterator[str]:
    """Yield what the page of hard cases says of the round earth."""
    yield _HEAD
    yield from _table("zenith angle [deg]", _ZENITHS_DEG)
    for name, height_km in (("molecules (scale height 8 km)", 8.0), ("aerosol (1.5 km)", 1.5)):
        yield _row(name, [f"{100.0 * (1.0 / chapman_ratio(zenith, height_km) - 1.0):.2g}" for zenith in _ZENITHS_DEG])
    yield _BY_SOLVER
    yield from _table("zenith angle of the sun [deg]", _SUNS_DEG)
    for wavelength_m in _WAVELENGTHS_M:
        found = [_sky_of(column(_AIR, wavelength_m=wavelength_m), sun) for sun in _SUNS_DEG]
        name = f"sky at 60 deg, across, {1e9 * wavelength_m:.0f} nm"
        yield _row(name, [_apart(*pair) for pair in found])
    yield ""
    yield from _table(f"zenith angle of the view, sun at {_SUN_OF_VIEWS_DEG:.0f} deg", _VIEWS_DEG)
    for wavelength_m in _WAVELENGTHS_M:
        seen = [_path_of(column(_AIR, wavelength_m=wavelength_m), view) for view in _VIEWS_DEG]
        yield _row(f"ground and path from 100 km, {1e9 * wavelength_m:.0f} nm", [_apart(*pair) for pair in seen])
    yield _TAIL


def chapman_ratio(zenith_deg: float, scale_height_km: float) -> float:
    """Return the air along a way through spherical shells over that through planes.

    Parameters
    ----------
    zenith_deg
        Of the way at the ground, 0 to 90.
    scale_height_km
        By which the air thins.

    References
    ----------
    S. Chapman, Proc. Phys. Soc. 43 (1931) 26, as an integral over height.
    """
    radius, zenith = _EARTH_M / 1e3, np.radians(zenith_deg)
    # Steps of equal growth of the root of the height, since the way is longest near the ground.
    height = np.linspace(0.0, np.sqrt(16.0 * scale_height_km), _STEPS) ** 2
    along = np.sqrt((radius * np.cos(zenith)) ** 2 + height * (2.0 * radius + height))
    density = np.exp(-height / scale_height_km)
    way = float(np.sum(0.5 * (density[1:] + density[:-1]) * np.diff(along)))
    return way / (scale_height_km / np.cos(zenith))


_AIR = AtmosphereState(visibility_m=23e3)


def _sky_of(air: Column, sun_deg: float) -> tuple[np.ndarray, np.ndarray]:
    return _planes_and_sphere(air, sun_deg, view_mu=0.5, looking_up=True)


def _path_of(air: Column, view_deg: float) -> tuple[np.ndarray, np.ndarray]:
    mu = float(np.cos(np.radians(view_deg)))
    return _planes_and_sphere(air, _SUN_OF_VIEWS_DEG, view_mu=mu, looking_up=False)


def _planes_and_sphere(air: Column, sun_deg: float, *, view_mu: float, looking_up: bool) -> tuple[np.ndarray, ...]:
    sk, mu0 = import_module("sasktran2"), float(np.cos(np.radians(sun_deg)))
    faces = face_heights_m(fine=True, cuts=2, face_m=0.0)
    layers = air.layers(fine=True, cuts=2)[::-1]
    found = []
    for radius_m in (_FLAT_M, _EARTH_M):
        heights = np.concatenate([faces[:1], 0.5 * (faces[1:] + faces[:-1]), faces[-1:]])
        geometry = sk.Geometry1D(
            mu0, 0.0, radius_m, heights, sk.InterpolationMethod.LinearInterpolation, sk.GeometryType.Spherical
        )
        views = sk.ViewingGeometry()
        if looking_up:
            views.add_ray(sk.SolarAnglesObserverLocation(mu0, _ACROSS_RAD, view_mu, 0.0))
        else:
            views.add_ray(sk.GroundViewingSolar(mu0, _ACROSS_RAD, view_mu, _CAMERA_M))
        config = _config(sk)
        filled = sk.Atmosphere(geometry, config, calculate_derivatives=False, numwavel=1)
        _fill(filled, layers, np.diff(faces))
        found.append(sk.Engine(config, geometry, views).calculate_radiance(filled)["radiance"].to_numpy()[0, 0])
    return tuple(found)


def _config(sk: Any) -> Any:
    config = sk.Config()
    config.num_stokes, config.num_streams, config.num_singlescatter_moments = 3, _STREAMS, _MOMENTS
    config.delta_m_scaling = True
    config.num_sza = 4
    config.multiple_scatter_source = sk.MultipleScatterSource.DiscreteOrdinates
    config.single_scatter_source = sk.SingleScatterSource.Exact
    return config


def _fill(air: Any, upward: Sequence[Layer], thickness_m: np.ndarray) -> None:
    coefficients = expansion_coefficients(upward, degree_max=_MOMENTS - 1, aerosol=AerosolKind.DEPOLARIZING)
    owner = np.concatenate([[0], np.arange(len(upward)), [len(upward) - 1]])
    albedos = coefficients[:, 0, 0]
    series = (coefficients / albedos[:, np.newaxis, np.newaxis])[owner].transpose(2, 1, 0)
    air.storage.total_extinction[:, 0] = (np.array([one.depth for one in upward]) / thickness_m)[owner]
    air.storage.ssa[:, 0] = albedos[owner]
    for name, values in zip(("a1", "a2", "a3", "b1"), series * [[[1.0]], [[1.0]], [[1.0]], [[-1.0]]], strict=True):
        getattr(air.leg_coeff, name)[:, :, 0] = values
    air.surface.albedo[:] = 0.1


def _apart(planes: np.ndarray, sphere: np.ndarray) -> str:
    return f"{100.0 * (planes[0] / sphere[0] - 1.0):+.2g} %, {dolp(planes) - dolp(sphere):+.1e}"


def _table(first: str, numbers: Sequence[float]) -> Iterator[str]:
    yield _row(first, [f"{one:g}" for one in numbers])
    yield "|---" * (len(numbers) + 1) + "|"


def _row(first: str, cells: Sequence[str]) -> str:
    return f"| {first} | {' | '.join(cells)} |"
