"""Section on what the light of each region is made of: a table and a figure."""

from collections.abc import Mapping

from model.scene.field_light import FieldLight
from rigctl.reports.figures.light_figure import light_figure
from rigctl.reports.report import Paragraph, Picture, Section
from rigctl.reports.tables.light_tables import share_table


def light_section(lights: Mapping[str, FieldLight]) -> Section:
    """Return the section on what the light of regions is made of.

    Parameters
    ----------
    lights : mapping
        Region to its light, as `rigctl.scene.scene_light.SceneLight.region` gives it; one or more.
    """
    text = (
        "Radiance at the aperture in W m-2 sr-1 in band, as the model has it: S1 = horizontal - vertical, S2 = (+45) - "
        "(-45). Reflected light is what is left of it at the camera; path is light that the air before the target adds."
    )
    picture = Picture(
        png=light_figure(lights), caption="What the light at the aperture is made of; the stroke is the total."
    )
    return Section(title="What the light is made of", blocks=(Paragraph(text=text), share_table(lights), picture))
