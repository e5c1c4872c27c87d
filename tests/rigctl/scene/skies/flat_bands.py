"""The sun's spectrum in a band in which a sensor responds alike to all wavelengths."""

import numpy as np

from rigctl.scene.sun import response_band


def flat_band(*, shortest_nm, longest_nm, distance_factor):
    """Return the sun's spectrum between two wavelengths."""
    return response_band(
        wavelength_nm=np.array([shortest_nm, longest_nm]), response=np.ones(2), distance_factor=distance_factor
    )
