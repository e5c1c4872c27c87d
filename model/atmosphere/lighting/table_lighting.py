"""Light from a user's own table: another code's, or an all-sky camera's."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

_TURN = 2.0 * np.pi
_ROUNDING_RAD = 1e-9


@dataclass(frozen=True, kw_only=True)
class TableLighting:
    """Light of one sun position in a band, from a table; a `model.atmosphere.lighting.lighting.Lighting`.

    Attributes
    ----------
    direct_irradiance
        Irradiance of the beam at the ground on a plane normal to it [W m-2].
    zenith_rad
        Zenith angles of the sky and of the views, shape (Z,), increasing, two or more [rad].
    phi_rad
        Azimuth of the sun minus that of the point or sensor, shape (P,), increasing from 0 to 2 pi, or from 0 to pi
        for a table of one side of the principal plane, which the other side then mirrors [rad].
    sky_stokes
        Radiance of the sky, shape (Z, P, 3) [W m-2 sr-1].
    height_m
        Heights of sensors over the ground, shape (H,), increasing from 0, where nothing is added [m].
    path_transmittance
        Shape (H, Z), 0 to 1.
    path_stokes
        Radiance added below the sensor over a black target, shape (H, Z, P, 3) [W m-2 sr-1].

    Notes
    -----
    Stokes parameters are read linearly, turned to a frame that does not depend on azimuth, so that the zenith (where
    the frame of the conventions turns) is no special point.
    """

    direct_irradiance: float
    zenith_rad: NDArray[np.float64]
    phi_rad: NDArray[np.float64]
    sky_stokes: NDArray[np.float64]
    height_m: NDArray[np.float64]
    path_transmittance: NDArray[np.float64]
    path_stokes: NDArray[np.float64]

    def __post_init__(self) -> None:
        if not 0.0 <= self.direct_irradiance < np.inf:
            raise ValueError(
                f"TableLighting: direct_irradiance = {self.direct_irradiance!r} W m-2, but it must be 0 or more"
            )
        for name, axis, least in (("zenith_rad", self.zenith_rad, 2), ("height_m", self.height_m, 1)):
            if axis.ndim != 1 or axis.size < least or not np.all(np.diff(axis) > 0.0):
                raise ValueError(f"TableLighting: {name} must hold {least} or more increasing numbers")
        _check_azimuths(self.phi_rad)
        self._check_shapes()

    def _check_shapes(self) -> None:
        """Refuse tables that do not fit their axes, or hold what is no number."""
        heights, zeniths, azimuths = self.height_m.size, self.zenith_rad.size, self.phi_rad.size
        wanted = {
            "sky_stokes": (zeniths, azimuths, 3),
            "path_transmittance": (heights, zeniths),
            "path_stokes": (heights, zeniths, azimuths, 3),
        }
        for name, shape in wanted.items():
            table = getattr(self, name)
            if table.shape != shape or not np.all(np.isfinite(table)):
                raise ValueError(f"TableLighting: {name} must be finite and of shape {shape}, not {table.shape}")

    def sky(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance of the sky, shape (..., 3) [W m-2 sr-1].

        Raises
        ------
        ValueError
            A zenith angle outside the table.

        References
        ----------
        definition: linear interpolation
        """
        return _read_directions(
            self.zenith_rad, *_whole_turn(self.phi_rad, self.sky_stokes), zenith_rad, phi_rad, looking="up"
        )

    def transmittance(self, *, height_m: float, zenith_rad: ArrayLike) -> NDArray[np.float64]:
        """Transmittance from the ground to a sensor.

        Raises
        ------
        ValueError
            A height or a zenith angle outside the table.

        References
        ----------
        definition: linear interpolation
        """
        table = self._at_height(self.path_transmittance, height_m)
        return _interpolate((self.zenith_rad,), table, np.asarray(zenith_rad, dtype=float)[..., np.newaxis])

    def path(self, *, height_m: float, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance added below a sensor, shape (..., 3) [W m-2 sr-1].

        Raises
        ------
        ValueError
            A height or a zenith angle outside the table.

        References
        ----------
        definition: linear interpolation
        """
        table = self._at_height(self.path_stokes, height_m)
        return _read_directions(self.zenith_rad, *_whole_turn(self.phi_rad, table), zenith_rad, phi_rad, looking="down")

    def _at_height(self, table: NDArray[np.float64], height_m: float) -> NDArray[np.float64]:
        """Table at one height, linear between the heights of the axis."""
        if not self.height_m[0] <= height_m <= self.height_m[-1]:
            raise ValueError(
                f"height_m = {height_m!r} m, the table holds {self.height_m[0]:.6g} to {self.height_m[-1]:.6g} m"
            )
        if self.height_m.size == 1:
            return np.asarray(table[0])
        return np.asarray(_between((self.height_m,), table, np.array([[height_m]]))[0])


def _check_azimuths(phi_rad: NDArray[np.float64]) -> None:
    """Refuse azimuths that cover neither a half nor a whole turn."""
    rising = phi_rad.ndim == 1 and phi_rad.size >= 2 and bool(np.all(np.diff(phi_rad) > 0.0))
    if not rising or abs(phi_rad[0]) > _ROUNDING_RAD:
        raise ValueError("TableLighting: phi_rad must increase from 0")
    if min(abs(phi_rad[-1] - _TURN), abs(phi_rad[-1] - np.pi)) > _ROUNDING_RAD:
        raise ValueError(f"TableLighting: phi_rad ends at {phi_rad[-1]:.6g} rad, but it must end at pi or 2 pi")


def _whole_turn(
    phi_rad: NDArray[np.float64], stokes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Table (Z, P, 3) over a whole turn; the other side of the principal plane has S2 of the other sign."""
    if phi_rad[-1] > np.pi + _ROUNDING_RAD:
        return phi_rad, stokes
    mirrored = stokes[:, -2::-1] * np.array([1.0, 1.0, -1.0])
    return np.concatenate([phi_rad, _TURN - phi_rad[-2::-1]]), np.concatenate([stokes, mirrored], axis=1)


def _read_directions(
    zenith_axis_rad: NDArray[np.float64],
    phi_axis_rad: NDArray[np.float64],
    stokes: NDArray[np.float64],
    zenith_rad: ArrayLike,
    phi_rad: ArrayLike,
    *,
    looking: Literal["up", "down"],
) -> NDArray[np.float64]:
    """Table (Z, P, 3) at directions."""
    zenith, phi = np.broadcast_arrays(np.asarray(zenith_rad, dtype=float), np.asarray(phi_rad, dtype=float))
    sense = 1.0 if looking == "up" else -1.0
    fixed = _turned(stokes, -sense * phi_axis_rad)
    points = np.stack([zenith, np.mod(phi, _TURN)], axis=-1)
    return _turned(_interpolate((zenith_axis_rad, phi_axis_rad), fixed, points), sense * phi)


def _turned(stokes: NDArray[np.float64], angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Stokes parameters with their vibration turned counter-clockwise."""
    cosine, sine = np.cos(2.0 * angle_rad), np.sin(2.0 * angle_rad)
    s0, s1, s2 = np.moveaxis(stokes, -1, 0)
    return np.stack([s0 + 0.0 * cosine, cosine * s1 - sine * s2, sine * s1 + cosine * s2], axis=-1)


def _interpolate(
    axes: tuple[NDArray[np.float64], ...], table: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Linear interpolation that refuses to leave the table's zenith angles."""
    zenith, axis = points[..., 0], axes[0]
    if not np.all((zenith >= axis[0]) & (zenith <= axis[-1])):
        raise ValueError(
            f"zenith_rad runs from {np.min(zenith):.6g} to {np.max(zenith):.6g} rad, "
            f"the table holds {axis[0]:.6g} to {axis[-1]:.6g} rad"
        )
    # The last azimuth may be short of a whole turn by rounding.
    return _between(axes, table, points).reshape((*zenith.shape, *table.shape[len(axes) :]))


def _between(
    axes: tuple[NDArray[np.float64], ...], table: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a table linearly between its nodes, and beyond its last ones along the same lines."""
    from scipy.interpolate import RegularGridInterpolator  # a quarter of a second, wanted for light from a table only

    return np.asarray(RegularGridInterpolator(axes, table, bounds_error=False, fill_value=None)(points))
