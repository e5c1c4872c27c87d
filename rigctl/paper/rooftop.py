"""The rooftop of [MK14] section III: black and white paint at sun 22, view 53, phi 180 deg."""

from collections.abc import Iterable
from dataclasses import replace

from model.accuracy.chain import Reading
from model.accuracy.predict import predict as predict_to
from model.prediction import RegionPrediction
from rigctl.paper.airborne import TARGET, TOLERANCE, WHITE, Airborne, s0_snr
from rigctl.paper.numbers import Number
from rigctl.scene.parameters import with_values

GEOMETRY = "sun 22, view 53, phi 180"
ANGLES = ("0", "45", "90", "135")
# Height of the camera, exposure and texture are not in the paper.
ASSUMED = {
    "geometry.camera_height_m": 20.0,
    "acquisition.exposure_ms": 0.02,
    f"regions.{TARGET}.texture_rms": 0.012,
    f"regions.{WHITE}.texture_rms": 0.008,
}
_STATED = {"sun.zenith_deg": 22.0, "geometry.camera_zenith_deg": 53.0, "geometry.phi_deg": 180.0}
PANELS = {TARGET: "black paint", WHITE: "white paint"}


class Rooftop:
    """Predictions of the two panels, with their numerical errors."""

    def __init__(self, airborne: Airborne) -> None:
        scene = with_values(airborne.predictor.scene, {**_STATED, **ASSUMED})
        lit = airborne.predictor.lit_scene(scene)
        regions = tuple(region for region in lit.regions if region.name in PANELS)
        found = predict_to(replace(lit, regions=regions, pairs=()), tolerance=TOLERANCE, store=airborne.light.lights)
        self.predictions: dict[str, RegionPrediction] = {name: found.result.predictions[name] for name in PANELS}
        self._errors = found.budget.total

    def number(self, region: str, quantity: str, statistic: str) -> Number:
        """Return one number of a panel."""
        value = float(self.predictions[region].quantities[quantity][statistic])
        error = self._errors.get(Reading(region, quantity, statistic), 0.0)
        relative = statistic != "mean" or quantity not in ("dolp", "dolp_pixels", "s1n", "s2n")
        return Number(
            label=f"{quantity} {statistic} {PANELS[region]}",
            value=value,
            error=error * abs(value) if relative else error,
        )

    def s0_snrs(self) -> Iterable[Number]:
        """Yield the ratio of S0 of each panel to its noise from frame to frame."""
        for name, label in PANELS.items():
            yield replace(s0_snr(name, self.predictions[name], self._errors), label=f"SNR of S0 {label}")
