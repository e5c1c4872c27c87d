"""A user's own sky, as a numpy archive: what another code computed, or an all-sky camera measured."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.sky import TableLighting
from rigctl.errors import ConfigError, DataError
from rigctl.storage.array_archive import read_arrays

# The sun of the scene may differ from the table's by this much.
_SAME_SUN_DEG = 0.5
# Arrays of the archive, with their shapes: Z zenith angles, P azimuths, H heights.
ARRAYS = {
    "sun_zenith_deg": "()",
    "direct_irradiance": "() in W m-2, on a plane normal to the beam at the ground",
    "zenith_deg": "(Z,)",
    "phi_deg": "(P,): azimuth of the sun minus that of the point or sensor, 0 to 180 or 0 to 360",
    "sky_stokes": "(Z, P, 3) in W m-2 sr-1",
    "height_m": "(H,), from 0",
    "path_transmittance": "(H, Z)",
    "path_stokes": "(H, Z, P, 3) in W m-2 sr-1",
}


def read_sky_table(path: Path, *, sun_zenith_rad: float) -> TableLighting:
    """Return the light of a table.

    Parameters
    ----------
    path : Path
        Archive of `numpy.savez` with the arrays of `ARRAYS`.
    sun_zenith_rad : float
        Of the scene [rad]; the table must be of the same.

    Raises
    ------
    ConfigError
        The file cannot be read, lacks an array, or is of another sun.
    """
    try:
        found = read_arrays(path)
        arrays = {name: np.asarray(found[name], dtype=np.float64) for name in ARRAYS if name in found}
    except DataError as error:
        raise ConfigError(str(error)) from error
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: holds what is no number: {error}") from error
    missing = [f"{name} {shape}" for name, shape in ARRAYS.items() if name not in arrays]
    if missing:
        raise ConfigError("\n  ".join([f"{path}: a table of the sky also needs", *missing]))
    _require_same_sun(path, arrays["sun_zenith_deg"], sun_zenith_rad)
    try:
        return TableLighting(
            direct_irradiance=float(arrays["direct_irradiance"]),
            zenith_rad=np.deg2rad(arrays["zenith_deg"]),
            phi_rad=np.deg2rad(arrays["phi_deg"]),
            sky_stokes=arrays["sky_stokes"],
            height_m=arrays["height_m"],
            path_transmittance=arrays["path_transmittance"],
            path_stokes=arrays["path_stokes"],
        )
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: {error}") from error


def _require_same_sun(path: Path, table_deg: NDArray[np.float64], sun_zenith_rad: float) -> None:
    scene_deg = float(np.degrees(sun_zenith_rad))
    if table_deg.shape != () or abs(float(table_deg) - scene_deg) > _SAME_SUN_DEG:
        raise ConfigError(
            f"{path}: is of a sun at {table_deg} deg from the zenith, the scene's stands at {scene_deg:.2f} deg; "
            f"allowed is a difference of {_SAME_SUN_DEG} deg"
        )
