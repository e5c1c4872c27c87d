"""Off-axis falloff: mean and variance of the fourth power of the cosine over a part of the field."""

from dataclasses import dataclass

import numpy as np

from model.quadrature import gauss_legendre
from model.scene.field_of_view import FieldPart

# cos^4 is smooth: 12 nodes along each side give 1e-12 up to 60 deg from the axis.
_NODES = 24


@dataclass(frozen=True, kw_only=True)
class Falloff:
    """Mean and variance over the pixels of what the lens lets through, 1 on its axis."""

    mean: float
    var: float


def cosine_fourth(part: FieldPart) -> Falloff:
    """Return mean and variance of cos^4 of the field angle over a rectangle of the focal plane.

    Parameters
    ----------
    part
        Of the field.

    Notes
    -----
    Pixels are even in the tangents x, y of the angles, and cos^4 = 1 / (1 + x^2 + y^2)^2. On a rectangle that holds the
    axis the mean is above 1 - 2 (x^2 + y^2) of its farthest corner, since (1 + t)^-2 >= 1 - 2 t.

    References
    ----------
    Definition (natural vignetting).
    """
    node, weight = gauss_legendre(_NODES)
    x, y = (
        np.tan(low) + node * (np.tan(high) - np.tan(low))
        for low, high in ((part.left_rad, part.right_rad), (part.bottom_rad, part.top_rad))
    )
    share = 1.0 / (1.0 + x[:, np.newaxis] ** 2 + y[np.newaxis, :] ** 2) ** 2
    mean = float(weight @ share @ weight)
    return Falloff(mean=mean, var=float(weight @ (share - mean) ** 2 @ weight))
