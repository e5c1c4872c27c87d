"""A slow way to the law of a quadratic form, in 32 digits; it shares no formula with the product's contour."""

from collections.abc import Sequence

import mpmath as mp

mp.mp.dps = 32


def ray_log_tail(
    threshold: float,
    weights: Sequence[float],
    offsets: Sequence[float],
    *,
    upper: bool,
    angle_deg: int = 60,
    degrees: Sequence[float] | None = None,
) -> mp.mpf:
    """Logarithm of a tail by Gauss-Legendre quadrature over a straight ray that starts beside the saddle.

    For weights of any spread. `angle_deg` is the ray's angle to the real axis: acute for positive weights, either for
    weights of both signs.
    """
    sign = 1 if upper else -1
    w, b = [sign * mp.mpf(x) for x in weights], [mp.mpf(x) for x in offsets]
    nu = [mp.mpf(x) for x in degrees or [1.0] * len(w)]
    level = sign * mp.mpf(threshold)
    forms = list(zip(w, b, nu, strict=True))

    def exponent(s: mp.mpc) -> mp.mpc:
        terms = (-n / 2 * mp.log(1 - 2 * x * s) + x * c * c * s / (1 - 2 * x * s) for x, c, n in forms)
        return mp.fsum(terms) - s * level - mp.log(s)

    start, width = _start(forms, level)
    height = exponent(start)
    turn = mp.expjpi(mp.mpf(angle_deg if max(w) > 0 else 180 - angle_deg) / 180)
    end = width
    while mp.re(exponent(start + end * turn) - height) > -45:
        end *= mp.mpf("1.5")
        assert end < width * mp.mpf("1e40"), "the ray climbs: mirror the angle"
    cuts = [mp.mpf(0), width / 4, width / 2, width]
    while cuts[-1] < end:
        cuts.append(cuts[-1] * mp.mpf("1.7"))
    total = mp.quad(lambda r: mp.im(mp.exp(exponent(start + r * turn) - height) * turn), cuts, maxdegree=5)
    return height + mp.log(total / mp.pi)


def _start(forms: list[tuple[mp.mpf, mp.mpf, mp.mpf]], level: mp.mpf) -> tuple[mp.mpf, mp.mpf]:
    """A point on the real axis a little beside the saddle, and the width of the saddle."""

    def slope(s: mp.mpf) -> mp.mpf:
        terms = (n * x / (1 - 2 * x * s) + x * c * c / (1 - 2 * x * s) ** 2 for x, c, n in forms)
        return mp.fsum(terms) - level - 1 / s

    top = max(x for x, _, _ in forms)
    low, high = mp.mpf(-68), mp.mpf(68)

    def point(y: mp.mpf) -> mp.mpf:
        return 1 / (2 * top * (1 + mp.exp(-y))) if top > 0 else mp.exp(y)

    for _ in range(70):
        middle = (low + high) / 2
        low, high = (low, middle) if slope(point(middle)) > 0 else (middle, high)
    saddle = point(high)
    curvature = (
        mp.fsum(
            2 * n * x**2 / (1 - 2 * x * saddle) ** 2 + 4 * x**2 * c**2 / (1 - 2 * x * saddle) ** 3 for x, c, n in forms
        )
        + 1 / saddle**2
    )
    width = 1 / mp.sqrt(curvature)
    return saddle - width / 7, width
