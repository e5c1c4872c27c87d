"""The page of a polarizer calibration: numbers, scans, harmonics, channels and maps."""

from collections.abc import Iterable, Mapping

from calibration.polarimeter.analyzer import DataReduction
from rigctl.calibrations.content_file import CalibrationFile
from rigctl.calibrations.polarizer.polarimeter_maps import PolarimeterMaps
from rigctl.calibrations.polarizer.polarizer_calibration import PolarizerCalibration
from rigctl.calibrations.polarizer.polarizer_json import PolarizerNumbers, rig_lines
from rigctl.reports.figures.rig_figures import channels_png, curves_png, harmonics_png, maps_png
from rigctl.reports.report import Block, Paragraph, Picture, Report, Section, Verbatim
from rigctl.reports.tables.calibration_tables import (
    channel_table,
    harmonic_table,
    matrix_table,
    number_table,
    region_table,
)

_CONVENTION = (
    "polarizer angle = sense · stage angle + offset, counter-clockwise as the camera sees the scene. For the rig file:"
)
_SCANS = (
    "Light against the angle of what turned, with Malus' law fitted to it; below, what the law leaves, in per cent of "
    "the mean."
)
_HARMONICS = (
    "Amplitude at one, three and four cycles a turn, each over the mean: of noise alone it is above the mark once in a "
    "thousand. One and three cycles are a wedge or a tilted element, four a detector that is not linear."
)
_HALF_TURN = "A scan of half a turn does not tell these apart: take it over a whole turn to see which it is."
_CHANNELS = (
    "Each stage angle by itself: response to unpolarized light over the mean, diattenuation, and how far the axis is "
    "from the common line. Bars are standard errors."
)


def polarizer_report(
    found: PolarizerCalibration,
    file: CalibrationFile[PolarizerNumbers],
    *,
    regions: Mapping[str, PolarizerCalibration],
    maps: PolarimeterMaps | None,
) -> Report:
    """Return the report of a polarizer calibration.

    Parameters
    ----------
    found : PolarizerCalibration
        The calibration, its sense decided.
    file : CalibrationFile
        What ``polarizer.json`` holds of it: whence, and when.
    regions : mapping
        Name to the calibration of a region by itself; may be empty.
    maps : PolarimeterMaps or None
        The same over the picture.
    """
    axis = (number_table(found), Paragraph(text=_CONVENTION), Verbatim(text=rig_lines(found)))
    return Report(
        title=f"Polarizer: {', '.join(source.path for source in file.header.sources())}",
        source=_facts(file),
        sections=[
            Section(title="Axis and extinction", blocks=axis),
            Section(title="Scans", blocks=(Picture(png=curves_png(found), caption=_SCANS),)),
            Section(title="What Malus' law leaves", blocks=tuple(_left(found))),
            *_channels(found),
            *_reduction(found.reduction),
            *([Section(title="Regions", blocks=(region_table(regions),))] if regions else []),
            *_maps(maps),
        ],
    )


def _left(found: PolarizerCalibration) -> Iterable[Block]:
    if (drawn := harmonics_png(found)) is not None:
        yield Picture(png=drawn, caption=_HARMONICS)
    yield harmonic_table(found)
    if found.harmonics and not found.harmonics_told_apart:
        yield Paragraph(text=_HALF_TURN)


def _channels(found: PolarizerCalibration) -> Iterable[Section]:
    if (drawn := channels_png(found)) is not None:
        blocks = (Picture(png=drawn, caption=_CHANNELS), channel_table(found))
        yield Section(title="Each stage angle", blocks=blocks)


def _reduction(reduction: DataReduction | None) -> Iterable[Section]:
    if reduction is not None:
        singular = ", ".join(f"{value:.4g}" for value in reduction.singular_values)
        text = (
            f"Stokes parameters = W · (counts over twice their mean), measured with known states; singular values "
            f"{singular}, of which three are kept; condition {reduction.condition:.3f}."
        )
        yield Section(title="Data reduction matrix", blocks=(Paragraph(text=text), matrix_table(reduction)))


def _maps(maps: PolarimeterMaps | None) -> Iterable[Section]:
    if maps is not None:
        picture = Picture(png=maps_png(maps), caption=_maps_caption(maps))
        yield Section(title="Over the picture", blocks=(picture,))


def _facts(file: CalibrationFile[PolarizerNumbers]) -> str:
    header, made = file.header, file.header.made_for
    known = (("camera", made.camera_model, made.camera_serial), ("stage", made.stage_model, made.stage_serial))
    devices = [
        f"{what} {model or ''} {serial}".replace("  ", " ") for what, model, serial in known if serial is not None
    ]
    facts = [
        *devices,
        f"{file.body.frames} frames",
        f"manifest {', '.join(source.sha256[:16] for source in header.sources())}",
        f"made {header.created_utc[:19]}Z by {header.created_by}",
    ]
    return f"{'; '.join(facts)}."


def _maps_caption(maps: PolarimeterMaps) -> str:
    side, left_out = maps.side_pixels, int((~maps.lit).sum())
    beside = f" {left_out} blocks are left out: dark or saturated." if left_out else ""
    return (
        f"Blocks of {side} x {side} pixels, each fitted by itself. Throughput is over its mean over the angles, so "
        f"that uneven light drops out; the axis is shown less its mean over the picture.{beside}"
    )
