"""The pBRDF against numbers of 40 and 50 digits, and against two renderers' models."""

import json
from pathlib import Path

import numpy as np
import pytest

from model.surface.pbrdf import Surface, mueller
from tests.model.surface.oracles import level_mueller

REFERENCE = json.loads(Path(__file__).with_name("reference_pbrdf.json").read_text())
SHADOW_KEYS = {
    "none": None,
    "v-cavity": "G_vcavity",
    "smith": "G_smith_separable",
    "smith-correlated": "G_smith_heightcorr",
}
# Rounding of the angles themselves, some 1e-16 rad, grows by 1 / cos at grazing and in the exponent; what is left of
# 1e-9 (regular) and 1e-8 is margin that a wrong formula does not fit in.
REGULAR, EDGE = 1e-9, 1e-8


def deviation(actual: np.ndarray, expected: np.ndarray) -> float:
    return float(np.max(np.abs(actual - expected)) / expected[0, 0])


@pytest.mark.parametrize("shadow", SHADOW_KEYS)
@pytest.mark.parametrize("row", REFERENCE["geometries"], ids=lambda row: f"{row['tag']}-{row['phi_deg']:g}")
def test_all_elements_of_the_table(row: dict, shadow: str) -> None:
    angles = np.deg2rad([row["theta_i_deg"], row["theta_r_deg"], row["phi_deg"]])
    tolerance = EDGE if row["tag"] in ("retro", "grazing") else REGULAR
    for name, index in REFERENCE["materials"].items():
        for slope, scalars in row["scalars"].items():
            g = 1.0 if SHADOW_KEYS[shadow] is None else scalars[SHADOW_KEYS[shadow]]
            expected = np.array(row["M"][name]) * scalars["D"] * scalars["prefactor"] * g
            surface = Surface(**index, slope_rms=float(slope), shadowing=shadow)
            assert deviation(mueller(*angles, surface=surface), expected) < tolerance


NASTY = [
    ("near retro", 30.0, 30.000001, 0.0),
    ("near retro across", 60.0, 60.0, 1e-6),
    ("near retro at 2 pi", 70.0, 70.000001, 359.999999),
    ("grazing both, forward", 89.99, 89.99, 180.0),
    ("grazing both, off plane", 89.99, 89.98, 179.97),
    ("grazing sun", 89.99, 40.0, 170.0),
    ("grazing camera", 35.0, 89.99, -175.0),
    ("both a hair above the horizon, forward", 89.9999999, 89.99999999, 180.0),
    ("both a hair above the horizon, off plane", 89.99999999, 89.9999999, 179.99999999),
    ("nadir and next to it", 0.0, 1e-7, 37.0),
    ("both next to nadir", 1e-6, 2e-6, 121.0),
    ("both at nadir", 0.0, 0.0, 73.0),
    ("out of plane", 61.0, 17.0, -100.0),
]


@pytest.mark.parametrize("shadow", SHADOW_KEYS)
@pytest.mark.parametrize(("n", "k"), [(1.5, 0.0), (1.4, 0.4), (0.2, 3.4), (0.8, 0.0), (1.0000001, 0.0)])
@pytest.mark.parametrize("case", NASTY, ids=lambda case: case[0])
def test_hard_geometries(case: tuple, n: float, k: float, shadow: str) -> None:
    angles = np.deg2rad(case[1:])
    medium = {"n": n, "k": k, "slope_rms": 0.3}
    expected = np.array(level_mueller(*angles, **medium, shadow=shadow))
    assert deviation(mueller(*angles, surface=Surface(**medium, shadowing=shadow)), expected) < EDGE


def test_polarised_diffuse_matches_the_plastic_of_mitsuba() -> None:
    # Mitsuba's own G (rational Smith) is in the row; single precision, hence 3e-7 of the largest element.
    lobe = {"n": 1.5, "slope_rms": 0.2, "shadowing": "none"}
    for row in REFERENCE["pplastic"]:
        angles = np.deg2rad([row["theta_i_deg"], row["theta_r_deg"], row["phi_deg"]])
        specular = mueller(*angles, surface=Surface(**lobe)) * row["G_mitsuba"]
        both = mueller(*angles, surface=Surface(**lobe, dhr=0.5, diffuse="polarised"))
        diffuse = both - mueller(*angles, surface=Surface(**lobe))
        rest = np.array(row["M"]) - specular
        # The two models scale the diffuse part differently; its shape is what both state.
        np.testing.assert_allclose(diffuse / diffuse[0, 0], rest / rest[0, 0], atol=2e-6)


@pytest.mark.parametrize(("phi_deg", "sign"), [(90.0, 1.0), (-90.0, -1.0)])
def test_sign_of_s2_beside_the_sun(phi_deg: float, sign: float) -> None:
    matrix = mueller(*np.deg2rad([43.0, 53.0, phi_deg]), surface=Surface(n=1.5, slope_rms=0.2))
    assert matrix[2, 0] / matrix[0, 0] == pytest.approx(sign * 0.440, abs=5e-4)
