"""A real division-of-focal-plane mosaic: its four pictures lie half a pixel apart, by how it is made."""

import os
from pathlib import Path

import numpy as np
import pytest

from rigctl.calibrations.registration import register_run
from rigctl.imports.images import ImportRequest
from rigctl.runs.folder import read_run
from rigctl.verbs.import_images import imported

REAL_DATA = os.environ.get("RIGCTL_REAL_DATA")


@pytest.mark.skipif(REAL_DATA is None, reason="set RIGCTL_REAL_DATA to the folder of real frames")
def test_the_pictures_of_a_mosaic_are_half_a_pixel_apart(tmp_path: Path) -> None:
    file = Path(REAL_DATA or "") / "imx250_fruits" / "fruits_IMX250MZR.png"
    imported(
        ImportRequest(run=tmp_path / "run", files=(file,), kind="scene", mosaic_deg=(90, 45, 135, 0), black_level_dn=0)
    )
    found = register_run(read_run(tmp_path / "run"))
    # 90 and 45 above, 135 and 0 below: a pixel that sits half a pixel to the right sees the scene moved to the left.
    truth = -np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5], [0.5, 0.5]])
    # Found within 0.12 pixel: fruit is glossy, and its polarization is at its edges.
    np.testing.assert_allclose(found.found.shift_pixels, truth, atol=0.15)
    assert found.finding is not None
