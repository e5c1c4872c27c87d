"""The page of a noise calibration: numbers, flags, curves, maps and the EMVA 1288 summary sheet."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from calibration.results import Flag
from calibration.sensor.noise import NoiseCalibration, Performance, first_lines, not_known
from calibration.sensor.pattern import FixedPattern
from rigctl.calibrations.noise.calibrate_files import FrameCalibration
from rigctl.calibrations.noise.noise_frames import FrameSource
from rigctl.reports.figures.calibration_figures import dark_png, linearity_png, photon_transfer_png, snr_png
from rigctl.reports.figures.calibration_pictures import histograms_png, maps_png, spectrograms_png
from rigctl.reports.report import Block, Bullets, Paragraph, Picture, Report, Section, Terms
from rigctl.reports.table import Table, text_columns
from rigctl.reports.tables.calibration_tables import calibration_rows, calibration_table, sheet_table, unknown_lines
from rigctl.version import VERSION

_DECIBEL = 20.0
_MS_PER_S = 1e3
_MADE_FOR = ("camera_model", "camera_serial", "gain_db", "pixel_format", "binning")
_NUMBERS = (
    "Left what the model uses (best: weighted fits, response of the sensor taken into account); right the fits of EMVA "
    "Standard 1288, Release 4.0 Linear, to set beside data sheets. Errors are standard errors; those of the standard's "
    "numbers are by leaving out one level after the other."
)
_TRANSFER = (
    "Noise in time against signal: dark noise, noise of photons and fixed pattern as lines; below, how far the "
    "variances are from the fit."
)
_LINEARITY = (
    "Mean against light; below, how far it is from a straight line. Error bars are the sampling of the means, often "
    "smaller than a point."
)
_DARK = "Mean and variance of dark frames against exposure{}."
_DARK_CURRENT = "; slopes of both are dark current, in electrons"
_SNR = "Signal over noise of one pixel in one frame."
_MAPS = (
    "Each pixel: mean in the dark, response to light, noise in the dark, and pixels that are further from the others "
    "than 6 standard deviations."
)
_HISTOGRAMS = (
    "How far pixels are from the mean of the 5 x 5 pixels around them, on logarithmic axes; below, how many are at "
    "least so far."
)
_SHEET = (
    "Not measured here, and therefore not stated: spectral responsivity, microlens angle, non-whiteness by section. "
    "Numbers without photons per pixel are left out."
)


def calibration_report(calibration: FrameCalibration, *, created_utc: str) -> Report:
    """Return the report of a noise calibration.

    Parameters
    ----------
    calibration : FrameCalibration
        The calibration.
    created_utc : str
        When it was made, as its file says it.
    """
    noise, remarks = calibration.noise, _remarks(calibration.noise.performance)
    rows = calibration_rows(noise)
    unknown = tuple(unknown_lines(noise))
    numbers: tuple[Block, ...] = (
        Bullets(items=first_lines(noise)),
        Paragraph(text=_NUMBERS),
        calibration_table(rows),
        *((Bullets(items=unknown),) if unknown else ()),
    )
    return Report(
        title=f"Sensor noise: {Path(calibration.frames.source.path).name}",
        source=_facts(calibration.frames.source, created_utc),
        sections=[
            Section(title="Numbers", blocks=(*numbers, Bullets(items=tuple(remarks))) if remarks else numbers),
            Section(title="What is to be known of the frames", blocks=(_flags(noise.flags),)),
            *_curves(noise),
            *_pattern(calibration.pattern),
            Section(
                title="EMVA 1288 summary sheet",
                blocks=(
                    Table(
                        columns=text_columns("operation point", "", left=(0, 1)),
                        rows=tuple(_sheet_facts(calibration)),
                    ),
                    sheet_table(rows),
                    Paragraph(text=_SHEET),
                ),
            ),
        ],
    )


def _flags(flags: tuple[Flag, ...]) -> Block:
    if not flags:
        return Paragraph(text="Nothing odd was found.")
    return Terms(items=tuple((flag.name, flag.message) for flag in flags))


def _curves(noise: NoiseCalibration) -> Iterable[Section]:
    yield _pictured("Photon transfer", photon_transfer_png(noise), _TRANSFER)
    no_curve = f" Its curve is a bound, or there is none: {not_known(noise).get('read_noise_e', 'it is not known')}."
    yield _pictured("Signal-to-noise ratio", snr_png(noise), _SNR + (no_curve if noise.read_noise_e is None else ""))
    yield _pictured("Linearity", linearity_png(noise), _LINEARITY, otherwise="The light of the levels is not known.")
    caption = _DARK.format("" if noise.dark_current_e_per_s is None else _DARK_CURRENT)
    yield _pictured("Dark signal", dark_png(noise), caption, otherwise="Exposures of the dark frames are not known.")


def _pictured(title: str, png: bytes | None, caption: str, *, otherwise: str = "There is nothing to draw.") -> Section:
    """Return a section with a figure; with words where there is nothing to draw."""
    if png is not None:
        return Section(title=title, blocks=(Picture(png=png, caption=caption),))
    return Section(title=title, blocks=(Paragraph(text=otherwise),))


def _pattern(pattern: FixedPattern | None) -> Iterable[Section]:
    blocks: tuple[Block, ...] = (Paragraph(text="No flat is brighter than its dark: there are no maps."),)
    if pattern is not None:
        by_frequency = "The fixed pattern by spatial frequency; independent pixels make a level line."
        blocks = (
            Picture(png=maps_png(pattern), caption=_MAPS),
            Picture(png=histograms_png(pattern), caption=_HISTOGRAMS),
            Picture(png=spectrograms_png(pattern), caption=by_frequency),
        )
    yield Section(title="Fixed pattern", blocks=blocks)


def _facts(source: FrameSource, created_utc: str) -> str:
    facts = [
        f"from {source.path}",
        f"SHA-256 over all frames {source.frames_sha256[:16]}",
        f"made {created_utc[:19]}Z by rigctl {VERSION}",
    ]
    return f"{'; '.join(facts)}."


def _remarks(best: Performance) -> list[str]:
    """Return numbers in other units, and what two ways to one number say of each other."""
    found = []
    if best.dynamic_range is not None:
        found.append(f"dynamic range {_decibels_and_bits(best.dynamic_range.value)}")
    if best.snr_max is not None:
        found.append(f"largest SNR {_decibels_and_bits(best.snr_max.value)}")
    if best.dark_current_disagreement is not None:
        score = best.dark_current_disagreement
        word = (
            "consistent" if abs(score) < 3.0 else "in disagreement: the camera clamps its black level, or light got in"
        )
        found.append(f"dark current by mean and by variance are {score:+.1f} standard errors apart, {word}")
    if best.quantum_efficiency is not None:
        found.append("the error of the quantum efficiency does not hold that of the photons as stated")
    return found


def _decibels_and_bits(ratio: float) -> str:
    return f"{_DECIBEL * np.log10(ratio):.1f} dB, {np.log2(ratio):.1f} bits"


def _sheet_facts(calibration: FrameCalibration) -> list[tuple[str, str]]:
    noise, made_for = calibration.noise, calibration.frames.made_for
    frames = [level.n_frames for level in (*noise.flats, *noise.darks)]
    exposures = [level.exposure_s for level in (*noise.flats, *noise.darks) if level.exposure_s is not None]
    flat, dark = noise.flats[noise.spatial.flat], noise.darks[noise.spatial.dark]
    rows, columns = flat.shape
    return [
        *((name.replace("_", " "), _known(getattr(made_for, name))) for name in _MADE_FOR),
        ("temperature", "not known" if made_for.temperature_c is None else f"{made_for.temperature_c:.1f} °C"),
        ("picture", f"{columns} x {rows} pixels, {calibration.frames.camera.bit_depth} bits"),
        ("levels", f"{len(noise.flats)} with light, {len(noise.darks)} dark, {sum(frames)} frames"),
        ("exposures", f"{_ms(min(exposures))} to {_ms(max(exposures))}" if exposures else "not known"),
        ("light varied by", "exposure time" if len(set(exposures)) > len(noise.darks) // 2 > 0 else "lamp"),
        ("fixed pattern from", f"{flat.n_frames} flats at {flat.mean_dn:.0f} DN and {dark.n_frames} darks"),
    ]


def _known(value: str | float | None) -> str:
    return "not known" if value is None else str(value)


def _ms(time_s: float) -> str:
    return f"{_MS_PER_S * time_s:.4g} ms"
