"""The result of `rigctl stokes` as planes with names, units and meanings: in one FITS, HDF5 or CSV file, or in Zarr.

`PLANES` is the list of them all; every format has the same planes.
"""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.base.durable import sha256_of
from rigctl.console import anonymized, is_anonymous
from rigctl.errors import ConfigError
from rigctl.measure.measure import Measurement
from rigctl.measure.pixel_errors import Doubt, PixelErrors
from rigctl.runs.fits import encode_image
from rigctl.runs.folder import MANIFEST_FILE
from rigctl.runs.records import FrameRecord
from rigctl.version import VERSION

_NOISE, _SHARED = "standard error by noise", "standard error by dark level, throughput and axis, shared by all pixels,"
# Name to unit and meaning; "S" is the unit of S0: DN, or DN/s where exposures differ.
PLANES = {
    "s0": ("S", "S0, all of the light, dark level off"),
    "s1": ("S", "S1, horizontal - vertical"),
    "s2": ("S", "S2, +45 deg - (-45) deg"),
    "s0_error": ("S", f"{_NOISE} of S0"),
    "s1_error": ("S", f"{_NOISE} of S1"),
    "s2_error": ("S", f"{_NOISE} of S2"),
    "s0_calibration_error": ("S", f"{_SHARED} of S0"),
    "s1_calibration_error": ("S", f"{_SHARED} of S1"),
    "s2_calibration_error": ("S", f"{_SHARED} of S2"),
    "s0_s1_cov": ("S2", "covariance of S0 and S1 by noise"),
    "s0_s2_cov": ("S2", "covariance of S0 and S2 by noise"),
    "s1_s2_cov": ("S2", "covariance of S1 and S2 by noise"),
    "dolp": ("", "degree of linear polarization; NaN where it has no meaning"),
    "dolp_error": ("", f"{_NOISE} of DoLP, to first order"),
    "aolp_deg": ("deg", "angle of linear polarization, counter-clockwise from horizontal, 0 to 180"),
    "aolp_error_deg": ("deg", f"{_NOISE} of AoLP, to first order; 52 where any angle may be"),
    "dq": (
        "",
        "mask, 0 is good: "
        + ", ".join(f"{bit} {name.lower().replace('_', ' ')}" for name, bit in Doubt.__members__.items()),
    ),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Plane:
    """A picture of the result."""

    values: NDArray[Any]
    unit: str
    meaning: str


def planes_of(measurement: Measurement, errors: PixelErrors) -> dict[str, Plane]:
    """Return all planes by name."""
    images, std = measurement.images, np.sqrt(np.stack([errors.cov[k, k] for k in range(3)]))
    values = dict(
        zip(
            PLANES,
            (
                *images.stokes, *std, *errors.calibration, errors.cov[0, 1], errors.cov[0, 2], errors.cov[1, 2],
                images.dolp, errors.dolp, images.aolp_deg, errors.aolp_deg, errors.doubts,
            ),
            strict=True,
        )
    )  # fmt: skip
    unit = measurement.grid.unit
    units = {"S": unit, "S2": f"{unit}^2" if unit == "DN" else "DN^2/s^2"}
    return {
        name: Plane(values=values[name], unit=units.get(kind, kind), meaning=meaning)
        for name, (kind, meaning) in PLANES.items()
    }


def stokes_fits(measurement: Measurement, errors: PixelErrors, calibrations: Mapping[str, Path]) -> bytes:
    """Return a FITS file: SCI (S0, S1, S2), ERR, COV, DQ, DOLP, DOLP_ERR, AOLP, AOLP_ERR, CALERR.

    FITS standard 4.0, sections 8.2 and 9; SOLARNET Metadata Recommendations, section 5.4.1, for POLCCONV and POLCANGL.
    """
    planes, of_noise = planes_of(measurement, errors), {"ERRTYPE": ("noise", "what it is the error of; see CALERR")}
    facts = {
        key: value if isinstance(value, tuple) else (value, "")
        for key, value in _facts(measurement, errors, calibrations).items()
    }
    units: dict[str, tuple[tuple[str, ...], dict[str, tuple[Any, str]]]] = {
        "SCI": (("s0", "s1", "s2"), {"EXTEND": (True, "")} | facts),
        "ERR": (("s0_error", "s1_error", "s2_error"), {"UTYPE": ("StdDevUncertainty", ""), **of_noise}),
        "COV": (("s0_s1_cov", "s0_s2_cov", "s1_s2_cov"), of_noise),
        "DQ": (("dq",), {}),
        "DOLP": (("dolp",), {}),
        "DOLP_ERR": (("dolp_error",), of_noise),
        "AOLP": (("aolp_deg",), {}),
        "AOLP_ERR": (("aolp_error_deg",), of_noise),
        "CALERR": (
            tuple(f"s{k}_calibration_error" for k in range(3)),
            {"UTYPE": ("StdDevUncertainty", ""), "ERRTYPE": ("calibration", "what it is the error of")},
        ),
    }
    return b"".join(
        encode_image(
            np.stack([planes[name].values for name in names]) if len(names) > 1 else planes[names[0]].values,
            {
                "EXTNAME": (extension, ""),
                "BUNIT": (planes[names[0]].unit, "unit of the samples"),
                "ROWORDER": ("TOP-DOWN", "first row is the top of the picture"),
            }
            | cards,
            comments=[f"{name}: {planes[name].meaning}" for name in names],
            is_extension=extension != "SCI",
        )
        for extension, (names, cards) in units.items()
    )


def _facts(measurement: Measurement, errors: PixelErrors, calibrations: Mapping[str, Path]) -> dict[str, Any]:
    """Return the header of the science image."""
    run, grid = measurement.run, measurement.grid
    frames = grid.frames
    first = frames[0]
    facts: dict[str, Any] = {
        "CTYPE1": ("X", "columns, to the right"),
        "CTYPE2": ("Y", "rows, downwards"),
        "CTYPE3": ("STOKES", "I, Q, U: S0, S1, S2"),
        # SAOImage DS9 needs these of every axis.
        **{f"{key}{axis}": 1.0 for axis in (1, 2, 3) for key in ("CRPIX", "CRVAL", "CDELT")},
        "POLCCONV": ("(+X,-Y,+Z)", "+Q right in the picture, Z to observer"),
        "POLCANGL": (0.0, "[deg] turn of that frame"),
        "POLANGS": (", ".join(f"{angle:.4f}" for angle in np.degrees(grid.polarizer_angles_rad)), "[deg] polarizer"),
        "NCYCLES": (grid.cycles, "repeats of these angles"),
        "EXTRATIO": (measurement.extinction_ratio, "extinction ratio of the polarizer"),
        "DARKSRC": measurement.frames.dark_level.source,
        "ERRSRC": (errors.source, "what ERR rests on"),
        "RUNID": run.path.absolute().name,
        "RUNHASH": sha256_of(run.path / MANIFEST_FILE),
        "SWVER": f"rigctl {VERSION}",
    }
    if axis_deg := run.session.polarizer.offset_std_deg:
        facts["AXISERR"] = (axis_deg, "[deg] std error that all polarizer angles share")
    facts |= _times(frames)
    if grid.exposures_s is not None and grid.is_one_exposure:
        facts["EXPTIME"] = (float(grid.exposures_s[0]), "[s] of one frame")
    means = {
        "CCD-TEMP": ("camera_temperature_c", "[deg C] camera, mean"),
        "SUNAZ": ("sun_azimuth_deg", "[deg] sun, clockwise from north, mean"),
        "SUNEL": ("sun_elevation_deg", "[deg] sun, mean"),
    }
    places = {"SITELAT": "site_latitude_deg", "SITELONG": "site_longitude_deg", "SITEELEV": "site_elevation_m"}
    for key, (name, comment) in means.items():
        numbers = [getattr(frame, name) for frame in frames]
        if all(number is not None for number in numbers):
            facts[key] = (float(np.mean(numbers)), comment)
    if not is_anonymous():
        facts |= {key: getattr(first, name) for key, name in places.items() if getattr(first, name) is not None}
        facts |= {} if first.camera_serial is None else {"CAMSN": first.camera_serial}
    facts |= {} if first.camera_model is None else {"INSTRUME": first.camera_model}
    simulation = None if run.session.rig is None else run.session.rig.simulation
    sensor = simulation.get("sensor") if simulation else None
    if first.filter_name is not None:
        facts["FILTER"] = first.filter_name
    elif isinstance(sensor, dict) and isinstance(sensor.get("wavelength_nm"), int | float):
        facts["FILTER"] = (f"{sensor['wavelength_nm']:g} nm", "effective wavelength")
    for number, (kind, path) in enumerate(sorted(calibrations.items()), start=1):
        facts[f"CAL{number}"] = (f"{kind} {path.name}", "calibration")
        facts[f"CAL{number}HASH"] = sha256_of(path)
    return {key: _card_value(value) for key, value in facts.items()}


def _times(frames: Sequence[FrameRecord]) -> dict[str, str]:
    """Return begin, middle and end of the exposures; the end by their length where it is not recorded."""
    starts, ends = [], []
    for frame in frames:
        if frame.start_utc is not None:
            starts.append(np.datetime64(frame.start_utc.removesuffix("Z"), "us"))
            length = np.timedelta64(round((frame.exposure_s or 0.0) * (frame.reads or 1) * 1e6), "us")
            ended = None if frame.end_utc is None else np.datetime64(frame.end_utc.removesuffix("Z"), "us")
            ends.append(starts[-1] + length if ended is None else ended)
    if not starts:
        return {}
    begin, end = min(starts), max(ends)
    times = {"DATE-BEG": begin, "DATE-AVG": begin + (end - begin) / 2, "DATE-END": end}
    return {"TIMESYS": "UTC"} | {key: str(when.astype("datetime64[ms]")) for key, when in times.items()}


def _card_value(value: Any) -> Any:
    """Return a card's value in ASCII and without names of machines, infinity as text."""
    if isinstance(value, tuple):
        return _card_value(value[0]), value[1]
    if isinstance(value, float) and not np.isfinite(value):
        return "infinite"
    return anonymized(value).encode("ascii", "replace").decode() if isinstance(value, str) else value


def stokes_hdf5(measurement: Measurement, errors: PixelErrors, calibrations: Mapping[str, Path], out: Path) -> None:
    """Write the planes into an HDF5 file, with the names of NeXus (NXdata, NXdetector, NXoptical_polarizer)."""
    try:
        import h5py
    except ImportError as error:
        raise ConfigError("--to hdf5 needs h5py: pip install 'rigctl[export]'") from error
    facts, grid = _facts(measurement, errors, calibrations), measurement.grid

    def group(name: str, kind: str, **fields: tuple[Any, str]) -> Any:
        made = file.create_group(name)
        made.attrs["NX_class"] = kind
        for key, (value, unit) in fields.items():
            if value is not None:
                made[key] = value
                if unit:
                    made[key].attrs["units"] = unit
        return made

    with h5py.File(out, "x") as file:
        file.attrs["default"] = "entry"
        entry = group(
            "entry",
            "NXentry",
            title=(facts["RUNID"], ""),
            start_time=(facts.get("DATE-BEG"), ""),
            end_time=(facts.get("DATE-END"), ""),
        )
        entry.attrs["default"] = "stokes"
        group("entry/instrument", "NXinstrument")
        first, exposures = grid.frames[0], grid.exposures_s
        group(
            "entry/instrument/detector",
            "NXdetector",
            description=(first.camera_model, ""),
            count_time=(exposures, "s"),
            saturation_value=(first.saturation_dn, ""),
            bit_depth_readout=(first.bit_depth, ""),
        )
        group(
            "entry/instrument/polarizer",
            "NXoptical_polarizer",
            type=("linear", ""),
            polarizer_angle=(np.degrees(grid.polarizer_angles_rad), "deg"),
            extinction_ratio=(measurement.extinction_ratio, ""),
        )
        data = group("entry/stokes", "NXdata")
        data.attrs.update({"signal": "dolp", "axes": ["y", "x"]})
        for name, plane in planes_of(measurement, errors).items():
            data.create_dataset(name, data=plane.values, compression="gzip", shuffle=True)
            data[name].attrs.update({"units": plane.unit, "long_name": plane.meaning})
        for key, value in facts.items():
            entry.attrs[key] = value[0] if isinstance(value, tuple) else value


def stokes_zarr(measurement: Measurement, errors: PixelErrors, calibrations: Mapping[str, Path], out: Path) -> None:
    """Write the planes into a Zarr folder that xarray opens, the facts of the FITS header as attributes."""
    try:
        import zarr
    except ImportError as error:
        raise ConfigError("--to zarr needs zarr: pip install 'rigctl[export]'") from error
    group = zarr.open_group(str(out), mode="w-", zarr_format=2)
    for name, plane in planes_of(measurement, errors).items():
        about: dict[str, Any] = {
            "_ARRAY_DIMENSIONS": ["y", "x"],
            "units": plane.unit or "1",
            "long_name": plane.meaning,
        }
        group.create_array(name, data=plane.values, fill_value=None, attributes=about)
    facts = _facts(measurement, errors, calibrations)
    group.attrs.update({key: value[0] if isinstance(value, tuple) else value for key, value in facts.items()})
    zarr.consolidate_metadata(str(out))


def stokes_csv(
    measurement: Measurement, errors: PixelErrors, inside: Mapping[str, NDArray[np.bool_]], out: Path
) -> None:
    """Write a row for each pixel of each region, or of the picture: region, x, y and the planes."""
    planes = planes_of(measurement, errors)
    whole = {"": np.ones(measurement.frames.saturated.shape, dtype=np.bool_)}
    with out.open("w", encoding="ascii", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("region", "x", "y", *planes))
        for region, pixels in (inside or whole).items():
            rows, columns = np.nonzero(pixels)
            values = [plane.values[pixels].tolist() for plane in planes.values()]
            for x, y, *numbers in zip(columns.tolist(), rows.tolist(), *values, strict=True):
                writer.writerow((region, x, y, *(f"{one:.7g}" if np.isfinite(one) else "" for one in numbers)))
