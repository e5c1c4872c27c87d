"""The effects that a rig file names, made into what the simulated camera calls."""

from typing import assert_never

from rigctl.files.rendering_sections import (
    BeamWanderSection,
    CosmicHitsSection,
    DriftSection,
    FixedPatternSection,
    PointSpreadSection,
    RenderingSection,
    SmearSection,
    VignettingSection,
)
from sim_devices.detector import Detector, Lens
from sim_devices.rendering.effect import RenderingEffect
from sim_devices.rendering.optics import beam_wander, drift, point_spread, vignetting
from sim_devices.rendering.readout import cosmic_hits, fixed_pattern, smear


def rendering_effect(
    section: RenderingSection, *, lens: Lens, detector: Detector, pattern_seed: int
) -> RenderingEffect:
    """Return the effect that a table of a rig file names."""
    match section:
        case PointSpreadSection():
            return point_spread(sigma_px=section.sigma_px)
        case VignettingSection():
            return vignetting(lens, detector)
        case FixedPatternSection():
            return fixed_pattern(
                column_offset_e=section.column_offset_e, width=detector.width, pattern_seed=pattern_seed
            )
        case DriftSection():
            return drift(rate_per_frame=section.rate_per_frame, flicker_std=section.flicker_std)
        case BeamWanderSection():
            return beam_wander(radius_px=section.radius_px, phase_deg=section.phase_deg)
        case SmearSection():
            return smear(row_transfer_us=section.row_transfer_us)
        case CosmicHitsSection():
            return cosmic_hits(rate_per_s=section.rate_per_s, mean_e=section.mean_e)
        case _:
            assert_never(section)
