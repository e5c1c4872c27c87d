"""The page of a noise calibration: numbers, flags, curves, maps and the EMVA 1288 summary sheet, in one HTML file."""

import base64
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined

from rigctl.calibrations.noise.calibrate_files import FrameCalibration
from rigctl.reports.figures.calibration_figures import dark_png, linearity_png, snr_png
from rigctl.reports.figures.calibration_pictures import histograms_png, maps_png, spectrograms_png
from rigctl.reports.figures.photon_transfer_figure import photon_transfer_png
from rigctl.reports.tables.calibration_table import calibration_rows

_DECIBEL = 20.0
_MS_PER_S = 1e3


def calibration_page(calibration: FrameCalibration, content: dict[str, Any]) -> str:
    """Return the page as HTML that needs no other file.

    Parameters
    ----------
    calibration : FrameCalibration
        The calibration.
    content : dict
        What ``noise.json`` holds of it.
    """
    noise, pattern = calibration.noise, calibration.pattern
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    template = environment.from_string((files("rigctl") / "data" / "calibration.html.j2").read_text(encoding="utf-8"))
    rows = calibration_rows(content)
    return template.render(
        title=Path(calibration.frames.source.path).name,
        facts=_facts(content),
        rows=rows,
        remarks=_remarks(content),
        flags=noise.flags,
        photon_transfer=_embedded(photon_transfer_png(noise)),
        snr=_embedded(snr_png(noise)),
        linearity=_embedded(linearity_png(noise)),
        dark=_embedded(dark_png(noise)),
        has_pattern=pattern is not None,
        maps=_embedded(maps_png(pattern) if pattern else None),
        histograms=_embedded(histograms_png(pattern) if pattern else None),
        spectrograms=_embedded(spectrograms_png(pattern) if pattern else None),
        sheet=[row for row in rows if row.symbol],
        sheet_facts=_sheet_facts(calibration, content),
    )


def _facts(content: dict[str, Any]) -> list[str]:
    source = content["source"]
    return [
        f"from {source['path']}",
        f"SHA-256 over all frames {source['frames_sha256'][:16]}",
        f"made {content['created_utc'][:19]}Z by {content['created_by']}",
    ]


def _remarks(content: dict[str, Any]) -> list[str]:
    """Return numbers in other units, and what two ways to one number say of each other."""
    found, best = [], content["performance"]
    if best["dynamic_range"] is not None:
        value = best["dynamic_range"]["value"]
        found.append(f"dynamic range {_DECIBEL * np.log10(value):.1f} dB, {np.log2(value):.1f} bits")
    if best["snr_max"] is not None:
        value = best["snr_max"]["value"]
        found.append(f"largest SNR {_DECIBEL * np.log10(value):.1f} dB, {np.log2(value):.1f} bits")
    if best["dark_current_disagreement"] is not None:
        score = best["dark_current_disagreement"]
        word = (
            "consistent" if abs(score) < 3.0 else "in disagreement: the camera clamps its black level, or light got in"
        )
        found.append(f"dark current by mean and by variance are {score:+.1f} standard errors apart, {word}")
    if best["quantum_efficiency"] is not None:
        found.append("the error of the quantum efficiency does not hold that of the photons as stated")
    return found


def _sheet_facts(calibration: FrameCalibration, content: dict[str, Any]) -> list[tuple[str, str]]:
    noise, made_for = calibration.noise, content["made_for"]
    frames = [level.n_frames for level in (*noise.flats, *noise.darks)]
    exposures = [level.exposure_s for level in (*noise.flats, *noise.darks) if level.exposure_s is not None]
    flat, dark = noise.flats[noise.spatial.flat], noise.darks[noise.spatial.dark]
    rows, columns = flat.shape
    known = {name: made_for[name] for name in ("camera_model", "camera_serial", "gain_db", "pixel_format", "binning")}
    return [
        *((name.replace("_", " "), "not known" if value is None else str(value)) for name, value in known.items()),
        ("temperature", "not known" if made_for["temperature_c"] is None else f"{made_for['temperature_c']:.1f} °C"),
        ("picture", f"{columns} x {rows} pixels, {calibration.frames.camera.bit_depth} bits"),
        ("levels", f"{len(noise.flats)} with light, {len(noise.darks)} dark, {sum(frames)} frames"),
        ("exposures", f"{_ms(min(exposures))} to {_ms(max(exposures))}" if exposures else "not known"),
        ("light varied by", "exposure time" if len(set(exposures)) > len(noise.darks) // 2 > 0 else "lamp"),
        ("fixed pattern from", f"{flat.n_frames} flats at {flat.mean_dn:.0f} DN and {dark.n_frames} darks"),
    ]


def _ms(time_s: float) -> str:
    return f"{_MS_PER_S * time_s:.4g} ms"


def _embedded(picture: bytes | None) -> str:
    return "" if picture is None else base64.b64encode(picture).decode("ascii")
