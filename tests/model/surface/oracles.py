"""Slow, literal microfacet reflection with three-dimensional vectors and 50 digits. Tests only."""

from collections.abc import Sequence

import mpmath as mp

Vector = list[mp.mpf]


def direction(zenith_rad: float, azimuth_rad: float) -> Vector:
    """East, north, up; azimuth clockwise from north."""
    z, a = mp.mpf(zenith_rad), mp.mpf(azimuth_rad)
    return [mp.sin(z) * mp.sin(a), mp.sin(z) * mp.cos(a), mp.cos(z)]


def dot(a: Sequence[mp.mpf], b: Sequence[mp.mpf]) -> mp.mpf:
    return mp.fsum(x * y for x, y in zip(a, b, strict=True))


def cross(a: Sequence[mp.mpf], b: Sequence[mp.mpf]) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def scaled(a: Sequence[mp.mpf], factor: mp.mpf) -> Vector:
    return [factor * x for x in a]


def unit(a: Sequence[mp.mpf]) -> Vector:
    return scaled(a, 1 / mp.sqrt(dot(a, a)))


def shadowing(name: str, ci: mp.mpf, cr: mp.mpf, cb: mp.mpf, cp: mp.mpf, slope: mp.mpf) -> mp.mpf:
    if name == "none":
        return mp.mpf(1)
    if name == "v-cavity":
        return min(mp.mpf(1), 2 * cb * ci / cp, 2 * cb * cr / cp)

    def shadow(c: mp.mpf) -> mp.mpf:
        if c == 1:
            return mp.mpf(0)
        a = c / (mp.sqrt(2) * slope * mp.sqrt(1 - c * c))
        return (mp.exp(-a * a) / (a * mp.sqrt(mp.pi)) - mp.erfc(a)) / 2

    if name == "smith":
        return 1 / ((1 + shadow(ci)) * (1 + shadow(cr)))
    return 1 / (1 + shadow(ci) + shadow(cr))


def facet_mueller(
    sun: Vector,
    camera: Vector,
    *,
    normal: Vector,
    h_in: Vector,
    h_out: Vector,
    n: float,
    k: float,
    slope_rms: float,
    shadow: str,
) -> list[list[float]]:
    """Mueller matrix [sr^-1] from axes (h_in, k x h_in) to (h_out, k x h_out)."""
    k_i, k_r = scaled(sun, mp.mpf(-1)), camera
    half = unit([a + b for a, b in zip(sun, camera, strict=True)])
    cp, cb, ci, cr = dot(half, sun), dot(half, normal), dot(normal, sun), dot(normal, camera)
    m2 = mp.mpc(n, k) ** 2
    w = mp.sqrt(m2 - 1 + cp * cp)
    rs, rp = (cp - w) / (cp + w), (m2 * cp - w) / (m2 * cp + w)
    plane = cross(k_i, k_r)
    s = h_in if dot(plane, plane) < mp.mpf(10) ** -90 else unit(plane)
    p_i, p_r = cross(k_i, s), cross(k_r, s)
    into, out = (h_in, cross(k_i, h_in)), (h_out, cross(k_r, h_out))
    jones = [[rs * dot(e, s) * dot(s, f) + rp * dot(e, p_r) * dot(p_i, f) for f in into] for e in out]
    sigma = mp.mpf(slope_rms)
    tan2 = (1 - cb * cb) / (cb * cb)
    density = mp.exp(-tan2 / (2 * sigma**2)) / (2 * mp.pi * sigma**2 * cb**4)
    factor = density * shadowing(shadow, ci, cr, cb, cp, sigma) / (4 * ci * cr)
    return [[float(factor * x) for x in row] for row in linear_block(jones)]


def linear_block(jones: list[list[mp.mpc]]) -> list[list[mp.mpf]]:
    """Response of S0, S1, S2 to light of S0, S1, S2: trace of sigma_i J sigma_j J+ over two."""
    pauli = (mp.matrix([[1, 0], [0, 1]]), mp.matrix([[1, 0], [0, -1]]), mp.matrix([[0, 1], [1, 0]]))
    j = mp.matrix(jones)
    adjoint = j.transpose_conj()

    def element(a: mp.matrix, b: mp.matrix) -> mp.mpf:
        product = a * j * b * adjoint
        return mp.re(product[0, 0] + product[1, 1]) / 2

    return [[element(a, b) for b in pauli] for a in pauli]


def level_mueller(
    theta_i_rad: float, theta_r_rad: float, phi_rad: float, *, n: float, k: float, slope_rms: float, shadow: str
) -> list[list[float]]:
    """The same for a level surface; sun to the north, phi = azimuth(sun) - azimuth(camera)."""
    with mp.workdps(50):
        phi = mp.mpf(phi_rad)
        camera = direction(theta_r_rad, -phi)
        return facet_mueller(
            direction(theta_i_rad, 0.0),
            camera,
            normal=[mp.mpf(0), mp.mpf(0), mp.mpf(1)],
            h_in=[mp.mpf(1), mp.mpf(0), mp.mpf(0)],
            h_out=[-mp.cos(-phi), mp.sin(-phi), mp.mpf(0)],
            n=n,
            k=k,
            slope_rms=slope_rms,
            shadow=shadow,
        )
