"""Sources for the direction of camera and panels: parse compass, level, positions, panel outlines, the sun's pixel."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.pointing import pose
from calibration.pointing.pose import (
    Lens,
    PanelStand,
    PoseSource,
    SunSeen,
    panel_stands,
    plain_lens,
    positions,
    refraction_rad,
    way_between,
    wrapped_rad,
)
from calibration.results import CalibrationError
from rigctl.base.numbers import is_utc_text, utc_moment
from rigctl.calibrations.lens import read_lens_file
from rigctl.errors import ConfigError, DataError
from rigctl.files.place import SiteSection
from rigctl.files.regions import Region, load_regions
from rigctl.files.scene_file import load_scene
from rigctl.runs.folder import Run
from rigctl.scene.sun import SunPosition, sun_covariance_deg2, sun_position

FloatArray = NDArray[np.float64]

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_SIZE = re.compile(rf"(?P<name>[^=]+)=(?P<width>{_NUMBER})x(?P<height>{_NUMBER})")
_WITH_STD = re.compile(rf"(?P<values>.+?)\s*(?:\+-|\+/-|\u00b1)\s*(?P<std>{_NUMBER})")
_EAST_WEST = re.compile(rf"\s*(?P<size>{_NUMBER})\s*(?P<side>[EeWw])\s*")
# A clock that is off by half a minute moves the sun by an eighth of a degree.
_SUN_STD_DEG = 0.02
_CORNERS = 4
# Latitude and longitude [deg], height [m].
_PLACE_LIMITS = (90.0, 360.0, 9000.0)


def stated_sources(
    *, compass: str | None, declination: str | None, level: str | None, camera_at: str | None, target_at: str | None
) -> Iterator[PoseSource]:
    """Yield a source for each measured direction; the texts are the options of `rigctl calibrate pointing`."""
    if (compass is None) != (declination is None):
        raise ConfigError("--compass, --declination: give both; a compass shows magnetic north")
    if compass is not None and declination is not None:
        yield _compass(compass, declination)
    if level is not None:
        (elevation, roll), std = _numbers("--level", level, (90.0, 180.0))
        yield pose.level(*np.radians([elevation, roll, std]).tolist())
    if (camera_at is None) != (target_at is None):
        raise ConfigError("--camera-at, --target-at: give both")
    if camera_at is not None and target_at is not None:
        yield _positions(camera_at, target_at)


def _compass(reading_text: str, declination_text: str) -> PoseSource:
    (reading,), std = _numbers("--compass", reading_text, (360.0,))
    (declination,), declination_std = _numbers("--declination", _signed(declination_text), (180.0,))
    angles = np.radians([reading, std, declination, declination_std]).tolist()
    return pose.compass(angles[0], angles[1], declination_rad=angles[2], declination_std_rad=angles[3])


def _signed(text: str) -> str:
    """Convert a declination as maps print it, ``11.3 W +- 0.3``, to a signed one: east is positive."""
    found = _WITH_STD.fullmatch(text.strip())
    side = _EAST_WEST.fullmatch(found["values"]) if found else None
    if found is None or side is None:
        return text
    if side["size"].startswith(("-", "+")):
        raise ConfigError(f"--declination: is {text!r}; write a sign, east positive, or a letter E or W, not both")
    return f"{'-' if side['side'] in 'Ww' else ''}{side['size']} +- {found['std']}"


def _numbers(option: str, text: str, most: Sequence[float]) -> tuple[list[float], float]:
    """Parse the numbers of an option and their standard uncertainty, which is required; check their limits."""
    found, count = _WITH_STD.fullmatch(text.strip()), len(most)
    try:
        values = [float(word) for word in found["values"].split(",")] if found else []
        std = float(found["std"]) if found else 0.0
    except ValueError:
        values, std = [], 0.0
    if len(values) != count or not std > 0.0 or not np.isfinite([*values, std]).all():
        example = ",".join(["12.5", "0.3", "160"][:count])
        raise ConfigError(
            f"{option}: is {text!r}; write {count} number{'s' * (count > 1)} and an error: '{example} +- 1'"
        )
    for value, limit in zip(values, most, strict=True):
        if abs(value) > limit:
            raise ConfigError(f"{option}: is {text!r}; {value:g} is not between -{limit:g} and {limit:g}")
    return values, std


def pixel_of_sun(text: str, run: Run) -> FloatArray:
    """Parse the sun's pixel "X,Y" in the pictures of a run."""
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 2 or not np.isfinite(values).all():
        raise ConfigError(f"--sun: is {text!r}; write two numbers, X,Y: pixels right and down")
    point, (width, height) = np.array(values), _picture_size(run)
    if np.any(point < -0.5) or np.any(point > np.array([width, height]) - 0.5):
        raise ConfigError(f"--sun: {text} is outside of the pictures, which have {width} x {height} pixels")
    return point


def _picture_size(run: Run) -> tuple[int, int]:
    if not run.frames:
        raise DataError(f"{run.path}: has no frames, so the size of its pictures is not known")
    return run.frames[0].width, run.frames[0].height


def _positions(camera: str, target: str) -> PoseSource:
    here, std = _numbers("--camera-at", camera, _PLACE_LIMITS)
    there, there_std = _numbers("--target-at", target, _PLACE_LIMITS)
    between, error = way_between(here, there), float(np.hypot(std, there_std))
    if float(np.hypot(between[0], between[1])) < error:
        raise ConfigError(
            "--camera-at, --target-at: are closer to each other than their errors, so they give no direction"
        )
    return positions(between, np.full(3, error))


def lens_of(file: Path | None, focal_px: str | None, run: Run) -> Lens:
    """Return the lens by its file or its focal length."""
    width, height = _picture_size(run)
    if file is not None:
        found = read_lens_file(file)
        if (found.width, found.height) != (width, height):
            raise DataError(
                f"{file}: is for pictures of {found.width} x {found.height} pixels; those of the run have "
                f"{width} x {height}"
            )
        return found.lens()
    if focal_px is None:
        raise ConfigError("--lens: directions of pixels need a lens; give --lens FILE or --focal-px '1500 +- 20'")
    (focal,), std = _numbers("--focal-px", focal_px, (1e7,))
    if not focal > 0.0:
        raise ConfigError(f"--focal-px: is {focal:g}; must be above 0")
    return plain_lens(focal, std, width, height)


def panels_in_picture(
    panels: Sequence[str], outlines: Path | None, *, pixel_std: float, lens: Callable[[], Lens]
) -> dict[str, tuple[PanelStand, ...]]:
    """Return the possible orientations of each panel, from its outline and size."""
    if not panels:
        return {}
    if outlines is None:
        raise ConfigError("--panel: needs --outlines FILE, a scene or regions file with the four corners of each panel")
    regions = {region.name: region for region in _regions(outlines)}
    found: dict[str, tuple[PanelStand, ...]] = {}
    for text in panels:
        size = _SIZE.fullmatch(text)
        if size is None or min(float(size["width"]), float(size["height"])) <= 0.0:
            raise ConfigError(f"--panel: is {text!r}; write its name and sides in metres, white_panel=0.6x0.4")
        name, sides = size["name"], (float(size["width"]), float(size["height"]))
        if name in found:
            raise ConfigError(f"--panel: {name} is given twice")
        try:
            corners = _corners(outlines, regions, name)
            found[name] = panel_stands(corners, *sides, pixel_std, lens())
        except CalibrationError as error:
            raise CalibrationError(f"panel {name}: {error}") from error
    return found


def _regions(path: Path) -> Sequence[Region]:
    try:
        return load_regions(path)
    except ConfigError:
        return load_scene(path).regions


def _corners(path: Path, regions: Mapping[str, Region], name: str) -> FloatArray:
    if name not in regions:
        raise ConfigError(f"--panel: {path} has no region {name}; there are {', '.join(regions)}")
    polygon = regions[name].polygon
    if polygon is None or len(polygon) != _CORNERS:
        raise ConfigError(
            f"--panel: {name} in {path} must be a polygon of the panel's four corners, in order, width first"
        )
    return np.array(polygon, dtype=np.float64)


def seen_sun(run: Run, *, at_ns: int | None, camera_at: str | None) -> SunSeen:
    """Return the apparent direction of the sun at the run's site, at a given time or in the middle of the run.

    The uncertainty includes the motion of the sun during the run, unless a time is given, and the errors of the site.
    """
    site = _site(run, camera_at)
    first, last = _moments(run, at_ns)
    moment = first + (last - first) / 2
    ends = [sun_position(one, site.place) for one in (first, moment, last)]
    found, elevation = ends[1], 0.5 * np.pi - ends[1].zenith_rad
    if elevation < 0.0:
        raise DataError(f"{run.path}: the sun is below the horizon at {moment:%Y-%m-%dT%H:%M:%SZ}")
    variance = np.radians(_SUN_STD_DEG) ** 2 + _apart_rad(ends[0], ends[2]) ** 2 / 12.0 + _site_variance(site, moment)
    return SunSeen(
        azimuth_rad=found.azimuth_rad,
        elevation_rad=elevation + refraction_rad(elevation),
        std_rad=float(np.sqrt(variance)),
    )


def _apart_rad(one: SunPosition, other: SunPosition) -> float:
    """Return the angle between two positions of the sun in the sky."""
    turned = np.array([other.azimuth_rad - one.azimuth_rad])
    across = float(wrapped_rad(turned)[0]) * np.sin(0.5 * (one.zenith_rad + other.zenith_rad))
    return float(np.hypot(other.zenith_rad - one.zenith_rad, across))


def _site_variance(site: SiteSection, moment: datetime) -> float:
    """Return the largest variance of the sun's direction that the errors of the site cause [rad^2]."""
    across = np.diag([1.0, np.sin(sun_position(moment, site.place).zenith_rad)])
    covariance_deg2 = across @ sun_covariance_deg2(site, moment) @ across
    return float(np.radians(1.0) ** 2 * np.linalg.eigvalsh(covariance_deg2)[-1])


def _site(run: Run, camera_at: str | None) -> SiteSection:
    """Return the site of the run, of its frames, or of --camera-at."""
    if run.session.site is not None:
        return run.session.site
    first = run.frames[0] if run.frames else None
    if first is not None and first.site_latitude_deg is not None:
        return SiteSection(
            latitude_deg=first.site_latitude_deg or 0.0,
            longitude_deg=first.site_longitude_deg or 0.0,
            elevation_m=first.site_elevation_m or 0.0,
        )
    if camera_at is not None:
        (latitude, longitude, height), _ = _numbers("--camera-at", camera_at, _PLACE_LIMITS)
        east = (longitude + 180.0) % 360.0 - 180.0
        return SiteSection(latitude_deg=latitude, longitude_deg=east, elevation_m=height)
    raise DataError(
        f"{run.path}: has no site, which the sun's direction depends on; give [site] in the rig file, or --camera-at"
    )


def _moments(run: Run, at_ns: int | None) -> tuple[datetime, datetime]:
    """Return the earliest and the latest time of the picture."""
    if at_ns is not None:
        at = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=at_ns // 1000)
        return at, at
    times = [utc_moment(one.start_utc) for one in run.frames if one.start_utc and is_utc_text(one.start_utc)]
    if not times:
        raise DataError(f"{run.path}: its frames have no time; give --at TIME")
    return min(times), max(times)
